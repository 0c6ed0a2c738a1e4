//! What moves is neither matched nor drawn: people who walk along with the robot would hold it back.
//!
//! A scan is compared with one half a second older: a small thing that stands where space was free then, or that has drawn
//! back from where it stood, moves.

use super::seen::{Memory, Place, Ranges, Seen, measure};
use mapwright_geom::{Stamp, Stored};
use mapwright_sensor::{BEAM_DROPPED, LaserModel, Sweep, SweepPoints};
use std::ops::Range;
use std::sync::Arc;

/// Scans are compared with the newest one that is so much older, seconds,
const LEAST_AGE_S: f64 = 0.45;
/// and not older than this,
const MOST_AGE_S: f64 = 1.5;
/// nor farther from it than this, metres and radians.
const COMPARED_M: f64 = 1.0;
const COMPARED_RAD: f64 = 1.0;
/// Scans are remembered so far apart, seconds.
const EVERY_S: f64 = 0.05;
/// Only what is so near covers enough of the view to do harm, metres.
const COVERING_M: f64 = 6.0;
/// A thing is what lies so near to its neighbours in the sweep, metres, and is no larger than this.
const GAP_M: f64 = 0.25;
const LARGEST_M: f64 = 1.2;
/// It moves if so many of its beams say so, and such a share of them.
const LEAST_BEAMS: usize = 3;
const MOVING_SHARE: f64 = 0.4;
/// Of the beams on a large one about so many are asked.
const ASKED: usize = 8;
/// Where a larger share of all returns would be gone, it is the robot that is elsewhere than thought.
const MOST_SHARE: f64 = 0.6;

/// Scans of the last seconds.
#[derive(Debug, Clone, Default)]
pub(super) struct DynamicObjects {
    seen: Memory,
    /// Of the present scan, if it was measured.
    ranges: Ranges,
    measured: bool,
    /// Hits on what moves.
    moving: Vec<usize>,
}

/// A scan that was measured and not remembered yet is forgotten.
impl Stored for DynamicObjects {
    fn put(&self, out: &mut Vec<u8>) {
        self.seen.put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        Some(Self { seen: Memory::take(from)?, ..Self::default() })
    }
}

impl DynamicObjects {
    /// Drops the beams that end on what moves; how many they are.
    pub(super) fn drop_from(&mut self, sweep: &mut Sweep, points: &SweepPoints, stamp: Stamp, place: Place) -> u32 {
        measure(sweep, &mut self.ranges);
        self.measured = true;
        let fits = |seen: &&Seen| (LEAST_AGE_S..=MOST_AGE_S).contains(&stamp.secs_since(seen.stamp));
        let Some(before) = self.seen.back_in_time().find(fits) else { return 0 };
        let before_from_now = place.since(before.place);
        let far = before_from_now.x.hypot(before_from_now.y) > COMPARED_M || before_from_now.theta.abs() > COMPARED_RAD;
        let pair = before.beside(&sweep.laser, &self.ranges, before_from_now);
        let Some(pair) = pair.filter(|_| !far) else { return 0 };
        self.moving.clear();
        for thing in things(&points.hits, points.origin) {
            let asked = thing.clone().step_by((thing.len() / ASKED).max(1));
            let (count, moved) = (asked.len(), asked.filter(|&hit| pair.has_moved(points.hits[hit])).count());
            if moved >= LEAST_BEAMS && moved as f64 >= MOVING_SHARE * count as f64 {
                self.moving.extend(thing);
            }
        }
        if self.moving.len() as f64 > MOST_SHARE * points.hits.len() as f64 {
            return 0;
        }
        let mut hits = (0..sweep.codes.len()).filter(|&beam| self.ranges[beam].is_finite()).enumerate();
        for &moving in &self.moving {
            let beam = hits.find(|&(hit, _)| hit == moving).map(|(_, beam)| beam);
            beam.into_iter().for_each(|beam| sweep.codes[beam] = BEAM_DROPPED);
        }
        self.moving.len() as u32
    }

    /// Remembers the present scan, if it was measured, now that it is known where it was taken.
    pub(super) fn remember(&mut self, laser: &Arc<LaserModel>, stamp: Stamp, place: Place) {
        if !std::mem::take(&mut self.measured) {
            return;
        }
        if self.seen.newest().is_some_and(|last| stamp < last.stamp) {
            self.seen.clear();
        }
        if self.seen.newest().is_none_or(|last| stamp.secs_since(last.stamp) >= EVERY_S) {
            self.seen.keep(laser, stamp, place, &self.ranges);
        }
    }

    /// It is no longer known where the robot is.
    pub(super) fn forget(&mut self) {
        self.seen.clear();
        self.measured = false;
    }
}

/// The hits of everything that is near enough and no larger than what moves: rows of hits that are near each other, but for
/// what is seen through a gap.
pub(super) fn things(hits: &[[f64; 2]], origin: [f64; 2]) -> impl Iterator<Item = Range<usize>> + '_ {
    let mut end = 0;
    let rows = std::iter::from_fn(move || {
        let first = end;
        (first < hits.len()).then(|| {
            let apart = |&k: &usize| distance2(hits[k - 1], hits[k]) > GAP_M * GAP_M;
            end = (first + 1..hits.len()).find(apart).unwrap_or(hits.len());
            first..end
        })
    });
    let is_behind = move |hit: usize, beside: usize| {
        hits.get(beside).is_some_and(|&beside| distance2(beside, origin) < distance2(hits[hit], origin))
    };
    let small = move |row: &Range<usize>| {
        row.len() >= LEAST_BEAMS
            && distance2(hits[row.start], hits[row.end - 1]) <= LARGEST_M * LARGEST_M
            && distance2(hits[row.start], origin) <= COVERING_M * COVERING_M
            && !(is_behind(row.start, row.start.wrapping_sub(1)) && is_behind(row.end - 1, row.end))
    };
    rows.filter(small)
}

fn distance2(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_geom::Pose2;
    use mapwright_sensor::{BeamTable, LaserScan};

    /// A round thing: where, metres, and its radius.
    type Round = ([f64; 2], f64);
    const PERIOD_S: f64 = 0.1;

    /// Distance to the nearest of the walls at y = 1.2 m and -1.2 m and round things.
    fn range_m(from: [f64; 2], bearing: f64, things: &[Round]) -> f64 {
        let (s, c) = bearing.sin_cos();
        let wall = if s.abs() > 1e-3 { (1.2 * s.signum() - from[1]) / s } else { f64::INFINITY };
        let round = |&(center, radius): &Round| {
            let (dx, dy) = (center[0] - from[0], center[1] - from[1]);
            let (along, off) = (dx * c + dy * s, dy * c - dx * s);
            let inside = radius * radius - off * off;
            if along > 0.0 && inside > 0.0 { along - inside.sqrt() } else { f64::INFINITY }
        };
        things.iter().map(round).fold(wall, f64::min)
    }

    /// Drives along a corridor; after each scan: beams dropped, and of them those that end on the first thing.
    fn drive(scans: usize, truth: impl Fn(f64) -> (Place, f64), things: impl Fn(f64) -> Vec<Round>) -> Vec<[usize; 2]> {
        let laser = Arc::new(LaserModel { range_max_m: 20.0, ..LaserModel::half_circle("laser", 181) });
        let (mut dynamic, mut table, mut points) =
            (DynamicObjects::default(), BeamTable::default(), SweepPoints::default());
        let scan = |number: usize| {
            let time_s = number as f64 * PERIOD_S;
            let (stamp, (place, x)) = (Stamp::from_secs_f64(time_s), truth(time_s));
            let bearing = |beam: usize| (beam as f64 - 90.0).to_radians();
            let ranges = |things: &[Round]| -> Vec<f64> {
                (0..181).map(|beam| range_m([x, 0.0], bearing(beam), things)).collect()
            };
            let all = ranges(&things(time_s));
            let ranges_m = all.iter().map(|&range| range as f32).collect();
            let scan = LaserScan { stamp, laser: Arc::clone(&laser), ranges_m, odom_from_robot: None };
            let (mut sweep, _) = Sweep::from_scan(&scan, [0.0; 3]);
            points.fill(&sweep, &mut table, 6.0);
            let dropped = dynamic.drop_from(&mut sweep, &points, stamp, place) as usize;
            dynamic.remember(&laser, stamp, place);
            let gone: Vec<usize> = (0..181).filter(|&beam| sweep.codes[beam] == BEAM_DROPPED).collect();
            assert_eq!(gone.len(), dropped);
            let first = ranges(&things(time_s)[..1]);
            [dropped, gone.iter().filter(|&&beam| (all[beam] - first[beam]).abs() < 1e-9).count()]
        };
        (0..scans).map(scan).collect()
    }

    /// 0.5 m/s, as matched and as the wheels say.
    fn steady(time_s: f64) -> (Place, f64) {
        let pose = Pose2::new(0.5 * time_s, 0.0, 0.0);
        (Place { local_from_robot: pose, odom_from_robot: pose }, pose.x)
    }

    #[test]
    fn who_walks_ahead_is_dropped_and_nothing_else() {
        let pillar = |x: f64| ([x, -0.7], 0.15);
        let person = |time_s: f64| ([0.5 * time_s + 0.8, 0.1], 0.25);
        let seen = drive(40, steady, |time_s| vec![person(time_s), pillar(2.0), pillar(3.5), pillar(5.0)]);
        for [dropped, person] in &seen[6..] {
            assert!(dropped == person && *person > 25, "{seen:?}");
        }
    }

    #[test]
    fn what_stands_is_kept() {
        let seen = drive(40, steady, |_| vec![([2.5, 0.5], 0.25), ([4.0, -0.6], 0.15), ([1.5, -0.8], 0.05)]);
        assert!(seen.iter().all(|[dropped, _]| *dropped == 0), "{seen:?}");
    }

    #[test]
    fn who_crosses_before_a_robot_that_stands_is_dropped() {
        let stands = |_: f64| (steady(0.0).0, 0.0);
        let seen = drive(20, stands, |time_s| vec![([1.5, 0.8 - 0.8 * time_s], 0.25), ([3.0, 0.6], 0.2)]);
        let dropped = seen[6..].iter().filter(|[dropped, person]| dropped == person && *person > 10).count();
        assert!(dropped > 10, "{seen:?}");
    }

    /// A match that is held back by who walks ahead says that the robot stands; the wheels know better.
    #[test]
    fn the_wheels_tell_how_far_the_robot_went() {
        let held = |time_s: f64| {
            let (place, x) = steady(time_s);
            (Place { local_from_robot: Pose2::IDENTITY, ..place }, x)
        };
        let seen = drive(20, held, |time_s| vec![([0.5 * time_s + 0.8, 0.1], 0.25), ([2.0, -0.7], 0.15)]);
        assert!(seen[6..].iter().all(|[dropped, person]| dropped == person && *person > 25), "{seen:?}");
    }

    /// What the last scan but one saw must not be taken for what this one saw.
    #[test]
    fn scans_that_were_not_measured_are_not_remembered() {
        let mut dynamic = DynamicObjects::default();
        let laser = Arc::new(LaserModel::half_circle("laser", 3));
        let ranges_m = vec![1.0; 3];
        let scan = LaserScan { stamp: Stamp(0), laser: Arc::clone(&laser), ranges_m, odom_from_robot: None };
        let (mut sweep, _) = Sweep::from_scan(&scan, [0.0; 3]);
        let place = steady(0.0).0;
        dynamic.drop_from(&mut sweep, &SweepPoints::default(), scan.stamp, place);
        for (second, remembered) in [(0.0, 1), (0.1, 1), (0.2, 1)] {
            dynamic.remember(&laser, Stamp::from_secs_f64(second), place);
            assert_eq!(dynamic.seen.back_in_time().count(), remembered, "{second} s");
        }
        assert_eq!(dynamic.seen.newest().map(|seen| seen.stamp), Some(Stamp(0)));
    }

    #[test]
    fn stamps_that_step_back_and_other_lasers_are_borne() {
        let mut dynamic = DynamicObjects::default();
        let place = steady(0.0).0;
        for (second, beams) in [(5.0, 181), (1.0, 90), (1.6, 90), (2.2, 3), (2.8, 0)] {
            let laser = Arc::new(LaserModel::half_circle("laser", beams));
            let scan = LaserScan {
                stamp: Stamp::from_secs_f64(second),
                laser: Arc::clone(&laser),
                ranges_m: vec![1.0; beams],
                odom_from_robot: None,
            };
            let (mut sweep, _) = Sweep::from_scan(&scan, [0.0; 3]);
            let mut points = SweepPoints::default();
            points.fill(&sweep, &mut BeamTable::default(), 6.0);
            assert_eq!(dynamic.drop_from(&mut sweep, &points, scan.stamp, place), 0);
            dynamic.remember(&laser, scan.stamp, place);
        }
    }
}
