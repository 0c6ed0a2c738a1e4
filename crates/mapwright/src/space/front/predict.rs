//! Step 2: where the robot should be before its cloud is looked at.

use super::wheels::Wheels;
use crate::settings::MotionSettings;
use mapwright_geom::{Cov6, Pose3, Stamp, Stored, is_in_place, stored};
use nalgebra::{Matrix3, UnitQuaternion, Vector3, Vector6};

/// How fast a robot, or a hand that holds a sensor, changes its speed: metres and radians per second squared.
const ACCELERATION_MPS2: f64 = 10.0;
const ACCELERATION_RADPS2: f64 = 20.0;
/// How fast it may be where nothing is known of that: metres and radians per second.
const SPEED_MPS: f64 = 20.0;
const SPEED_RADPS: f64 = 2.0;
/// No period, speed or square of one that is gone on with is larger, in seconds and metres.
const LARGEST: f64 = 1e6;
/// What a prediction is wrong by at least, metres and radians.
const LEAST_M: f64 = 0.005;
const LEAST_RAD: f64 = 0.005;
/// Between two clouds pass so many seconds at least and at most, as far as the prediction is concerned; stamps may be bad.
const PERIOD_S: [f64; 2] = [0.005, 5.0];
/// Where nothing is known of the time between two clouds, seconds.
const USUAL_PERIOD_S: f64 = 0.1;
/// The motion before is carried on if the time is not more than so many times longer.
const CARRIED_PERIODS: f64 = 4.0;
/// Weight of the newest in the running means of the time between two clouds and of the square of the speed.
const PERIOD_WEIGHT: f64 = 0.02;
const SPEED_WEIGHT: f64 = 0.05;
/// From the middle of its time to its end a motion changes by such a share of what it has changed by since the motion before; by
/// as much again it may be off.
const CHANGE_LEFT: f64 = 0.5;
/// During a sweep the twist is off by this share of that; where it were looser, a map of clouds that are bent would ask for bent ones.
const LEFT_OFF: f64 = 0.5;
/// And by so much at least, of what matches are wrong by from one to the next, metres and radians.
const LEAST_TWIST_M: f64 = 0.001;
const LEAST_TWIST_RAD: f64 = 0.001;

/// The motion since the last cloud, and the information of its right perturbation.
#[derive(Debug, Clone, Copy)]
pub struct Step {
    pub(super) last_from_robot: Pose3,
    pub(super) information: Cov6,
    pub(super) elapsed_s: f64,
    /// The cloud before is longer ago than is usual.
    pub(super) after_gap: bool,
    /// As long as so many steps that are no gaps.
    pub(super) steps: f64,
    pub(super) from_odometry: bool,
    /// The robot was looked for, and is where it was found: how it came there is not known.
    pub(super) is_looked_for: bool,
    /// Whether its rotation was read from an inertial sensor.
    pub(super) from_imu: bool,
    /// The rotation that was read from one that is not believed yet.
    pub(super) read: Option<UnitQuaternion<f64>>,
}

impl Step {
    /// The same with a rotation that was read, and its information; wheels keep their translation, and a velocity that is carried on its
    /// components along the robot's own axes.
    pub(super) fn turning(self, rotation: UnitQuaternion<f64>, information_of_rotation: &Matrix3<f64>) -> Self {
        let last_from_robot = if self.from_odometry {
            Pose3 { rotation, ..self.last_from_robot }
        } else {
            let (way, turn) = (self.last_from_robot.log(), rotation.scaled_axis());
            Pose3::exp(Vector6::new(way.x, way.y, way.z, turn.x, turn.y, turn.z))
        };
        let mut information = self.information;
        information.fixed_view_mut::<3, 3>(3, 3).copy_from(information_of_rotation);
        Self { last_from_robot, information, from_imu: true, ..self }
    }
}

impl Step {
    /// The same with a way by what has pushed the robot, in the frame that it was in, where that is surer than what is carried on.
    pub(super) fn pushed(self, way_m: Vector3<f64>, sigma_m: f64) -> Self {
        let information = 1.0 / (LEAST_M * LEAST_M + sigma_m * sigma_m);
        if self.from_odometry || information <= self.information[(0, 0)] {
            return self;
        }
        let mut step = self;
        step.last_from_robot.translation = way_m;
        (0..3).for_each(|axis| step.information[(axis, axis)] = information);
        step
    }
}

/// What the predictor remembers.
#[derive(Debug, Clone, Default)]
pub(super) struct Predictor {
    stamp: Option<Stamp>,
    wheels: Wheels,
    /// The last motion and the seconds that it took.
    last: Option<(Pose3, f64)>,
    /// How much the twist of that differs from the one before, metres and radians per second.
    change_per_s: Option<[f64; 6]>,
    /// Running mean of the time between two clouds, seconds, and of the square of how fast the robot moves, metres a second.
    period_s: f64,
    speed2: f64,
    /// The last cloud of which it was known how the robot had moved.
    known: Option<Stamp>,
}
stored!(Predictor { stamp, wheels, last, change_per_s, period_s, speed2, known });

impl Predictor {
    /// Goes on as it was.
    pub(super) fn restore(from: &mut &[u8]) -> Option<Self> {
        let predictor = Self::take(from)?;
        let is_sound = [predictor.period_s, predictor.speed2].iter().all(|number| (0.0..=LARGEST).contains(number))
            && predictor.last.is_none_or(|(motion, elapsed_s)| {
                is_in_place(motion) && (PERIOD_S[0]..=PERIOD_S[1]).contains(&elapsed_s)
            })
            && predictor.change_per_s.iter().flatten().all(|number| number.abs() <= LARGEST);
        (is_sound && predictor.wheels.is_sound()).then_some(predictor)
    }

    pub(super) fn step(&self, settings: &MotionSettings, stamp: Stamp, odom_from_robot: Option<Pose3>) -> Step {
        let since_s = self.elapsed_s(stamp);
        let after_gap = self.is_gap(since_s);
        let steps = if after_gap { since_s / (CARRIED_PERIODS * self.period_s) } else { 1.0 };
        let usual_s = self.last.map_or(USUAL_PERIOD_S, |(_, elapsed_s)| elapsed_s);
        let elapsed_s = if since_s > 0.0 { since_s.clamp(PERIOD_S[0], PERIOD_S[1]) } else { usual_s };
        let by_wheels = self.wheels.step(settings, odom_from_robot, (since_s.max(elapsed_s), steps));
        let (last_from_robot, information) = by_wheels.unwrap_or_else(|| self.carried(elapsed_s));
        let from_odometry = by_wheels.is_some();
        Step {
            last_from_robot,
            information,
            elapsed_s,
            after_gap,
            steps,
            from_odometry,
            is_looked_for: false,
            from_imu: false,
            read: None,
        }
    }

    /// The same step where the wheels are wrong: the motion before goes on, and turns as an inertial sensor read it.
    pub(super) fn without_wheels(&self, step: &Step) -> Step {
        let (last_from_robot, information) = self.carried(step.elapsed_s);
        let carried = Step { last_from_robot, information, from_odometry: false, ..*step };
        if !step.from_imu {
            return carried;
        }
        carried.turning(step.last_from_robot.rotation, &step.information.fixed_view::<3, 3>(3, 3).into_owned())
    }

    /// The motion before, carried on, and its information.
    fn carried(&self, elapsed_s: f64) -> (Pose3, Cov6) {
        let carried = self.last.filter(|(_, last_s)| elapsed_s <= CARRIED_PERIODS * last_s);
        let last_from_robot =
            carried.map_or(Pose3::identity(), |(step, last_s)| Pose3::exp(step.log() * (elapsed_s / last_s)));
        let (speed_mps, speed_radps) = if carried.is_some() { (0.0, 0.0) } else { (SPEED_MPS, SPEED_RADPS) };
        let sigma_m = LEAST_M + (speed_mps + 0.5 * ACCELERATION_MPS2 * elapsed_s) * elapsed_s;
        let sigma_rad = LEAST_RAD + (speed_radps + 0.5 * ACCELERATION_RADPS2 * elapsed_s) * elapsed_s;
        (last_from_robot, information_of([sigma_m; 3], [sigma_rad; 3]))
    }

    /// A match that alone knew the pose to `information` has put it here instead of where `step` had it.
    pub(super) fn observe(&mut self, settings: &MotionSettings, step: &Step, correction: Pose3, information: &Cov6) {
        self.wheels.observe(settings, step, correction, information);
    }

    /// The robot's twist while a cloud is taken: as it has moved by the last matches, which know its tilting as well; by odometry while
    /// there is none.
    pub(super) fn twist_per_s(&self, step: Step) -> Option<Vector6<f64>> {
        let by_odometry = step.from_odometry.then_some((step.last_from_robot, step.elapsed_s));
        self.last.or(by_odometry).map(|(motion, elapsed_s)| motion.log() / elapsed_s)
    }

    /// The same once it is known how the robot has moved up to the middle of the cloud, and its variances: it goes on changing as it did from
    /// the motion before, each being the mean of its time, give or take half of that.
    pub(super) fn twist_after(&self, step: &Step, moved: Pose3) -> (Vector6<f64>, Vector6<f64>) {
        if step.is_looked_for {
            let twist_per_s = self.twist_per_s(*step).unwrap_or_else(Vector6::zeros);
            return (twist_per_s, both([ACCELERATION_MPS2, ACCELERATION_RADPS2].map(|change| change * step.elapsed_s)));
        }
        let mean_per_s = moved.log() / step.elapsed_s.max(PERIOD_S[0]);
        let Some((before, before_s)) = self.last else {
            let sigmas = [0.5 * ACCELERATION_MPS2, 0.5 * ACCELERATION_RADPS2].map(|change| change * step.elapsed_s);
            return (mean_per_s, both(sigmas));
        };
        let left_per_s = CHANGE_LEFT * (mean_per_s - before.log() / before_s);
        let [way, turn] = [0, 3].map(|first| LEFT_OFF * left_per_s.fixed_rows::<3>(first).norm());
        let least = [LEAST_TWIST_M, LEAST_TWIST_RAD].map(|least| least / step.elapsed_s.max(PERIOD_S[0]));
        (mean_per_s + left_per_s, both([way + least[0], turn + least[1]]))
    }

    /// The same of the last motion.
    pub(super) fn change_per_s(&self) -> Option<Vector6<f64>> {
        self.change_per_s.map(Vector6::from)
    }

    /// The time since the last cloud, seconds; zero or less where that is not known.
    fn elapsed_s(&self, stamp: Stamp) -> f64 {
        self.stamp.map_or(0.0, |last| stamp.secs_since(last))
    }

    fn is_gap(&self, elapsed_s: f64) -> bool {
        self.period_s > 0.0 && elapsed_s > CARRIED_PERIODS * self.period_s
    }

    /// Usual time from cloud to cloud, seconds; zero while it is not known.
    pub(super) fn period_s(&self) -> f64 {
        self.period_s
    }

    /// How far the robot usually goes in the time from the last cloud of which its motion was known up to a stamp, root mean square, metres.
    pub(super) fn usual_way_m(&self, stamp: Stamp) -> f64 {
        let elapsed_s = self.known.map_or(0.0, |known| stamp.secs_since(known));
        self.speed2.sqrt() * elapsed_s.max(self.period_s)
    }

    /// How the robot has moved, if that is known.
    pub(super) fn settle(&mut self, stamp: Stamp, odom_from_robot: Option<Pose3>, moved: Option<Pose3>) {
        let elapsed_s = self.elapsed_s(stamp);
        let is_gap = self.is_gap(elapsed_s);
        self.wheels.settle(elapsed_s, odom_from_robot, moved);
        let usual_s = self.last.map_or(USUAL_PERIOD_S, |(_, elapsed_s)| elapsed_s);
        if elapsed_s > 0.0 && !is_gap {
            let weight = if self.period_s > 0.0 { PERIOD_WEIGHT } else { 1.0 };
            self.period_s += weight * (elapsed_s.min(PERIOD_S[1]) - self.period_s);
        }
        let elapsed_s = if elapsed_s > 0.0 { elapsed_s.clamp(PERIOD_S[0], PERIOD_S[1]) } else { usual_s };
        if let Some(moved) = moved.filter(|_| !is_gap) {
            self.speed2 += SPEED_WEIGHT * ((moved.translation.norm() / elapsed_s).powi(2) - self.speed2);
        }
        let last = moved.filter(|_| self.stamp.is_some()).map(|moved| (moved, elapsed_s));
        let twist_per_s = |(motion, elapsed_s): (Pose3, f64)| motion.log() / elapsed_s;
        self.change_per_s = self.last.zip(last).map(|(a, b)| (twist_per_s(b) - twist_per_s(a)).into());
        self.last = last;
        self.known = if moved.is_some() { Some(stamp) } else { self.known };
        self.stamp = Some(stamp);
    }
}

/// Variances of a twist, of the standard deviations of its velocity and its turn rate.
fn both([way, turn]: [f64; 2]) -> Vector6<f64> {
    Vector6::from_fn(|axis, _| if axis < 3 { way * way } else { turn * turn })
}

/// Variances of where the robot is so many seconds from where its twist is known, which has changed so much of late: a part of that is left;
/// where it is not known, what the next motion is uncertain by.
pub(super) fn carried_on_variances(step: &Step, change_per_s: Option<Vector6<f64>>, seconds: f64) -> Cov6 {
    let by_step = || {
        let information = step.information.diagonal();
        Vector6::from_fn(|axis, _| 1.0 / (information[axis].sqrt() * step.elapsed_s.max(PERIOD_S[0])))
    };
    let left_per_s = change_per_s.map_or_else(by_step, |change_per_s| CHANGE_LEFT * change_per_s);
    let turn = if step.from_imu { 0.0 } else { 1.0 };
    let sigma = |axis: usize| seconds * left_per_s[axis] * if axis < 3 { 1.0 } else { turn };
    Cov6::from_diagonal(&Vector6::from_fn(|axis, _| sigma(axis).powi(2)))
}

pub(super) fn information_of(sigmas_m: [f64; 3], sigmas_rad: [f64; 3]) -> Cov6 {
    let [a, b, c] = sigmas_m.map(|sigma| 1.0 / (sigma * sigma));
    let [d, e, f] = sigmas_rad.map(|sigma| 1.0 / (sigma * sigma));
    Cov6::from_diagonal(&Vector6::new(a, b, c, d, e, f))
}
