//! Relative pose error.

use crate::associate::{MAX_STAMP_DIFFERENCE_S, PosePair, StampedPose, associate, finite_pairs};
use crate::error::EvalError;
use crate::stats::{ErrorStats, PoseErrors};
use mapwright_geom::Pose;

/// How far apart the two poses of a pair are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Delta {
    /// Matched poses (`evo_rpe --delta_unit f`).
    Frames(usize),
    /// Metres along the path (`evo_rpe --delta_unit m`).
    Metres(f64),
}

/// Which pairs are compared; the default is evo's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RpeSettings {
    /// How far apart the two poses of a pair are.
    pub delta: Delta,
    /// A pair from every pose, instead of each pair beginning where the last one ended.
    pub all_pairs: bool,
    /// With `all_pairs` and metres: how far a pair's distance may be off, as a share of it.
    pub relative_tolerance: f64,
    /// Metres are measured along the reference's path instead of the estimate's.
    pub pairs_from_reference: bool,
}

impl Default for RpeSettings {
    fn default() -> Self {
        Self { delta: Delta::Frames(1), all_pairs: false, relative_tolerance: 0.1, pairs_from_reference: false }
    }
}

/// Relative pose error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rpe {
    /// Length of the translation error of each pair, metres.
    pub translation_m: ErrorStats,
    /// Absolute heading error of each pair, degrees.
    pub rotation_deg: ErrorStats,
    /// Poses left out because of NaN or infinity.
    pub not_finite: usize,
}

/// Relative pose error of an estimate: stamps paired by [`associate`] within [`MAX_STAMP_DIFFERENCE_S`], then
/// `(world_from_i^-1 world_from_j)^-1 (map_from_i^-1 map_from_j)` for poses i and j that are `delta` apart (Sturm et
/// al. 2012). `evo_rpe tum reference estimate` computes the same for planar trajectories.
///
/// # Errors
/// When no stamps match, no pose is finite, the step is not positive or the trajectory has no such pair.
pub fn rpe(reference: &[StampedPose], estimate: &[StampedPose], settings: &RpeSettings) -> Result<Rpe, EvalError> {
    rpe_of_pairs(&associate(reference, estimate, MAX_STAMP_DIFFERENCE_S)?, settings)
}

/// [`rpe`] of poses that are paired already.
///
/// # Errors
/// When no pose is finite, the step is not positive or the trajectory has no such pair.
pub fn rpe_of_pairs(pairs: &[PosePair], settings: &RpeSettings) -> Result<Rpe, EvalError> {
    let (poses, not_finite) = finite_pairs(pairs)?;
    let measured = |p: &PosePair| {
        if settings.pairs_from_reference { p.world_from_robot } else { p.map_from_robot }
    };
    let steps = steps_along(&poses.iter().map(measured).collect::<Vec<_>>(), settings)?;
    let errors: Vec<_> = steps.iter().map(|&(i, j)| step_error(&poses[i], &poses[j])).collect();
    let errors = PoseErrors::of(&errors).ok_or_else(|| no_pairs(settings, poses.len()))?;
    let PoseErrors { translation_m, rotation_deg } = errors;
    Ok(Rpe { translation_m, rotation_deg, not_finite })
}

/// The first and last pose of each step that is compared, along a path in the plane or in space.
pub(crate) fn steps_along<P: Pose>(path: &[P], settings: &RpeSettings) -> Result<Vec<(usize, usize)>, EvalError> {
    match settings.delta {
        Delta::Frames(frames) => steps_by_frames(path.len(), frames, settings.all_pairs),
        Delta::Metres(metres) => steps_by_metres(path, metres, settings),
    }
}

pub(crate) fn no_pairs(settings: &RpeSettings, poses: usize) -> EvalError {
    let delta = match settings.delta {
        Delta::Frames(frames) => format!("{frames} frames"),
        Delta::Metres(metres) => format!("{metres} m"),
    };
    EvalError::NoPairs { delta, poses }
}

pub(crate) fn step_error(i: &PosePair, j: &PosePair) -> (f64, f64) {
    let true_i_from_j = i.world_from_robot.between(j.world_from_robot);
    let estimated_i_from_j = i.map_from_robot.between(j.map_from_robot);
    let error = true_i_from_j.between(estimated_i_from_j);
    (error.x.hypot(error.y), error.theta.abs().to_degrees())
}

fn steps_by_frames(poses: usize, frames: usize, all_pairs: bool) -> Result<Vec<(usize, usize)>, EvalError> {
    if frames == 0 {
        return Err(EvalError::BadDelta { delta: 0.0 });
    }
    let stride = if all_pairs { 1 } else { frames };
    Ok((0..poses.saturating_sub(frames)).step_by(stride).map(|i| (i, i + frames)).collect())
}

fn steps_by_metres<P: Pose>(path: &[P], metres: f64, settings: &RpeSettings) -> Result<Vec<(usize, usize)>, EvalError> {
    if !(metres > 0.0 && metres.is_finite()) {
        return Err(EvalError::BadDelta { delta: metres });
    }
    Ok(if settings.all_pairs {
        steps_from_every_pose(path, metres, settings.relative_tolerance * metres)
    } else {
        steps_end_to_end(path, metres)
    })
}

/// Each step begins where the last one ended, and ends at the first pose `metres` or more along the path.
fn steps_end_to_end<P: Pose>(path: &[P], metres: f64) -> Vec<(usize, usize)> {
    let mut steps = Vec::new();
    let (mut start, mut travelled_m) = (0, 0.0);
    for k in 1..path.len() {
        travelled_m += path[k].distance(path[k - 1]);
        if travelled_m >= metres {
            steps.push((start, k));
            (start, travelled_m) = (k, 0.0);
        }
    }
    steps
}

/// From every pose to the first of those whose distance along the path is nearest to `metres`, if within `tolerance_m`.
fn steps_from_every_pose<P: Pose>(path: &[P], metres: f64, tolerance_m: f64) -> Vec<(usize, usize)> {
    let mut travelled_m = vec![0.0; path.len()];
    for k in 1..path.len() {
        travelled_m[k] = travelled_m[k - 1] + path[k].distance(path[k - 1]);
    }
    let mut steps = Vec::new();
    for i in 0..path.len().saturating_sub(1) {
        let later = &travelled_m[i + 1..];
        let off_m = |k: usize| (later[k] - travelled_m[i] - metres).abs();
        let beyond = later.partition_point(|m| m - travelled_m[i] < metres);
        let nearest_m = off_m(beyond.min(later.len() - 1)).min(off_m(beyond.saturating_sub(1)));
        // distances fall up to `beyond`, so the first pose this near is found by bisection
        let first = later[..beyond].partition_point(|m| (m - travelled_m[i] - metres).abs() > nearest_m);
        if nearest_m <= tolerance_m {
            steps.push((i, i + 1 + first));
        }
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_geom::Pose2;
    use proptest::prelude::*;

    fn along(steps_m: &[f64]) -> Vec<Pose2> {
        let mut x = 0.0;
        let ahead = steps_m.iter().map(|s| {
            x += s;
            Pose2::new(x, 0.0, 0.0)
        });
        std::iter::once(Pose2::IDENTITY).chain(ahead).collect()
    }

    #[test]
    fn frames_are_counted_with_and_without_overlap() {
        assert_eq!(steps_by_frames(7, 3, false).unwrap(), [(0, 3), (3, 6)]);
        assert_eq!(steps_by_frames(5, 3, true).unwrap(), [(0, 3), (1, 4)]);
        assert_eq!(steps_by_frames(3, 3, true).unwrap(), []);
        assert!(steps_by_frames(3, 0, true).is_err());
    }

    #[test]
    fn metres_are_measured_along_the_path() {
        let path = along(&[0.6, 0.6, 0.0, 0.6, 0.6]);
        assert_eq!(steps_end_to_end(&path, 1.0), [(0, 2), (2, 5)]);
        assert_eq!(steps_from_every_pose(&path, 1.2, 0.1), [(0, 2), (1, 4), (2, 5), (3, 5)]);
    }

    proptest! {
        #[test]
        fn bisection_finds_what_a_search_of_all_poses_finds(
            quarters in prop::collection::vec(0..5u8, 1..40), metres in 0.1..4.0f64, tolerance_m in 0.0..0.5f64,
        ) {
            let steps_m: Vec<_> = quarters.iter().map(|q| 0.25 * f64::from(*q)).collect();
            let path = along(&steps_m);
            let mut expected = Vec::new();
            for i in 0..path.len() - 1 {
                let off_m = |j: usize| (path[j].x - path[i].x - metres).abs();
                let nearest = (i + 1..path.len()).min_by(|a, b| off_m(*a).total_cmp(&off_m(*b))).unwrap();
                if off_m(nearest) <= tolerance_m {
                    expected.push((i, nearest));
                }
            }
            prop_assert_eq!(steps_from_every_pose(&path, metres, tolerance_m), expected);
        }
    }

    #[test]
    fn too_short_a_path_is_refused_in_words() {
        let pose = |x: f64| PosePair {
            stamp: mapwright_geom::Stamp(0),
            world_from_robot: Pose2::new(x, 0.0, 0.0),
            map_from_robot: Pose2::new(x, 0.0, 0.0),
        };
        let settings = RpeSettings { delta: Delta::Metres(5.0), ..RpeSettings::default() };
        let error = rpe_of_pairs(&[pose(0.0), pose(1.0)], &settings).unwrap_err();
        assert_eq!(error.to_string(), "expected pairs of poses 5 m apart, found none among 2 poses");
    }
}
