//! What an inertial sensor tells the front end: how the robot turned since the last cloud and during a sweep, and where down is.
//!
//! Its readings are believed once matches have borne them out, and no longer than they do: a mount that is told wrongly shows with the
//! first turn. Until a turn has been borne out, what they say is one more start of the match, and no more. The gyroscope's bias is what matches and readings differ by over a second or more.

use super::mount::{ImuMount, Mount, Pushes, Turns, UPRIGHT_COS};
use super::predict::Step;
use super::span::Span;
use super::speed::{Push, Velocity};
use super::sweep_motion::SweepMotion;
use mapwright_geom::{Pose3, Stamp, Stored, is_covariance, is_in_place, stored};
use mapwright_record::Session;
use mapwright_sensor::{
    Down, DownEstimate, ImuReading, ImuReadings, ImuTaken, SpaceSweep, TURN_NOISE_RAD2_PER_S, Turned, in_metres,
};
use nalgebra::{Matrix3, UnitQuaternion, Vector3, Vector6};

/// Bias of a gyroscope that nothing is known of, standard deviation, radians a second: 1.1 degrees, as of cheap ones.
const BIAS_SIGMA_RAD_PER_S: f64 = 0.02;
/// No bias is larger than a robot turns, radians a second.
const LARGEST_BIAS_RAD_PER_S: f64 = 100.0;
/// How fast its variance grows with time, (rad/s)^2 a second: 0.1 degrees a second in a quarter of an hour, as when one warms up.
const BIAS_WALK_PER_S: f64 = 1e-9;
/// Scale and mount of a gyroscope are wrong by so much of what it turns by,
const SCALE_SHARE: f64 = 0.01;
/// and a rotation between two clouds by so much at least, radians: stamps.
const LEAST_RAD: f64 = 0.002;
/// Time that nothing was read of: the rate may change by so much, radians per second squared.
const UNREAD_RAD_PER_S2: f64 = 20.0;
/// Rotations of matches are wrong by so much, standard deviation, radians.
const MATCH_RAD: f64 = 0.003;
/// Matches and readings are compared over so long to learn the bias, seconds.
const LEARNT_S: f64 = 1.0;
/// Readings and a match agree up to this chi-square with three degrees of freedom, five standard deviations.
const AGREEING_CHI2: f64 = 25.0;
/// Each cloud that agrees counts one, each that does not three, between zero and the most; readings are made use of from the least on.
const TRUST_LOST: u32 = 3;
const TRUST_AT_MOST: u32 = 12;
const TRUST_AT_LEAST: u32 = 3;
/// and once clouds that agree have turned by so much in all, radians, of which those count that turn by more than noise and bias make up.
const PROVEN_RAD: f64 = 0.4;
const TELLING_RAD: f64 = 0.03;
/// A robot is pushed by so much besides gravity while nothing tells of it, standard deviation, metres per second squared,
const PUSHED_M_PER_S2: f64 = 0.5;
/// and by so much besides what matches say of its velocities: these are some 0.05 m/s wrong, whatever their number on the way.
const MATCHED_M_PER_S2: f64 = 0.15;
/// A velocity is that of so long at least, seconds: over less it is mostly the matches' noise.
const VELOCITY_S: f64 = 0.35;
/// A direction of gravity is written down when it is known so well, radians: after a second on the way.
const WRITTEN_RAD: f64 = 0.012;
/// Over longer times readings are not followed, seconds.
const FOLLOWED_S: f64 = 5.0;
/// Clouds of two sensors were taken at once where less than this share of the time between two of one lies between them.
const AT_ONCE_SHARE: f64 = 0.25;
/// How the robot may have turned in a time that nothing was read of, radians a second.
const UNKNOWN_RAD_PER_S: f64 = 1.0;

/// What became of the readings of an inertial sensor.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ImuReport {
    /// Readings that were handed in.
    pub readings: u64,
    /// Of those, left out: not finite, or beyond 100 rad/s or 50 g;
    pub unsound: u64,
    /// and those beyond 100 rad/s while matches had not told the unit: sound where [`ImuMount::in_degrees`] says so in the end, else none.
    pub too_fast: u64,
    /// Left out: what they tell of had been mapped.
    pub late: u64,
    /// More than a second older than the newest before, which were forgotten.
    pub set_back: u64,
    /// Pieces between readings whose force was too far from gravity to say where down is.
    pub pushed: u64,
    /// Clouds whose rotation was predicted by readings.
    pub predicted: u64,
    /// Clouds that came without enough readings since the one before.
    pub unread: u64,
    /// Matches that contradicted the readings.
    pub contradicted: u64,
    /// Directions of gravity that were written down.
    pub gravity: u64,
    /// How the sensor sits and reads, where matches say that it is not as was told.
    pub mount: ImuMount,
    /// The gyroscope's bias, radians a second about the robot's axes,
    pub bias_rad_per_s: [f64; 3],
    /// and its standard deviation about the axis about which it is known least.
    pub bias_sigma_rad_per_s: f64,
}

/// What is remembered of readings.
#[derive(Debug, Clone)]
pub(super) struct Inertial {
    readings: ImuReadings,
    bias: Bias,
    down: Down,
    /// Up to where readings tell of it.
    down_until: Option<Stamp>,
    /// The robot's velocity then, in its frame, by matches, metres a second.
    velocity_m_per_s: Option<Vector3<f64>>,
    /// The way since a stamp, for the next velocity.
    way: Option<(Stamp, Pose3)>,
    /// The middle of the last cloud, and of the one before.
    last: Option<Stamp>,
    before_last: Option<Stamp>,
    /// How the robot has moved since then by clouds of other sensors that were taken at once with it, where there were any; none within
    /// where one of them does not know.
    back: Option<Option<Pose3>>,
    /// Whether the present cloud is such a one.
    is_back: bool,
    /// Since then, as read.
    turned: Option<Turned>,
    /// What readings and matches say since the bias was learnt last.
    since: (Turned, UnitQuaternion<f64>),
    trust: u32,
    proven_rad: f64,
    /// The robot's velocity at the last cloud, what has pushed it since, and what it is by both at the present one.
    velocity: Option<Velocity>,
    push: Option<Push>,
    velocity_now: Option<Velocity>,
    /// How the sensor sits and reads, and what tells of that.
    mount: Mount,
    turns: Turns,
    pushes: Pushes,
    /// How it has turned since the last cloud as read, rotation vectors added up; the bias is in it.
    read_rad: Vector3<f64>,
    /// From the robot at the last cloud to a frame that does not turn, by matches.
    steady_from_last: UnitQuaternion<f64>,
    report: ImuReport,
}

impl Default for Inertial {
    fn default() -> Self {
        Self {
            readings: ImuReadings::default(),
            bias: Bias::default(),
            down: Down::default(),
            down_until: None,
            velocity_m_per_s: None,
            way: None,
            last: None,
            before_last: None,
            back: None,
            is_back: false,
            turned: None,
            since: (Turned::none(), UnitQuaternion::identity()),
            trust: 0,
            proven_rad: 0.0,
            velocity: None,
            push: None,
            velocity_now: None,
            mount: Mount::default(),
            turns: Turns::default(),
            pushes: Pushes::default(),
            read_rad: Vector3::zeros(),
            steady_from_last: UnitQuaternion::identity(),
            report: ImuReport::default(),
        }
    }
}

stored!(Bias { rad_per_s, covariance });

impl Inertial {
    /// Between two clouds; what was counted is the run's own and is not kept.
    pub(super) fn put(&self, out: &mut Vec<u8>) {
        let Self { readings, bias, down, down_until, velocity_m_per_s, way, last, before_last, .. } = self;
        readings.put(out);
        bias.put(out);
        down.put(out);
        [*down_until, *last, *before_last].put(out);
        velocity_m_per_s.put(out);
        way.put(out);
        self.turned.put(out);
        self.since.put(out);
        self.trust.put(out);
        self.proven_rad.put(out);
        self.velocity.put(out);
        self.mount.put(out);
        self.turns.put(out);
        self.pushes.put(out);
        (self.read_rad, self.steady_from_last).put(out);
    }

    /// Of robots with several sensors: the motion by clouds that were taken at once with another.
    pub(super) fn put_back(&self, out: &mut Vec<u8>) {
        self.back.put(out);
    }

    /// The same with that.
    pub(super) fn take_back(self, from: &mut &[u8]) -> Option<Self> {
        let back: Option<Option<Pose3>> = Stored::take(from)?;
        Some(Self { back: back.filter(|back| back.is_none_or(is_in_place)), ..self })
    }

    /// One that goes on as it was.
    pub(super) fn restore(from: &mut &[u8]) -> Option<Self> {
        let (readings, bias, down) = Stored::take(from)?;
        let [down_until, last, before_last]: [Option<Stamp>; 3] = Stored::take(from)?;
        let (velocity_m_per_s, way): (_, Option<(Stamp, Pose3)>) = Stored::take(from)?;
        let (turned, since) = Stored::take(from)?;
        let (trust, proven_rad): (u32, f64) = Stored::take(from)?;
        let velocity: Option<Velocity> = Stored::take(from)?;
        velocity.as_ref().is_none_or(Velocity::is_sound).then_some(())?;
        let mount: Mount = Stored::take(from)?;
        let (turns, pushes) = (Stored::take(from)?, Stored::take(from)?);
        let (read_rad, steady_from_last) = Stored::take(from)?;
        let is_way = way.is_none_or(|(since, way)| {
            let elapsed_s = last.map_or(0.0, |last| last.secs_since(since));
            elapsed_s > 0.0 && elapsed_s < VELOCITY_S && is_in_place(way)
        });
        let is_trust = trust <= TRUST_AT_MOST && (0.0..f64::INFINITY).contains(&proven_rad);
        let report = ImuReport { mount: mount.told(), ..ImuReport::default() };
        let restored = Self {
            readings,
            bias,
            down,
            down_until,
            velocity_m_per_s,
            way,
            last,
            before_last,
            back: None,
            is_back: false,
            turned,
            since,
            trust,
            proven_rad,
            velocity,
            push: None,
            velocity_now: None,
            mount,
            turns,
            pushes,
            read_rad,
            steady_from_last,
            report,
        };
        (restored.bias.is_sound() && is_way && is_trust).then_some(restored)
    }

    pub(super) fn add(&mut self, told: ImuReading) -> ImuTaken {
        let reading = ImuReading {
            turn_rate_rad_per_s: self.mount.rate(told.turn_rate_rad_per_s),
            specific_force_m_per_s2: told.specific_force_m_per_s2.map(|force| self.mount.force(force)),
            ..told
        };
        // Where matches have told the unit no reading is in another.
        let is_unit_known = self.mount.in_degrees || self.is_trusted();
        let taken = match reading.is_too_fast() && is_unit_known {
            true => ImuTaken::Unsound,
            false => self.readings.add(reading),
        };
        self.report.too_fast += u64::from(reading.is_too_fast() && taken != ImuTaken::Unsound);
        self.report.readings += 1;
        told.specific_force_m_per_s2.iter().for_each(|force| self.turns.hold(*force));
        match taken {
            ImuTaken::Kept => {}
            ImuTaken::Unsound => self.report.unsound += 1,
            ImuTaken::Late => self.report.late += 1,
            ImuTaken::SetBack => self.report.set_back += 1,
        }
        taken
    }

    pub(super) fn report(&self) -> ImuReport {
        let bias_sigma_rad_per_s = self.bias.sigma_rad_per_s();
        ImuReport { bias_rad_per_s: self.bias.rad_per_s.into(), bias_sigma_rad_per_s, ..self.report }
    }

    fn is_trusted(&self) -> bool {
        self.trust >= TRUST_AT_LEAST && self.proven_rad >= PROVEN_RAD
    }

    /// The step with the rotation that was read, if readings are there and believed; `now` is the middle of the cloud.
    pub(super) fn predict(&mut self, step: Step, now: Stamp) -> Step {
        if self.readings.is_empty() {
            return step;
        }
        if self.last.is_none() {
            self.follow_down(now, None);
        }
        // Sensors may sweep at once: over the time between two such clouds a match says nothing of a speed.
        let least_s = AT_ONCE_SHARE * step.own_elapsed_s;
        self.is_back = step.is_beside && self.last.is_some_and(|last| now.secs_since(last) < least_s);
        if self.is_back {
            return step;
        }
        let turned = self.last.and_then(|last| self.readings.turned(last, now, self.bias.rad_per_s));
        self.report.unread += u64::from(self.last.is_some() && turned.is_none());
        self.turned = turned;
        let read =
            |last: Stamp| self.readings.pieces(last, now).map(|piece| piece.turn_rate_rad_per_s * piece.elapsed_s);
        self.read_rad = self.last.map_or(Vector3::zeros(), |last| read(last).sum());
        self.push = self.last.zip(turned).and_then(|(last, turned)| self.pushed(last, now, turned.start_from_end));
        self.velocity_now = self.push.zip(self.velocity).map(|(push, velocity)| push.after(velocity));
        self.before_last = self.last.replace(now);
        self.readings.use_until(now);
        let Some(turned) = turned else { return step };
        if !self.is_trusted() {
            return Step { read: Some(turned.start_from_end), ..step };
        }
        let Some(information) = self.covariance(&turned).try_inverse() else { return step };
        self.report.predicted += 1;
        let turning = step.turning(turned.start_from_end, &information);
        let way = self.push.zip(self.velocity).map(|(push, velocity)| push.way(velocity));
        way.map_or(turning, |(way_m, sigma_m)| turning.pushed(way_m, sigma_m))
    }

    /// What has pushed the robot since a stamp up to which its turning is known, where it is known where down is.
    fn pushed(&self, last: Stamp, now: Stamp, start_from_end: UnitQuaternion<f64>) -> Option<Push> {
        let mut down = self.down;
        let until = self.down_until.filter(|until| self.knows_down() && *until <= last)?;
        if until < last {
            let turned = self.readings.turned(until, last, self.bias.rad_per_s)?;
            down.turn(turned.start_from_end.scaled_axis(), turned.elapsed_s, self.bias.sigma_rad_per_s());
        }
        let down = down.estimate()?;
        let pushed = self.readings.pushed([last, now], self.bias.rad_per_s, down.down_in_robot)?;
        Some(Push { pushed, start_from_end, down_sigma_rad: down.sigma_rad })
    }

    /// The robot's velocity in the middle of the present cloud, before that is matched.
    pub(super) fn velocity_now(&self) -> Option<Velocity> {
        self.velocity_now
    }

    /// How uncertain a turn rate is, readings averaged over so long, radians a second.
    pub(super) fn turn_sigma_rad_per_s(&self, elapsed_s: f64) -> f64 {
        (self.bias.covariance.diagonal().max() + TURN_NOISE_RAD2_PER_S / elapsed_s.max(1e-3)).sqrt()
    }

    /// Of the rotation's right perturbation: noise, bias, scale, and what was not read, rad^2.
    fn covariance(&self, turned: &Turned) -> Matrix3<f64> {
        let scale_rad = SCALE_SHARE * turned.start_from_end.angle();
        let unread_rad = 0.5 * UNREAD_RAD_PER_S2 * turned.unread_s * turned.unread_s;
        let even_rad2 = LEAST_RAD * LEAST_RAD
            + scale_rad * scale_rad
            + unread_rad * unread_rad
            + TURN_NOISE_RAD2_PER_S * turned.elapsed_s;
        turned.by_bias_s * self.bias.covariance * turned.by_bias_s.transpose() + Matrix3::identity() * even_rad2
    }

    /// How the robot moves during a sweep: its velocity as it was, its turning as read where that is believed; whether it is.
    pub(super) fn shape(
        &self,
        twist_per_s: Option<Vector6<f64>>,
        stamp: Stamp,
        span: Span,
        motion: &mut SweepMotion,
    ) -> bool {
        let [first, last] = [span.first_s, span.last_s].map(|after_s| span.stamp_after(stamp, after_s));
        let bias = self.bias.rad_per_s;
        if self.is_trusted() && self.readings.turned(first, last, bias).is_some() {
            let carried = || twist_per_s.map_or(Vector3::zeros(), |twist| twist.fixed_rows::<3>(0).into_owned());
            let velocity = self.velocity_now.map_or_else(carried, |velocity| velocity.m_per_s);
            motion.turn(self.readings.pieces(first, last), bias, velocity, span);
            return true;
        }
        match twist_per_s {
            Some(twist_per_s) => motion.carry_on(twist_per_s, span),
            None => motion.forget(),
        }
        false
    }

    /// How a match says that the robot moved since the last cloud, if it is believed: readings are compared with it.
    pub(super) fn learn(&mut self, moved: Option<Pose3>) {
        if self.is_back {
            let before = self.back.unwrap_or(Some(Pose3::identity()));
            self.back = Some(before.zip(moved).map(|(before, moved)| before * moved));
            return;
        }
        let moved = match self.back.take() {
            Some(before) => before.zip(moved).map(|(before, moved)| before * moved),
            None => moved,
        };
        let compared = self.turned.take().zip(moved);
        self.velocity = self.push.take().and_then(|push| {
            let known = moved.map_or(self.velocity, |moved| Some(push.learn(self.velocity, moved.translation)));
            known.map(|known| push.after(known))
        });
        self.steady_from_last *= moved.map_or_else(UnitQuaternion::identity, |moved| moved.rotation);
        self.weigh_forces(compared.map(|(_, moved)| moved));
        let Some((turned, moved)) = compared else {
            self.forget_since();
            return;
        };
        self.turns.add(&self.mount, self.read_rad, moved.rotation.scaled_axis());
        let off = (turned.start_from_end.inverse() * moved.rotation).scaled_axis();
        let covariance = self.covariance(&turned) + Matrix3::identity() * (2.0 * MATCH_RAD * MATCH_RAD);
        let agrees = covariance.try_inverse().is_some_and(|information| off.dot(&(information * off)) <= AGREEING_CHI2);
        if !agrees {
            self.report.contradicted += 1;
            self.trust = self.trust.saturating_sub(TRUST_LOST);
            self.proven_rad = 0.0;
            self.forget_since();
            if let Some(other) = self.turns.other(&self.mount) {
                self.sits(other);
            }
            return;
        }
        self.trust = (self.trust + 1).min(TRUST_AT_MOST);
        let angle_rad = turned.start_from_end.angle();
        self.proven_rad += if angle_rad >= TELLING_RAD { angle_rad } else { 0.0 };
        let (read, matched) = self.since;
        self.since = (read.then(turned), matched * moved.rotation);
        if self.since.0.elapsed_s >= LEARNT_S {
            self.bias.learn(&self.since.0, self.since.1);
            self.forget_since();
        }
    }

    /// The sensor sits and reads otherwise than was thought; it has to be borne out anew.
    fn sits(&mut self, mount: Mount) {
        let Self { turns, report, last, before_last, steady_from_last, .. } = self;
        let report = ImuReport { mount: mount.told(), ..*report };
        let pushes = if mount.forces_down == self.mount.forces_down { Pushes::default() } else { self.pushes };
        let (turns, last, before_last, steady_from_last) = (*turns, *last, *before_last, *steady_from_last);
        *self = Self { mount, turns, pushes, last, before_last, steady_from_last, report, ..Self::default() };
    }

    fn forget_since(&mut self) {
        self.since = (Turned::none(), UnitQuaternion::identity());
    }

    /// Follows where down is: to the middle of some way, where the velocity is what matches say of all of it, the acceleration since the
    /// middle of the way before known thereby; and to the last cloud where nothing matched.
    fn weigh_forces(&mut self, moved: Option<Pose3>) {
        let Some(last) = self.last else { return };
        let Some((moved, before)) = moved.zip(self.before_last) else {
            (self.velocity_m_per_s, self.way) = (None, None);
            self.pushes.break_off();
            return self.follow_down(last, None);
        };
        let (since, way) = self.way.map_or((before, moved), |(since, way)| (since, way * moved));
        let elapsed_s = last.secs_since(since);
        self.way = (elapsed_s < VELOCITY_S).then_some((since, way));
        if self.way.is_some() {
            return;
        }
        let middle = Stamp(since.0 + (last.0 - since.0) / 2);
        let velocity = way.log().fixed_rows::<3>(0) / elapsed_s;
        let since = self.down_until.zip(self.velocity_m_per_s);
        let push = since.and_then(|(since, velocity_then)| {
            let turned = self.readings.turned(since, middle, self.bias.rad_per_s)?;
            Some((turned.start_from_end * velocity - velocity_then) / turned.elapsed_s)
        });
        if let Some(push) = push.filter(|_| self.is_trusted()) {
            self.weigh_sign(middle, last, push);
        }
        self.follow_down(middle, push);
        self.velocity_m_per_s = Some(velocity);
        if self.pushes.take_reversed() {
            self.sits(Mount { forces_down: !self.mount.forces_down, ..self.mount });
        }
    }

    /// The mean force since down was followed, up to a stamp before the last cloud's, beside the acceleration by matches, in the robot's
    /// frame then.
    fn weigh_sign(&mut self, middle: Stamp, last: Stamp, push_m_per_s2: Vector3<f64>) {
        let Some(since) = self.down_until else { return };
        let (mut sum, mut elapsed_s) = (Vector3::zeros(), 0.0);
        for piece in self.readings.pieces(since, middle) {
            let turn = (piece.turn_rate_rad_per_s - self.bias.rad_per_s) * piece.elapsed_s;
            sum = UnitQuaternion::from_scaled_axis(-turn) * sum;
            let Some(force) = piece.specific_force_m_per_s2 else { return self.pushes.break_off() };
            sum += in_metres(force) * piece.elapsed_s;
            elapsed_s += piece.elapsed_s;
        }
        let turned = self.readings.turned(middle, last, self.bias.rad_per_s);
        let Some(turned) = turned.filter(|_| elapsed_s > 0.0) else { return self.pushes.break_off() };
        let steady_from_middle = self.steady_from_last * turned.start_from_end.inverse();
        self.pushes.add(steady_from_middle * (sum / elapsed_s), steady_from_middle * push_m_per_s2);
    }

    /// Whether forces are known to say where down is: they say that the robot stands as its axes do, or accelerations bear them out.
    fn knows_down(&self) -> bool {
        let is_upright = self.down.estimate().is_some_and(|down| -down.down_in_robot.z > UPRIGHT_COS);
        self.is_trusted() && self.pushes.is_borne_out(is_upright)
    }

    /// Follows where down is to a stamp; the acceleration until then is that, in the frame of where it was followed to, if it is known.
    fn follow_down(&mut self, now: Stamp, push_m_per_s2: Option<Vector3<f64>>) {
        let Some(since) = self.down_until.or(self.readings.oldest()) else { return };
        let behind_s = now.secs_since(since);
        let since = if (0.0..=FOLLOWED_S).contains(&behind_s) {
            since
        } else {
            self.down = Down::default();
            self.readings
                .oldest()
                .map_or(now, |oldest| oldest.max(Stamp(now.0.saturating_sub((FOLLOWED_S * 1e9) as i64))))
        };
        self.down_until = Some(now);
        let bias_sigma = self.bias.sigma_rad_per_s();
        let sigma_m_per_s2 = if push_m_per_s2.is_some() { MATCHED_M_PER_S2 } else { PUSHED_M_PER_S2 };
        let mut push = push_m_per_s2.unwrap_or_else(Vector3::zeros);
        for piece in self.readings.pieces(since, now) {
            let rate = piece.turn_rate_rad_per_s - self.bias.rad_per_s;
            let sigma = if piece.is_read { bias_sigma } else { UNKNOWN_RAD_PER_S };
            self.down.turn(rate * piece.elapsed_s, piece.elapsed_s, sigma);
            push = UnitQuaternion::from_scaled_axis(-rate * piece.elapsed_s) * push;
            if let Some(force) = piece.specific_force_m_per_s2 {
                self.report.pushed += u64::from(!self.down.weigh(force, push, sigma_m_per_s2, piece.elapsed_s));
            }
        }
    }

    /// Where down is by what was read since this was asked and known the last time, so that errors of two have nothing to do with each
    /// other; none until it is known well enough.
    pub(super) fn take_down(&mut self) -> Option<DownEstimate> {
        self.down.estimate().filter(|down| down.sigma_rad <= WRITTEN_RAD && self.knows_down())?;
        let mut down = std::mem::take(&mut self.down);
        if let Some((until, last)) = self.down_until.zip(self.last).filter(|(until, last)| until < last) {
            let turned = self.readings.turned(until, last, self.bias.rad_per_s)?;
            let sigma = self.bias.sigma_rad_per_s();
            down.turn(turned.start_from_end.scaled_axis(), turned.elapsed_s, sigma);
        }
        let known = down.estimate()?;
        self.report.gravity += 1;
        Some(known)
    }
}

/// A gyroscope's bias about the robot's axes, as matches tell it.
#[derive(Debug, Clone, Copy)]
struct Bias {
    rad_per_s: Vector3<f64>,
    covariance: Matrix3<f64>,
}

impl Default for Bias {
    fn default() -> Self {
        let variance = BIAS_SIGMA_RAD_PER_S * BIAS_SIGMA_RAD_PER_S;
        Self { rad_per_s: Vector3::zeros(), covariance: Matrix3::identity() * variance }
    }
}

impl Bias {
    /// Whether it can be one of what was learnt.
    fn is_sound(&self) -> bool {
        let most = LARGEST_BIAS_RAD_PER_S.powi(2);
        let is_known = is_covariance(&self.covariance) && self.covariance.diagonal().max() <= most;
        is_known && self.rad_per_s.norm() <= LARGEST_BIAS_RAD_PER_S
    }

    fn sigma_rad_per_s(&self) -> f64 {
        self.covariance.diagonal().max().sqrt()
    }

    /// A rotation as read with the present bias, and as matches say that it was: a Kalman filter's measurement. One that differs by
    /// more than can be is left out.
    fn learn(&mut self, read: &Turned, matched: UnitQuaternion<f64>) {
        let off = (read.start_from_end.inverse() * matched).scaled_axis();
        let scale_rad = SCALE_SHARE * read.start_from_end.angle();
        let noise_rad2 = 2.0 * MATCH_RAD * MATCH_RAD + scale_rad * scale_rad + TURN_NOISE_RAD2_PER_S * read.elapsed_s;
        self.covariance += Matrix3::identity() * (BIAS_WALK_PER_S * read.elapsed_s);
        let carried = read.by_bias_s * self.covariance;
        let innovation = carried * read.by_bias_s.transpose() + Matrix3::identity() * noise_rad2;
        let Some(information) = innovation.try_inverse() else { return };
        if off.dot(&(information * off)) > AGREEING_CHI2 {
            return;
        }
        let gain = carried.transpose() * information;
        self.rad_per_s += gain * off;
        let left = self.covariance - gain * carried;
        self.covariance = (left + left.transpose()) * 0.5;
    }
}

/// So many directions of gravity are weighed together, the newest,
const WEIGHED: usize = 10;
/// at least so many since the map was levelled the last time.
const WEIGHED_AT_LEAST: usize = 5;
/// The map leans when the mean of what they say is this unlikely: the 99 % quantile of chi-square with two degrees of freedom.
const LEANING_CHI2: f64 = 9.21;

/// Whether directions of gravity say together that the map leans.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct LevelWatch {
    levelled_at: usize,
}
stored!(LevelWatch { levelled_at });

impl LevelWatch {
    /// Whether it may have watched this session.
    pub(crate) fn is_of(&self, session: &Session<SpaceSweep>) -> bool {
        self.levelled_at <= session.gravity().len()
    }

    /// Asked whenever a direction was written down; true at most once for every five.
    pub(crate) fn is_leaning(&mut self, session: &Session<SpaceSweep>) -> bool {
        let gravity = session.gravity();
        if gravity.len() < self.levelled_at + WEIGHED_AT_LEAST {
            return false;
        }
        let newest = gravity.iter().rev().take(WEIGHED);
        let errors = newest.filter_map(|known| {
            let map_from_keyframe = session.map_from_keyframe().get(session.place(known.keyframe)?)?;
            let leaning = map_from_keyframe.rotation * Vector3::from(known.down_in_keyframe);
            Some(leaning.xy() / known.sigma_rad)
        });
        let (sum, count) = errors.fold((nalgebra::Vector2::zeros(), 0), |(sum, count), error| (sum + error, count + 1));
        let leans = sum.norm_squared() > LEANING_CHI2 * f64::from(count);
        if leans {
            self.levelled_at = gravity.len();
        }
        leans
    }
}
