//! What moves is neither matched nor drawn: people who walk along with the robot would hold it back.
//!
//! A scan is compared with one half a second older: a small thing that stands where space was free then, or that has drawn
//! back from where it stood, moves.

use mapwright_geom::{Pose2, Stamp, Stored, stored};
use mapwright_sensor::{BEAM_DROPPED, BEAM_NO_RETURN, LaserModel, Sweep, SweepPoints};
use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::ops::Range;
use std::sync::Arc;

/// Scans are compared with the newest one that is so much older, seconds,
const LEAST_AGE_S: f64 = 0.45;
/// and not older than this,
const MOST_AGE_S: f64 = 1.5;
/// nor farther from it than this, metres and radians.
const COMPARED_M: f64 = 1.0;
const COMPARED_RAD: f64 = 1.0;
/// Scans are remembered so far apart, seconds, and so many of them.
const EVERY_S: f64 = 0.05;
const REMEMBERED: usize = 32;
/// Only what is so near covers enough of the view to do harm, metres.
const COVERING_M: f64 = 6.0;
/// So far in front of what was seen there before, or behind it, something has moved, metres.
const MARGIN_M: f64 = 0.1;
/// Nobody draws back farther than this meanwhile, metres.
const DRAWN_BACK_M: f64 = 1.5;
/// Bearings are uncertain by so much, radians, but at least by so many beams.
const BEARING_RAD: f64 = 0.03;
const BEARING_BEAMS: usize = 2;
/// Of many beams that look there so many are looked at.
const LOOKED_AT: usize = 16;
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

/// A scan that is remembered.
#[derive(Debug, Clone)]
struct Seen {
    stamp: Stamp,
    place: Place,
    laser: Arc<LaserModel>,
    ranges: Ranges,
}

/// Where a scan was taken.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub(super) local_from_robot: Pose2,
    pub(super) odom_from_robot: Pose2,
}

impl Place {
    /// The motion since another place: its heading as matched, its way as the wheels say, for who follows the robot holds its
    /// matches back.
    fn since(self, before: Self) -> Pose2 {
        let Pose2 { x, y, .. } = before.odom_from_robot.between(self.odom_from_robot);
        Pose2::new(x, y, before.local_from_robot.between(self.local_from_robot).theta)
    }
}

/// Distance by beam: where something is, infinity where nothing is, not a number where nothing is known.
type Ranges = Vec<f32>;

/// Scans of the last seconds.
#[derive(Debug, Clone, Default)]
pub(super) struct DynamicObjects {
    seen: VecDeque<Seen>,
    /// Of the present scan, if it was measured.
    ranges: Ranges,
    measured: bool,
    /// Hits on what moves.
    moving: Vec<usize>,
}

stored!(Place { local_from_robot, odom_from_robot });

/// A scan that was measured and not remembered yet is forgotten.
impl Stored for DynamicObjects {
    fn put(&self, out: &mut Vec<u8>) {
        self.seen.len().put(out);
        let mut last: Option<&Arc<LaserModel>> = None;
        for seen in &self.seen {
            let is_new = !last.is_some_and(|last| is_same(last, &seen.laser));
            is_new.then(|| LaserModel::clone(&seen.laser)).put(out);
            (seen.stamp, seen.place).put(out);
            seen.ranges.put(out);
            last = Some(&seen.laser);
        }
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        let count = usize::take(from).filter(|count| *count <= REMEMBERED)?;
        let (mut seen, mut last) = (VecDeque::new(), None);
        for _ in 0..count {
            let laser = <Option<LaserModel> as Stored>::take(from)?.map(Arc::new).or(last)?;
            let ((stamp, place), ranges) = (Stored::take(from)?, Stored::take(from)?);
            last = Some(Arc::clone(&laser));
            seen.push_back(Seen { stamp, place, laser, ranges });
        }
        Some(Self { seen, ..Self::default() })
    }
}

fn is_same(a: &Arc<LaserModel>, b: &Arc<LaserModel>) -> bool {
    Arc::ptr_eq(a, b) || a == b
}

impl DynamicObjects {
    /// Drops the beams that end on what moves; how many they are.
    pub(super) fn drop_from(&mut self, sweep: &mut Sweep, points: &SweepPoints, stamp: Stamp, place: Place) -> u32 {
        self.measure(sweep);
        let fits = |seen: &&Seen| (LEAST_AGE_S..=MOST_AGE_S).contains(&stamp.secs_since(seen.stamp));
        let Some(before) = self.seen.iter().rev().find(fits) else { return 0 };
        let before_from_now = place.since(before.place);
        let far = before_from_now.x.hypot(before_from_now.y) > COMPARED_M || before_from_now.theta.abs() > COMPARED_RAD;
        if far || !is_same(&before.laser, &sweep.laser) || before.ranges.len() != self.ranges.len() {
            return 0;
        }
        let Some(bearings) = Bearings::of(&sweep.laser, sweep.codes.len()) else { return 0 };
        let pair = Pair { bearings, before: &before.ranges, now: &self.ranges, before_from_now };
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

    fn measure(&mut self, sweep: &Sweep) {
        let step_m = sweep.step_m as f32;
        self.ranges.clear();
        self.ranges.extend(sweep.codes.iter().map(|&code| match code {
            BEAM_DROPPED => f32::NAN,
            BEAM_NO_RETURN => f32::INFINITY,
            _ => f32::from(code) * step_m,
        }));
        self.measured = true;
    }

    /// Remembers the present scan, if it was measured, now that it is known where it was taken.
    pub(super) fn remember(&mut self, laser: &Arc<LaserModel>, stamp: Stamp, place: Place) {
        if !std::mem::take(&mut self.measured) {
            return;
        }
        if self.seen.back().is_some_and(|last| stamp < last.stamp) {
            self.seen.clear();
        }
        if self.seen.back().is_some_and(|last| stamp.secs_since(last.stamp) < EVERY_S) {
            return;
        }
        let old = if self.seen.len() >= REMEMBERED { self.seen.pop_front() } else { None };
        let mut ranges = old.map_or_else(Vec::new, |seen| seen.ranges);
        ranges.clone_from(&self.ranges);
        self.seen.push_back(Seen { stamp, place, laser: Arc::clone(laser), ranges });
    }

    /// It is no longer known where the robot is.
    pub(super) fn forget(&mut self) {
        self.seen.clear();
        self.measured = false;
    }
}

/// The hits of everything that is near enough and no larger than what moves: rows of hits that are near each other, but for
/// what is seen through a gap.
fn things(hits: &[[f64; 2]], origin: [f64; 2]) -> impl Iterator<Item = Range<usize>> + '_ {
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

/// Which beam looks where.
#[derive(Debug, Clone, Copy)]
struct Bearings {
    robot_from_laser: Pose2,
    inverted: bool,
    angle_min_rad: f64,
    angle_step_rad: f64,
    beams: usize,
    /// Beams to either side that may look there as well.
    around: usize,
}

impl Bearings {
    fn of(laser: &LaserModel, beams: usize) -> Option<Self> {
        let step_rad = laser.angle_step_rad.abs();
        (step_rad > 1e-6).then(|| Self {
            robot_from_laser: laser.robot_from_laser,
            inverted: laser.inverted,
            angle_min_rad: laser.angle_min_rad,
            angle_step_rad: laser.angle_step_rad,
            beams,
            around: ((BEARING_RAD / step_rad) as usize).max(BEARING_BEAMS),
        })
    }

    /// Distance of a point in the robot's frame, and the beams that look there.
    fn look(&self, point: [f64; 2]) -> Option<(f64, Range<usize>)> {
        let Pose2 { x, y, theta, .. } = self.robot_from_laser;
        let (dx, dy) = (point[0] - x, point[1] - y);
        let in_laser = dy.atan2(dx) - theta;
        let in_laser = if self.inverted { -in_laser } else { in_laser };
        let turned = (in_laser - self.angle_min_rad) * self.angle_step_rad.signum();
        let turns = (turned / TAU).floor();
        let beam = ((turned - turns * TAU) / self.angle_step_rad.abs() + 0.5) as usize;
        let around = beam.saturating_sub(self.around)..(beam + self.around + 1).min(self.beams);
        (beam < self.beams).then(|| ((dx * dx + dy * dy).sqrt(), around))
    }
}

/// A scan and an earlier one.
struct Pair<'a> {
    bearings: Bearings,
    before: &'a [f32],
    now: &'a [f32],
    before_from_now: Pose2,
}

impl Pair<'_> {
    /// Whether what a beam ends on was not there before.
    fn has_moved(&self, hit: [f64; 2]) -> bool {
        let Some((away_m, around)) = self.bearings.look(self.before_from_now.transform(hit)) else { return false };
        let (nearest, farthest) = extremes(&self.before[around]);
        nearest > away_m + MARGIN_M
            || (farthest + MARGIN_M < away_m
                && away_m < farthest + DRAWN_BACK_M
                && self.is_gone(hit, farthest / away_m))
    }

    /// Whether what stood before the hit, on such a share of the way to it from where the earlier scan was taken, is there no
    /// longer.
    fn is_gone(&self, hit: [f64; 2], share: f64) -> bool {
        let Pose2 { x, y, .. } = self.bearings.robot_from_laser;
        let origin = self.before_from_now.inverse().transform([x, y]);
        let stood = [0, 1].map(|k| origin[k] + share * (hit[k] - origin[k]));
        let Some((away_m, around)) = self.bearings.look(stood) else { return false };
        extremes(&self.now[around]).0 > away_m + MARGIN_M
    }
}

/// The nearest and the farthest, of many beams evenly chosen ones; not a number where one of them is not known.
fn extremes(ranges: &[f32]) -> (f64, f64) {
    let (mut nearest, mut farthest) = (f32::INFINITY, 0.0_f32);
    for &range in ranges.iter().step_by((ranges.len() / LOOKED_AT).max(1)) {
        if range.is_nan() {
            return (f64::NAN, f64::NAN);
        }
        (nearest, farthest) = (nearest.min(range), farthest.max(range));
    }
    (f64::from(nearest), f64::from(farthest))
}

fn distance2(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1])
}

#[cfg(test)]
mod tests {
    use super::*;
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
            assert_eq!(dynamic.seen.len(), remembered, "{second} s");
        }
        assert_eq!(dynamic.seen[0].stamp, Stamp(0));
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
