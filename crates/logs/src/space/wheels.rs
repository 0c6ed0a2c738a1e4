//! The wheels' poses of the recent past.

use crate::merge::{WINDOW_MESSAGES, WINDOW_S};
use mapwright_geom::{Pose3, Stamp};
use std::collections::VecDeque;

/// Readings are kept for so long, by their stamps: longer than clouds wait for them, seconds.
const KEPT_S: f64 = 10.0;

/// Readings of odometry in the order of their stamps.
#[derive(Debug, Default)]
pub(super) struct Wheels(VecDeque<(Stamp, Pose3)>);

impl Wheels {
    /// One that is far older than all others begins anew.
    pub(super) fn add(&mut self, stamp: Stamp, odom_from_robot: Pose3) {
        if self.newest().is_some_and(|newest| newest.secs_since(stamp) > KEPT_S) {
            self.0.clear();
        }
        let place = self.0.partition_point(|(known, _)| *known <= stamp);
        self.0.insert(place, (stamp, odom_from_robot));
        let newest = self.newest().unwrap_or(stamp);
        let is_old = |reading: &(Stamp, Pose3)| newest.secs_since(reading.0) > KEPT_S;
        while self.0.len() > WINDOW_MESSAGES || self.0.front().is_some_and(is_old) {
            self.0.pop_front();
        }
    }

    /// The stamp of the newest reading.
    pub(super) fn newest(&self) -> Option<Stamp> {
        self.0.back().map(|(stamp, _)| *stamp)
    }

    /// The reading of a stamp, or interpolated there between two that are near enough, else the one before, if it is near.
    pub(super) fn at(&self, stamp: Stamp) -> Option<Pose3> {
        let (before_stamp, before) = self.before(stamp)?;
        self.between(stamp).or_else(|| (stamp.secs_since(before_stamp) <= WINDOW_S).then_some(before))
    }

    /// The reading of a stamp, or interpolated there between two that are near enough.
    pub(super) fn between(&self, stamp: Stamp) -> Option<Pose3> {
        let (before_stamp, before) = self.before(stamp)?;
        if before_stamp == stamp {
            return Some(before);
        }
        let (later_stamp, later) = *self.0.get(self.0.partition_point(|(known, _)| *known <= stamp))?;
        let apart_s = later_stamp.secs_since(before_stamp);
        let share = stamp.secs_since(before_stamp) / apart_s;
        (apart_s <= WINDOW_S).then(|| before * Pose3::exp(before.between(later).log() * share))
    }

    /// The last reading up to a stamp.
    fn before(&self, stamp: Stamp) -> Option<(Stamp, Pose3)> {
        self.0.get(self.0.partition_point(|(known, _)| *known <= stamp).checked_sub(1)?).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    fn add(wheels: &mut Wheels, ms: i64, x: f64) {
        wheels.add(Stamp(ms * 1_000_000), Pose3 { translation: Vector3::new(x, 0.0, -x), ..Pose3::identity() });
    }

    fn at(wheels: &Wheels, ms: i64) -> Option<f64> {
        wheels.at(Stamp(ms * 1_000_000)).map(|pose| (pose.translation.x * 1e6).round() / 1e6)
    }

    #[test]
    fn readings_are_interpolated_in_the_order_of_their_stamps() {
        let mut wheels = Wheels::default();
        assert_eq!(at(&wheels, 0), None);
        for (ms, x) in [(1000, 1.0), (3000, 3.0), (2000, 2.0), (6000, 9.0)] {
            add(&mut wheels, ms, x);
        }
        let found = [999, 1000, 1500, 2750, 4000, 5900, 6000, 8000, 8001].map(|ms| at(&wheels, ms));
        let expected = [None, Some(1.0), Some(1.5), Some(2.75), Some(3.0), None, Some(9.0), Some(9.0), None];
        assert_eq!(found, expected);
    }

    #[test]
    fn memory_is_bounded_and_a_clock_that_was_set_back_begins_anew() {
        let mut wheels = Wheels::default();
        (0..20_000).for_each(|ms| add(&mut wheels, ms, 0.0));
        assert_eq!(wheels.0.len(), WINDOW_MESSAGES);
        add(&mut wheels, 5, 7.0);
        assert_eq!((wheels.0.len(), at(&wheels, 6)), (1, Some(7.0)));
    }
}
