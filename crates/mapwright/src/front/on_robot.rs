//! What keeps its place relative to the robot is neither matched nor drawn: the legs of who pushes it, its own body and posts.
//!
//! A near hit speaks for that where it lies in space that was free, seen from where the robot was before it moved on, or has left
//! where it stood then; it speaks against it where the same was seen there. What is said of a cell of the robot's frame, look by
//! look, adds up to the odds that what is seen in the cell travels with the robot. Things of the surroundings pass through a cell in a
//! few looks, and an empty cell is no part of the robot. A robot that stands learns nothing and forgets nothing.

use super::dynamic::things;
use super::seen::{Memory, Pair, Place, Ranges, Seen, measure};
use mapwright_geom::{Pose2, Stamp, Stored};
use mapwright_sensor::{BEAM_DROPPED, Sweep, SweepPoints};

/// Who pushes a robot walks within an arm and a stride, and no part of it reaches farther, metres.
const REACH_M: f64 = 1.5;
/// Edge of a cell, metres, and cells along an edge of the square around the robot.
const CELL_M: f64 = 0.1;
const CELLS: usize = 30;
/// Legs swing, and hits lie on other parts of them from scan to scan: a hit speaks of the cells this near, metres.
const SWING_M: f64 = 0.2;
/// A look is a scan after this much motion, metres; a radian of turning moves what is half a metre away by half a metre.
const LOOK_M: f64 = 0.1;
const TURNING_M_PER_RAD: f64 = 0.5;
/// Scans are remembered after this much motion; as far apart as they are compared where wheels are sound and nothing is suspected.
const EVERY_M: f64 = 0.08;
/// A look compares with the newest scan after which the robot moved so far: farther than a foot that rests on the floor stays in its
/// place among those of the other steps.
const COMPARED_M: f64 = 0.4;
/// And a hit that has to have been elsewhere by this much in the robot's frame, metres.
const SHIFTED_M: f64 = 0.25;
/// Log odds that a thing in a cell is on the robot, before anything is known: one in ten thousand cells.
const BEFORE: f32 = -9.0;
/// The same of a small thing that the first scan of all sees so near, metres: what is on the robot is there from the beginning. A leg that
/// was seen then may be so far off in the next scans.
const AT_FIRST: f32 = -2.0;
const AT_FIRST_M: f64 = 1.0;
const STRIDE_M: f64 = 0.3;
/// From such odds on a hit is dropped: where wheels are sound there is time to be sure, for what is seen from nearby alone seems to
/// travel with the robot as far as it reaches; where nothing but matches says how the robot moves, to match a thing that travels with it
/// holds it back, and it goes from even odds on.
const DROPPED: f32 = 12.0;
const DROPPED_ALONE: f32 = 0.0;
/// What a look adds where all hits lie in what was free, and where all were there before: twelve times likelier of what is on the robot,
/// as its cells are found free nearly always, and seven times less.
const MOVED: f32 = 2.5;
const STILL: f32 = -2.0;
/// And where nothing is seen in a cell of which something was known.
const EMPTY: f32 = -1.0;
/// So sure one can become, and so sure that it is not so: it takes a few looks to change one's mind.
const SUREST: f32 = 18.0;
const LEAST_SURE: f32 = -12.0;
/// After so many metres of way half of what was known is forgotten.
const HALF_M: f64 = 10.0;
/// Where more than this share of what is farther away is elsewhere as well, the robot is not where it is thought to be.
const MOST_SHARE: f64 = 0.2;
/// So many of those hits are asked, and of the near ones.
const ASKED: usize = 32;
const NEAR_ASKED: usize = 64;

/// What was seen of late near the robot, and where in its frame things travel with it.
#[derive(Debug, Clone, Default)]
pub(super) struct OnRobot {
    seen: Memory,
    /// Whether ways in `seen` are those of the wheels.
    by_wheels: bool,
    /// Log odds by cell, beyond those of which nothing is known; empty before the first look.
    odds: Vec<f32>,
    /// Whether any cell has odds beyond those of which nothing is known.
    is_suspicious: bool,
    /// Of the present scan, if it was measured.
    ranges: Ranges,
    near: Vec<Near>,
    far: Vec<[f64; 2]>,
    measured: bool,
}

/// How it is known how the robot moved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Motion {
    /// By sound wheels.
    ByWheels,
    /// By a match that told it in all directions.
    ByScans,
    /// Along a direction in which nothing was told the robot is taken to go on as before: nothing is learnt of what goes with it.
    Guessed,
}

/// A scan when it is known where it was taken.
#[derive(Debug, Clone, Copy)]
pub(super) struct Present<'a> {
    pub(super) sweep: &'a Sweep,
    pub(super) points: &'a SweepPoints,
    /// Of its beams.
    pub(super) directions: &'a [[f64; 2]],
    pub(super) stamp: Stamp,
    pub(super) place: Place,
    pub(super) known: Motion,
}

/// A near hit.
#[derive(Debug, Clone, Copy)]
struct Near {
    beam: usize,
    /// Whether it is on a small thing; asked of the first scan alone.
    is_small: bool,
    /// Where it is in the frame of the robot when the beam was taken, and its cell there.
    place: [f64; 2],
    cell: [usize; 2],
    /// Where it is at the scan's stamp, in the robot's frame.
    hit: [f64; 2],
}

/// A scan that was measured and not remembered yet is forgotten.
impl Stored for OnRobot {
    fn put(&self, out: &mut Vec<u8>) {
        self.seen.put(out);
        (self.by_wheels, self.odds.clone()).put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        let seen = Memory::take(from)?;
        let (by_wheels, odds): (bool, Vec<f32>) = Stored::take(from)?;
        let is_sound = odds.is_empty() || odds.len() == CELLS * CELLS;
        let is_odds = |odds: &f32| (LEAST_SURE - BEFORE..=SUREST - BEFORE).contains(odds);
        let is_suspicious = is_any_above(&odds);
        (is_sound && odds.iter().all(is_odds)).then(|| Self { seen, by_wheels, odds, is_suspicious, ..Self::default() })
    }
}

impl OnRobot {
    /// Drops the beams that end on what is on the robot; how many they are. `points` are the sweep's, `directions` those of its beams;
    /// `by_wheels` says whether sound wheels tell how the robot moves.
    pub(super) fn drop_from(
        &mut self,
        sweep: &mut Sweep,
        points: &SweepPoints,
        directions: &[[f64; 2]],
        by_wheels: bool,
    ) -> u32 {
        self.measured = !by_wheels || self.odds.is_empty() || self.is_suspicious;
        if !self.measured {
            return 0;
        }
        self.gather(sweep, points, directions);
        let dropped = |from: f32| {
            let odds = &self.odds;
            self.near.iter().filter(move |near| odds.get(index(near.cell)).is_some_and(|odds| odds + BEFORE > from))
        };
        let from = if by_wheels { DROPPED } else { DROPPED_ALONE };
        let mut count = 0;
        for near in dropped(from) {
            sweep.codes[near.beam] = BEAM_DROPPED;
            count += 1;
        }
        count
    }

    /// What is near in a sweep, and what is farther away.
    fn gather(&mut self, sweep: &Sweep, points: &SweepPoints, directions: &[[f64; 2]]) {
        measure(sweep, &mut self.ranges);
        self.near.clear();
        self.far.clear();
        let small: Vec<_> =
            if self.odds.is_empty() { things(&points.hits, points.origin).collect() } else { Vec::new() };
        // a cell in the corner of the square
        let farthest_m = 1.5 * REACH_M + points.origin[0].hypot(points.origin[1]);
        let beams = self.ranges.iter().zip(directions).enumerate().filter(|(_, (range_m, _))| range_m.is_finite());
        for (number, ((beam, (&range_m, direction)), &hit)) in beams.zip(&points.hits).enumerate() {
            let range_m = f64::from(range_m);
            let place = [0, 1].map(|axis| points.origin[axis] + range_m * direction[axis]);
            match if range_m <= farthest_m { cell_of(place) } else { None } {
                Some(cell) => {
                    let is_small = small.iter().any(|thing| thing.contains(&number));
                    self.near.push(Near { beam, is_small, place, cell, hit });
                }
                None => self.far.push(hit),
            }
        }
    }

    /// Looks at the present scan, now that it is known where it was taken, and what says so.
    pub(super) fn remember(&mut self, seen: &Present<'_>) {
        let &Present { sweep, points, directions, stamp, place, known } = seen;
        let by_wheels = known == Motion::ByWheels;
        let measured = std::mem::take(&mut self.measured);
        if by_wheels != std::mem::replace(&mut self.by_wheels, by_wheels) || known == Motion::Guessed {
            self.seen.clear();
        }
        if known == Motion::Guessed || self.odds.is_empty() && !measured {
            return;
        }
        if self.odds.is_empty() {
            let is_near = |near: &&Near| near.is_small && near.place[0].hypot(near.place[1]) <= AT_FIRST_M;
            let first = self.near.iter().filter(is_near);
            self.odds = counts(first.map(|near| (near.cell, false)), STRIDE_M).into_iter().map(begin).collect();
            self.is_suspicious = is_any_above(&self.odds);
        }
        let since = |seen: &Seen| {
            if by_wheels {
                place.since(seen.place)
            } else {
                seen.place.local_from_robot.between(place.local_from_robot)
            }
        };
        let step_m = self.seen.newest().map(|seen| moved_m(since(seen)));
        let is_suspected = self.is_suspicious;
        let every_m = if by_wheels && !is_suspected { COMPARED_M } else { EVERY_M };
        if step_m.is_some_and(|step_m| step_m < every_m) {
            return;
        }
        if !measured {
            self.gather(sweep, points, directions);
        }
        let laser = &sweep.laser;
        let before = self.seen.back_in_time().find(|seen| moved_m(since(seen)) >= COMPARED_M);
        let is_asked = !self.near.is_empty() || is_suspected;
        if let (Some(before), Some(step_m), true) = (before, step_m, is_asked) {
            let before_from_now = since(before);
            let pair = before.beside(laser, &self.ranges, before_from_now);
            if let Some(pair) = pair.filter(|pair| self.is_there(pair)) {
                let asked = self.near.iter().step_by(self.near.len().div_ceil(NEAR_ASKED).max(1));
                let said = asked.filter_map(|near| {
                    let shifted = distance(before_from_now.transform(near.hit), near.hit) >= SHIFTED_M;
                    let moved = if shifted { pair.what_became_of(near.hit)? } else { return None };
                    Some((near.cell, moved))
                });
                let said = counts(said, SWING_M);
                // only where something is known does an empty cell say anything
                let near = self.near.iter().filter(|_| is_suspected);
                let seen = counts(near.map(|near| (near.cell, true)), SWING_M);
                add(&mut self.odds, said.into_iter().zip(seen), step_m);
                self.is_suspicious = is_any_above(&self.odds);
            }
        }
        self.seen.keep(laser, stamp, place, &self.ranges);
    }

    /// Whether the robot is where it is thought to be: whether what is farther away is where it was.
    fn is_there(&self, pair: &Pair<'_>) -> bool {
        let far = self.far.iter().step_by(self.far.len().div_ceil(ASKED).max(1));
        let (asked, elsewhere) = (far.len(), far.filter(|hit| pair.has_moved(**hit)).count());
        elsewhere as f64 <= MOST_SHARE * asked as f64
    }

    /// It is no longer known where the robot is; what is on it is.
    pub(super) fn forget_scans(&mut self) {
        self.seen.clear();
        self.measured = false;
    }
}

/// Of each cell, how many hits say that they were there, and that they moved.
type Counts = [[u16; 2]; CELLS * CELLS];

/// How many hits around a cell say so, cell by cell: sums over squares, along rows and then along columns.
fn counts(said: impl Iterator<Item = ([usize; 2], bool)>, around_m: f64) -> Counts {
    let around = (around_m / CELL_M).round() as usize;
    let mut counts = [[0_u16; 2]; CELLS * CELLS];
    let mut said = said.peekable();
    if said.peek().is_none() {
        return counts;
    }
    for (cell, moved) in said {
        let count = &mut counts[index(cell)][usize::from(moved)];
        *count = count.saturating_add(1);
    }
    sum_along(&sum_along(&counts, 1, CELLS, around), CELLS, 1, around)
}

/// Sums over so many neighbours to either side, `step` apart, along lines that are `line` apart.
fn sum_along(counts: &Counts, step: usize, line: usize, around: usize) -> Counts {
    let mut sums = [[0_u16; 2]; CELLS * CELLS];
    for from in (0..CELLS).map(|number| number * line) {
        for at in 0..CELLS {
            let count = counts[from + at * step];
            if count != [0; 2] {
                for near in at.saturating_sub(around)..=(at + around).min(CELLS - 1) {
                    let sum = &mut sums[from + near * step];
                    *sum = [sum[0].saturating_add(count[0]), sum[1].saturating_add(count[1])];
                }
            }
        }
    }
    sums
}

/// What the first scan says of a cell.
fn begin([count, _]: [u16; 2]) -> f32 {
    if count > 0 { AT_FIRST - BEFORE } else { 0.0 }
}

/// Adds what a look says of each cell, after so much motion: of what is there, and whether anything is.
fn add(odds: &mut [f32], said: impl Iterator<Item = ([u16; 2], [u16; 2])>, step_m: f64) {
    let keep = (-std::f64::consts::LN_2 * step_m / HALF_M).exp() as f32;
    let weight = (step_m / LOOK_M).min(1.0) as f32;
    for (odds, ([still, moved], [_, seen])) in odds.iter_mut().zip(said) {
        *odds *= keep;
        let says = if still > 0 || moved > 0 {
            (f32::from(moved) * MOVED + f32::from(still) * STILL) / (f32::from(still) + f32::from(moved))
        } else if seen == 0 && *odds > 0.0 {
            EMPTY
        } else {
            continue;
        };
        *odds = (*odds + weight * says).clamp(LEAST_SURE - BEFORE, SUREST - BEFORE);
    }
}

fn is_any_above(odds: &[f32]) -> bool {
    odds.iter().any(|odds| *odds > 0.0)
}

fn moved_m(motion: Pose2) -> f64 {
    motion.x.hypot(motion.y) + TURNING_M_PER_RAD * motion.theta.abs()
}

fn cell_of(place: [f64; 2]) -> Option<[usize; 2]> {
    let cell = place.map(|along| ((along + REACH_M) / CELL_M).floor());
    let is_near = cell.iter().all(|along| (0.0..CELLS as f64).contains(along));
    is_near.then(|| cell.map(|along| along as usize))
}

fn index([x, y]: [usize; 2]) -> usize {
    y * CELLS + x
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;
    use mapwright_sensor::{BeamTable, LaserModel, LaserScan};
    use std::ops::Range;
    use std::sync::Arc;

    /// A round thing: where, metres, and its radius.
    type Round = ([f64; 2], f64);
    const BEAMS: usize = 360;

    /// Distance to the nearest of the walls at y = 0.8 m and -2 m and round things.
    fn range_m(from: [f64; 2], bearing: f64, things: &[Round]) -> f64 {
        let (s, c) = bearing.sin_cos();
        let y = if s > 0.0 { 0.8 } else { -2.0 };
        let wall = if s.abs() > 1e-3 { (y - from[1]) / s } else { f64::INFINITY };
        let round = |&(center, radius): &Round| {
            let (dx, dy) = (center[0] - from[0], center[1] - from[1]);
            let (along, off) = (dx * c + dy * s, dy * c - dx * s);
            let inside = radius * radius - off * off;
            if along > 0.0 && inside > 0.0 { along - inside.sqrt() } else { f64::INFINITY }
        };
        things.iter().map(round).fold(wall, f64::min)
    }

    /// Drives `step_m` a scan past pillars, with things on the robot; after each scan: beams dropped that end on these and on others, and
    /// those on these that are left.
    fn drive(on: &mut OnRobot, scans: Range<usize>, step_m: f64, by_wheels: bool, things: &[Round]) -> Vec<[usize; 3]> {
        let laser = Arc::new(LaserModel {
            angle_min_rad: -std::f64::consts::PI,
            angle_step_rad: std::f64::consts::TAU / BEAMS as f64,
            range_max_m: 12.0,
            ..LaserModel::half_circle("laser", BEAMS)
        });
        let (mut table, mut points) = (BeamTable::default(), SweepPoints::default());
        let mut scan = |number: usize| {
            let x = step_m * number as f64;
            // Legs swing in turn.
            let swing = |k: usize| if k < 2 { 0.1 * (1.1 * number as f64 + 3.1 * k as f64).sin() } else { 0.0 };
            let shifted = |(k, &([dx, dy], radius)): (usize, &Round)| ([x + dx + swing(k), dy], radius);
            let carried: Vec<Round> = things.iter().enumerate().map(shifted).collect();
            let pillars = (0..8).map(|k| ([0.7 + 1.3 * f64::from(k), -0.8], 0.06));
            let all: Vec<Round> = carried.iter().copied().chain(pillars).collect();
            let bearing = |beam: usize| laser.angle_min_rad + laser.angle_step_rad * beam as f64;
            let range = |things: &[Round], beam: usize| range_m([x, 0.0], bearing(beam), things);
            let ranges_m = (0..BEAMS).map(|beam| range(&all, beam) as f32).collect();
            let stamp = Stamp::from_secs_f64(0.2 * number as f64);
            let scan = LaserScan { stamp, laser: Arc::clone(&laser), ranges_m, odom_from_robot: None };
            let (mut sweep, _) = Sweep::from_scan(&scan, [0.0; 3]);
            points.fill(&sweep, &mut table, 6.0);
            let directions = table.directions(&laser, BEAMS);
            let dropped = on.drop_from(&mut sweep, &points, directions, by_wheels) as usize;
            let pose = Pose2::new(x, 0.0, 0.0);
            let place = Place { local_from_robot: pose, odom_from_robot: pose };
            let known = if by_wheels { Motion::ByWheels } else { Motion::ByScans };
            on.remember(&Present { sweep: &sweep, points: &points, directions, stamp, place, known });
            let is_on = |beam: &usize| range(&carried, *beam) <= range(&all, *beam) && range(&carried, *beam) < 2.0;
            let gone = |beam: &usize| sweep.codes[*beam] == BEAM_DROPPED;
            let ends: Vec<usize> =
                (0..BEAMS).filter(|beam| is_on(beam) && range(&carried, *beam) < range(&[], *beam)).collect();
            let on_things = ends.iter().filter(|beam| gone(beam)).count();
            [on_things, dropped - on_things, ends.len() - on_things]
        };
        scans.map(&mut scan).collect()
    }

    const LEGS: [Round; 3] = [([-0.6, 0.13], 0.1), ([-0.6, -0.13], 0.1), ([0.15, -0.2], 0.02)];

    #[test]
    fn legs_and_posts_are_dropped_after_a_metre_or_two_and_little_else() {
        for (by_wheels, until) in [(true, 16), (false, 10)] {
            let seen = drive(&mut OnRobot::default(), 0..60, 0.12, by_wheels, &LEGS);
            for [gone, others, left] in &seen[until..] {
                assert!(*gone > 40 && *left <= 6 && *others <= 4, "wheels {by_wheels}: {seen:?}");
            }
            assert_eq!(seen[1][0], 0, "nothing is dropped on suspicion alone: {seen:?}");
        }
    }

    #[test]
    fn what_stands_is_kept_though_walls_alongside_keep_their_distance() {
        let seen = drive(&mut OnRobot::default(), 0..80, 0.1, true, &[]);
        assert!(seen.iter().all(|[_, others, _]| *others == 0), "{seen:?}");
        let alone = drive(&mut OnRobot::default(), 0..80, 0.1, false, &[]);
        assert!(alone[12..].iter().all(|[_, others, _]| *others == 0), "{alone:?}");
    }

    #[test]
    fn a_robot_that_stands_learns_nothing_and_one_that_goes_on_as_it_was_knows_it_all() {
        let mut on = OnRobot::default();
        let seen = drive(&mut on, 0..40, 0.0, true, &LEGS);
        assert!(seen.iter().all(|[gone, others, _]| gone + others == 0), "{seen:?}");
        drive(&mut on, 0..20, 0.12, true, &LEGS);
        let mut bytes = Vec::new();
        on.put(&mut bytes);
        let mut again = OnRobot::take(&mut &bytes[..]).unwrap();
        assert_eq!(drive(&mut again, 20..35, 0.12, true, &LEGS), drive(&mut on, 20..35, 0.12, true, &LEGS));
        assert!(OnRobot::take(&mut &bytes[..bytes.len() - 1]).is_none());
        // Nobody pushes any longer.
        let seen = drive(&mut on, 35..75, 0.12, true, &[]);
        assert!(seen[25..].iter().all(|[_, others, _]| *others == 0), "{seen:?}");
    }
}
