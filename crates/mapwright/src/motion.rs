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

/// From so many usual periods on, the time between two scans is a gap.
const GAP_PERIODS: f64 = 8.0;
/// How evenly a robot moves from scan to scan: metres, radians, and a share of the motion.
const STEADY_M: f64 = 0.05;
const STEADY_RAD: f64 = 0.1;
const STEADY_SHARE: f64 = 0.4;
/// Weight of the newest period in the running mean.
const PERIOD_WEIGHT: f64 = 0.02;
/// Motion between two scans that no ground robot makes; odometry that claims more is not believed, metres.
const FARTHEST_STEP_M: f64 = 10.0;

/// Over longer steps what lies behind is better known than what lies ahead, and a scan would be drawn back, metres.
const FAILING_STEP_AT_MOST_M: f64 = 0.5;

/// What the predictor remembers.
#[derive(Debug, Clone, Default)]
pub(crate) struct Predictor {
    odom_from_robot: Option<Pose2>,
    stamp: Option<Stamp>,
    /// The last motion from scan to scan.
    twist: Option<[f64; 3]>,
    /// Running mean of the time between scans.
    period_s: f64,
}

impl Predictor {
    /// Usual time between two scans, seconds.
    pub(crate) fn period_s(&self) -> f64 {
        self.period_s
    }

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

    /// The last motion once more. Scans come at an even rate even where their stamps come in bursts, so a motion is
    /// carried from scan to scan; only a gap of several periods adds uncertainty with its length.
    fn constant_velocity(&self, settings: &MotionSettings, elapsed_s: f64) -> Step {
        let gap_s = if elapsed_s > GAP_PERIODS * self.period_s { elapsed_s - self.period_s } else { 0.0 };
        let carried = self.twist.filter(|_| gap_s == 0.0).unwrap_or([0.0; 3]);
        let (translation, rotation) = (carried[0].hypot(carried[1]), carried[2].abs());
        let sigma_t = STEADY_M + STEADY_SHARE * translation + settings.translation_floor_m + 0.5 * gap_s.min(4.0);
        let sigma_r = STEADY_RAD + STEADY_SHARE * rotation + settings.rotation_floor_rad + 0.8 * gap_s.min(4.0);
        Step {
            last_from_robot: Pose2::exp(carried),
            variances: [sigma_t * sigma_t, sigma_t * sigma_t, sigma_r * sigma_r],
            from_odometry: false,
        }
    }

    /// What the robot did instead if the wheels fail: they spin while it stands, they count but do not tell forwards from
    /// backwards, or it went on as before. Nothing where `step` is not the wheels' or is long.
    pub(crate) fn failures(&self, step: Step) -> impl Iterator<Item = Pose2> + use<> {
        let said = step.last_from_robot;
        let stood = Pose2::new(0.0, 0.0, said.theta);
        let reversed = Pose2::new(-said.x, -said.y, said.theta);
        let possible = step.from_odometry && said.x.hypot(said.y) <= FAILING_STEP_AT_MOST_M;
        [Some(stood), Some(reversed), self.twist.map(Pose2::exp)].into_iter().flatten().filter(move |_| possible)
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
        self.twist = trusted.then(|| last_from_robot.log());
        if elapsed_s > 0.0 && elapsed_s < 2.0 {
            let weight = if self.period_s > 0.0 { PERIOD_WEIGHT } else { 1.0 };
            self.period_s += weight * (elapsed_s - self.period_s);
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
