//! Maps of the plane, cell by cell: keyframes drawn where they are, and which tiles that changed.

use crate::news::Seen;
use crate::wire::TILE_SIDE;
use mapwright_geom::{Pose2, Pose3};
use mapwright_grid::{Change, CountGrid};
use mapwright_sensor::{BeamTable, Sweep, SweepPoints};
use std::collections::BTreeSet;
use std::ops::Bound;
use std::sync::Arc;

/// A keyframe is drawn anew when one of its points may have moved by more than this share of a cell, as in the exported map.
const FOLLOW_CELLS: f64 = 0.25;
/// What nothing is known of.
const UNKNOWN: u8 = 128;
/// What one, two beams have passed and none hit; more are [`FREE`].
const PASSED: [u8; 2] = [64, 32];
const FREE: u8 = 0;
/// Grey levels of cells that were hit: the fewer there are, the fewer tiles change.
const LEVELS: f64 = 6.0;

/// Along a beam tiles are looked up so often, in cells, and those count that lie as near as that: half a step, and what rounding makes.
const STEP_CELLS: f64 = 16.0;
const MARGIN_CELLS: f64 = STEP_CELLS / 2.0 + 2.0;
/// No beam is as long, in cells; what would be is a fault of its sensor.
const MOST_CELLS: f64 = 1e5;
/// Set in a touched slot where a beam ended.
const BEAM_END: u32 = 1 << 31;

/// First and last column and row of tiles.
type Around = [[i32; 2]; 2];

/// How keyframes become cells: settings of the map that is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pen {
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// How far a beam without return clears free space, metres.
    pub free_range_m: f64,
    /// Passes that a hit outweighs.
    pub passes_per_hit: u32,
}

impl Pen {
    /// The same with values that can be drawn with.
    fn sound(self) -> Self {
        let or = |value: f64, least: f64, otherwise: f64| {
            if value.is_finite() && value >= least { value } else { otherwise }
        };
        Self {
            resolution_m: or(self.resolution_m, 1e-3, 0.05),
            free_range_m: or(self.free_range_m, 0.0, 0.0),
            passes_per_hit: self.passes_per_hit.max(1),
        }
    }
}

/// A sweep and where it is drawn.
struct Drawn {
    sweep: Arc<Sweep>,
    map_from_robot: Pose2,
    /// The same as it was told.
    told: Pose3,
    /// Distance of its farthest point from the robot, metres: how far a rotation moves it.
    lever_m: f64,
}

/// Counts of hits and passes, and the tiles in which some changed.
pub(crate) struct Picture {
    pen: Pen,
    counts: CountGrid,
    drawn: Vec<Option<Drawn>>,
    /// Tiles in which cells may have changed: those that were read before, and those that were not.
    changed: BTreeSet<(i32, i32)>,
    fresh: BTreeSet<(i32, i32)>,
    read: BTreeSet<(i32, i32)>,
    /// Of those that were read before, the one that was read last.
    last: (i32, i32),
    points: SweepPoints,
    table: BeamTable,
}

/// A keyframe that is not drawn as it should be.
pub(crate) enum Work {
    /// It is not drawn yet.
    New(usize),
    /// It is drawn elsewhere, or should not be.
    Old(usize),
}

impl Picture {
    pub(crate) fn new(pen: Pen) -> Self {
        let pen = pen.sound();
        Self {
            pen,
            counts: CountGrid::new(pen.resolution_m),
            drawn: Vec::new(),
            changed: BTreeSet::new(),
            fresh: BTreeSet::new(),
            read: BTreeSet::new(),
            last: (0, 0),
            points: SweepPoints::default(),
            table: BeamTable::default(),
        }
    }

    pub(crate) fn resolution_m(&self) -> f64 {
        self.pen.resolution_m
    }

    /// What is to be done so that all keyframes are drawn where they are, the newest first.
    pub(crate) fn work<'a>(&self, wanted: impl ExactSizeIterator<Item = (&'a Seen, &'a Pose3)>) -> Vec<Work> {
        let mut work: Vec<Work> =
            (wanted.len()..self.drawn.len()).filter(|&number| self.drawn[number].is_some()).map(Work::Old).collect();
        for (number, (seen, &map_from_robot)) in wanted.enumerate() {
            match (self.drawn.get(number).and_then(Option::as_ref), seen) {
                (None, Seen::Plane(_)) if map_from_robot.is_finite() => work.push(Work::New(number)),
                (Some(drawn), Seen::Plane(sweep)) => {
                    if !Arc::ptr_eq(&drawn.sweep, sweep) || self.has_moved(drawn, map_from_robot) {
                        work.push(Work::Old(number));
                    }
                }
                (Some(_), _) => work.push(Work::Old(number)),
                (None, _) => {}
            }
        }
        work.reverse();
        work
    }

    fn has_moved(&self, drawn: &Drawn, told: Pose3) -> bool {
        if drawn.told == told {
            return false;
        }
        let now = in_plane(told);
        let turned_rad = drawn.map_from_robot.between(now).theta.abs();
        drawn.map_from_robot.distance(now) + drawn.lever_m * turned_rad > FOLLOW_CELLS * self.pen.resolution_m
    }

    /// Takes a keyframe out where it is drawn, and draws it where it is wanted.
    pub(crate) fn redraw(&mut self, number: usize, wanted: Option<(&Seen, &Pose3)>) {
        if self.drawn.len() <= number {
            self.drawn.resize_with(number + 1, || None);
        }
        if let Some(old) = self.drawn[number].take() {
            self.draw(&old.sweep, old.map_from_robot, Change::Remove);
        }
        if let Some((Seen::Plane(sweep), &map_from_robot)) = wanted
            && map_from_robot.is_finite()
        {
            let told = map_from_robot;
            let map_from_robot = in_plane(told);
            self.draw(sweep, map_from_robot, Change::Add);
            let lever_m = self.lever_m();
            self.drawn[number] = Some(Drawn { sweep: Arc::clone(sweep), map_from_robot, told, lever_m });
        }
    }

    fn draw(&mut self, sweep: &Arc<Sweep>, map_from_robot: Pose2, change: Change) {
        self.points.fill(sweep, &mut self.table, self.pen.free_range_m);
        self.points.normals.clear();
        self.points.normals.resize(self.points.hits.len(), [0.0; 2]); // a picture shows none
        let mut touched = Vec::new();
        self.counts.draw(&self.points, map_from_robot, change, &mut touched);
        if change == Change::Remove {
            touched.iter().for_each(|slot| self.counts.release_if_empty(slot & !BEAM_END));
        }
        self.mark(map_from_robot);
    }

    fn lever_m(&self) -> f64 {
        let ends = self.points.hits.iter().chain(&self.points.free_ends);
        ends.fold(0.0_f64, |most, &[x, y]| most.max(x.hypot(y)))
    }

    /// Marks the tiles that the beams of `points` cross: those within some cells of points along each beam.
    fn mark(&mut self, map_from_robot: Pose2) {
        let cells_per_m = 1.0 / self.pen.resolution_m;
        let in_cells = |point: [f64; 2]| map_from_robot.transform(point).map(|metres| metres * cells_per_m);
        let start = in_cells(self.points.origin);
        // Of the beam before at each step: neighbours mostly cross the same tiles.
        let mut last: Vec<Option<Around>> = Vec::new();
        for &end in self.points.hits.iter().chain(&self.points.free_ends) {
            let [dx, dy] = [in_cells(end)[0] - start[0], in_cells(end)[1] - start[1]];
            let length = dx.hypot(dy).min(MOST_CELLS);
            let steps = (length / STEP_CELLS).ceil() as usize;
            last.resize(last.len().max(steps + 1), None);
            for (step, last) in last.iter_mut().enumerate().take(steps + 1) {
                let share = (STEP_CELLS * step as f64 / length.max(1e-9)).min(1.0);
                let around = [start[0] + share * dx, start[1] + share * dy].map(tiles_around);
                if *last != Some(around) {
                    *last = Some(around);
                    let [[x0, x1], [y0, y1]] = around;
                    for tile in (y0..=y1).flat_map(|y| (x0..=x1).map(move |x| (x, y))) {
                        let known = self.read.contains(&tile);
                        if known {
                            self.changed.insert(tile)
                        } else {
                            self.fresh.insert(tile)
                        };
                    }
                }
            }
        }
    }

    /// A tile in which cells may have changed since it was read, of those that were never read or of the
    /// others in turn; with its cells row by row.
    pub(crate) fn next_changed(&mut self, fresh: bool) -> Option<((i32, i32), Vec<u8>)> {
        let tile = if fresh {
            self.fresh.pop_first()?
        } else {
            let (after, first) =
                (self.changed.range((Bound::Excluded(self.last), Bound::Unbounded)).next(), self.changed.first());
            let tile = *after.or(first)?;
            self.changed.remove(&tile);
            self.last = tile;
            tile
        };
        self.read.insert(tile);
        Some((tile, self.cells(tile)))
    }

    /// Cells of a tile, the lowest row first.
    pub(crate) fn cells(&self, (tile_x, tile_y): (i32, i32)) -> Vec<u8> {
        let side = TILE_SIDE as i32;
        let rows = (0..side).flat_map(|row| (0..side).map(move |column| (column, row)));
        rows.map(|(column, row)| self.cell(tile_x.wrapping_mul(side) + column, tile_y.wrapping_mul(side) + row))
            .collect()
    }

    fn cell(&self, x: i32, y: i32) -> u8 {
        let passes = self.counts.passes(x, y);
        let hits = self.counts.slot(x, y).map_or(0, |slot| self.counts.cell(slot).hits);
        match (hits, passes) {
            (0, 0) => UNKNOWN,
            (0, passes) => *PASSED.get(passes as usize - 1).unwrap_or(&FREE),
            _ => {
                let weight = f64::from(hits) * f64::from(self.pen.passes_per_hit);
                let share = weight / (weight + f64::from(passes));
                (((share * LEVELS).round() / LEVELS) * 255.0) as u8
            }
        }
    }

    #[cfg(test)]
    pub(crate) fn has_changed(&self) -> bool {
        !self.changed.is_empty() || !self.fresh.is_empty()
    }

    #[cfg(test)]
    pub(crate) fn counts(&self) -> &CountGrid {
        &self.counts
    }
}

/// First and last tile along an axis within a margin of a coordinate; coordinate and margin in cells.
fn tiles_around(cells: f64) -> [i32; 2] {
    let tile = |cells: f64| (cells / TILE_SIDE as f64).floor() as i32;
    [tile(cells - MARGIN_CELLS), tile(cells + MARGIN_CELLS)]
}

/// What a pose in space is in the plane.
fn in_plane(pose: Pose3) -> Pose2 {
    let (_, _, yaw) = pose.rotation.euler_angles();
    Pose2::new(pose.translation.x, pose.translation.y, yaw)
}
