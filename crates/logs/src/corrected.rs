//! Odometry with what is known to be wrong with it taken out.

use crate::choice::OdometryCalibration;
use mapwright_geom::{Pose2, Stamp};

/// Puts odometry together anew, step by step.
#[derive(Debug, Clone)]
pub(crate) struct Corrected {
    calibration: OdometryCalibration,
    /// The last pose as said, and as it should be.
    last: Option<[Pose2; 2]>,
}

impl Corrected {
    pub(crate) fn new(calibration: OdometryCalibration) -> Self {
        Self { calibration, last: None }
    }

    /// When a reading with this stamp was true.
    pub(crate) fn stamp(&self, stamp: Stamp) -> Stamp {
        Stamp(stamp.0.saturating_sub(Stamp::from_secs_f64(self.calibration.lag_s).0))
    }

    /// The pose as it should be.
    pub(crate) fn pose(&mut self, said: Pose2) -> Pose2 {
        let OdometryCalibration { translation_scale, rotation_scale, drift_rad_per_m, .. } = self.calibration;
        let corrected = self.last.map_or(said, |[before, corrected]| {
            let step = before.between(said);
            let ahead = if step.x < 0.0 { -1.0 } else { 1.0 };
            let drift_rad = drift_rad_per_m * ahead * step.x.hypot(step.y);
            let turn_rad = rotation_scale * step.theta + drift_rad;
            corrected * Pose2::new(translation_scale * step.x, translation_scale * step.y, turn_rad)
        });
        self.last = Some([said, corrected]);
        corrected
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wrong_is_taken_out() {
        let calibration =
            OdometryCalibration { translation_scale: 1.02, rotation_scale: 0.97, drift_rad_per_m: 0.01, lag_s: 0.1 };
        let mut corrected = Corrected::new(calibration);
        let (mut said, mut truth) = (Pose2::new(3.0, 1.0, 0.5), Pose2::new(3.0, 1.0, 0.5));
        for k in 0..200_i64 {
            let (turn, ahead_m) = (0.05 * (k as f64 * 0.1).sin(), 0.1);
            assert!(corrected.pose(said).distance(truth) < 1e-9);
            said = said * Pose2::new(ahead_m, 0.0, turn);
            truth = truth * Pose2::new(1.02 * ahead_m, 0.0, 0.97 * turn + 0.01 * ahead_m);
        }
        assert_eq!(corrected.stamp(Stamp(500_000_000)), Stamp(400_000_000));
    }
}
