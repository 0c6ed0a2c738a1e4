//! What keeps its place relative to the robot is neither matched nor drawn: the legs of who pushes it, its own body and posts.
//!
//! A near hit speaks for that where it lies in space that was free, seen from where the robot was before it moved on, or has left
//! where it stood then; it speaks against it where the same was seen there. What is said of a cell of the robot's frame, look by
//! look, adds up to the odds that what is seen in the cell travels with the robot. Things of the surroundings pass through a cell in a
//! few looks. A robot that stands learns nothing and forgets nothing.

use super::seen::{Memory, Place, Ranges, Seen, measure};
use mapwright_geom::{Pose2, Stamp, Stored};
use mapwright_sensor::{BEAM_DROPPED, LaserModel, Sweep, SweepPoints};
use std::sync::Arc;

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
/// Scans are remembered after this much motion.
const EVERY_M: f64 = 0.05;
/// A look compares with the newest scan after which the robot moved so far: farther than a foot that rests on the floor stays in its
/// place among those of the other steps.
const COMPARED_M: f64 = 0.4;
/// And a hit that has to have been elsewhere by this much in the robot's frame, metres.
const SHIFTED_M: f64 = 0.25;
/// Log odds that a thing in a cell is on the robot, before anything is known: one in ten thousand cells.
const BEFORE: f32 = -9.0;
/// What a look adds where all hits lie in what was free, and where all were there before: twelve times likelier of what is on the robot,
/// as its cells are found free nearly always, and seven times less.
const MOVED: f32 = 2.5;
const STILL: f32 = -2.0;
/// So sure one can become, and so sure that it is not so: it takes a few looks to change one's mind.
const SUREST: f32 = 6.0;
const LEAST_SURE: f32 = -12.0;
/// After so many metres of way half of what was known is forgotten.
const HALF_M: f64 = 10.0;
/// Where more than this share of what is farther away is elsewhere as well, the robot is not where it is thought to be.
const MOST_SHARE: f64 = 0.2;
/// So many of those hits are asked.
const ASKED: usize = 64;

/// What was seen of late near the robot, and where in its frame things travel with it.
#[derive(Debug, Clone, Default)]
pub(super) struct OnRobot {
    seen: Memory,
    /// Whether ways in `seen` are those of the wheels.
    by_wheels: bool,
    /// Log odds by cell, beyond those of which nothing is known; empty before the first look.
    odds: Vec<f32>,
    /// Of the present scan, if it was measured.
    ranges: Ranges,
    near: Vec<Near>,
    far: Vec<[f64; 2]>,
    measured: bool,
}

/// A near hit.
#[derive(Debug, Clone, Copy)]
struct Near {
    /// Its cell: where the robot was when the beam was taken.
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
        (is_sound && odds.iter().all(is_odds)).then(|| Self { seen, by_wheels, odds, ..Self::default() })
    }
}

impl OnRobot {
    /// Drops the beams that end on what is on the robot; how many they are. `points` are the sweep's, `directions` those of its beams.
    pub(super) fn drop_from(&mut self, sweep: &mut Sweep, points: &SweepPoints, directions: &[[f64; 2]]) -> u32 {
        measure(sweep, &mut self.ranges);
        self.measured = true;
        self.near.clear();
        self.far.clear();
        let mut dropped = 0;
        let returns = (0..sweep.codes.len()).filter(|&beam| self.ranges[beam].is_finite());
        for ((beam, &hit), direction) in returns.zip(&points.hits).filter_map(|(beam, hit)| Some(((beam, hit), directions.get(beam)?))) {
            let range_m = f64::from(self.ranges[beam]);
            let place = [0, 1].map(|axis| points.origin[axis] + range_m * direction[axis]);
            let Some(cell) = cell_of(place) else {
                self.far.push(hit);
                continue;
            };
            self.near.push(Near { cell, hit });
            if self.odds.get(index(cell)).is_some_and(|odds| odds + BEFORE > 0.0) {
                sweep.codes[beam] = BEAM_DROPPED;
                dropped += 1;
            }
        }
        dropped
    }

    /// Looks at the present scan, if it was measured, now that it is known where it was taken, and whether the wheels say so.
    pub(super) fn remember(&mut self, laser: &Arc<LaserModel>, stamp: Stamp, place: Place, by_wheels: bool) {
        if !std::mem::take(&mut self.measured) {
            return;
        }
        if by_wheels != std::mem::replace(&mut self.by_wheels, by_wheels) {
            self.seen.clear();
        }
        let since = |seen: &Seen| {
            if by_wheels { place.since(seen.place) } else { seen.place.local_from_robot.between(place.local_from_robot) }
        };
        let moved_m = self.seen.newest().map(|seen| moved_m(since(seen)));
        if moved_m.is_some_and(|moved_m| moved_m < EVERY_M) {
            return;
        }
        let before = self.seen.back_in_time().find(|seen| moved_m_at_least(since(seen)));
        let pair = before.and_then(|before| {
            let before_from_now = since(before);
            Some((before.beside(laser, &self.ranges, before_from_now)?, before_from_now))
        });
        if let (Some((pair, before_from_now)), Some(moved_m)) = (pair, moved_m) {
            let far = self.far.iter().step_by(self.far.len().div_ceil(ASKED).max(1));
            let (asked, elsewhere) = (far.len(), far.filter(|hit| pair.has_moved(**hit)).count());
            if !self.near.is_empty() && elsewhere as f64 <= MOST_SHARE * asked as f64 {
                let shifted = |hit: [f64; 2]| distance(before_from_now.transform(hit), hit) >= SHIFTED_M;
                let said = self.near.iter().filter(|near| shifted(near.hit)).filter_map(|near| {
                    let moved = pair.has_moved(near.hit);
                    (moved || pair.was_there(near.hit)).then_some((near.cell, moved))
                });
                look(&mut self.odds, said, moved_m);
            }
        }
        self.seen.keep(laser, stamp, place, &self.ranges);
    }

    /// It is no longer known where the robot is; what is on it is.
    pub(super) fn forget_scans(&mut self) {
        self.seen.clear();
        self.measured = false;
    }
}

/// Adds what hits say of the cells around theirs, after so much motion.
fn look(odds: &mut Vec<f32>, said: impl Iterator<Item = ([usize; 2], bool)>, moved_m: f64) {
    odds.resize(CELLS * CELLS, 0.0);
    let keep = (-std::f64::consts::LN_2 * moved_m / HALF_M).exp() as f32;
    odds.iter_mut().for_each(|odds| *odds *= keep);
    let around = (SWING_M / CELL_M) as usize;
    let mut counts = vec![[0_u16; 2]; CELLS * CELLS];
    for ([x, y], moved) in said {
        for y in y.saturating_sub(around)..=(y + around).min(CELLS - 1) {
            for x in x.saturating_sub(around)..=(x + around).min(CELLS - 1) {
                counts[index([x, y])][usize::from(moved)] += 1;
            }
        }
    }
    let weight = (moved_m / LOOK_M).min(1.0) as f32;
    for (odds, [still, moved]) in odds.iter_mut().zip(counts).filter(|(_, counts)| *counts != [0; 2]) {
        let (still, moved) = (f32::from(still), f32::from(moved));
        let says = (moved * MOVED + still * STILL) / (moved + still);
        *odds = (*odds + weight * says).clamp(LEAST_SURE - BEFORE, SUREST - BEFORE);
    }
}

fn moved_m(motion: Pose2) -> f64 {
    motion.x.hypot(motion.y) + TURNING_M_PER_RAD * motion.theta.abs()
}

fn moved_m_at_least(motion: Pose2) -> bool {
    moved_m(motion) >= COMPARED_M
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
