//! Events that arrive in another order than that of their stamps: the order in which the robot drove less far.

use crate::clock::LATE_MOST_S;
use crate::merge::{WINDOW_BYTES, WINDOW_MESSAGES};
use crate::scans::end_of;
use mapwright_formats::OrderReport;
use mapwright_geom::{Pose2, Stamp};
use mapwright_sensor::{LaserScan, Odometry, SonarReading, TurnRate};
use std::collections::VecDeque;

/// A radian of turning counts as so many metres of way.
const METRES_PER_RAD: f64 = 1.0;
/// Ranges of a beam in successive scans differ by so much at most, metres: beyond it one of them met something else.
const MOST_APART_M: f32 = 0.5;

/// An event of a log.
#[derive(Debug)]
pub(crate) enum Event {
    Scan(LaserScan),
    Odometry(Odometry),
    TurnRate(TurnRate),
    Sonar(Box<SonarReading>),
}

impl Event {
    /// When it was there: a scan at the end of its sweep.
    pub(crate) fn at(&self) -> Stamp {
        match self {
            Self::Scan(scan) => end_of(scan),
            Self::Odometry(odometry) => odometry.stamp,
            Self::TurnRate(turn_rate) => turn_rate.stamp,
            Self::Sonar(reading) => reading.stamp,
        }
    }

    fn pose(&self) -> Option<Pose2> {
        match self {
            Self::Scan(scan) => scan.odom_from_robot,
            Self::Odometry(odometry) => Some(odometry.odom_from_robot),
            Self::TurnRate(_) | Self::Sonar(_) => None,
        }
    }

    /// Bytes held beside the value itself.
    pub(crate) fn held_bytes(&self) -> usize {
        match self {
            Self::Scan(scan) => size_of::<LaserScan>() + scan.ranges_m.capacity() * size_of::<f32>(),
            Self::Sonar(reading) => size_of::<SonarReading>() + reading.ranges_m.capacity() * size_of::<f32>(),
            Self::Odometry(_) | Self::TurnRate(_) => 0,
        }
    }
}

/// What tells how far apart two events were taken: where the wheels were, else what was seen.
#[derive(Debug, Clone, Copy)]
enum Sight<'a> {
    Pose(Pose2),
    /// By which laser, and what.
    Ranges(&'a str, &'a [f32]),
}

impl<'a> Sight<'a> {
    fn of(event: &'a Event) -> Option<Self> {
        match (event.pose(), event) {
            (Some(pose), _) => Some(Self::Pose(pose)),
            (None, Event::Scan(scan)) => Some(Self::Ranges(&scan.laser.name, &scan.ranges_m)),
            _ => None,
        }
    }

    /// Metres; none where two cannot be compared.
    fn apart_m(self, other: Self) -> f64 {
        match (self, other) {
            (Self::Pose(a), Self::Pose(b)) => {
                let step = a.between(b);
                step.x.hypot(step.y) + METRES_PER_RAD * step.theta.abs()
            }
            (Self::Ranges(by, a), Self::Ranges(other, b)) if by == other && a.len() == b.len() && !a.is_empty() => {
                let apart = |(a, b): (&f32, &f32)| f64::from((a - b).abs().min(MOST_APART_M));
                a.iter().zip(b).map(apart).sum::<f64>() / a.len() as f64
            }
            _ => 0.0,
        }
    }
}

/// An event that waits, and how many arrived before it.
#[derive(Debug)]
struct Waiting {
    arrived: u64,
    at: Stamp,
    event: Event,
}

/// Holds events back until none can come any more that was there before them; then the next is the one that arrived first, or, where that
/// makes the way shorter, the one with the earliest stamp. A robot that is said to go to and fro at every event did not: its events
/// are told in the wrong order. A stamp that is earlier by more than the window is of a clock that was set: nothing is put in order
/// across it.
#[derive(Debug, Default)]
pub(crate) struct Order {
    /// In the order of their stamps.
    waiting: VecDeque<Waiting>,
    bytes: usize,
    arrived: u64,
    /// How many of those that wait first have their turn whatever comes.
    due: usize,
    /// The number of the last that says where it was taken.
    last_seen: u64,
    /// None that waits has a lower number.
    lowest: u64,
    report: OrderReport,
}

impl Order {
    pub(crate) fn report(&self) -> OrderReport {
        self.report
    }

    /// Takes the next event as it arrived.
    pub(crate) fn push(&mut self, event: Event) {
        let at = event.at();
        self.bytes += event.held_bytes();
        let (arrived, says) = (self.arrived, Sight::of(&event).is_some());
        self.arrived += 1;
        let latest = self.waiting.back().map_or(at, |last| last.at);
        if latest.secs_since(at) > LATE_MOST_S {
            self.due = self.waiting.len();
        }
        let later = self.waiting.iter().skip(self.due).rev().take_while(|waiting| waiting.at > at).count();
        let place = self.waiting.len() - later;
        self.report.disordered += u64::from(later > 0);
        self.waiting.insert(place, Waiting { arrived, at, event });
        if says {
            self.measure(place);
            self.last_seen = arrived;
        }
    }

    /// By how much the event that was put at a place makes the two ways longer.
    fn measure(&mut self, place: usize) {
        let sight = |at: usize| self.waiting.get(at).and_then(|waiting| Sight::of(&waiting.event));
        let apart_m = |a: Option<usize>, b: Option<usize>| match (a.and_then(sight), b.and_then(sight)) {
            (Some(a), Some(b)) => a.apart_m(b),
            _ => 0.0,
        };
        let is_last_seen = |at: &usize| self.waiting[*at].arrived == self.last_seen;
        let is_seen = |at: &usize| sight(*at).is_some();
        let before = (self.due..place).rev().find(is_seen);
        let after = (place + 1..self.waiting.len()).find(is_seen);
        if after.is_none() && before.is_none_or(|at| is_last_seen(&at)) {
            return;
        }
        let arrived_before = (self.due..self.waiting.len()).rev().filter(|at| *at != place).find(is_last_seen);
        let arrived_m = apart_m(arrived_before, Some(place));
        let stamped_m = apart_m(before, Some(place)) + apart_m(Some(place), after) - apart_m(before, after);
        self.report.ways[0] += arrived_m;
        self.report.ways[1] += stamped_m;
    }

    /// The next whose turn it is; at the log's end in any case.
    pub(crate) fn pop(&mut self, is_end: bool) -> Option<Event> {
        let (first, last) = (self.waiting.front()?, self.waiting.back()?);
        let is_full = self.waiting.len() > WINDOW_MESSAGES || self.bytes > WINDOW_BYTES;
        if !(is_end || self.due > 0 || is_full || last.at.secs_since(first.at) > LATE_MOST_S) {
            return None;
        }
        let [arrived_m, stamped_m] = self.report.ways;
        let earliest = self.earliest()?;
        let place = if stamped_m < arrived_m { 0 } else { earliest };
        self.report.moved += u64::from(place != earliest);
        let Waiting { event, arrived, .. } = self.waiting.remove(place)?;
        self.lowest = if place == earliest { arrived + 1 } else { self.lowest };
        self.due = self.due.saturating_sub(1);
        self.bytes = self.bytes.saturating_sub(event.held_bytes());
        Some(event)
    }

    /// Which of those that wait arrived first.
    fn earliest(&self) -> Option<usize> {
        // those that arrived behind a clock that was set have higher numbers than those that it found waiting
        let numbers = || self.waiting.iter().map(|waiting| waiting.arrived).enumerate();
        let (first, number) = numbers().next()?;
        if number == self.lowest {
            return Some(first);
        }
        numbers().min_by_key(|(_, arrived)| *arrived).map(|(place, _)| place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scans::no_scan;

    fn scan(s: f64, x_m: Option<f64>, range_m: f32) -> Event {
        let odom_from_robot = x_m.map(|x| Pose2::new(x, 0.0, 0.0));
        Event::Scan(LaserScan {
            stamp: Stamp::from_secs_f64(s),
            odom_from_robot,
            ranges_m: vec![range_m; 3],
            ..no_scan()
        })
    }

    fn odometry(s: f64, x_m: f64) -> Event {
        Event::Odometry(Odometry { stamp: Stamp::from_secs_f64(s), odom_from_robot: Pose2::new(x_m, 0.0, 0.0) })
    }

    /// Stamps of all in the order in which they are handed out, in tenths of a second, and the report.
    fn ordered(events: impl IntoIterator<Item = Event>) -> (Vec<i64>, OrderReport) {
        let (mut order, mut stamps) = (Order::default(), Vec::new());
        let mut take = |event: Event| {
            let stamp = match event {
                Event::Scan(scan) => scan.stamp,
                Event::Odometry(odometry) => odometry.stamp,
                Event::TurnRate(turn_rate) => turn_rate.stamp,
                Event::Sonar(reading) => reading.stamp,
            };
            stamps.push((stamp.as_secs_f64() * 10.0).round() as i64);
        };
        for event in events {
            order.push(event);
            while let Some(event) = order.pop(false) {
                take(event);
            }
        }
        while let Some(event) = order.pop(true) {
            take(event);
        }
        (stamps, order.report())
    }

    /// Every fifth of the moments of a drive at a metre a second comes four later than it should.
    fn late(moments: i64) -> Vec<i64> {
        let mut arrived: Vec<_> = (0..moments).collect();
        arrived.sort_by_key(|k| 2 * k + if k % 5 == 0 { 7 } else { 0 });
        arrived
    }

    #[test]
    fn what_was_recorded_late_comes_when_it_was_taken() {
        let drive = |k: i64| {
            if k % 3 == 0 {
                odometry(k as f64 / 10.0, k as f64 / 10.0)
            } else {
                scan(k as f64 / 10.0, Some(k as f64 / 10.0), 1.0)
            }
        };
        let (stamps, report) = ordered(late(200).into_iter().map(drive));
        assert_eq!(stamps, (0..200).collect::<Vec<_>>());
        assert!(report.moved > 0 && report.ways[0] > 2.0 * report.ways[1], "{report:?}");
    }

    #[test]
    fn stamps_that_were_made_late_count_for_nothing() {
        // the robot drives in the order of arrival
        let arrived = late(200);
        let drive = |(at, k): (usize, &i64)| scan(*k as f64 / 10.0, Some(at as f64 / 10.0), 1.0);
        let (stamps, report) = ordered(arrived.iter().enumerate().map(drive));
        assert_eq!(stamps, arrived);
        assert!(report.moved == 0 && report.disordered > 0 && report.ways[1] > 2.0 * report.ways[0], "{report:?}");
    }

    #[test]
    fn without_odometry_successive_scans_look_alike() {
        let (stamps, report) = ordered(late(200).into_iter().map(|k| scan(k as f64 / 10.0, None, 0.1 * k as f32)));
        assert_eq!(stamps, (0..200).collect::<Vec<_>>());
        assert!(report.moved > 0, "{report:?}");
        let same = ordered(late(200).into_iter().map(|k| scan(k as f64 / 10.0, None, 1.0)));
        assert_eq!(same.0, late(200), "nothing tells");
    }

    #[test]
    fn nothing_is_put_in_order_across_a_clock_that_was_set() {
        let stamps = [100, 101, 103, 102, 3, 4, 6, 5, 7, 900, 901];
        let drive = |(at, stamp): (usize, &i64)| odometry(*stamp as f64 / 10.0, at as f64);
        let (handed, report) = ordered(stamps.iter().enumerate().map(drive));
        assert_eq!((handed.as_slice(), report.disordered), (&stamps[..], 2));
        // a place of its own for each tenth of a second
        let (handed, _) = ordered(stamps.iter().map(|stamp| odometry(*stamp as f64 / 10.0, *stamp as f64)));
        assert_eq!(handed, [100, 101, 102, 103, 3, 4, 5, 6, 7, 900, 901]);
    }
}
