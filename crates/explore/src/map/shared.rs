//! A map that grows with every sweep: what a sweep changes costs what the sweep is long, however large the map is.

use super::{BORDER, Cell, MAX_CELLS, OccupancyMap, Stood};
use mapwright_geom::{Pose2, sin_cos};
use mapwright_grid::Change;
use mapwright_sensor::SweepPoints;

/// The map grows by so much more than it must, metres, so that it seldom grows.
const SPARE_M: f64 = 8.0;
/// What an obstacle that no beam has shown counts: more hits than any number of passes outweighs.
const FELT: u32 = 1 << 24;

/// The counts of all robots' sweeps in one frame, and the map that they amount to.
#[derive(Debug, Clone)]
pub struct SharedMap {
    map: OccupancyMap,
    /// Hits and passes of each cell.
    counts: Vec<[u32; 2]>,
    passes_per_hit: u32,
    /// Obstacles that no beam has shown, and until when they count, seconds.
    felt_m: Vec<([f64; 2], f64)>,
}

impl SharedMap {
    /// An empty map. A cell is occupied where hits times `passes_per_hit` reach the passes.
    #[must_use]
    pub fn new(resolution_m: f64, passes_per_hit: u32) -> Self {
        let cells = vec![Cell::Unknown; 9];
        let stood = vec![Stood::default(); 9];
        let map = OccupancyMap { origin_m: [0.0; 2], resolution_m, width: 3, height: 3, cells, stood, passing: 0 };
        Self { map, counts: vec![[0; 2]; 9], passes_per_hit, felt_m: Vec::new() }
    }

    /// The map as it is now.
    #[must_use]
    pub fn map(&self) -> &OccupancyMap {
        &self.map
    }

    /// Counts a sweep in or out. A sweep that would make the map larger than can be kept is left out; whether it was counted.
    pub fn draw(&mut self, points: &SweepPoints, map_from_robot: Pose2, change: Change) -> bool {
        let (sin, cos) = sin_cos(map_from_robot.theta);
        let to_map =
            |[x, y]: [f64; 2]| [map_from_robot.x + (cos * x - sin * y), map_from_robot.y + (sin * x + cos * y)];
        let start_m = to_map(points.origin);
        let (mut low_m, mut high_m) = (start_m, start_m);
        for end_m in points.hits.iter().chain(&points.free_ends).map(|&end| to_map(end)) {
            for k in 0..2 {
                (low_m[k], high_m[k]) = (low_m[k].min(end_m[k]), high_m[k].max(end_m[k]));
            }
        }
        if !self.hold(low_m, high_m) {
            return false;
        }
        for &hit in &points.hits {
            let end = self.in_cells(to_map(hit));
            self.pass(self.in_cells(start_m), end, change);
            self.count(end[1] as usize * self.map.width + end[0] as usize, 0, 1, change);
        }
        for &free in &points.free_ends {
            self.pass(self.in_cells(start_m), self.in_cells(to_map(free)), change);
        }
        true
    }

    /// The middle of a robot is there: others can stand there as well, however near the walls are that beams have shown.
    pub fn stand(&mut self, point_m: [f64; 2]) {
        if let Some(index) = self.map.index_of(point_m) {
            let share = self.in_cells(point_m).map(|cells| cells - cells.floor());
            self.map.stood[index] = Stood::at(share);
        }
    }

    /// Something is there that no beam need have shown, for it held a robot or is one that has died: an obstacle until that time, seconds. If it
    /// stays for good, nobody can stand within `radius_m` because others have stood there.
    pub fn feel(&mut self, point_m: [f64; 2], radius_m: f64, until_s: f64) {
        let Some(index) = self.map.index_of(point_m).filter(|&index| self.is_inside(index)) else { return };
        self.count(index, 0, FELT, Change::Add);
        self.felt_m.push((point_m, until_s));
        self.count_passing();
        if until_s.is_finite() {
            // Where one has stood others can again when it has gone: it may be the only way out.
            return;
        }
        let cells = (radius_m / self.map.resolution_m).ceil() as i64;
        for (x, y) in (-cells..=cells).flat_map(|y| (-cells..=cells).map(move |x| (x, y))) {
            let near_m = [point_m[0] + x as f64 * self.map.resolution_m, point_m[1] + y as f64 * self.map.resolution_m];
            self.map.index_of(near_m).into_iter().for_each(|near| self.map.stood[near] = Stood::default());
        }
    }

    /// Forgets what held robots so long ago that it may have been something that moves.
    pub fn forget(&mut self, now_s: f64) {
        while let Some(at) = self.felt_m.iter().position(|&(_, until_s)| until_s <= now_s) {
            let (point_m, _) = self.felt_m.swap_remove(at);
            if let Some(index) = self.map.index_of(point_m) {
                self.count(index, 0, FELT, Change::Remove);
            }
        }
        self.count_passing();
    }

    fn count_passing(&mut self) {
        self.map.passing = self.felt_m.iter().filter(|(_, until_s)| until_s.is_finite()).count();
    }

    fn in_cells(&self, point_m: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|k| (point_m[k] - self.map.origin_m[k]) / self.map.resolution_m)
    }

    fn is_inside(&self, index: usize) -> bool {
        let (x, y) = (index % self.map.width, index / self.map.width);
        let inner = |at: usize, side: usize| at >= BORDER && at + BORDER < side;
        inner(x, self.map.width) && inner(y, self.map.height)
    }

    /// From the start up to but not including the cell of the end: one cell a step along the longer axis.
    fn pass(&mut self, start: [f64; 2], end: [f64; 2], change: Change) {
        let along = usize::from((end[1] - start[1]).abs() > (end[0] - start[0]).abs());
        let across = 1 - along;
        let (first, last) = (start[along] as i64, end[along] as i64);
        let steps = last.abs_diff(first) as usize;
        if steps == 0 {
            return;
        }
        let direction = if last > first { 1.0 } else { -1.0 };
        let slope = (end[across] - start[across]) / (end[along] - start[along]);
        let mut at = [0.0; 2];
        at[along] = first as f64 + 0.5;
        at[across] = start[across] + slope * (at[along] - start[along]);
        for _ in 0..steps {
            let index = at[1].max(0.0) as usize * self.map.width + at[0].max(0.0) as usize;
            self.count(index, 1, 1, change);
            at[along] += direction;
            at[across] += slope * direction;
        }
    }

    #[inline]
    fn count(&mut self, index: usize, which: usize, by: u32, change: Change) {
        let Some(counts) = self.counts.get_mut(index) else { return };
        let before = said(*counts, self.passes_per_hit);
        counts[which] = match change {
            Change::Add => counts[which].saturating_add(by),
            Change::Remove => counts[which].saturating_sub(by),
        };
        if said(*counts, self.passes_per_hit) != before {
            self.settle(index);
        }
    }

    /// A cell has changed, and with it what its neighbours may be.
    fn settle(&mut self, index: usize) {
        if self.is_inside(index) {
            for cell in self.map.sides(index).into_iter().chain([index]) {
                self.map.cells[cell] = self.shown(cell);
            }
        }
    }

    /// What is said of a cell, and, where that is nothing, what its neighbours say: beams far out leave gaps between each other.
    fn shown(&self, index: usize) -> Cell {
        let said = |index: usize| said(self.counts[index], self.passes_per_hit);
        if said(index) != Cell::Unknown {
            return said(index);
        }
        let near = self.map.sides(index).map(said);
        let between = !near.contains(&Cell::Occupied) && near.iter().filter(|cell| **cell == Cell::Free).count() >= 3;
        if between { Cell::Free } else { Cell::Unknown }
    }

    /// Makes room for what lies between two corners.
    fn hold(&mut self, low_m: [f64; 2], high_m: [f64; 2]) -> bool {
        let (old, cell_m) = (self.map.size(), self.map.resolution_m);
        let [low, high] = [low_m, high_m].map(|corner_m| self.in_cells(corner_m));
        let border = BORDER as f64 + 1.0;
        if (0..2).all(|k| low[k] >= border && high[k] + border < old[k] as f64) {
            return true;
        }
        let spare = border + (SPARE_M / cell_m).ceil();
        // Cells more at the lower and at the upper end of each axis.
        let more = [0, 1].map(|k| {
            let below = if low[k] < border { (spare - low[k].floor()).max(0.0) } else { 0.0 };
            let above = high[k] + border - old[k] as f64;
            [below, if above >= 0.0 { (above + spare).ceil() } else { 0.0 }]
        });
        let size = [0, 1].map(|k| more[k][0] + old[k] as f64 + more[k][1]);
        let area = size[0] * size[1];
        if area.is_nan() || area > MAX_CELLS as f64 {
            return false;
        }
        let [width, height] = size.map(|side| side as usize);
        let [left, below] = [0, 1].map(|k| more[k][0] as usize);
        let (mut cells, mut counts) = (vec![Cell::Unknown; width * height], vec![[0; 2]; width * height]);
        let mut stood = vec![Stood::default(); width * height];
        for row in 0..old[1] {
            let (from, to) = (row * old[0], (row + below) * width + left);
            cells[to..to + old[0]].copy_from_slice(&self.map.cells[from..from + old[0]]);
            counts[to..to + old[0]].copy_from_slice(&self.counts[from..from + old[0]]);
            stood[to..to + old[0]].copy_from_slice(&self.map.stood[from..from + old[0]]);
        }
        let origin_m = [0, 1].map(|k| self.map.origin_m[k] - more[k][0] * cell_m);
        self.map =
            OccupancyMap { origin_m, resolution_m: cell_m, width, height, cells, stood, passing: self.map.passing };
        self.counts = counts;
        true
    }
}

#[inline]
fn said([hits, passes]: [u32; 2], passes_per_hit: u32) -> Cell {
    match (hits, passes) {
        (0, 0) => Cell::Unknown,
        _ if hits > 0 && hits.saturating_mul(passes_per_hit) >= passes => Cell::Occupied,
        _ => Cell::Free,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_grid::CountGrid;

    /// A round room of so many metres, seen from its middle.
    fn room(radius_m: f64) -> SweepPoints {
        let at = |k: u32| f64::from(k).to_radians();
        let hits: Vec<[f64; 2]> = (0..360).map(|k| [radius_m * at(k).cos(), radius_m * at(k).sin()]).collect();
        SweepPoints { normals: vec![[0.0; 2]; hits.len()], hits, ..SweepPoints::default() }
    }

    #[test]
    fn it_shows_what_counts_of_all_sweeps_show_and_forgets_what_is_taken_out() {
        let mut shared = SharedMap::new(0.1, 12);
        let mut counts = CountGrid::new(0.1);
        for (k, radius_m) in [3.0, 2.0, 30.0].into_iter().enumerate() {
            let pose = Pose2::new(-4.0 * k as f64 + 0.03, 2.0 * k as f64 + 0.01, 0.1);
            assert!(shared.draw(&room(radius_m), pose, Change::Add));
            counts.draw(&room(radius_m), pose, Change::Add, &mut Vec::new());
        }
        let whole = OccupancyMap::of_counts(&[&counts], 12).unwrap();
        let differ = |index: &usize| shared.map().at(whole.center_m(*index)) != whole.cells()[*index];
        let differing = (0..whole.cells().len()).filter(differ).count();
        // Beams that pass the corners of cells are rounded differently.
        assert!(differing * 100 < whole.cells().len(), "{differing} of {}", whole.cells().len());
        let before = shared.map().clone();
        shared.draw(&room(5.0), Pose2::new(3.0, 3.0, 1.0), Change::Add);
        assert_ne!(&before, shared.map());
        shared.draw(&room(5.0), Pose2::new(3.0, 3.0, 1.0), Change::Remove);
        assert_eq!(&before, shared.map());
        assert!(!shared.draw(&room(1e6), Pose2::IDENTITY, Change::Add), "too large to keep");
        assert_eq!(&before, shared.map());
    }

    #[test]
    fn what_held_a_robot_is_an_obstacle_for_a_while() {
        let mut shared = SharedMap::new(0.1, 12);
        (0..50).for_each(|_| assert!(shared.draw(&room(3.0), Pose2::IDENTITY, Change::Add)));
        let before = shared.map().clone();
        shared.feel([1.0, 1.0], 0.4, 20.0);
        assert_eq!(shared.map().at([1.0, 1.0]), Cell::Occupied);
        shared.forget(19.0);
        assert_eq!(shared.map().at([1.0, 1.0]), Cell::Occupied);
        shared.forget(20.0);
        assert_eq!(&before, shared.map());
    }
}
