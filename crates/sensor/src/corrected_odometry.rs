//! Odometry with what is known to be wrong with it taken out.

use mapwright_geom::{Pose, Pose2, Pose3, Stamp};
use nalgebra::{UnitQuaternion, Vector3};

/// What is known to be wrong with odometry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OdometryCalibration {
    /// True distance per reported distance.
    pub translation_scale: f64,
    /// True turn per reported turn.
    pub rotation_scale: f64,
    /// True turn per metre driven that is not reported, radians per metre.
    pub drift_rad_per_m: f64,
    /// Time by which it lags behind the laser, seconds.
    pub lag_s: f64,
}

impl OdometryCalibration {
    /// One that lags, and is right otherwise.
    #[must_use]
    pub fn of_lag(lag_s: f64) -> Self {
        Self { translation_scale: 1.0, rotation_scale: 1.0, drift_rad_per_m: 0.0, lag_s }
    }
}

/// A pose of which a step can be corrected: of the plane, or of space.
pub trait OdometryStep: Pose {
    /// The step as it should be.
    #[must_use]
    fn corrected(self, calibration: &OdometryCalibration) -> Self;
}

/// How the heading drifts over a step, radians: with its way, backwards the other way.
fn drift_rad(calibration: &OdometryCalibration, ahead_m: f64, way_m: f64) -> f64 {
    calibration.drift_rad_per_m * if ahead_m < 0.0 { -way_m } else { way_m }
}

impl OdometryStep for Pose2 {
    fn corrected(self, calibration: &OdometryCalibration) -> Self {
        let OdometryCalibration { translation_scale, rotation_scale, .. } = *calibration;
        let turn_rad = rotation_scale * self.theta + drift_rad(calibration, self.x, self.x.hypot(self.y));
        Self::new(translation_scale * self.x, translation_scale * self.y, turn_rad)
    }
}

impl OdometryStep for Pose3 {
    /// About the axis that is up on the robot; roll and pitch are what something else has measured.
    fn corrected(self, calibration: &OdometryCalibration) -> Self {
        let OdometryCalibration { translation_scale, rotation_scale, .. } = *calibration;
        let drift_rad = drift_rad(calibration, self.translation.x, self.translation.norm());
        let turn = self.rotation.scaled_axis();
        let turn = Vector3::new(turn.x, turn.y, rotation_scale * turn.z + drift_rad);
        Self { rotation: UnitQuaternion::from_scaled_axis(turn), translation: self.translation * translation_scale }
    }
}

/// Puts odometry together anew, step by step.
#[derive(Debug, Clone)]
pub struct CorrectedOdometry<P = Pose2> {
    calibration: OdometryCalibration,
    /// The last pose as said, and as it should be.
    last: Option<[P; 2]>,
}

impl<P: OdometryStep> CorrectedOdometry<P> {
    /// With what is known to be wrong.
    #[must_use]
    pub fn new(calibration: OdometryCalibration) -> Self {
        Self { calibration, last: None }
    }

    /// When a reading with this stamp was true.
    #[must_use]
    pub fn stamp(&self, stamp: Stamp) -> Stamp {
        Stamp(stamp.0.saturating_sub(Stamp::from_secs_f64(self.calibration.lag_s).0))
    }

    /// The pose as it should be.
    pub fn pose(&mut self, said: P) -> P {
        let corrected =
            self.last.map_or(said, |[before, corrected]| corrected * before.between(said).corrected(&self.calibration));
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
        let mut corrected = CorrectedOdometry::new(calibration);
        let (mut said, mut truth) = (Pose2::new(3.0, 1.0, 0.5), Pose2::new(3.0, 1.0, 0.5));
        for k in 0..200_i64 {
            let (turn, ahead_m) = (0.05 * (k as f64 * 0.1).sin(), 0.1);
            assert!(corrected.pose(said).distance(truth) < 1e-9);
            said = said * Pose2::new(ahead_m, 0.0, turn);
            truth = truth * Pose2::new(1.02 * ahead_m, 0.0, 0.97 * turn + 0.01 * ahead_m);
        }
        assert_eq!(corrected.stamp(Stamp(500_000_000)), Stamp(400_000_000));
    }

    #[test]
    fn in_space_roll_and_pitch_stay_as_they_are() {
        let calibration =
            OdometryCalibration { translation_scale: 1.1, rotation_scale: 0.9, drift_rad_per_m: 0.0, lag_s: 0.0 };
        let step = Pose3::exp([0.5, 0.1, 0.2, 0.03, -0.02, 0.4].into());
        let turn = step.corrected(&calibration).rotation.scaled_axis();
        assert!((turn - Vector3::new(0.03, -0.02, 0.36)).norm() < 1e-9, "{turn}");
        let mut corrected = CorrectedOdometry::new(calibration);
        corrected.pose(Pose3::identity());
        assert!((corrected.pose(step).translation - step.translation * 1.1).norm() < 1e-12);
    }
}
