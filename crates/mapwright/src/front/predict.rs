//! Prediction: where the robot should be before its scan is looked at.

use crate::odometry::{OdometryTrust, odometry_variances};
use crate::sensors::{PerSensor, SensorId};
use crate::settings::MotionSettings;
use mapwright_geom::{Pose2, Stamp, Stored, stored};
use mapwright_sensor::Pace;

/// The motion since the last scan, with standard deviations of its right-perturbation tangent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    pub(crate) last_from_robot: Pose2,
    /// Variances of x, y and heading.
    pub(crate) variances: [f64; 3],
    /// The same by the motion model alone, before what odometry has been found wrong by.
    pub(crate) expected: [f64; 3],
    pub(crate) from_odometry: bool,
    /// The scan before is longer ago than is usual.
    pub(crate) after_gap: bool,
    /// How many times the usual motion from scan to scan it would be, had the robot gone on as before.
    periods: f64,
}

impl Step {
    fn is_short(&self) -> bool {
        self.last_from_robot.x.hypot(self.last_from_robot.y) <= FAILING_STEP_AT_MOST_M
    }

    /// The same motion, driven backwards.
    pub(crate) fn reversed(&self) -> Pose2 {
        let Pose2 { x, y, theta } = self.last_from_robot;
        Pose2::new(-x, -y, theta)
    }
}

/// How a robot turned out to have moved since the scan before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Moved {
    /// The wheels were heard.
    By(Pose2),
    /// As a match says that had nothing but the velocity to begin from.
    Matched(Pose2),
    /// The pose was put right by more than the motion; that counts as the one before.
    AsBefore,
    Unknown,
}

/// A motion in such a time says how the robot moves, seconds.
const MOVING_S: std::ops::Range<f64> = 1e-3..1.0;
/// From so many usual periods on, the time between two scans is a gap.
const GAP_PERIODS: f64 = 8.0;
/// How evenly a robot moves from scan to scan: how it speeds up, metres per second squared, over periods up to so many
/// seconds; radians; and shares of translation and rotation.
const STEADY_MPS2: f64 = 1.0;
const STEADY_AT_MOST_S: f64 = 0.5;
const STEADY_RAD: f64 = 0.1;
const STEADY_SHARE: [f64; 2] = [0.1, 0.4];
/// Weight of the newest motion in the velocity that is carried: matches in a corridor stick to what was just drawn, and a
/// velocity that follows each of them comes to a stand.
const VELOCITY_WEIGHT: f64 = 0.3;
/// Weight of the newest period in the running mean. What is no gap counts as one, and what takes up to so many seconds; of the first
/// nobody knows whether it is.
const PERIOD_WEIGHT: f64 = 0.02;
const PERIOD_S: f64 = 2.0;
const FIRST_PERIOD_S: f64 = 10.0;
/// How fast a robot is thought to drive and turn before it has moved, metres and radians per second, and how fast at least: it may drive
/// off unseen. Weight of the newest scan in the running mean of the squares.
const USUAL_AT_FIRST: [f64; 2] = [0.5, 0.8];
const USUAL_AT_LEAST: [f64; 2] = [0.05, 0.1];
const USUAL_WEIGHT: f64 = 0.01;
/// Standard deviation of a heading of which nothing is known, radians: pi / sqrt(3).
const ANY_HEADING_RAD: f64 = 1.8;
/// Over longer steps what lies behind is better known than what lies ahead, and a scan would be drawn back, metres.
const FAILING_STEP_AT_MOST_M: f64 = 0.5;

/// No motion from scan to scan, period or variance that is gone on with is larger, metres, radians and seconds.
const LARGEST: f64 = 1e3;

/// What the predictor remembers.
#[derive(Debug, Clone)]
pub(crate) struct Predictor {
    odom_from_robot: Option<Pose2>,
    stamp: Option<Stamp>,
    /// Motion from scan to scan: the last one; without odometry its translation is averaged. Of several lasers, in a usual period.
    twist: Option<[f64; 3]>,
    /// The laser of the present scan, and the last scan of each.
    laser: SensorId,
    last: PerSensor<Option<LastScan>>,
    /// The last scan came after a gap.
    after_gap: bool,
    /// Running mean of the time between scans.
    period_s: f64,
    /// What odometry has been wrong by of late.
    trust: OdometryTrust,
    /// How fast the robot usually drives and turns, metres and radians per second.
    usual: [f64; 2],
    /// How fast it drives and turns at most, by its odometry.
    pace: Pace,
    /// The wheels have been seen to count a way back as one ahead.
    reverses: bool,
    /// Scans in a row of which the velocity alone says how far the robot went.
    carried_scans: f64,
}

stored!(Predictor {
    odom_from_robot,
    stamp,
    twist,
    laser,
    last,
    after_gap,
    period_s,
    trust,
    usual,
    pace,
    reverses,
    carried_scans
});

/// The last scan of a laser, and how the robot has moved since, where that is known. Scans of several lasers come at no even rate, so that
/// motions are compared by stamps; and between two lasers' scans, which may be taken at once, a motion says nothing of a speed.
#[derive(Debug, Clone, Copy)]
struct LastScan {
    stamp: Stamp,
    then_from_last: Option<Pose2>,
}

stored!(LastScan { stamp, then_from_last });

impl Default for Predictor {
    fn default() -> Self {
        Self {
            odom_from_robot: None,
            stamp: None,
            twist: None,
            laser: SensorId::default(),
            last: PerSensor::default(),
            after_gap: false,
            period_s: 0.0,
            trust: OdometryTrust::default(),
            usual: USUAL_AT_FIRST,
            pace: Pace::default(),
            reverses: false,
            carried_scans: 0.0,
        }
    }
}

impl Predictor {
    /// Goes on as it was.
    pub(super) fn restore(from: &mut &[u8]) -> Option<Self> {
        let predictor = Self::take(from)?;
        let twist = predictor.twist.unwrap_or_default();
        let moved = predictor.last.iter().flatten().filter_map(|last| last.then_from_last);
        let moved: Vec<f64> = moved.flat_map(|moved| [moved.x, moved.y]).collect();
        let is_sound = twist
            .iter()
            .chain(&moved)
            .chain([&predictor.period_s, &predictor.carried_scans])
            .all(|number| number.abs() <= LARGEST);
        (is_sound && predictor.trust.is_sound(LARGEST) && predictor.pace.is_sound()).then_some(predictor)
    }

    /// Goes through an earlier scan again: where odometry had the robot, if there was any, and how it has moved since the scan before.
    /// The motion's variances as they were predicted.
    pub(super) fn go_through(
        &mut self,
        settings: &MotionSettings,
        stamp: Stamp,
        odom_from_robot: Option<Pose2>,
        last_from_robot: Pose2,
    ) -> [f64; 3] {
        let step = self.step(settings, stamp, odom_from_robot);
        let moved = if step.from_odometry { Moved::By(last_from_robot) } else { Moved::Matched(last_from_robot) };
        self.settle(stamp, odom_from_robot, moved);
        step.variances
    }

    /// The next scan is of this laser.
    pub(super) fn turn_to(&mut self, laser: SensorId) {
        self.laser = laser;
        self.last.of(laser);
    }

    /// Whether scans of several lasers come in turn.
    fn has_several(&self) -> bool {
        self.last.iter().flatten().count() > usize::from(self.last.get(self.laser).is_some_and(Option::is_some))
    }

    /// The usual periods from the last scan to one: one, for scans of a laser come at an even rate; of several by their stamps. Where these make
    /// a gap, or run backwards by more than lasers may differ in the order of their scans, they say nothing.
    fn periods(&self, stamp: Stamp) -> f64 {
        let elapsed_s = self.stamp.map_or(0.0, |last| stamp.secs_since(last));
        let periods = elapsed_s / self.period_s;
        if self.has_several() && periods.abs() <= GAP_PERIODS { periods } else { 1.0 }
    }

    /// The motion since the last scan of the same laser, where others came between, and the time since, seconds.
    fn since_own(&self, stamp: Stamp, last_from_robot: Pose2) -> Option<(Pose2, f64)> {
        let own = self.last.get(self.laser).copied().flatten()?;
        Some((own.then_from_last? * last_from_robot, stamp.secs_since(own.stamp)))
    }

    /// The motion from the last scan to this one.
    pub(crate) fn step(&self, settings: &MotionSettings, stamp: Stamp, odom_from_robot: Option<Pose2>) -> Step {
        let elapsed_s = self.stamp.map_or(0.0, |last| stamp.secs_since(last));
        // Stamps may stand still or run backwards: then the time is not known and counts as one usual period. Lasers may sweep at once.
        let least_s = if self.has_several() { 0.0 } else { 0.1 };
        let elapsed_s = if elapsed_s > 0.0 { elapsed_s } else { least_s };
        let periods = self.periods(stamp);
        let increment = match (settings.use_odometry, self.odom_from_robot, odom_from_robot) {
            (true, Some(last), Some(now)) => {
                Some(last.between(now)).filter(|step| self.pace.believes(elapsed_s, *step))
            }
            _ => None,
        };
        match increment {
            Some(last_from_robot) => {
                let after_gap = self.is_gap(elapsed_s);
                let steps = if after_gap { elapsed_s / (GAP_PERIODS * self.period_s) } else { 1.0 };
                let expected = odometry_variances(settings, last_from_robot, elapsed_s, steps);
                let [translation, rotation] = self.trust.worse();
                let variances = [translation * expected[0], translation * expected[1], rotation * expected[2]];
                Step { last_from_robot, variances, expected, from_odometry: true, after_gap, periods }
            }
            None => self.constant_velocity(settings, elapsed_s, periods),
        }
    }

    /// Variances of a motion, as poses add them up, after a match with such information along its weaker direction. A velocity that is wrong stays so
    /// until a scan tells: over `n` scans in a row it errs by `n` times as much, not by the root of it.
    pub(crate) fn noise(&mut self, step: Step, weakest: f64) -> [f64; 3] {
        let [x, y, rotation] = step.variances;
        let is_told = weakest * x > 1.0;
        self.carried_scans = if step.from_odometry || is_told { 0.0 } else { (self.carried_scans + 1.0).min(LARGEST) };
        let grown = 2.0 * self.carried_scans.max(1.0) - 1.0;
        [grown * x, grown * y, rotation]
    }

    /// The motion as before. Scans come at an even rate even where their stamps come in bursts, so a motion is
    /// carried from scan to scan, over gaps too, for many of them are a logger that was late: a gap of several periods
    /// adds as much uncertainty as the robot usually drives and turns in it, and nothing else.
    fn constant_velocity(&self, settings: &MotionSettings, elapsed_s: f64, periods: f64) -> Step {
        let gap_s = if elapsed_s > GAP_PERIODS * self.period_s { elapsed_s - self.period_s } else { 0.0 };
        let carried = self.twist.unwrap_or([0.0; 3]).map(|part| periods * part);
        let (translation, rotation) = (carried[0].hypot(carried[1]), carried[2].abs());
        let steady_m = STEADY_MPS2 * self.period_s.min(STEADY_AT_MOST_S).powi(2);
        let [share_t, share_r] = STEADY_SHARE;
        let sigma_t = steady_m + share_t * translation + settings.translation_floor_m + self.usual[0] * gap_s;
        let sigma_r = STEADY_RAD
            + share_r * rotation
            + settings.rotation_floor_rad
            + (self.usual[1] * gap_s).min(ANY_HEADING_RAD);
        Step {
            last_from_robot: Pose2::exp(carried),
            variances: [sigma_t * sigma_t, sigma_t * sigma_t, sigma_r * sigma_r],
            expected: [sigma_t * sigma_t, sigma_t * sigma_t, sigma_r * sigma_r],
            from_odometry: false,
            after_gap: gap_s > 0.0,
            periods,
        }
    }

    fn is_gap(&self, elapsed_s: f64) -> bool {
        self.period_s > 0.0 && elapsed_s > GAP_PERIODS * self.period_s
    }

    /// Usual time from scan to scan, seconds; zero while it is not known.
    pub(super) fn usual_period_s(&self) -> f64 {
        self.period_s
    }

    /// What the robot did instead if the wheels fail: they spin while it stands, they count but do not tell forwards from
    /// backwards, or it went on as before. Nothing where `step` is not the wheels', or where it is long and they were never caught.
    pub(crate) fn failures(&self, step: Step) -> impl Iterator<Item = Pose2> + use<> {
        let said = step.last_from_robot;
        let stood = Pose2::new(0.0, 0.0, said.theta);
        let possible = step.from_odometry && (step.is_short() || self.reverses);
        let went_on = self.twist.map(|twist| Pose2::exp(twist.map(|part| step.periods * part)));
        let failures = [Some(stood), Some(step.reversed()), went_on];
        failures.into_iter().flatten().filter(move |_| possible)
    }

    /// Whether wheels that were caught tell of a long step: in the wrong place a scan may well fit.
    pub(crate) fn may_be_reversed(&self, step: Step) -> bool {
        self.reverses && step.from_odometry && !step.is_short()
    }

    /// The wheels told a way back as one ahead.
    pub(crate) fn catch_reversed(&mut self) {
        self.reverses = true;
    }

    /// Whether the robot can have made a motion of which odometry tells, in so many seconds.
    pub(crate) fn believes(&self, elapsed_s: f64, motion: Pose2) -> bool {
        self.pace.believes(elapsed_s, motion)
    }

    /// The robot's twist per second while it makes `step`.
    pub(crate) fn twist(&self, stamp: Stamp, step: Step) -> [f64; 3] {
        let since_last = || (step.last_from_robot, self.stamp.map_or(0.0, |last| stamp.secs_since(last)));
        let own = if self.has_several() { self.since_own(stamp, step.last_from_robot) } else { None };
        let (motion, elapsed_s) = own.unwrap_or_else(since_last);
        if MOVING_S.contains(&elapsed_s) { motion.log().map(|d| d / elapsed_s) } else { [0.0; 3] }
    }

    /// The time since the last scan, seconds, if the motion in it says how the robot moves.
    pub(super) fn moving_s(&self, stamp: Stamp) -> Option<f64> {
        self.stamp.map(|last| stamp.secs_since(last)).filter(|elapsed_s| MOVING_S.contains(elapsed_s))
    }

    /// A match that knew the pose by itself, to these variances, has moved the prediction by `correction`.
    pub(crate) fn observe(&mut self, step: Step, correction: [f64; 3], match_variances: [f64; 3]) {
        for axis in (0..3).filter(|_| step.from_odometry) {
            let prior = [step.variances[axis], step.expected[axis]];
            self.trust.observe(axis / 2, correction[axis], prior, match_variances[axis]);
        }
    }

    /// Whether odometry's translations have lately been much worse than its model.
    pub(crate) fn doubts_odometry(&self) -> bool {
        self.trust.doubts()
    }

    /// Where odometry has the robot after a scan without a reading: as far on as the robot has moved, where that is known.
    fn odometry_after(&self, moved: Moved) -> Option<Pose2> {
        match moved {
            Moved::By(motion) | Moved::Matched(motion) => self.odom_from_robot.map(|last| last * motion),
            Moved::AsBefore | Moved::Unknown => self.odom_from_robot,
        }
    }

    /// Remembers a scan and how the robot turned out to have moved.
    pub(crate) fn settle(&mut self, stamp: Stamp, odom_from_robot: Option<Pose2>, moved: Moved) {
        let elapsed_s = self.stamp.map_or(0.0, |last| stamp.secs_since(last));
        let after_gap = elapsed_s > GAP_PERIODS * self.period_s && self.period_s > 0.0;
        let driven = moved;
        let moved = if self.has_several() { self.in_a_period(stamp, driven) } else { driven };
        self.note_last(stamp, driven);
        match moved {
            // What was driven in a gap is no motion from scan to scan; where gaps are usual it is all there is.
            Moved::Matched(_) if after_gap && !self.after_gap && self.twist.is_some() => {}
            Moved::By(last_from_robot) => self.twist = Some(last_from_robot.log()),
            Moved::Matched(last_from_robot) => {
                let [x, y, theta] = last_from_robot.log();
                let [vx, vy, _] = self.twist.unwrap_or([x, y, theta]);
                self.twist = Some([vx + VELOCITY_WEIGHT * (x - vx), vy + VELOCITY_WEIGHT * (y - vy), theta]);
            }
            Moved::AsBefore => {}
            Moved::Unknown => self.twist = None,
        }
        self.after_gap = after_gap;
        if let Moved::By(motion) | Moved::Matched(motion) = moved
            && !after_gap
            && self.period_s > 0.0
        {
            let now = [motion.x.hypot(motion.y), motion.theta.abs()].map(|moved| moved / self.period_s);
            for (axis, usual) in self.usual.iter_mut().enumerate() {
                let mean_square = *usual * *usual + USUAL_WEIGHT * (now[axis] * now[axis] - *usual * *usual);
                *usual = mean_square.sqrt().max(USUAL_AT_LEAST[axis]);
            }
        }
        let at_most_s = if self.period_s > 0.0 { PERIOD_S.max(GAP_PERIODS * self.period_s) } else { FIRST_PERIOD_S };
        if elapsed_s > 0.0 && elapsed_s < at_most_s {
            let weight = if self.period_s > 0.0 { PERIOD_WEIGHT } else { 1.0 };
            self.period_s += weight * (elapsed_s - self.period_s);
        }
        self.stamp = Some(stamp);
        if let (Some(last), Some(now)) = (self.odom_from_robot, odom_from_robot) {
            self.pace.add(elapsed_s, last.between(now));
        }
        self.odom_from_robot = odom_from_robot.or_else(|| self.odometry_after(driven));
    }

    /// The same in one usual period, by the last scan of the same laser; as before where there is none, or its stamp is no earlier.
    fn in_a_period(&self, stamp: Stamp, moved: Moved) -> Moved {
        let by_period = |motion: Pose2| {
            let (motion, elapsed_s) = self.since_own(stamp, motion)?;
            let periods = self.period_s / elapsed_s;
            (elapsed_s > 0.0 && self.period_s > 0.0).then(|| Pose2::exp(motion.log().map(|part| periods * part)))
        };
        match moved {
            Moved::By(motion) => by_period(motion).map_or(Moved::AsBefore, Moved::By),
            Moved::Matched(motion) => by_period(motion).map_or(Moved::AsBefore, Moved::Matched),
            Moved::AsBefore | Moved::Unknown => moved,
        }
    }

    fn note_last(&mut self, stamp: Stamp, moved: Moved) {
        let by = match moved {
            Moved::By(motion) | Moved::Matched(motion) => Some(motion),
            Moved::AsBefore | Moved::Unknown => None,
        };
        *self.last.of(self.laser) = None;
        for last in self.last.iter_mut().flatten() {
            last.then_from_last = last.then_from_last.zip(by).map(|(then, by)| then * by);
        }
        *self.last.of(self.laser) = Some(LastScan { stamp, then_from_last: Some(Pose2::IDENTITY) });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::odometry::WORSE_AT_MOST;
    use crate::settings::Settings;

    /// Drives 4,000 steps of 0.1 m with wheels that err `worse` times as much as the model says, each judged by a match as
    /// certain as `scan_m2`; the standard deviation forwards that is stated in the end, against the model's.
    fn stated(worse: f64, scan_m2: f64) -> f64 {
        let settings = Settings::default().motion;
        let mut predictor = Predictor::default();
        let (mut odom_from_robot, mut ratio) = (Pose2::IDENTITY, 0.0);
        predictor.settle(Stamp(0), Some(odom_from_robot), Moved::By(Pose2::IDENTITY));
        for k in 1..4000_i64 {
            odom_from_robot = odom_from_robot * Pose2::new(0.1, 0.0, 0.0);
            let step = predictor.step(&settings, Stamp(100_000_000 * k), Some(odom_from_robot));
            // A sequence of which the variance is one.
            let error = [1.4, -0.7, 0.2, -1.4, 0.9, -0.4][k as usize % 6] * worse * step.expected[0].sqrt();
            let gain = step.variances[0] / (step.variances[0] + scan_m2);
            predictor.observe(step, [gain * error, 0.0, 0.0], [scan_m2, f64::INFINITY, f64::INFINITY]);
            predictor.settle(Stamp(100_000_000 * k), Some(odom_from_robot), Moved::By(step.last_from_robot));
            ratio = (step.variances[0] / step.expected[0]).sqrt();
        }
        ratio
    }

    #[test]
    fn long_steps_of_wheels_fail_only_where_they_were_caught() {
        let mut predictor = Predictor::default();
        predictor.settle(Stamp(0), Some(Pose2::IDENTITY), Moved::By(Pose2::new(0.1, 0.0, 0.0)));
        let step = |predictor: &Predictor, ahead_m: f64| {
            let settings = Settings::default().motion;
            predictor.step(&settings, Stamp(1_000_000_000), Some(Pose2::new(ahead_m, 0.0, 0.1)))
        };
        let [short, long] = [0.4, 0.6].map(|ahead_m| step(&predictor, ahead_m));
        let ahead_m = |predictor: &Predictor, step| predictor.failures(step).map(|moved| moved.x).collect::<Vec<_>>();
        assert_eq!(ahead_m(&predictor, short), [0.0, -0.4, 0.1]);
        assert!(ahead_m(&predictor, long).is_empty() && !predictor.may_be_reversed(long));
        predictor.catch_reversed();
        assert!(predictor.may_be_reversed(long) && !predictor.may_be_reversed(short));
        assert_eq!(ahead_m(&predictor, long), [0.0, -0.6, 0.1]);
        let unheard = predictor.step(&Settings::default().motion, Stamp(1_000_000_000), None);
        assert!(!unheard.from_odometry && ahead_m(&predictor, unheard).is_empty());
    }

    #[test]
    fn odometry_that_went_on_during_a_pause_is_believed_and_a_jump_is_not() {
        let settings = Settings::default().motion;
        let mut predictor = Predictor::default();
        predictor.settle(Stamp(0), Some(Pose2::IDENTITY), Moved::By(Pose2::IDENTITY));
        let is_believed = |after_s: f64, by_m: f64| {
            let stamp = Stamp::from_secs_f64(after_s);
            predictor.step(&settings, stamp, Some(Pose2::new(by_m, 0.0, 0.0))).from_odometry
        };
        assert!(is_believed(60.0, 45.0) && is_believed(0.1, 2.9), "a robot drove on");
        assert!(!is_believed(0.1, 3.1) && !is_believed(60.0, 200.0) && !is_believed(-5.0, 12.0), "a jump");
        assert!(!is_believed(60.0, f64::NAN));
    }

    #[test]
    fn without_odometry_a_motion_is_carried_over_a_gap_that_makes_it_uncertain() {
        let settings = Settings::default().motion;
        let mut predictor = Predictor::default();
        let motion = Pose2::new(0.06, 0.0, 0.02);
        (0..50).for_each(|k| predictor.settle(Stamp(200_000_000 * k), None, Moved::Matched(motion)));
        let after_s = |seconds: f64| {
            let stamp = Stamp(200_000_000 * 49 + (seconds * 1e9) as i64);
            predictor.step(&settings, stamp, None)
        };
        let (usual, burst, gap) = (after_s(0.2), after_s(0.001), after_s(2.4));
        for step in [usual, burst, gap] {
            assert!(step.last_from_robot.distance(motion) < 1e-12, "{step:?}");
        }
        assert_eq!(usual.variances, burst.variances);
        let sigma_m = |step: Step| step.variances[0].sqrt();
        assert!(!usual.after_gap && gap.after_gap);
        // It drives 0.3 m a second.
        let grown_m = |gap: Step| sigma_m(gap) - sigma_m(usual);
        assert!((0.3 * 2.2..0.45 * 2.2).contains(&grown_m(gap)), "{gap:?}");
        let minute = after_s(60.2);
        assert!(grown_m(minute) > 25.0 * grown_m(gap), "no distance that time does not allow bounds it: {minute:?}");
        assert!(minute.variances[2].sqrt() < 2.2, "a heading is on a circle");
    }

    #[test]
    fn odometry_over_a_gap_is_no_more_certain_than_over_the_scans_that_are_missing() {
        let settings = Settings::default().motion;
        let mut predictor = Predictor::default();
        let stamp = |k: i64| Stamp(100_000_000 * k);
        let at = |k: i64| Pose2::new(0.05 * k as f64, 0.0, 0.0);
        (0..50).for_each(|k| predictor.settle(stamp(k), Some(at(k)), Moved::By(Pose2::new(0.05, 0.0, 0.0))));
        let gap = predictor.step(&settings, stamp(149), Some(at(149)));
        assert!(gap.from_odometry && gap.after_gap);
        let mut sum = mapwright_geom::Cov3::zeros();
        for k in 50..150 {
            let step = predictor.step(&settings, stamp(k), Some(at(k)));
            let noise = mapwright_geom::Cov3::from_diagonal(&step.variances.into());
            sum = mapwright_geom::compose_covariance(&sum, step.last_from_robot, &noise);
            predictor.settle(stamp(k), Some(at(k)), Moved::By(step.last_from_robot));
        }
        for (axis, least, most) in [(1, 1.0, 3.5), (2, 1.0, 3.5)] {
            let ratio = (gap.variances[axis] / sum[(axis, axis)]).sqrt();
            assert!((least..most).contains(&ratio), "axis {axis}: {ratio}");
        }
    }

    #[test]
    fn without_odometry_neither_a_slip_put_right_nor_a_gap_nor_single_matches_make_a_robot_fast() {
        let settings = Settings::default().motion;
        let mut predictor = Predictor::default();
        let motion = Pose2::new(0.05, 0.0, 0.0);
        let stamp = |k: i64| Stamp(100_000_000 * k);
        (0..50).for_each(|k| predictor.settle(stamp(k), None, Moved::Matched(motion)));
        let carried_m = |predictor: &Predictor| predictor.clone().step(&settings, stamp(60), None).last_from_robot.x;
        predictor.settle(stamp(50), None, Moved::AsBefore);
        assert!((carried_m(&predictor) - 0.05).abs() < 1e-12, "what was put right is no motion");
        predictor.settle(stamp(70), None, Moved::Matched(Pose2::new(1.0, 0.0, 0.0)));
        assert!((carried_m(&predictor) - 0.05).abs() < 1e-12, "nor is what was driven in two seconds");
        predictor.settle(stamp(71), None, Moved::Matched(Pose2::IDENTITY));
        assert!((carried_m(&predictor) - 0.035).abs() < 1e-12, "one match that stays behind does not stop it");
        (72..100).for_each(|k| predictor.settle(stamp(k), None, Moved::Matched(Pose2::IDENTITY)));
        assert!(carried_m(&predictor) < 1e-5, "many do");
        // Where every scan comes after a gap their motions count.
        (0..30).for_each(|k| predictor.settle(stamp(150 + 50 * k), None, Moved::Matched(Pose2::new(1.0, 0.0, 0.0))));
        assert!(carried_m(&predictor) > 0.9);
        predictor.settle(stamp(2000), None, Moved::Unknown);
        assert_eq!(carried_m(&predictor), 0.0, "of a lost robot nothing is known");
    }

    #[test]
    fn odometry_is_believed_as_it_deserves() {
        let (good, bad, hopeless) = (stated(0.5, 1e-8), stated(3.0, 1e-8), stated(100.0, 1e-8));
        assert!(good == 1.0 && hopeless == WORSE_AT_MOST.sqrt(), "{good} {hopeless}");
        assert!((bad - 3.0).abs() < 0.4, "{bad}");
        assert_eq!(stated(3.0, 1e6), 1.0, "a match that knows nothing judges nothing");
    }
}
