//! Inertial readings in space: how the robot turned between two stamps, and where down is.

use mapwright_geom::{Stamp, Stored, stored};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use std::collections::VecDeque;

mod down;

pub use down::{Down, DownEstimate, STANDARD_GRAVITY_M_PER_S2, TURN_NOISE_RAD2_PER_S, in_metres};

/// Readings that are kept: four seconds at a thousand a second.
const READINGS: usize = 4096;
/// No robot turns as fast, radians a second.
const FASTEST_RAD_PER_S: f64 = 100.0;
/// No robot is pushed as hard, 50 times its weight, metres per second squared.
const HARDEST_M_PER_S2: f64 = 500.0;
/// Time between readings farther apart counts as not read, seconds.
const JOINED_S: f64 = 0.1;
/// A reading that is so much older than the newest says that the clock was set back, seconds.
const SET_BACK_S: f64 = 1.0;
/// Motion over more than this is not made of readings, seconds.
const LONGEST_S: f64 = 5.0;
/// Of a time at most this share may be unread.
const UNREAD_SHARE: f64 = 0.5;

/// A reading of an inertial sensor, turned by its mount.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuReading {
    /// When.
    pub stamp: Stamp,
    /// Angular velocity about the robot's axes, radians a second.
    pub turn_rate_rad_per_s: Vector3<f64>,
    /// Specific force along the robot's axes, metres per second squared: at rest g upwards. None where there is no accelerometer.
    pub specific_force_m_per_s2: Option<Vector3<f64>>,
}

impl ImuReading {
    /// Whether it can be: finite, within 50 g, and within 100 rad/s were its turn rate in degrees a second, which only matches tell.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        let force = self.specific_force_m_per_s2.unwrap_or_else(Vector3::zeros);
        // not `>`: NaN must fail
        self.turn_rate_rad_per_s.norm() <= FASTEST_RAD_PER_S.to_degrees() && force.norm() <= HARDEST_M_PER_S2
    }
}

impl ImuReading {
    /// Whether it turns as fast as no robot does, 100 rad/s, where its turn rate is in radians.
    #[must_use]
    pub fn is_too_fast(&self) -> bool {
        self.turn_rate_rad_per_s.norm() > FASTEST_RAD_PER_S
    }
}

/// What became of a reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImuTaken {
    /// Kept, in its place by stamp.
    Kept,
    /// Left out: not finite, or beyond 100 rad/s in whatever unit, or 50 g.
    Unsound,
    /// Left out: the time that it belongs to has been made use of.
    Late,
    /// Kept; it is more than a second older than the newest before it, which were forgotten.
    SetBack,
}

/// The motion of a time between or around readings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuPiece {
    /// Its middle, after the start that was asked for, seconds.
    pub middle_s: f64,
    /// How long it is, seconds.
    pub elapsed_s: f64,
    /// Mean angular velocity as read, radians a second.
    pub turn_rate_rad_per_s: Vector3<f64>,
    /// Mean specific force, where there are readings on both sides with one, metres per second squared.
    pub specific_force_m_per_s2: Option<Vector3<f64>>,
    /// Whether readings surround it closely.
    pub is_read: bool,
}

/// How the robot turned between two stamps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turned {
    /// Its rotation then, seen from before.
    pub start_from_end: UnitQuaternion<f64>,
    /// Derivative of the rotation's right perturbation by the gyroscope's bias, seconds (Forster et al. 2017, "On-manifold
    /// preintegration for real-time visual-inertial odometry", eq. 44).
    pub by_bias_s: Matrix3<f64>,
    /// How long it took, seconds.
    pub elapsed_s: f64,
    /// For how much of that nothing was read, seconds.
    pub unread_s: f64,
}

impl Turned {
    /// No turn in no time.
    #[must_use]
    pub fn none() -> Self {
        let start_from_end = UnitQuaternion::identity();
        Self { start_from_end, by_bias_s: Matrix3::zeros(), elapsed_s: 0.0, unread_s: 0.0 }
    }

    /// This, and what comes after it.
    #[must_use]
    pub fn then(self, next: Self) -> Self {
        let back = next.start_from_end.inverse().to_rotation_matrix();
        let mut start_from_end = self.start_from_end * next.start_from_end;
        start_from_end.renormalize_fast();
        Self {
            start_from_end,
            by_bias_s: back.matrix() * self.by_bias_s + next.by_bias_s,
            elapsed_s: self.elapsed_s + next.elapsed_s,
            unread_s: self.unread_s + next.unread_s,
        }
    }
}

/// How the robot moved between two stamps by what pushed it, as if it had stood at the first (Forster et al. 2017, eq. 33).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pushed {
    /// Its way, in its frame at the first stamp, metres.
    pub way_m: Vector3<f64>,
    /// Its velocity at the second one, in the same frame, metres a second.
    pub velocity_m_per_s: Vector3<f64>,
    /// How long it took, seconds.
    pub elapsed_s: f64,
}

/// A time that is none of a rotation's, seconds: longer than whatever is put together.
const PUT_TOGETHER_S: f64 = 3600.0;

impl Stored for Turned {
    fn put(&self, out: &mut Vec<u8>) {
        (self.start_from_end, self.by_bias_s, self.elapsed_s, self.unread_s).put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        let (start_from_end, by_bias_s, elapsed_s, unread_s) = Stored::take(from)?;
        let is_time = |seconds: f64| (0.0..=PUT_TOGETHER_S).contains(&seconds);
        (is_time(elapsed_s) && is_time(unread_s)).then_some(Self { start_from_end, by_bias_s, elapsed_s, unread_s })
    }
}

stored!(ImuReading { stamp, turn_rate_rad_per_s, specific_force_m_per_s2 });

impl Stored for ImuReadings {
    fn put(&self, out: &mut Vec<u8>) {
        self.readings.put(out);
        self.used_until.put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        let (readings, used_until): (VecDeque<ImuReading>, _) = Stored::take(from)?;
        let in_order = readings.iter().zip(readings.iter().skip(1)).all(|(a, b)| a.stamp < b.stamp);
        let are_sound = readings.len() <= READINGS && readings.iter().all(ImuReading::is_sound);
        (in_order && are_sound).then_some(Self { readings, used_until, ..Self::default() })
    }
}

/// The last readings, in the order of their stamps.
#[derive(Debug, Clone)]
pub struct ImuReadings {
    readings: VecDeque<ImuReading>,
    used_until: Option<Stamp>,
    /// So many are kept.
    most: usize,
}

impl Default for ImuReadings {
    /// The last 4096.
    fn default() -> Self {
        Self::keeping(READINGS)
    }
}

impl ImuReadings {
    /// Keeps so many.
    #[must_use]
    pub fn keeping(most: usize) -> Self {
        Self { readings: VecDeque::new(), used_until: None, most }
    }

    /// How many are kept.
    #[must_use]
    pub fn len(&self) -> usize {
        self.readings.len()
    }

    /// Keeps a reading in its place; of two of the same time the second counts.
    pub fn add(&mut self, reading: ImuReading) -> ImuTaken {
        if !reading.is_sound() {
            return ImuTaken::Unsound;
        }
        let behind_s = self.readings.back().map_or(0.0, |newest| newest.stamp.secs_since(reading.stamp));
        if behind_s > SET_BACK_S {
            self.readings.clear();
            self.used_until = None;
            self.readings.push_back(reading);
            return ImuTaken::SetBack;
        }
        if self.used_until.is_some_and(|used| reading.stamp < used) {
            return ImuTaken::Late;
        }
        let place = self.readings.partition_point(|known| known.stamp < reading.stamp);
        match self.readings.get_mut(place).filter(|known| known.stamp == reading.stamp) {
            Some(same) => *same = reading,
            None => self.readings.insert(place, reading),
        }
        if self.readings.len() > self.most {
            self.readings.pop_front();
        }
        ImuTaken::Kept
    }

    /// Readings before this stamp have served: others of that time are late.
    pub fn use_until(&mut self, stamp: Stamp) {
        self.used_until = Some(stamp);
    }

    /// Whether nothing was read.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.readings.is_empty()
    }

    /// The stamp of the oldest reading.
    #[must_use]
    pub fn oldest(&self) -> Option<Stamp> {
        self.readings.front().map(|reading| reading.stamp)
    }

    /// The pieces of a time, in order, from reading to reading; before the first and after the last reading the nearest one holds.
    /// None of an empty time, and where there are no readings.
    pub fn pieces(&self, start: Stamp, end: Stamp) -> impl Iterator<Item = ImuPiece> + '_ {
        let first = self.readings.partition_point(|reading| reading.stamp <= start);
        let last = self.readings.partition_point(|reading| reading.stamp < end).max(first);
        let is_empty = self.readings.is_empty() || end <= start;
        let knot = move |k: usize| self.readings.get(k).map_or(end, |reading| reading.stamp);
        (first..if is_empty { first } else { last + 1 }).filter_map(move |k| {
            let from = if k == first { start } else { knot(k - 1) };
            let until = if k == last { end } else { knot(k) };
            self.piece(k, start, [from, until])
        })
    }

    /// The piece that ends with reading `next` or before.
    fn piece(&self, next: usize, start: Stamp, [from, until]: [Stamp; 2]) -> Option<ImuPiece> {
        let elapsed_s = until.secs_since(from);
        let (before, after) = (next.checked_sub(1).and_then(|k| self.readings.get(k)), self.readings.get(next));
        let nearest = before.or(after).filter(|_| elapsed_s > 0.0)?;
        let middle_s = from.secs_since(start) + 0.5 * elapsed_s;
        let held = ImuPiece {
            middle_s,
            elapsed_s,
            turn_rate_rad_per_s: nearest.turn_rate_rad_per_s,
            specific_force_m_per_s2: None,
            is_read: false,
        };
        let Some((before, after)) = before.zip(after) else { return Some(held) };
        let apart_s = after.stamp.secs_since(before.stamp);
        let share = (start.secs_since(before.stamp) + middle_s) / apart_s;
        let forces = before.specific_force_m_per_s2.zip(after.specific_force_m_per_s2);
        let is_read = apart_s <= JOINED_S;
        Some(ImuPiece {
            turn_rate_rad_per_s: before.turn_rate_rad_per_s.lerp(&after.turn_rate_rad_per_s, share),
            specific_force_m_per_s2: forces.filter(|_| is_read).map(|(a, b)| a.lerp(&b, share)),
            is_read,
            ..held
        })
    }

    /// How the robot turned, the bias (radians a second) taken off; none where less than half of the time was read, over no time,
    /// and over more than 5 s.
    #[must_use]
    pub fn turned(&self, start: Stamp, end: Stamp, bias_rad_per_s: Vector3<f64>) -> Option<Turned> {
        let elapsed_s = end.secs_since(start);
        if !(elapsed_s > 0.0 && elapsed_s <= LONGEST_S) {
            return None;
        }
        let turned = self.pieces(start, end).map(|piece| {
            let turn = (piece.turn_rate_rad_per_s - bias_rad_per_s) * piece.elapsed_s;
            Turned {
                start_from_end: UnitQuaternion::from_scaled_axis(turn),
                by_bias_s: Matrix3::identity() * -piece.elapsed_s,
                elapsed_s: piece.elapsed_s,
                unread_s: if piece.is_read { 0.0 } else { piece.elapsed_s },
            }
        });
        let turned = turned.reduce(Turned::then)?;
        (turned.unread_s <= UNREAD_SHARE * elapsed_s).then_some(turned)
    }
}

impl ImuReadings {
    /// How the robot was pushed besides by gravity, which points down at the first stamp in its frame then (of length one); none where some
    /// of the time was not read, and over more than 5 s.
    #[must_use]
    pub fn pushed(
        &self,
        [start, end]: [Stamp; 2],
        bias_rad_per_s: Vector3<f64>,
        down_in_start: Vector3<f64>,
    ) -> Option<Pushed> {
        let elapsed_s = end.secs_since(start);
        if !(elapsed_s > 0.0 && elapsed_s <= LONGEST_S) {
            return None;
        }
        let mut start_from_robot = UnitQuaternion::identity();
        let (mut way_m, mut velocity_m_per_s) = (Vector3::zeros(), Vector3::zeros());
        for piece in self.pieces(start, end) {
            let turn = (piece.turn_rate_rad_per_s - bias_rad_per_s) * piece.elapsed_s;
            let half = UnitQuaternion::from_scaled_axis(0.5 * turn);
            let force = start_from_robot * (half * in_metres(piece.specific_force_m_per_s2?));
            let push = force + down_in_start * STANDARD_GRAVITY_M_PER_S2;
            way_m += (velocity_m_per_s + 0.5 * push * piece.elapsed_s) * piece.elapsed_s;
            velocity_m_per_s += push * piece.elapsed_s;
            start_from_robot *= UnitQuaternion::from_scaled_axis(turn);
        }
        Some(Pushed { way_m, velocity_m_per_s, elapsed_s })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(s: f64) -> Stamp {
        Stamp::from_secs_f64(s)
    }

    fn reading(s: f64, turn_rate_rad_per_s: [f64; 3]) -> ImuReading {
        ImuReading {
            stamp: at(s),
            turn_rate_rad_per_s: turn_rate_rad_per_s.into(),
            specific_force_m_per_s2: Some(Vector3::new(0.0, 0.0, STANDARD_GRAVITY_M_PER_S2)),
        }
    }

    #[test]
    fn a_constant_turn_is_found_between_any_two_stamps() {
        let mut readings = ImuReadings::default();
        assert!(readings.turned(at(0.0), at(1.0), Vector3::zeros()).is_none());
        let rate = Vector3::new(0.3, -0.2, 1.5);
        (0..200).for_each(|k| assert_eq!(readings.add(reading(0.01 * f64::from(k), rate.into())), ImuTaken::Kept));
        for [from, until] in [[0.203, 0.817], [0.5, 0.505], [0.2, 0.3], [1.9, 2.0]] {
            let turned = readings.turned(at(from), at(until), Vector3::zeros()).unwrap();
            let expected = UnitQuaternion::from_scaled_axis(rate * (until - from));
            assert!(turned.start_from_end.angle_to(&expected) < 1e-9, "{from} to {until}: {turned:?}");
        }
        assert!(readings.turned(at(1.95), at(2.5), Vector3::zeros()).is_none(), "most of it was not read");
        assert!(readings.turned(at(1.0), at(1.0), Vector3::zeros()).is_none());
        assert!(readings.turned(at(1.0), at(0.5), Vector3::zeros()).is_none());
        let unread_s = readings.turned(at(1.9), at(2.0), Vector3::zeros()).unwrap().unread_s;
        assert!((unread_s - 0.01).abs() < 1e-9);
    }

    #[test]
    fn an_even_push_while_turning_is_half_its_time_squared() {
        let (rate, push) = (Vector3::new(0.2, -0.4, 1.0), Vector3::new(0.5, 0.2, -0.1));
        let mut readings = ImuReadings::default();
        for k in 0..200 {
            let s = 0.01 * f64::from(k);
            let robot_from_start = UnitQuaternion::from_scaled_axis(-rate * (s - 0.5));
            let force = robot_from_start * (push + Vector3::new(0.0, 0.0, STANDARD_GRAVITY_M_PER_S2));
            readings.add(ImuReading { specific_force_m_per_s2: Some(force), ..reading(s, rate.into()) });
        }
        let pushed = readings.pushed([at(0.5), at(1.5)], Vector3::zeros(), -Vector3::z()).unwrap();
        assert!(
            (pushed.way_m - 0.5 * push).norm() < 1e-3 && (pushed.velocity_m_per_s - push).norm() < 2e-3,
            "{pushed:?}"
        );
        assert!(
            readings.pushed([at(1.5), at(2.5)], Vector3::zeros(), -Vector3::z()).is_none(),
            "not all of it was read"
        );
    }

    #[test]
    fn readings_out_of_order_find_their_place_and_bad_ones_are_told() {
        let mut readings = ImuReadings::default();
        for k in [0, 2, 1, 4, 3, 5] {
            assert_eq!(readings.add(reading(0.1 * f64::from(k), [0.0, 0.0, f64::from(k)])), ImuTaken::Kept);
        }
        let stamps: Vec<f64> = readings.readings.iter().map(|known| known.turn_rate_rad_per_s.z).collect();
        assert_eq!(stamps, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
        assert_eq!(readings.add(reading(0.2, [0.0, 0.0, 7.0])), ImuTaken::Kept);
        assert_eq!((readings.readings.len(), readings.readings[2].turn_rate_rad_per_s.z), (6, 7.0));
        for bad in [[f64::NAN, 0.0, 0.0], [0.0, f64::INFINITY, 0.0], [0.0, 0.0, 1e4]] {
            assert_eq!(readings.add(reading(0.6, bad)), ImuTaken::Unsound);
        }
        let pushed = ImuReading { specific_force_m_per_s2: Some(Vector3::repeat(f64::NAN)), ..reading(0.6, [0.0; 3]) };
        assert_eq!(readings.add(pushed), ImuTaken::Unsound);
        readings.use_until(at(0.35));
        assert_eq!(readings.add(reading(0.3, [0.0; 3])), ImuTaken::Late);
        assert_eq!(readings.add(reading(0.45, [0.0; 3])), ImuTaken::Kept);
        assert_eq!(readings.add(reading(-30.0, [0.0; 3])), ImuTaken::SetBack);
        assert_eq!((readings.readings.len(), readings.oldest()), (1, Some(at(-30.0))));
        assert_eq!(readings.add(reading(-29.9, [0.0; 3])), ImuTaken::Kept);
    }

    #[test]
    fn what_is_remembered_comes_back_to_the_bit_and_damage_is_refused() {
        let mut readings = ImuReadings::default();
        for k in 0..50 {
            readings.add(reading(0.01 * f64::from(k), [0.1, -0.2, 0.03 * f64::from(k)]));
        }
        readings.use_until(at(0.2));
        let turned = readings.turned(at(0.1), at(0.4), Vector3::repeat(0.01)).unwrap();
        let mut down = Down::default();
        down.weigh(Vector3::new(0.1, 0.2, 9.8), Vector3::zeros(), 0.5, 0.01);
        let mut bytes = Vec::new();
        (readings.clone(), turned, down).put(&mut bytes);
        let from = &mut &bytes[..];
        let (read, turned_read, down_read): (ImuReadings, Turned, Down) = Stored::take(from).unwrap();
        assert!(from.is_empty() && turned_read == turned && down_read == down);
        assert_eq!((&read.readings, read.used_until), (&readings.readings, readings.used_until));
        readings.readings.swap(3, 4);
        let mut bytes = Vec::new();
        readings.put(&mut bytes);
        assert!(ImuReadings::take(&mut &bytes[..]).is_none(), "out of order");
        let mut bytes = Vec::new();
        (true, Vector3::new(0.0, 0.0, 2.0), 0.1).put(&mut bytes);
        assert!(Down::take(&mut &bytes[..]).is_none(), "no direction");
    }

    #[test]
    fn memory_is_bounded() {
        let mut readings = ImuReadings::default();
        for k in 0..20_000 {
            readings.add(reading(1e-3 * f64::from(k), [0.0; 3]));
        }
        assert_eq!(readings.readings.len(), READINGS);
    }

    proptest! {
        #[test]
        fn the_derivative_by_the_bias_is_that_of_differences(
            rates in prop::collection::vec(prop::array::uniform3(-2.0..2.0f64), 20..60),
            bias in prop::array::uniform3(-0.1..0.1f64),
        ) {
            let mut readings = ImuReadings::default();
            for (k, rate) in rates.iter().enumerate() {
                readings.add(reading(0.01 * k as f64, *rate));
            }
            let (start, end, bias) = (at(0.004), at(0.01 * rates.len() as f64 - 0.013), Vector3::from(bias));
            let turned = readings.turned(start, end, bias).unwrap();
            for axis in 0..3 {
                let mut step = Vector3::zeros();
                step[axis] = 1e-5;
                let [more, less] = [bias + step, bias - step].map(|b| readings.turned(start, end, b).unwrap());
                let numeric = (less.start_from_end.inverse() * more.start_from_end).scaled_axis() / 2e-5;
                // pieces turn by 0.02 rad at most, half of which the derivative of one leaves out
                prop_assert!((numeric - turned.by_bias_s.column(axis)).norm() < 0.02 * turned.elapsed_s);
            }
        }

        #[test]
        fn pieces_cover_the_time(from in -0.3..0.5f64, length in 0.001..1.0f64) {
            let mut readings = ImuReadings::default();
            for k in 0..40 {
                readings.add(reading(0.011 * f64::from(k), [0.0; 3]));
            }
            let pieces: Vec<ImuPiece> = readings.pieces(at(from), at(from + length)).collect();
            let covered_s: f64 = pieces.iter().map(|piece| piece.elapsed_s).sum();
            prop_assert!((covered_s - length).abs() < 1e-8, "{} of {}", covered_s, length);
            prop_assert!(pieces.windows(2).all(|pair| pair[0].middle_s < pair[1].middle_s));
        }
    }
}
