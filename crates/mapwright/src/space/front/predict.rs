//! Step 2: where the robot should be before its cloud is looked at.

use super::wheels::Wheels;
use crate::sensors::{PerSensor, SensorId};
use crate::settings::MotionSettings;
use mapwright_geom::{Cov6, Pose3, Stamp, Stored, is_in_place, stored};
use nalgebra::{Matrix3, UnitQuaternion, Vector3, Vector6};

/// How fast a robot, or a hand that holds a sensor, changes its speed: metres and radians per second squared. Its turning it changes as it has
/// of late, where this is the most, and worth one cloud.
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
/// A match is wrong by so much in rotation, radians.
const MATCH_RAD: f64 = 0.003;
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
    /// Another sensor took the cloud before.
    pub(super) is_beside: bool,
    /// The time since the cloud before of the same sensor, seconds; where nothing is known of it, the usual one.
    pub(super) own_elapsed_s: f64,
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

/// The last cloud of a sensor, and how the robot moved. Clouds of several sensors come at no even rate, and two may be taken at once: over
/// such a time a motion says nothing of a speed.
#[derive(Debug, Clone, Copy)]
struct Own {
    stamp: Stamp,
    /// How the robot has moved since, where that is known.
    then_from_last: Option<Pose3>,
    /// Its motion before that, from cloud to cloud of this sensor, and the seconds that it took.
    motion: Option<(Pose3, f64)>,
}
stored!(Own { stamp, then_from_last, motion });

/// When a cloud was taken.
#[derive(Debug, Clone, Copy)]
pub(super) struct Taken {
    pub(super) stamp: Stamp,
    /// The middle of the sweep, seconds after that.
    pub(super) middle_s: f64,
}

/// What came of a cloud.
#[derive(Debug, Clone, Copy)]
pub(super) struct Settled {
    pub(super) last_from_robot: Pose3,
    /// Whether a match bears that out.
    pub(super) is_matched: bool,
    /// The robot was looked for: how it came there is not known.
    pub(super) is_looked_for: bool,
    /// Another sensor has said where it is just before, and this one sees elsewhere.
    pub(super) sees_elsewhere: bool,
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
    /// The same of the square of how fast it changes its turning, (rad/s^2)^2, where that is known.
    turn_change2: Option<f64>,
    /// The last cloud of which it was known how the robot had moved.
    known: Option<Stamp>,
    /// The sensor of the present cloud, and of the last one with the middle of its sweep, seconds after its stamp; and what is known of
    /// each. Where there is one, all above is its own.
    sensor: SensorId,
    newest: Option<(SensorId, f64)>,
    own: PerSensor<Option<Own>>,
    /// For how long nothing was matched, as clouds of one see elsewhere than what is known, seconds: the prediction is as unsure.
    unmatched_s: f64,
}
stored!(Predictor {
    stamp, wheels, last, change_per_s, period_s, speed2, turn_change2, known; sensor, newest, own, unmatched_s
});

impl Predictor {
    /// Goes on as it was.
    pub(super) fn restore(from: &mut &[u8]) -> Option<Self> {
        let predictor = Self::take(from)?;
        let is_sound = [predictor.period_s, predictor.speed2].iter().all(|number| (0.0..=LARGEST).contains(number))
            && predictor.turn_change2.is_none_or(|change2| (0.0..=ACCELERATION_RADPS2.powi(2)).contains(&change2))
            && predictor.last.is_none_or(|(motion, elapsed_s)| {
                is_in_place(motion) && (PERIOD_S[0]..=PERIOD_S[1]).contains(&elapsed_s)
            })
            && predictor.change_per_s.iter().flatten().all(|number| number.abs() <= LARGEST);
        (is_sound && predictor.wheels.is_sound()).then_some(predictor)
    }

    /// Of robots with several sensors: what is remembered of each.
    pub(super) fn put_sensors(&self, out: &mut Vec<u8>) {
        self.newest.put(out);
        self.own.put(out);
        self.unmatched_s.put(out);
    }

    /// The same with that.
    pub(super) fn take_sensors(self, from: &mut &[u8]) -> Option<Self> {
        let (newest, own, unmatched_s) = (Stored::take(from)?, Stored::take(from)?, f64::take(from)?);
        (0.0..=PERIOD_S[1]).contains(&unmatched_s).then_some(Self { newest, own, unmatched_s, ..self })
    }

    /// The next cloud is of this sensor.
    pub(super) fn turn_to(&mut self, sensor: SensorId) {
        self.sensor = sensor;
        self.own.of(sensor);
    }

    /// Whether another sensor took the last cloud.
    fn is_beside(&self) -> bool {
        self.newest.is_some_and(|(newest, _)| newest != self.sensor)
    }

    fn own(&self) -> Option<Own> {
        self.own.get(self.sensor).copied().flatten()
    }

    /// The time since the last cloud, seconds, and by how much more the middles of the two lie apart: zero where one sensor took both.
    fn since_last(&self, taken: Taken) -> (f64, f64) {
        let middle_s = self.newest.filter(|_| self.is_beside()).map(|(_, middle_s)| middle_s);
        (self.elapsed_s(taken.stamp), middle_s.map_or(0.0, |middle_s| taken.middle_s - middle_s))
    }

    /// The time since the last cloud of the same sensor, seconds; zero or less where that is not known.
    fn own_elapsed_s(&self, stamp: Stamp) -> f64 {
        if !self.is_beside() {
            return self.elapsed_s(stamp);
        }
        self.own().map_or(0.0, |own| stamp.secs_since(own.stamp))
    }

    /// The motion since the last cloud of the same sensor, which ends with such a one since the last cloud.
    fn own_motion(&self, moved: Pose3) -> Option<Pose3> {
        if !self.is_beside() {
            return Some(moved);
        }
        Some(self.own()?.then_from_last? * moved)
    }

    /// The motion before that, and the seconds that it took.
    fn own_before(&self) -> Option<(Pose3, f64)> {
        if self.is_beside() { self.own()?.motion } else { self.last }
    }

    pub(super) fn step(&self, settings: &MotionSettings, taken: Taken, odom_from_robot: Option<Pose3>) -> Step {
        let is_beside = self.is_beside();
        let (since_s, apart_s) = self.since_last(taken);
        let after_gap = self.is_gap(since_s);
        let steps = if after_gap { since_s / (CARRIED_PERIODS * self.period_s) } else { 1.0 };
        let usual_s = self.last.map_or(USUAL_PERIOD_S, |(_, elapsed_s)| elapsed_s);
        let own_elapsed_s = self.own_elapsed_s(taken.stamp);
        let within = |seconds: f64| seconds.clamp(PERIOD_S[0], PERIOD_S[1]);
        let own_elapsed_s = if own_elapsed_s > 0.0 { within(own_elapsed_s) } else { usual_s };
        // Sensors may sweep at once, and the one that began earlier may end later.
        let signed_s = if is_beside { (since_s + apart_s).clamp(-PERIOD_S[1], PERIOD_S[1]) } else { own_elapsed_s };
        let elapsed_s = if is_beside { within(signed_s.abs()) } else { own_elapsed_s };
        let lead =
            self.last.filter(|_| apart_s != 0.0).map(|(step, last_s)| Pose3::exp(step.log() * (apart_s / last_s)));
        let by_wheels = self.wheels.step(settings, (odom_from_robot, lead), (since_s.max(elapsed_s), steps));
        let (last_from_robot, information) = by_wheels.unwrap_or_else(|| self.carried(elapsed_s, signed_s));
        let from_odometry = by_wheels.is_some();
        Step {
            last_from_robot,
            information,
            elapsed_s,
            after_gap,
            steps,
            from_odometry,
            is_beside,
            own_elapsed_s,
            is_looked_for: false,
            from_imu: false,
            read: None,
        }
    }

    /// The same step where the wheels are wrong: the motion before goes on, and turns as an inertial sensor read it.
    pub(super) fn without_wheels(&self, step: &Step) -> Step {
        let (last_from_robot, information) = self.carried(step.elapsed_s, step.elapsed_s);
        let carried = Step { last_from_robot, information, from_odometry: false, ..*step };
        if !step.from_imu {
            return carried;
        }
        carried.turning(step.last_from_robot.rotation, &step.information.fixed_view::<3, 3>(3, 3).into_owned())
    }

    /// How fast the robot changes its turning, radians per second squared.
    fn turn_change_radps2(&self) -> f64 {
        let most2 = ACCELERATION_RADPS2.powi(2);
        let of_late2 = self.turn_change2.unwrap_or(most2);
        (of_late2 + SPEED_WEIGHT * (most2 - of_late2)).sqrt()
    }

    /// The motion before, carried on over so many seconds, backwards where they are negative, and its information.
    fn carried(&self, elapsed_s: f64, signed_s: f64) -> (Pose3, Cov6) {
        let carried = self.last.filter(|(_, last_s)| elapsed_s <= CARRIED_PERIODS * last_s);
        let last_from_robot =
            carried.map_or(Pose3::identity(), |(step, last_s)| Pose3::exp(step.log() * (signed_s / last_s)));
        let (speed_mps, speed_radps) = if carried.is_some() { (0.0, 0.0) } else { (SPEED_MPS, SPEED_RADPS) };
        let unsure_s = signed_s.abs() + self.unmatched_s;
        let sigma_m = LEAST_M + (speed_mps + 0.5 * ACCELERATION_MPS2 * unsure_s) * unsure_s;
        let sigma_rad = LEAST_RAD + (speed_radps + 0.5 * self.turn_change_radps2() * unsure_s) * unsure_s;
        (last_from_robot, information_of([sigma_m; 3], [sigma_rad; 3]))
    }

    /// A match that alone knew the pose to `information` has put it here instead of where `step` had it.
    pub(super) fn observe(&mut self, settings: &MotionSettings, step: &Step, correction: Pose3, information: &Cov6) {
        if step.from_odometry {
            let motion = (step.last_from_robot, step.elapsed_s, step.steps);
            let told = (&step.information, !step.from_imu);
            self.wheels.observe(settings, motion, told, (correction, information));
        }
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
        let elapsed_s = step.own_elapsed_s;
        let Some(moved) = self.own_motion(moved).filter(|_| !step.is_looked_for) else {
            let twist_per_s = self.twist_per_s(*step).unwrap_or_else(Vector6::zeros);
            return (twist_per_s, both([ACCELERATION_MPS2, ACCELERATION_RADPS2].map(|change| change * elapsed_s)));
        };
        let mean_per_s = moved.log() / elapsed_s.max(PERIOD_S[0]);
        let Some((before, before_s)) = self.own_before() else {
            let sigmas = [0.5 * ACCELERATION_MPS2, 0.5 * ACCELERATION_RADPS2].map(|change| change * elapsed_s);
            return (mean_per_s, both(sigmas));
        };
        let left_per_s = CHANGE_LEFT * (mean_per_s - before.log() / before_s);
        let [way, turn] = [0, 3].map(|first| LEFT_OFF * left_per_s.fixed_rows::<3>(first).norm());
        let least = [LEAST_TWIST_M, LEAST_TWIST_RAD].map(|least| least / elapsed_s.max(PERIOD_S[0]));
        (mean_per_s + left_per_s, both([way + least[0], turn + least[1]]))
    }

    /// The same of the last motion.
    pub(super) fn change_per_s(&self) -> Option<Vector6<f64>> {
        self.change_per_s.map(Vector6::from)
    }

    /// Variances of where the robot is since it was matched last: by the wheels, or as it has changed its motion of late.
    pub(super) fn variances(&self, step: &Step) -> Cov6 {
        let by_wheels = || step.information.diagonal().map(|information| 1.0 / information);
        let seconds = step.elapsed_s + self.unmatched_s;
        let carried_on = || carried_on_variances(step, self.change_per_s(), seconds).diagonal();
        let variances = if step.from_odometry { by_wheels() } else { carried_on() };
        Cov6::from_diagonal(&(variances + both([LEAST_M, MATCH_RAD])))
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

    /// Whether clouds come so soon after each other that what the one has told of the pose holds for the other.
    pub(super) fn is_at_once(&self, earlier: Stamp, later: Stamp) -> bool {
        !self.is_gap(later.secs_since(earlier))
    }

    /// How the robot has moved, as far as that is known.
    pub(super) fn settle(&mut self, taken: Taken, odom_from_robot: Option<Pose3>, settled: Settled) {
        let Settled { last_from_robot, is_matched, is_looked_for, sees_elsewhere } = settled;
        let stamp = taken.stamp;
        let since_last_s = self.elapsed_s(stamp).clamp(0.0, PERIOD_S[1]);
        self.unmatched_s = if sees_elsewhere { (self.unmatched_s + since_last_s).min(PERIOD_S[1]) } else { 0.0 };
        let moved = Some(last_from_robot).filter(|_| is_matched && !is_looked_for);
        let elapsed_s = self.own_elapsed_s(stamp);
        let is_gap = self.is_gap(elapsed_s);
        self.wheels.settle(self.elapsed_s(stamp), odom_from_robot, moved);
        let usual_s = self.last.map_or(USUAL_PERIOD_S, |(_, elapsed_s)| elapsed_s);
        if elapsed_s > 0.0 && !is_gap {
            let weight = if self.period_s > 0.0 { PERIOD_WEIGHT } else { 1.0 };
            self.period_s += weight * (elapsed_s.min(PERIOD_S[1]) - self.period_s);
        }
        let elapsed_s = if elapsed_s > 0.0 { elapsed_s.clamp(PERIOD_S[0], PERIOD_S[1]) } else { usual_s };
        let own = moved.and_then(|moved| self.own_motion(moved));
        if let Some(own) = own.filter(|_| !is_gap) {
            self.speed2 += SPEED_WEIGHT * ((own.translation.norm() / elapsed_s).powi(2) - self.speed2);
        }
        let last = own.filter(|_| self.stamp.is_some()).map(|own| (own, elapsed_s));
        let twist_per_s = |(motion, elapsed_s): (Pose3, f64)| motion.log() / elapsed_s;
        if !self.is_beside() || last.is_some() {
            let change = |(a, b)| (twist_per_s(b) - twist_per_s(a)).into();
            self.change_per_s = self.own_before().zip(last).map(change);
            if let Some(change_per_s) = self.change_per_s().filter(|_| !is_gap) {
                // By constant turning the robot is off by half of this times the squared time.
                let seen = (2.0 * change_per_s.fixed_rows::<3>(3).norm() / elapsed_s).min(ACCELERATION_RADPS2);
                let of_late2 = self.turn_change2.unwrap_or(ACCELERATION_RADPS2.powi(2));
                self.turn_change2 = Some(of_late2 + SPEED_WEIGHT * (seen * seen - of_late2));
            }
        }
        for other in self.own.iter_mut().flatten() {
            let then_from_last = other.then_from_last.filter(|_| !is_looked_for);
            other.then_from_last = then_from_last.map(|then_from_last| then_from_last * last_from_robot);
        }
        *self.own.of(self.sensor) = Some(Own { stamp, then_from_last: Some(Pose3::identity()), motion: last });
        self.last = last.or_else(|| self.by_another(stamp));
        self.newest = Some((self.sensor, taken.middle_s));
        self.known = if moved.is_some() { Some(stamp) } else { self.known };
        self.stamp = Some(stamp);
    }

    /// The newest motion from cloud to cloud of any sensor, where that is no older than motions are carried on.
    fn by_another(&self, stamp: Stamp) -> Option<(Pose3, f64)> {
        let moved = self.own.iter().flatten().filter_map(|own| Some((own.stamp, own.motion?)));
        let newest = moved.reduce(|a, b| if b.0 > a.0 { b } else { a })?;
        (stamp.secs_since(newest.0) <= CARRIED_PERIODS * newest.1.1).then_some(newest.1)
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

fn information_of(sigmas_m: [f64; 3], sigmas_rad: [f64; 3]) -> Cov6 {
    let [a, b, c] = sigmas_m.map(|sigma| 1.0 / (sigma * sigma));
    let [d, e, f] = sigmas_rad.map(|sigma| 1.0 / (sigma * sigma));
    Cov6::from_diagonal(&Vector6::new(a, b, c, d, e, f))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drive(predictor: &mut Predictor, from: u32, clouds: u32, turn_rad: f64) -> Step {
        let taken = |k: u32| Taken { stamp: Stamp::from_secs_f64(0.1 * f64::from(k)), middle_s: 0.0 };
        let last_from_robot = Pose3::exp(Vector6::new(0.1, 0.0, 0.0, 0.0, 0.0, turn_rad));
        for k in from..from + clouds {
            let settled = Settled { last_from_robot, is_matched: true, is_looked_for: false, sees_elsewhere: false };
            predictor.settle(taken(k), None, settled);
        }
        predictor.step(&MotionSettings::default(), taken(from + clouds), None)
    }

    #[test]
    fn who_turns_evenly_is_thought_to_go_on_so() {
        let mut predictor = Predictor::default();
        let sigma_rad = |step: Step| 1.0 / step.information[(5, 5)].sqrt();
        let first_rad = sigma_rad(drive(&mut predictor, 0, 3, 0.1));
        assert!((0.09..=0.105).contains(&first_rad), "as anything may turn: {first_rad}");
        let even_rad = sigma_rad(drive(&mut predictor, 3, 100, 0.1));
        assert!((0.02..0.04).contains(&even_rad), "{even_rad}");
        let sudden_rad = sigma_rad(drive(&mut predictor, 103, 1, 0.5));
        assert!((1.1 * even_rad..first_rad).contains(&sudden_rad), "it may do so again: {sudden_rad}");
    }

    #[test]
    fn no_bytes_make_it_surer_than_that() {
        let mut bytes = Vec::new();
        Predictor { turn_change2: Some(-100.0), ..Predictor::default() }.put(&mut bytes);
        assert!(Predictor::restore(&mut bytes.as_slice()).is_none());
    }
}
