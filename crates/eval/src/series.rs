//! Errors pose by pose and step by step, to be drawn over time.

use crate::associate::{MAX_STAMP_DIFFERENCE_S, StampedPose, associate, finite_pairs};
use crate::ate::{Alignment, align, pose_error};
use crate::error::EvalError;
use crate::rpe::{RpeSettings, step_error, steps_along};
use mapwright_geom::{Pose2, Stamp};

/// The error of a pose, or of the step that ends there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorAt {
    /// The reference's stamp.
    pub stamp: Stamp,
    /// Metres.
    pub translation_m: f64,
    /// Degrees.
    pub rotation_deg: f64,
}

impl ErrorAt {
    /// Of metres and degrees.
    pub(crate) fn of(stamp: Stamp, (translation_m, rotation_deg): (f64, f64)) -> Self {
        Self { stamp, translation_m, rotation_deg }
    }
}

/// Errors in the order of the pairs.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ErrorSeries {
    /// Of each aligned pose, those that [`ate`](fn@crate::ate) takes together.
    pub absolute: Vec<ErrorAt>,
    /// Of each step, those that [`rpe`](fn@crate::rpe) takes together; none where the way is too short for one.
    pub relative: Vec<ErrorAt>,
}

/// The errors of [`ate`](fn@crate::ate) and [`rpe`](fn@crate::rpe), each with its stamp.
///
/// # Errors
/// When no stamps match, no pose is finite, one trajectory does not move and so cannot be aligned, or the step is not positive.
pub fn error_series(
    reference: &[StampedPose],
    estimate: &[StampedPose],
    alignment: Alignment,
    steps: &RpeSettings,
) -> Result<ErrorSeries, EvalError> {
    let (pairs, _) = finite_pairs(&associate(reference, estimate, MAX_STAMP_DIFFERENCE_S)?)?;
    let alignment = align(&pairs, alignment)?;
    let way: Vec<Pose2> = pairs
        .iter()
        .map(|pair| if steps.pairs_from_reference { pair.world_from_robot } else { pair.map_from_robot })
        .collect();
    let between = |(i, j): (usize, usize)| ErrorAt::of(pairs[j].stamp, step_error(&pairs[i], &pairs[j]));
    Ok(ErrorSeries {
        absolute: pairs.iter().map(|pair| ErrorAt::of(pair.stamp, pose_error(pair, &alignment))).collect(),
        relative: steps_along(&way, steps)?.into_iter().map(between).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Delta, ErrorStats, ate, rpe, space_error_series, space_errors};
    use mapwright_geom::{Pose as _, Pose3};

    fn way(off: f64) -> Vec<StampedPose> {
        let pose = |k: i64| {
            let s = k as f64;
            let world_from_robot = Pose2::new(0.3 * s + off * (s * 0.7).sin(), (0.2 * s).sin(), 0.05 * s + off * 0.1);
            StampedPose { stamp: Stamp(k * 100_000_000), world_from_robot }
        };
        (0..80).map(pose).collect()
    }

    fn metres(errors: &[ErrorAt]) -> ErrorStats {
        ErrorStats::of(&errors.iter().map(|error| error.translation_m).collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn the_series_add_up_to_the_errors() {
        let (reference, estimate) = (way(0.0), way(0.2));
        let steps = RpeSettings { delta: Delta::Metres(1.0), ..RpeSettings::default() };
        let series = error_series(&reference, &estimate, Alignment::Rigid, &steps).unwrap();
        assert_eq!(metres(&series.absolute), ate(&reference, &estimate, Alignment::Rigid).unwrap().translation_m);
        assert_eq!(metres(&series.relative), rpe(&reference, &estimate, &steps).unwrap().translation_m);
        assert!(series.absolute.iter().zip(&reference).all(|(error, pose)| error.stamp == pose.stamp));
    }

    #[test]
    fn so_do_those_of_space() {
        let in_space = |way: Vec<StampedPose>| -> Vec<(Stamp, Pose3)> {
            way.iter().map(|pose| (pose.stamp, pose.world_from_robot.in_space())).collect()
        };
        let (reference, estimate) = (in_space(way(0.0)), in_space(way(0.2)));
        let steps = RpeSettings { delta: Delta::Metres(1.0), ..RpeSettings::default() };
        let series = space_error_series(&reference, &estimate, Alignment::Rigid, &steps).unwrap();
        let errors = space_errors(&reference, &estimate, Alignment::Rigid, &steps).unwrap();
        assert_eq!(metres(&series.absolute), errors.absolute.translation_m);
        assert_eq!(metres(&series.relative), errors.relative.translation_m);
    }

    #[test]
    fn a_way_too_short_for_a_step_has_errors_of_poses_alone() {
        let steps = RpeSettings { delta: Delta::Metres(500.0), ..RpeSettings::default() };
        let series = error_series(&way(0.0), &way(0.1), Alignment::Rigid, &steps).unwrap();
        assert!(series.relative.is_empty() && series.absolute.len() == 80);
        assert!(error_series(&way(0.0), &[], Alignment::Rigid, &steps).is_err());
    }
}
