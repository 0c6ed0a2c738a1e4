//! Errors of trajectories in space, as evo computes them, and those of KITTI's benchmark.

use crate::associate::{MAX_STAMP_DIFFERENCE_S, paired_stamps};
use crate::ate::Alignment;
use crate::error::EvalError;
use crate::rpe::{RpeSettings, no_pairs, steps_along};
use crate::series::{ErrorAt, ErrorSeries};
use crate::stats::PoseErrors;
use mapwright_geom::{Cov6, Pose3, Stamp};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Lengths of KITTI's segments, metres, and from every which pose on they are measured (Geiger et al. 2012, the benchmark's
/// `evaluate_odometry.cpp`).
const SEGMENTS_M: [f64; 8] = [100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0];
const SEGMENT_STEP: usize = 10;

/// Errors of an estimate.
#[derive(Debug, Clone, PartialEq)]
pub struct SpaceErrors {
    /// Pairs that were compared,
    pub pairs: usize,
    /// and those left out because of NaN or infinity.
    pub not_finite: usize,
    /// What the estimate's positions are multiplied with before they are moved,
    pub scale: f64,
    /// and the motion that aligns it.
    pub world_from_map: Pose3,
    /// Of each aligned pose: distance from the reference's and the angle between both.
    pub absolute: PoseErrors,
    /// Of each step between paired poses: how far it ends from the reference's, and by how much it turns differently.
    pub relative: PoseErrors,
    /// Errors over long segments, where the way is long enough for one.
    pub segments: Option<SegmentErrors>,
}

/// KITTI's errors: over segments of 100, 200 to 800 m of the reference's way, each error divided by the segment's length.
#[derive(Debug, Clone, PartialEq)]
pub struct SegmentErrors {
    /// Over all segments.
    pub all: SegmentError,
    /// Over those of one length each.
    pub by_length: Vec<SegmentError>,
}

/// Means over segments.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SegmentError {
    /// How long they are, metres; the mean where they differ.
    pub length_m: f64,
    /// How many.
    pub count: usize,
    /// Where they end beside the reference's, percent of their length.
    pub translation_percent: f64,
    /// How much they turn otherwise, degrees in 100 m.
    pub rotation_deg_per_100_m: f64,
}

/// Compares an estimate with a reference: absolutely as `evo_ape tum reference estimate -a` does (without `-a` or with `-s` as the
/// alignment says; Umeyama 1991), and step by step as `evo_rpe` does. Poses are paired like those of the plane, see
/// [`associate`](fn@crate::associate).
///
/// # Errors
/// When no stamps match, no pose is finite, the poses all but lie on a line and so cannot be aligned, or there is no such step.
pub fn space_errors(
    reference: &[(Stamp, Pose3)],
    estimate: &[(Stamp, Pose3)],
    alignment: Alignment,
    steps: &RpeSettings,
) -> Result<SpaceErrors, EvalError> {
    let paired = Paired::of(reference, estimate)?;
    let (scale, world_from_map) = aligned(&paired.poses, alignment)?;
    let error = |[truth, pose]: &[Pose3; 2]| {
        let scaled = Pose3 { translation: scale * pose.translation, rotation: pose.rotation };
        size(truth.between(world_from_map * scaled))
    };
    let absolute: Vec<_> = paired.poses.iter().map(error).collect();
    let way = |k: usize| paired.poses.iter().map(|pair| pair[k]).collect::<Vec<_>>();
    let measured = way(usize::from(!steps.pairs_from_reference));
    let between = |(i, j): (usize, usize)| size(step_error(&paired.poses[i], &paired.poses[j]));
    let relative: Vec<_> = steps_along(&measured, steps)?.into_iter().map(between).collect();
    let pairs = paired.poses.len();
    Ok(SpaceErrors {
        pairs,
        not_finite: paired.not_finite,
        scale,
        world_from_map,
        absolute: PoseErrors::of(&absolute).ok_or(EvalError::NothingFinite { pairs })?,
        relative: PoseErrors::of(&relative).ok_or_else(|| no_pairs(steps, pairs))?,
        segments: segment_errors(&paired.poses),
    })
}

/// The errors of [`space_errors`] pose by pose and step by step, to be drawn over time.
///
/// # Errors
/// When no stamps match, no pose is finite, or the poses all but lie on a line and so cannot be aligned.
pub fn space_error_series(
    reference: &[(Stamp, Pose3)],
    estimate: &[(Stamp, Pose3)],
    alignment: Alignment,
    steps: &RpeSettings,
) -> Result<ErrorSeries, EvalError> {
    let paired = Paired::of(reference, estimate)?;
    let (scale, world_from_map) = aligned(&paired.poses, alignment)?;
    let at = |k: usize, error: Pose3| ErrorAt::of(paired.stamps[k], size(error));
    let absolute = |(k, [truth, pose]): (usize, &[Pose3; 2])| {
        let scaled = Pose3 { translation: scale * pose.translation, rotation: pose.rotation };
        at(k, truth.between(world_from_map * scaled))
    };
    let measured: Vec<Pose3> = paired.poses.iter().map(|pair| pair[usize::from(!steps.pairs_from_reference)]).collect();
    let relative = |(i, j): (usize, usize)| at(j, step_error(&paired.poses[i], &paired.poses[j]));
    Ok(ErrorSeries {
        absolute: paired.poses.iter().enumerate().map(absolute).collect(),
        relative: steps_along(&measured, steps)?.into_iter().map(relative).collect(),
    })
}

/// `e^T P^-1 e` of a pose in space and the covariance of its right perturbation (m^2, m rad, rad^2), the normalised estimation error
/// squared as of [`Nees`](crate::Nees): 6 on average where covariances are honest. None where something is not finite or the
/// covariance not positive definite.
#[must_use]
pub fn space_nees(world_from_robot: Pose3, estimated_world_from_robot: Pose3, covariance: &Cov6) -> Option<f64> {
    let error = estimated_world_from_robot.between(world_from_robot).log();
    let factor = covariance.cholesky()?.unpack();
    let sample = factor.solve_lower_triangular(&error)?.norm_squared();
    sample.is_finite().then_some(sample)
}

/// Poses of the reference and of the estimate that belong together.
struct Paired {
    /// The reference's.
    stamps: Vec<Stamp>,
    poses: Vec<[Pose3; 2]>,
    not_finite: usize,
}

impl Paired {
    fn of(reference: &[(Stamp, Pose3)], estimate: &[(Stamp, Pose3)]) -> Result<Self, EvalError> {
        let stamps = |poses: &[(Stamp, Pose3)]| poses.iter().map(|(stamp, _)| *stamp).collect::<Vec<_>>();
        let paired = paired_stamps(&stamps(reference), &stamps(estimate), MAX_STAMP_DIFFERENCE_S)?;
        let pair = |&[i, j]: &[usize; 2]| (reference[i].0, [reference[i].1, estimate[j].1]);
        let is_finite = |(_, pair): &(Stamp, [Pose3; 2])| pair.iter().all(|pose| pose.is_finite());
        let (stamps, poses): (Vec<_>, Vec<_>) = paired.iter().map(pair).filter(is_finite).unzip();
        if poses.is_empty() {
            return Err(EvalError::NothingFinite { pairs: paired.len() });
        }
        Ok(Self { not_finite: paired.len() - poses.len(), stamps, poses })
    }
}

/// The error of the step from one pair of poses to another.
fn step_error(from: &[Pose3; 2], to: &[Pose3; 2]) -> Pose3 {
    from[0].between(to[0]).between(from[1].between(to[1]))
}

/// Metres and degrees.
fn size(error: Pose3) -> (f64, f64) {
    (error.translation.norm(), error.rotation.angle().to_degrees())
}

/// Scale and motion that minimise the summed squared distances of the positions (Umeyama 1991, eqs. 34 to 43).
fn aligned(pairs: &[[Pose3; 2]], alignment: Alignment) -> Result<(f64, Pose3), EvalError> {
    if alignment == Alignment::None {
        return Ok((1.0, Pose3::identity()));
    }
    let share = 1.0 / pairs.len() as f64;
    let mean = |k: usize| pairs.iter().map(|pair| pair[k].translation).sum::<Vector3<f64>>() * share;
    let (truth, map) = (mean(0), mean(1));
    let product = |[a, b]: &[Pose3; 2]| (a.translation - truth) * (b.translation - map).transpose();
    let covariance: Matrix3<f64> = pairs.iter().map(product).sum::<Matrix3<f64>>() * share;
    let not_alignable = || EvalError::NotAlignable { pairs: pairs.len() };
    let svd = covariance.try_svd(true, true, f64::EPSILON, 1000).ok_or_else(not_alignable)?;
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Err(not_alignable()) };
    // As evo has it: poses on a line, or on one spot, can be turned about it at will.
    if svd.singular_values.iter().filter(|&&d| d > f64::EPSILON).count() < 2 {
        return Err(not_alignable());
    }
    let sign = if (u * v_t).determinant() < 0.0 { -1.0 } else { 1.0 };
    // The singular values fall, so that the last axis is the one to be mirrored.
    let mirror = Vector3::new(1.0, 1.0, sign);
    let rotation = u * Matrix3::from_diagonal(&mirror) * v_t;
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    let spread = pairs.iter().map(|pair| (pair[1].translation - map).norm_squared()).sum::<f64>() * share;
    let scale = if alignment == Alignment::Similarity { svd.singular_values.dot(&mirror) / spread } else { 1.0 };
    Ok((scale, Pose3 { translation: truth - scale * (rotation * map), rotation }))
}

/// Errors over segments of the reference's way; none where it is shorter than the shortest.
fn segment_errors(pairs: &[[Pose3; 2]]) -> Option<SegmentErrors> {
    let mut travelled_m = vec![0.0; pairs.len()];
    for k in 1..pairs.len() {
        travelled_m[k] = travelled_m[k - 1] + pairs[k][0].distance(pairs[k - 1][0]);
    }
    let mut all = Vec::new();
    let mut by_length = Vec::new();
    for length_m in SEGMENTS_M {
        let of_length: Vec<_> = (0..pairs.len())
            .step_by(SEGMENT_STEP)
            .filter_map(|first| {
                let last = travelled_m.partition_point(|m| *m <= travelled_m[first] + length_m);
                let (metres, degrees) = size(step_error(&pairs[first], pairs.get(last)?));
                Some([length_m, metres / length_m, degrees / length_m])
            })
            .collect();
        by_length.extend(SegmentError::mean(&of_length));
        all.extend(of_length);
    }
    Some(SegmentErrors { all: SegmentError::mean(&all)?, by_length })
}

impl SegmentError {
    /// Of lengths, and of metres and degrees a metre.
    fn mean(errors: &[[f64; 3]]) -> Option<Self> {
        let count = errors.len();
        let mean = |k: usize| errors.iter().map(|error| error[k]).sum::<f64>() / count as f64;
        (count > 0).then(|| Self {
            length_m: mean(0),
            count,
            translation_percent: 100.0 * mean(1),
            rotation_deg_per_100_m: 100.0 * mean(2),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector6;

    fn curve(k: i64) -> (Stamp, Pose3) {
        let t = 0.1 * k as f64;
        (Stamp(k * 100_000_000), Pose3::exp(Vector6::new(t, t.sin(), 0.3 * t.cos(), 0.0, 0.1 * t, 0.2 * t)))
    }

    fn errors(truth: &[(Stamp, Pose3)], estimate: &[(Stamp, Pose3)]) -> Result<SpaceErrors, EvalError> {
        space_errors(truth, estimate, Alignment::Rigid, &RpeSettings::default())
    }

    #[test]
    fn a_moved_trajectory_is_aligned_and_an_error_is_found() {
        let truth: Vec<_> = (0..50).map(curve).collect();
        let moved = Pose3::exp(Vector6::new(3.0, -2.0, 1.0, 0.4, -0.2, 1.5));
        let mut estimate: Vec<_> = truth.iter().map(|&(stamp, pose)| (Stamp(stamp.0 + 1000), moved * pose)).collect();
        let found = errors(&truth, &estimate).unwrap();
        let (metres, degrees) = (found.absolute.translation_m.max, found.relative.rotation_deg.max);
        assert!(found.pairs == 50 && metres < 1e-9 && degrees < 1e-6, "{found:?}");
        assert_eq!(found.segments, None);
        estimate[20].1.translation.z += 0.1;
        estimate[30].1.translation.x = f64::NAN;
        let found = errors(&truth, &estimate).unwrap();
        let (absolute, relative) = (found.absolute.translation_m, found.relative.translation_m);
        assert!((absolute.max - 0.1).abs() < 0.01 && (relative.max - 0.1).abs() < 0.01, "{found:?}");
        assert_eq!((found.pairs, found.not_finite), (49, 1));
    }

    #[test]
    fn errors_are_measured_in_standard_deviations() {
        let truth = curve(7).1;
        let off = Pose3::exp(Vector6::new(0.1, -0.2, 0.0, 0.0, 0.03, 0.0));
        let mut covariance = Cov6::from_diagonal(&Vector6::new(0.01, 0.04, 0.01, 1e-4, 9e-4, 1e-4));
        let apart = space_nees(truth * off, truth, &covariance).unwrap();
        let log = off.log();
        let expected: f64 = (0..6).map(|k| log[k] * log[k] / covariance[(k, k)]).sum();
        assert!((apart - expected).abs() < 1e-9 && (2.9..3.1).contains(&apart), "{apart}");
        (covariance[(0, 1)], covariance[(1, 0)]) = (-0.018, -0.018);
        assert!(space_nees(truth * off, truth, &covariance).unwrap() < apart - 0.5);
        (covariance[(0, 1)], covariance[(1, 0)]) = (0.03, 0.03);
        assert_eq!(space_nees(truth * off, truth, &covariance), None);
        assert_eq!(space_nees(truth, truth, &Cov6::from_element(f64::NAN)), None);
    }

    #[test]
    fn what_cannot_be_aligned_is_refused() {
        let truth: Vec<_> = (0..50).map(curve).collect();
        let line: Vec<_> = (0..50)
            .map(|k| (curve(k).0, Pose3 { translation: Vector3::x() * k as f64, ..Pose3::identity() }))
            .collect();
        assert_eq!(errors(&line, &line).unwrap_err(), EvalError::NotAlignable { pairs: 50 });
        assert!(errors(&truth[..1], &truth).is_err());
        assert!(errors(&truth, &[]).is_err());
        assert!(space_errors(&line, &line, Alignment::None, &RpeSettings::default()).is_ok());
    }
}
