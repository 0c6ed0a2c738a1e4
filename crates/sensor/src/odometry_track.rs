//! Where odometry had the robot in the recent past.

use mapwright_geom::{Pose, Stamp, Tangent};
use std::collections::VecDeque;

/// Between readings that lie farther apart nothing is interpolated, and for so long the last one stands, seconds.
pub const ODOMETRY_APART_MOST_S: f64 = 2.0;
/// Readings are kept for so long, by their stamps, seconds; and so many.
const KEPT_S: f64 = 10.0;
const KEPT_MOST: usize = 4096;

/// A reading of odometry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OdometryReading<P> {
    /// When it was true.
    pub stamp: Stamp,
    /// Where the robot was.
    pub odom_from_robot: P,
    /// Odometry begins anew with it: nothing lies between it and the one before.
    pub is_anew: bool,
}

impl<P: Pose> OdometryReading<P> {
    /// Where the robot was at a time after this reading: on the way to the next one, if that is near enough; else here, if this is.
    #[must_use]
    pub fn interpolated(&self, next: Option<&Self>, at: Stamp) -> Option<P> {
        let since_s = at.secs_since(self.stamp);
        if let Some(next) = next.filter(|next| !next.is_anew) {
            let apart_s = next.stamp.secs_since(self.stamp);
            if apart_s > 0.0 && apart_s <= ODOMETRY_APART_MOST_S {
                let step = self.odom_from_robot.local(next.odom_from_robot);
                return Some(self.odom_from_robot.retract(&P::Tangent::from_fn(|part| step[part] * since_s / apart_s)));
            }
        }
        (since_s <= ODOMETRY_APART_MOST_S).then_some(self.odom_from_robot)
    }
}

/// Readings of odometry in the order of their stamps, of the last ten seconds.
#[derive(Debug, Clone)]
pub struct OdometryTrack<P>(VecDeque<OdometryReading<P>>);

impl<P> Default for OdometryTrack<P> {
    fn default() -> Self {
        Self(VecDeque::new())
    }
}

impl<P: Pose> OdometryTrack<P> {
    /// Takes in a reading. One that is far older than all others begins anew.
    pub fn add(&mut self, reading: OdometryReading<P>) {
        if self.newest().is_some_and(|newest| newest.stamp.secs_since(reading.stamp) > KEPT_S) {
            self.0.clear();
        }
        let place = self.0.partition_point(|known| known.stamp <= reading.stamp);
        self.0.insert(place, reading);
        let newest = self.0.back().map_or(reading.stamp, |newest| newest.stamp);
        let is_old = |reading: &OdometryReading<P>| newest.secs_since(reading.stamp) > KEPT_S;
        while self.0.len() > KEPT_MOST || self.0.front().is_some_and(is_old) {
            self.0.pop_front();
        }
    }

    /// The reading with the latest stamp.
    #[must_use]
    pub fn newest(&self) -> Option<&OdometryReading<P>> {
        self.0.back()
    }

    /// The reading with the earliest stamp.
    #[must_use]
    pub fn oldest(&self) -> Option<&OdometryReading<P>> {
        self.0.front()
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// The reading of a stamp, or interpolated there between two that are near enough, else the one before, if it is near.
    #[must_use]
    pub fn at(&self, stamp: Stamp) -> Option<P> {
        let [before, after] = self.around(stamp);
        let before = before?;
        if before.stamp == stamp { Some(before.odom_from_robot) } else { before.interpolated(after, stamp) }
    }

    /// The reading of a stamp, or interpolated there between two that are near enough.
    #[must_use]
    pub fn between(&self, stamp: Stamp) -> Option<P> {
        let [before, after] = self.around(stamp);
        let before = before?;
        if before.stamp == stamp {
            return Some(before.odom_from_robot);
        }
        let is_near = |after: &&OdometryReading<P>| {
            !after.is_anew && after.stamp.secs_since(before.stamp) <= ODOMETRY_APART_MOST_S
        };
        before.interpolated(Some(after.filter(is_near)?), stamp)
    }

    /// The last reading up to a stamp, and the first after it.
    fn around(&self, stamp: Stamp) -> [Option<&OdometryReading<P>>; 2] {
        let after = self.0.partition_point(|known| known.stamp <= stamp);
        [after.checked_sub(1).and_then(|before| self.0.get(before)), self.0.get(after)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_geom::Pose3;
    use nalgebra::Vector3;

    fn add(track: &mut OdometryTrack<Pose3>, ms: i64, x: f64, is_anew: bool) {
        let odom_from_robot = Pose3 { translation: Vector3::new(x, 0.0, -x), ..Pose3::identity() };
        track.add(OdometryReading { stamp: Stamp(ms * 1_000_000), odom_from_robot, is_anew });
    }

    fn rounded(pose: Option<Pose3>) -> Option<f64> {
        pose.map(|pose| (pose.translation.x * 1e6).round() / 1e6)
    }

    #[test]
    fn readings_are_interpolated_in_the_order_of_their_stamps() {
        let mut track = OdometryTrack::default();
        assert_eq!(track.at(Stamp(0)), None);
        for (ms, x) in [(1000, 1.0), (3000, 3.0), (2000, 2.0), (6000, 9.0)] {
            add(&mut track, ms, x, false);
        }
        let stamps = [999, 1000, 1500, 2750, 4000, 5900, 6000, 8000, 8001].map(|ms| Stamp(ms * 1_000_000));
        let expected = [None, Some(1.0), Some(1.5), Some(2.75), Some(3.0), None, Some(9.0), Some(9.0), None];
        assert_eq!(stamps.map(|stamp| rounded(track.at(stamp))), expected);
        let expected = [None, Some(1.0), Some(1.5), Some(2.75), None, None, Some(9.0), None, None];
        assert_eq!(stamps.map(|stamp| rounded(track.between(stamp))), expected);
    }

    #[test]
    fn nothing_lies_between_readings_of_which_the_second_begins_anew() {
        let mut track = OdometryTrack::default();
        add(&mut track, 0, 100.0, false);
        add(&mut track, 1000, 0.0, true);
        assert_eq!(rounded(track.at(Stamp(500_000_000))), Some(100.0));
        assert_eq!(track.between(Stamp(500_000_000)), None);
    }

    #[test]
    fn memory_is_bounded_and_a_clock_that_was_set_back_begins_anew() {
        let mut track = OdometryTrack::default();
        (0..20_000).for_each(|ms| add(&mut track, ms, 0.0, false));
        assert_eq!(track.0.len(), KEPT_MOST);
        add(&mut track, 5, 7.0, false);
        assert_eq!((track.0.len(), rounded(track.at(Stamp(6_000_000)))), (1, Some(7.0)));
    }
}
