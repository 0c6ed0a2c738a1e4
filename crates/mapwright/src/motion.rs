//! Prediction: where the robot should be before its scan is looked at.

use crate::settings::MotionSettings;
use mapwright_geom::{Pose2, Stamp};
use mapwright_sensor::MotionModel;

/// The motion since the last scan, with standard deviations of its right-perturbation tangent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Step {
    pub(crate) last_from_robot: Pose2,
    /// Variances of x, y and heading.
    pub(crate) variances: [f64; 3],
    pub(crate) from_odometry: bool,
}

/// Longest time over which a velocity is carried on, seconds.
const LONGEST_CARRY_S: f64 = 0.5;
/// Motion between two scans that no ground robot makes; odometry that claims more is not believed, metres.
const FARTHEST_STEP_M: f64 = 10.0;

/// What the predictor remembers.
#[derive(Debug, Clone, Default)]
pub(crate) struct Predictor {
    odom_from_robot: Option<Pose2>,
    stamp: Option<Stamp>,
    velocity: Option<[f64; 3]>,
}

impl Predictor {
    /// The motion from the last scan to this one.
    pub(crate) fn step(&self, settings: &MotionSettings, stamp: Stamp, odom_from_robot: Option<Pose2>) -> Step {
        let elapsed_s = self.stamp.map_or(0.0, |last| stamp.secs_since(last));
        // Stamps may stand still or run backwards: then the time is not known and counts as one usual period.
        let elapsed_s = if elapsed_s > 0.0 { elapsed_s } else { 0.1 };
        let increment = match (settings.use_odometry, self.odom_from_robot, odom_from_robot) {
            (true, Some(last), Some(now)) => Some(last.between(now)).filter(|step| believable(*step)),
            _ => None,
        };
        match increment {
            Some(last_from_robot) => Step {
                last_from_robot,
                variances: odometry_variances(settings, last_from_robot, elapsed_s),
                from_odometry: true,
            },
            None => self.constant_velocity(settings, elapsed_s),
        }
    }

    fn constant_velocity(&self, settings: &MotionSettings, elapsed_s: f64) -> Step {
        let carry_s = elapsed_s.min(LONGEST_CARRY_S);
        let twist = self.velocity.map_or([0.0; 3], |rates| rates.map(|rate| rate * carry_s));
        // What a robot can change within the time: 1 m/s^2 and 2 rad/s^2 would be hard driving indoors.
        let (translation, rotation) = (0.5 * elapsed_s.min(2.0), 1.0 * elapsed_s.min(3.0));
        let variance_t = settings.translation_floor_m.powi(2) + translation * translation * 0.25;
        let variance_r = settings.rotation_floor_rad.powi(2) + rotation * rotation;
        Step {
            last_from_robot: Pose2::exp(twist),
            variances: [variance_t, variance_t, variance_r],
            from_odometry: false,
        }
    }

    /// The robot's twist per second while it makes `step`.
    pub(crate) fn twist(&self, stamp: Stamp, step: Step) -> [f64; 3] {
        let elapsed_s = self.stamp.map_or(0.0, |last| stamp.secs_since(last));
        if elapsed_s > 1e-3 && elapsed_s < 1.0 { step.last_from_robot.log().map(|d| d / elapsed_s) } else { [0.0; 3] }
    }

    /// Remembers a scan and where the robot turned out to have moved.
    pub(crate) fn settle(
        &mut self,
        stamp: Stamp,
        odom_from_robot: Option<Pose2>,
        last_from_robot: Pose2,
        trusted: bool,
    ) {
        let elapsed_s = self.stamp.map_or(0.0, |last| stamp.secs_since(last));
        if trusted && elapsed_s > 1e-3 && elapsed_s < 1.0 {
            self.velocity = Some(last_from_robot.log().map(|d| d / elapsed_s));
        } else if !trusted || elapsed_s >= 1.0 {
            self.velocity = None;
        }
        self.stamp = Some(stamp);
        if odom_from_robot.is_some() {
            self.odom_from_robot = odom_from_robot;
        }
    }
}

fn believable(step: Pose2) -> bool {
    step.is_finite() && step.x.hypot(step.y) <= FARTHEST_STEP_M
}

/// Variances of an odometry step.
fn odometry_variances(settings: &MotionSettings, step: Pose2, elapsed_s: f64) -> [f64; 3] {
    let model = MotionModel {
        alpha1: settings.alpha1,
        alpha2: settings.alpha2,
        alpha3: settings.alpha3,
        alpha4: settings.alpha4,
    };
    let spread = model.spread(step);
    let floor_t = settings.translation_floor_m.powi(2) + (settings.translation_per_second_m * elapsed_s).powi(2);
    let floor_r = settings.rotation_floor_rad.powi(2) + (settings.rotation_per_second_rad * elapsed_s).powi(2);
    let rotation = spread.rotation1 + spread.rotation2;
    let translation = spread.translation + floor_t;
    [translation, translation, rotation + floor_r]
}
