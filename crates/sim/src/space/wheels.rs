//! Where a robot in space believes to be by its wheels.

use super::turn::upright;
use crate::math::{between, rotate};
use crate::odometry::{OdometryNoise, Wheels};
use crate::rng::Rng;
use crate::robot::Arc2;
use mapwright_geom::{Pose2, Pose3};

/// Noise of odometry in space: that of the wheels in the plane of the robot, and what tilts it unnoticed.
#[derive(Debug, Clone, PartialEq)]
pub struct SpaceOdometryNoise {
    /// Noise of the wheels.
    pub wheels: OdometryNoise,
    /// Variance of pitch and of roll per metre driven, rad^2/m.
    pub tilt_variance_rad2_per_m: f64,
}

impl SpaceOdometryNoise {
    /// Perfect odometry.
    pub const NONE: Self = Self { wheels: OdometryNoise::NONE, tilt_variance_rad2_per_m: 0.0 };
}

impl Default for SpaceOdometryNoise {
    /// The default wheels; pitch and roll drift by 0.05 degrees a metre.
    fn default() -> Self {
        let tilt_sigma_rad = 0.05f64.to_radians();
        Self { wheels: OdometryNoise::default(), tilt_variance_rad2_per_m: tilt_sigma_rad * tilt_sigma_rad }
    }
}

/// Odometry: each true motion with the error that the wheels make on the same motion of the plane, and tilted a little.
pub(crate) struct Odometry {
    wheels: Wheels,
    tilt_variance_rad2_per_m: f64,
    rng: Rng,
    /// The last tick's true pose, the motion it begins with, seen from above, and odometry's pose.
    last: Option<(Pose3, Arc2, Pose3)>,
}

impl Odometry {
    pub(crate) fn new(noise: &SpaceOdometryNoise, seed: u64) -> Self {
        Self {
            wheels: Wheels::new(noise.wheels.clone(), seed),
            tilt_variance_rad2_per_m: noise.tilt_variance_rad2_per_m,
            rng: Rng::keyed(seed, 0x0074_696c_7473),
            last: None,
        }
    }

    /// Odometry's pose now, given what the robot is about to do.
    pub(crate) fn count(&mut self, world_from_robot: Pose3, about_to: Arc2) -> Pose3 {
        let odom_from_robot = match self.last {
            None => Pose3::default(),
            Some((before, planar, odom_from_before)) => {
                odom_from_before * before.between(world_from_robot) * self.error(planar)
            }
        };
        self.last = Some((world_from_robot, about_to, odom_from_robot));
        odom_from_robot
    }

    /// What the wheels get wrong of a motion, seen from where it ends.
    fn error(&mut self, planar: Arc2) -> Pose3 {
        let before = self.wheels.odom_from_robot();
        self.wheels.count(planar);
        let reported = between(before, self.wheels.odom_from_robot());
        let [x, y] = rotate([planar.distance_m, 0.0], 0.5 * planar.turn_rad);
        let wrong = between(Pose2::new(x, y, planar.turn_rad), reported);
        let tilt_sigma_rad = (self.tilt_variance_rad2_per_m * planar.distance_m.abs()).sqrt();
        let [pitch_rad, roll_rad] = [self.rng.normal(tilt_sigma_rad), self.rng.normal(tilt_sigma_rad)];
        upright([wrong.x, wrong.y, 0.0], wrong.theta, pitch_rad, roll_rad)
    }
}
