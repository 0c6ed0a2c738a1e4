//! Readings as they arrive from a log or a driver.

use crate::head::{RANGE_MAX_UNSAID_M, SWEEP_MOST_S};
use mapwright_geom::{Pose2, Stamp, stored, wrap_angle};
use std::sync::Arc;

/// Two lasers of one name look different ways from here on, radians: no mount is said, or measured, so wrongly.
const SAME_WAY_RAD: f64 = std::f64::consts::FRAC_PI_4;

/// How a planar laser looks at the world. Shared by all scans it takes.
#[derive(Debug, Clone, PartialEq)]
pub struct LaserModel {
    /// Name for reports, such as `FLASER` or a topic; it tells the lasers of a robot apart.
    pub name: String,
    /// Bearing of the first beam in the laser's frame, radians.
    pub angle_min_rad: f64,
    /// Step from one beam to the next, radians; negative for a laser that sweeps clockwise.
    pub angle_step_rad: f64,
    /// Readings below are not returns, metres.
    pub range_min_m: f64,
    /// Readings at or above are not returns (but show free space), metres.
    pub range_max_m: f64,
    /// Pose of the laser on the robot.
    pub robot_from_laser: Pose2,
    /// Whether the laser is mounted upside down: bearings then turn the other way seen from above.
    pub inverted: bool,
    /// Time from one beam to the next, seconds; zero where not known.
    pub beam_period_s: f64,
}

impl LaserModel {
    /// A laser in the robot's origin that looks over the half circle ahead with `beams` beams from -90 deg on, the last
    /// at +90 deg for an odd number of beams and one step before for an even number; reach 80 m.
    #[must_use]
    pub fn half_circle(name: &str, beams: usize) -> Self {
        let steps = if beams % 2 == 1 { beams - 1 } else { beams }.max(1);
        Self {
            name: name.to_owned(),
            angle_min_rad: -std::f64::consts::FRAC_PI_2,
            angle_step_rad: std::f64::consts::PI / steps as f64,
            range_min_m: 0.0,
            range_max_m: RANGE_MAX_UNSAID_M,
            robot_from_laser: Pose2::IDENTITY,
            inverted: false,
            beam_period_s: 0.0,
        }
    }

    /// Whether a laser like this can be mapped with.
    ///
    /// # Errors
    /// What is wrong, in words: numbers that are not finite, bearings beyond 100 rad, a place farther than 1 km from the
    /// robot, or a sweep of more than 10 s.
    pub fn check(&self, beams: usize) -> Result<(), &'static str> {
        let last_rad = self.angle_min_rad + self.angle_step_rad * beams as f64;
        let bearings = [self.angle_min_rad, last_rad, self.robot_from_laser.theta];
        if !bearings.iter().all(|angle| angle.abs() <= 100.0) {
            return Err("the laser's bearings are not finite or beyond 100 rad");
        }
        if !(self.robot_from_laser.x.abs() <= 1000.0 && self.robot_from_laser.y.abs() <= 1000.0) {
            return Err("the laser's place on the robot is not finite or farther than 1 km");
        }
        if self.range_min_m.is_nan() || self.range_max_m.is_nan() {
            return Err("the laser's range limits are not numbers");
        }
        let sweep_s = (self.beam_period_s * beams as f64).abs();
        if sweep_s.is_nan() || sweep_s > SWEEP_MOST_S {
            return Err("the laser's sweep is not finite or longer than 10 s");
        }
        Ok(())
    }

    /// Whether scans of both are one stream, of one laser: they have one name and look the same way, whatever else has changed; or
    /// they sit in one place and begin with the same bearing, as where a log has a laser's scans under two names.
    #[must_use]
    pub fn is_one_with(&self, other: &Self) -> bool {
        let place = |laser: &Self| (laser.robot_from_laser, laser.inverted, laser.angle_min_rad);
        let turned_rad = wrap_angle(self.robot_from_laser.theta - other.robot_from_laser.theta);
        (self.name == other.name && turned_rad.abs() <= SAME_WAY_RAD) || place(self) == place(other)
    }

    /// Bearing of a beam in the robot's frame, radians.
    #[must_use]
    pub fn bearing_in_robot(&self, beam: usize) -> f64 {
        let in_laser = self.angle_min_rad + beam as f64 * self.angle_step_rad;
        self.robot_from_laser.theta + if self.inverted { -in_laser } else { in_laser }
    }
}

/// One sweep of a planar laser.
#[derive(Debug, Clone, PartialEq)]
pub struct LaserScan {
    /// When the first beam was taken.
    pub stamp: Stamp,
    /// The laser that took it.
    pub laser: Arc<LaserModel>,
    /// Raw ranges in metres, one a beam, as delivered: NaN, infinite and out-of-range values included.
    pub ranges_m: Vec<f32>,
    /// Odometry's pose of the robot at the stamp, where the log has it.
    pub odom_from_robot: Option<Pose2>,
}

stored!(LaserModel {
    name,
    angle_min_rad,
    angle_step_rad,
    range_min_m,
    range_max_m,
    robot_from_laser,
    inverted,
    beam_period_s
});

/// A reading of the wheels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Odometry {
    /// When it was taken.
    pub stamp: Stamp,
    /// Pose of the robot in the frame odometry started in; drifts without bound.
    pub odom_from_robot: Pose2,
}

stored!(Odometry { stamp, odom_from_robot });

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lasers_are_told_apart_by_name_and_mount() {
        let front = LaserModel::half_circle("front", 181);
        let mounted = |laser: &LaserModel, x: f64, theta: f64| LaserModel {
            robot_from_laser: Pose2::new(x, 0.0, theta),
            ..laser.clone()
        };
        let rear = mounted(&LaserModel::half_circle("rear", 181), -0.3, 3.1);
        assert!(!front.is_one_with(&rear) && !rear.is_one_with(&front));
        assert!(front.is_one_with(&LaserModel::half_circle("front", 90)), "fewer beams");
        assert!(front.is_one_with(&LaserModel::half_circle("ROBOTLASER1", 181)), "one laser under two names");
        assert!(front.is_one_with(&mounted(&front, 0.1, 0.2)), "a mount that is put right");
        assert!(!front.is_one_with(&mounted(&front, -0.3, 3.1)), "two of one name look different ways");
        assert!(front.is_one_with(&mounted(&front, 0.0, std::f64::consts::TAU - 0.1)));
    }
}
