//! Scans of one or several lasers and odometry in the order of their stamps, over a bounded window. Clocks that are set on the way, or differ, count as if they were not.

use crate::clock::{Arrival, Clock};
use crate::scans::{Taken, end_of as scan_end};
use mapwright_geom::{Pose2, Stamp};
use mapwright_sensor::{ODOMETRY_APART_MOST_S, Odometry, OdometryReading, Pace};
use std::collections::VecDeque;

/// How long a message waits for those of another topic, seconds between the times of recording; and how far readings of
/// odometry may lie apart to be interpolated.
pub const WINDOW_S: f64 = ODOMETRY_APART_MOST_S;
/// How many messages wait at most.
pub const WINDOW_MESSAGES: usize = 4096;

/// How many bytes of scans wait at most, but for one.
pub const WINDOW_BYTES: usize = 64 << 20;

/// How many readings older than the window are kept, for scans that were recorded late: 20 s of a hundred a second.
const OLDER_KEPT: usize = 2048;

/// A message that waits.
#[derive(Debug)]
struct Waiting<T> {
    recorded: Stamp,
    place: u64,
    /// Its stamp on a clock that is never set.
    at: Stamp,
    item: T,
}

/// A reading, with its stamp on a clock that is never set.
type Reading = OdometryReading<Pose2>;

/// A message whose turn it is; its number in the recording, and whether others with later stamps went before it.
#[derive(Debug)]
pub(crate) struct Next<T> {
    pub(crate) place: u64,
    /// Its stamp on a clock that is never set.
    pub(crate) at: Stamp,
    pub(crate) is_late: bool,
    pub(crate) item: T,
}

/// What comes next.
#[derive(Debug)]
pub(crate) enum Turn {
    Scan(Next<Taken>),
    Odometry(Next<Odometry>),
}

/// Whose clock turned out to have been set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Source {
    /// One of the plan's lasers, from 0.
    Laser(usize),
    Odometry,
}

/// Scans of one laser that wait.
#[derive(Debug, Default)]
struct LaserQueue {
    waiting: VecDeque<Waiting<Taken>>,
    clock: Clock,
    /// The last that was delivered.
    last: Option<Stamp>,
}

/// Scans and odometry that wait for each other.
#[derive(Debug)]
pub(crate) struct Merger {
    lasers: Vec<LaserQueue>,
    odometry: VecDeque<Waiting<(Odometry, Reading)>>,
    /// Delivered readings of the last [`WINDOW_S`], in their order.
    past: VecDeque<Reading>,
    /// Those before.
    older: VecDeque<Reading>,
    pace: Pace,
    last_pushed: Option<Reading>,
    odometry_clock: Clock,
    arrival: Arrival,
    /// A clock that turned out to have been set, and by how many seconds.
    clock_set: Option<(Source, f64)>,
    recorded: Stamp,
    now: Stamp,
    /// Bytes of the scans that wait.
    scan_bytes: usize,
    /// There is no odometry to wait for.
    is_alone: bool,
    last_scan: Option<Stamp>,
}

impl Merger {
    /// For scans of so many lasers, alone or with odometry for them to wait for.
    pub(crate) fn new(lasers: usize, has_odometry: bool) -> Self {
        Self {
            lasers: std::iter::repeat_with(LaserQueue::default).take(lasers.max(1)).collect(),
            odometry: VecDeque::new(),
            past: VecDeque::new(),
            older: VecDeque::with_capacity(if has_odometry { OLDER_KEPT } else { 0 }),
            pace: Pace::default(),
            last_pushed: None,
            odometry_clock: Clock::default(),
            arrival: Arrival::default(),
            clock_set: None,
            recorded: Stamp(0),
            now: Stamp(0),
            scan_bytes: 0,
            is_alone: !has_odometry,
            last_scan: None,
        }
    }

    /// The time at which the newest message of any topic was recorded.
    pub(crate) fn at(&mut self, recorded: Stamp) {
        self.recorded = recorded;
        self.now = self.arrival.at(recorded);
    }

    pub(crate) fn push_scan(&mut self, place: u64, scan: Taken) {
        self.scan_bytes += scan.held_bytes();
        let at_laser = scan.laser.min(self.lasers.len() - 1);
        let beside = if self.is_alone && at_laser > 0 { self.lasers[0].clock.clone() } else { Clock::default() };
        let other = if self.is_alone { &beside } else { &self.odometry_clock };
        let LaserQueue { waiting, clock, .. } = &mut self.lasers[at_laser];
        let undecided = clock.undecided();
        let (at, set_by_s) = clock.follow(scan.scan.stamp, self.recorded, other);
        waiting.push_back(Waiting { recorded: self.now, place, at, item: scan });
        if set_by_s.is_some() {
            let late = waiting.iter_mut().rev().skip(1).take(undecided);
            late.for_each(|late| late.at = clock.at(late.item.scan.stamp));
        }
        self.clock_set = set_by_s.map(|by_s| (Source::Laser(at_laser), by_s)).or(self.clock_set);
    }

    pub(crate) fn push_odometry(&mut self, place: u64, odometry: Odometry) {
        let undecided = self.odometry_clock.undecided();
        let (at, set_by_s) = self.odometry_clock.follow(odometry.stamp, self.recorded, &self.lasers[0].clock);
        let odom_from_robot = odometry.odom_from_robot;
        let is_anew = self.last_pushed.is_some_and(|last| {
            !self.pace.add(at.secs_since(last.stamp), last.odom_from_robot.between(odom_from_robot))
        });
        let reading = Reading { stamp: at, odom_from_robot, is_anew };
        self.last_pushed = Some(reading);
        self.odometry.push_back(Waiting { recorded: self.now, place, at, item: (odometry, reading) });
        if set_by_s.is_some() {
            let clock = &self.odometry_clock;
            self.odometry.iter_mut().rev().skip(1).take(undecided).for_each(|late| {
                late.at = clock.at(late.item.0.stamp);
                late.item.1.stamp = late.at;
            });
        }
        self.clock_set = set_by_s.map(|by_s| (Source::Odometry, by_s)).or(self.clock_set);
    }

    /// Whose clock turned out to have been set since this was asked last, and by how much, seconds.
    pub(crate) fn take_clock_set(&mut self) -> Option<(Source, f64)> {
        self.clock_set.take()
    }

    /// Bytes held by what waits.
    pub(crate) fn held_bytes(&self) -> usize {
        let capacity: usize = self.lasers.iter().map(|laser| laser.waiting.capacity()).sum();
        let waiting = capacity * size_of::<Waiting<Taken>>();
        let odometry = self.odometry.capacity() * size_of::<Waiting<(Odometry, Reading)>>();
        let past = (self.past.capacity() + self.older.capacity()) * size_of::<Reading>();
        self.scan_bytes + waiting + odometry + past
    }

    /// The next in order, where it is certain or has waited long enough; at the recording's end in any case.
    pub(crate) fn pop(&mut self, is_end: bool) -> Option<Turn> {
        let undecided: usize = self.lasers.iter().map(|laser| laser.clock.undecided()).sum();
        if undecided + self.odometry_clock.undecided() > 0 && !is_end && !self.is_full() {
            return None;
        }
        let scans = self.lasers.iter().enumerate().filter_map(|(at, laser)| Some((at, laser.waiting.front()?)));
        let scan = scans.min_by_key(|(_, scan)| end_of(scan));
        let odometry = self.odometry.front();
        let (laser, recorded) = match (scan, odometry) {
            (Some((_, scan)), Some(odometry)) if end_of(scan) >= odometry.at => (None, odometry.recorded),
            (Some((laser, scan)), _) => (Some(laser), scan.recorded),
            (None, Some(odometry)) => (None, odometry.recorded),
            (None, None) => return None,
        };
        let all_wait =
            self.lasers.iter().all(|laser| !laser.waiting.is_empty()) && (self.is_alone || odometry.is_some());
        if !(all_wait || is_end || self.is_due(recorded)) {
            return None;
        }
        match laser {
            Some(laser) => self.pop_scan(laser).map(Turn::Scan),
            None => self.pop_odometry().map(Turn::Odometry),
        }
    }

    fn is_due(&self, recorded: Stamp) -> bool {
        self.now.secs_since(recorded) > WINDOW_S || self.is_full()
    }

    fn is_full(&self) -> bool {
        let scans: usize = self.lasers.iter().map(|laser| laser.waiting.len()).sum();
        scans + self.odometry.len() > WINDOW_MESSAGES || self.scan_bytes > WINDOW_BYTES
    }

    fn pop_scan(&mut self, laser: usize) -> Option<Next<Taken>> {
        let LaserQueue { waiting, last, .. } = self.lasers.get_mut(laser)?;
        let end = end_of(waiting.front()?);
        let Waiting { place, at, item, .. } = waiting.pop_front()?;
        self.scan_bytes = self.scan_bytes.saturating_sub(item.held_bytes());
        let steps_back = last.replace(at).is_some_and(|last| at < last);
        let is_late = !steps_back && self.past.back().is_some_and(|odometry| end < odometry.stamp);
        self.last_scan = Some(at);
        Some(Next { place, at, is_late, item })
    }

    fn pop_odometry(&mut self) -> Option<Next<Odometry>> {
        let Waiting { place, at, item: (item, reading), .. } = self.odometry.pop_front()?;
        let steps_back = self.past.back().is_some_and(|last| at < last.stamp);
        let is_late = !steps_back && self.last_scan.is_some_and(|scan| at < scan);
        self.past.push_back(reading);
        while self.past.len() > WINDOW_MESSAGES
            || self.past.front().is_some_and(|first| at.secs_since(first.stamp) > WINDOW_S)
        {
            if self.older.len() == OLDER_KEPT {
                self.older.pop_front();
            }
            self.older.extend(self.past.pop_front());
        }
        Some(Next { place, at, is_late, item })
    }

    /// Odometry's pose at a time (of [`Next::at`]), by the module's rule.
    pub(crate) fn odom_from_robot(&self, at: Stamp) -> Option<Pose2> {
        let waiting = self.odometry.front().map(|waiting| &waiting.item.1);
        // where stamps step backwards, the reading of this very stamp may stand anywhere
        let all = self.odometry.iter().map(|waiting| &waiting.item.1).chain(self.past.iter().rev());
        if let Some(same) = all.into_iter().find(|reading| reading.stamp == at) {
            return Some(same.odom_from_robot);
        }
        let mut after: Option<&Reading> = None;
        for reading in waiting.into_iter().chain(self.past.iter().rev()).chain(self.older.iter().rev()) {
            if reading.stamp <= at {
                return reading.interpolated(after, at);
            }
            after = Some(reading);
        }
        None
    }

    /// The robot's twist per second at a time: between the readings around it, else between the last two before.
    pub(crate) fn twist_per_s(&self, at: Stamp) -> Option<[f64; 3]> {
        let waiting = self.odometry.front().map(|waiting| &waiting.item.1);
        let mut after: Option<&Reading> = None;
        for reading in waiting.into_iter().chain(self.past.iter().rev()).chain(self.older.iter().rev()) {
            let after_it = after.filter(|after| !after.is_anew);
            let apart_s = after_it.map_or(0.0, |after| after.stamp.secs_since(reading.stamp));
            if let Some(after) = after_it.filter(|_| apart_s > 0.0 && apart_s <= WINDOW_S && reading.stamp <= at) {
                let step = reading.odom_from_robot.between(after.odom_from_robot).log();
                return Some(step.map(|part| part / apart_s));
            }
            after = Some(reading);
        }
        None
    }

    /// The time of the last reading delivered.
    pub(crate) fn last_odometry(&self) -> Option<Stamp> {
        self.past.back().map(|odometry| odometry.stamp)
    }
}

/// When the scan is there, on a clock that is never set.
fn end_of(scan: &Waiting<Taken>) -> Stamp {
    let taken = &scan.item.scan;
    Stamp(scan.at.0.saturating_add(scan_end(taken).0.saturating_sub(taken.stamp.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scans::no_scan;
    use mapwright_sensor::LaserScan;

    fn odometry(ms: i64, x: f64) -> Odometry {
        Odometry { stamp: Stamp(ms * 1_000_000), odom_from_robot: Pose2::new(x, 0.0, 0.0) }
    }

    fn scan(ms: i64) -> Taken {
        LaserScan { stamp: Stamp(ms * 1_000_000), ..no_scan() }.into()
    }

    /// Stamps in ms of all that is delivered, scans negative.
    fn drain(merger: &mut Merger, is_end: bool) -> Vec<i64> {
        let turn = |turn| match turn {
            Turn::Scan(next) => -next.item.scan.stamp.0 / 1_000_000,
            Turn::Odometry(next) => next.item.stamp.0 / 1_000_000,
        };
        std::iter::from_fn(|| merger.pop(is_end)).map(turn).collect()
    }

    #[test]
    fn topics_are_merged_by_stamps_and_each_keeps_its_own_order() {
        let mut merger = Merger::new(1, true);
        merger.push_scan(1, scan(100));
        merger.push_scan(2, scan(90)); // steps back and keeps its place
        merger.push_odometry(3, odometry(50, 0.0));
        merger.push_odometry(4, odometry(95, 0.0));
        merger.push_odometry(5, odometry(150, 0.0));
        assert_eq!(drain(&mut merger, false), [50, 95, -100, -90]);
        assert_eq!(drain(&mut merger, true), [150]);
    }

    #[test]
    fn a_scan_comes_when_its_sweep_is_over() {
        let mut merger = Merger::new(1, true);
        let laser = mapwright_sensor::LaserModel { beam_period_s: 0.01, ..(*no_scan().laser).clone() };
        let slow = LaserScan { stamp: Stamp(0), ranges_m: vec![1.0; 10], laser: laser.into(), odom_from_robot: None };
        merger.push_scan(1, slow.into());
        [0, 50, 100, 150].into_iter().for_each(|ms| merger.push_odometry(2, odometry(ms, 0.0)));
        assert_eq!(drain(&mut merger, true), [0, 50, 100, 0, 150]);
    }

    #[test]
    fn scans_of_two_lasers_come_in_the_order_of_their_stamps() {
        let by = |laser: usize, ms: i64| Taken { laser, ..scan(ms) };
        for has_odometry in [true, false] {
            let mut merger = Merger::new(2, has_odometry);
            merger.push_scan(1, by(0, 100));
            merger.push_scan(2, by(0, 200));
            if has_odometry {
                merger.push_odometry(3, odometry(400, 0.0));
            }
            assert!(drain(&mut merger, false).is_empty(), "the rear laser may still say something");
            merger.push_scan(4, by(1, 130));
            merger.push_scan(5, by(1, 230));
            assert_eq!(drain(&mut merger, false), [-100, -130, -200]);
            merger.at(Stamp(3_000_000_000));
            let left: &[i64] = if has_odometry { &[-230, 400] } else { &[-230] };
            assert_eq!(drain(&mut merger, false), left, "nobody waits for ever, no reading either");
        }
    }

    #[test]
    fn the_reading_of_the_scans_own_stamp_counts_wherever_it_stands() {
        let mut merger = Merger::new(1, true);
        for (ms, x) in [(50, 0.0), (300, 1.0), (100, 2.0), (200, 3.0)] {
            merger.push_odometry(1, odometry(ms, x));
        }
        assert!(matches!(merger.pop(true), Some(Turn::Odometry(_))));
        assert_eq!(merger.odom_from_robot(Stamp(100_000_000)).map(|pose| pose.x), Some(2.0));
    }

    #[test]
    fn nobody_waits_longer_than_the_window_and_who_comes_later_is_late() {
        let mut merger = Merger::new(1, true);
        merger.at(Stamp(0));
        merger.push_scan(1, scan(100));
        assert!(drain(&mut merger, false).is_empty());
        merger.at(Stamp(2_100_000_000));
        assert_eq!(drain(&mut merger, false), [-100]);
        merger.push_odometry(2, odometry(60, 0.0));
        let Some(Turn::Odometry(next)) = merger.pop(true) else { panic!() };
        assert!(next.is_late);
    }

    #[test]
    fn a_scan_that_steps_back_waits_until_it_is_known_whether_it_was_late() {
        // scans and odometry five times a second, of which scans are 2 s early from the second second on
        let mut merger = Merger::new(1, true);
        let mut poses = Vec::new();
        let mut take = |merger: &mut Merger, is_end: bool| {
            while let Some(turn) = merger.pop(is_end) {
                if let Turn::Scan(next) = turn {
                    poses.push(merger.odom_from_robot(next.at).map(|pose| (10.0 * pose.x).round() as i64));
                }
            }
        };
        for k in 0..60 {
            let ms = 200 * k;
            merger.at(Stamp(ms * 1_000_000));
            merger.push_odometry(2 * k as u64, odometry(ms, ms as f64 / 1e3));
            merger.push_scan(2 * k as u64 + 1, scan(if k < 10 { ms } else { ms - 2000 }));
            take(&mut merger, false);
        }
        take(&mut merger, true);
        assert_eq!(poses, (0..60).map(|k| Some(2 * k)).collect::<Vec<_>>());
    }

    #[test]
    fn no_more_messages_wait_than_the_window_holds() {
        let mut merger = Merger::new(1, true);
        for place in 0..3 * WINDOW_MESSAGES as i64 {
            merger.push_odometry(place as u64, odometry(place, 0.0));
            drain(&mut merger, false);
            assert!(merger.odometry.len() <= WINDOW_MESSAGES);
        }
    }

    #[test]
    fn odometry_is_interpolated_at_the_scans_stamp_or_is_the_one_before() {
        let mut merger = Merger::new(1, true);
        for (ms, x) in [(0, 0.0), (100, 1.0), (200, 3.0), (9000, 5.0)] {
            merger.push_odometry(1, odometry(ms, x));
        }
        for _ in 0..2 {
            assert!(matches!(merger.pop(true), Some(Turn::Odometry(_))));
        }
        let x_at = |merger: &Merger, ms: i64| merger.odom_from_robot(Stamp(ms * 1_000_000)).map(|pose| pose.x);
        assert_eq!([x_at(&merger, 100), x_at(&merger, 150), x_at(&merger, 50)], [Some(1.0), Some(2.0), Some(0.5)]);
        assert_eq!(x_at(&merger, -1), None);
        drain(&mut merger, true);
        assert_eq!(x_at(&merger, 20_000), None, "too old");
        let mut sparse = Merger::new(1, true);
        sparse.push_odometry(1, odometry(0, 1.0));
        sparse.push_odometry(2, odometry(5000, 9.0));
        assert!(matches!(sparse.pop(true), Some(Turn::Odometry(_))));
        assert_eq!([x_at(&sparse, 1000), x_at(&sparse, 3000)], [Some(1.0), None], "the next is too far away");
    }
}
