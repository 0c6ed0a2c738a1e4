//! Scans that are remembered, and what stands elsewhere in a later one.

use mapwright_geom::{Pose2, Stamp, Stored, stored};
use mapwright_sensor::{BEAM_DROPPED, BEAM_NO_RETURN, LaserModel, Sweep};
use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::ops::Range;
use std::sync::Arc;

/// So far in front of what was seen there before, or behind it, something has moved, metres.
const MARGIN_M: f64 = 0.1;
/// Nobody draws back farther than this meanwhile, metres.
const DRAWN_BACK_M: f64 = 1.5;
/// Bearings are uncertain by so much, radians, but at least by so many beams.
const BEARING_RAD: f64 = 0.03;
const BEARING_BEAMS: usize = 2;
/// Of many beams that look there so many are looked at.
const LOOKED_AT: usize = 16;

/// The last scans, the oldest first.
#[derive(Debug, Clone, Default)]
pub(super) struct Memory(VecDeque<Seen>);

/// So many scans are kept at most.
const REMEMBERED: usize = 32;

/// A scan that is remembered.
#[derive(Debug, Clone)]
pub(super) struct Seen {
    pub(super) stamp: Stamp,
    pub(super) place: Place,
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
    pub(super) fn since(self, before: Self) -> Pose2 {
        let Pose2 { x, y, .. } = before.odom_from_robot.between(self.odom_from_robot);
        Pose2::new(x, y, before.local_from_robot.between(self.local_from_robot).theta)
    }
}

/// Distance by beam: where something is, infinity where nothing is, not a number where nothing is known.
pub(super) type Ranges = Vec<f32>;

stored!(Place { local_from_robot, odom_from_robot });

impl Stored for Memory {
    fn put(&self, out: &mut Vec<u8>) {
        self.0.len().put(out);
        let mut last: Option<&Arc<LaserModel>> = None;
        for seen in &self.0 {
            let is_new = !last.is_some_and(|last| is_same(last, &seen.laser));
            is_new.then(|| LaserModel::clone(&seen.laser)).put(out);
            (seen.stamp, seen.place).put(out);
            seen.ranges.put(out);
            last = Some(&seen.laser);
        }
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        let count = usize::take(from).filter(|count| *count <= REMEMBERED)?;
        let (mut memory, mut last) = (VecDeque::new(), None);
        for _ in 0..count {
            let laser = <Option<LaserModel> as Stored>::take(from)?.map(Arc::new).or(last)?;
            let ((stamp, place), ranges) = (Stored::take(from)?, Stored::take(from)?);
            last = Some(Arc::clone(&laser));
            memory.push_back(Seen { stamp, place, laser, ranges });
        }
        Some(Self(memory))
    }
}

fn is_same(a: &Arc<LaserModel>, b: &Arc<LaserModel>) -> bool {
    Arc::ptr_eq(a, b) || a == b
}

impl Memory {
    pub(super) fn newest(&self) -> Option<&Seen> {
        self.0.back()
    }

    /// From the newest on.
    pub(super) fn back_in_time(&self) -> impl Iterator<Item = &Seen> {
        self.0.iter().rev()
    }

    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// Keeps a scan; the oldest goes where there are many.
    pub(super) fn keep(&mut self, laser: &Arc<LaserModel>, stamp: Stamp, place: Place, ranges: &Ranges) {
        let old = if self.0.len() >= REMEMBERED { self.0.pop_front() } else { None };
        let mut kept = old.map_or_else(Vec::new, |seen| seen.ranges);
        kept.clone_from(ranges);
        self.0.push_back(Seen { stamp, place, laser: Arc::clone(laser), ranges: kept });
    }
}

impl Seen {
    /// This scan and one that the same laser took after such a motion; none of another laser.
    pub(super) fn beside<'a>(
        &'a self,
        laser: &Arc<LaserModel>,
        now: &'a [f32],
        before_from_now: Pose2,
    ) -> Option<Pair<'a>> {
        let is_alike = is_same(&self.laser, laser) && self.ranges.len() == now.len();
        let bearings = Bearings::of(laser, now.len()).filter(|_| is_alike)?;
        Some(Pair { bearings, before: &self.ranges, now, before_from_now })
    }
}

/// Distances of a sweep, into a buffer.
pub(super) fn measure(sweep: &Sweep, ranges: &mut Ranges) {
    let step_m = sweep.step_m as f32;
    ranges.clear();
    ranges.extend(sweep.codes.iter().map(|&code| match code {
        BEAM_DROPPED => f32::NAN,
        BEAM_NO_RETURN => f32::INFINITY,
        _ => f32::from(code) * step_m,
    }));
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
pub(super) struct Pair<'a> {
    bearings: Bearings,
    before: &'a [f32],
    now: &'a [f32],
    before_from_now: Pose2,
}

impl Pair<'_> {
    /// Whether what a beam ends on was not there before.
    pub(super) fn has_moved(&self, hit: [f64; 2]) -> bool {
        let Some((away_m, around)) = self.bearings.look(self.before_from_now.transform(hit)) else { return false };
        let (nearest, farthest) = extremes(&self.before[around]);
        self.is_news(hit, away_m, nearest, farthest)
    }

    /// Whether what a beam ends on was not there before, or was; none where that is not known.
    pub(super) fn what_became_of(&self, hit: [f64; 2]) -> Option<bool> {
        let (away_m, around) = self.bearings.look(self.before_from_now.transform(hit))?;
        let (nearest, farthest) = extremes(&self.before[around]);
        if self.is_news(hit, away_m, nearest, farthest) {
            return Some(true);
        }
        (nearest <= away_m + MARGIN_M && farthest >= away_m - MARGIN_M).then_some(false)
    }

    fn is_news(&self, hit: [f64; 2], away_m: f64, nearest: f64, farthest: f64) -> bool {
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
