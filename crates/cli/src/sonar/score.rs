//! A map's cells beside the walls that are really there.

use mapwright::{CountGrid, Pose2};
use mapwright_sim::{Segment, Site};
use std::f64::consts::TAU;

/// A cell is right where the truth is so within this, metres.
const WITHIN_M: f64 = 0.15;
/// Side of the cells in which the truth is drawn, metres.
const CELL_M: f64 = 0.05;
/// What a sonar could have shown of a wall lies within this of the way, metres.
const SEEN_WITHIN_M: f64 = 3.0;
/// Places of the way from where walls are looked for lie so far apart, metres; and so many directions are looked in.
const LOOK_EVERY_M: f64 = 0.5;
const LOOK_DIRECTIONS: u32 = 90;
/// Cells count as free where hits are so few among the passes, as `map.yaml` says (free_thresh 0.196 of the exported scale).
const FREE_SHARE: f64 = 0.27;

/// How many cells of a map are right.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct CellScore {
    pub(crate) free: u64,
    pub(crate) free_right: u64,
    pub(crate) occupied: u64,
    pub(crate) occupied_right: u64,
    /// Pieces of walls near the way and in its sight, and those of them that the map has.
    pub(crate) walls: u64,
    pub(crate) walls_found: u64,
}

impl CellScore {
    /// Of a map that is laid on the world so; `way` is the robot's true way.
    pub(crate) fn of(map: &CountGrid, passes_per_hit: u32, world_from_map: Pose2, site: &Site, way: &[Pose2]) -> Self {
        let truth = Truth::of(site, way);
        let mut score = Self::default();
        let mut drawn = Raster::like(&truth.surface);
        let resolution_m = map.resolution_m();
        for (x, y, hits, passes) in map.known_cells() {
            let centre = [f64::from(x) + 0.5, f64::from(y) + 0.5].map(|cells| cells * resolution_m);
            let at = world_from_map.transform(centre);
            let weight = f64::from(hits) * f64::from(passes_per_hit);
            if hits > 0 && weight >= f64::from(passes) {
                score.occupied += 1;
                score.occupied_right += u64::from(truth.surface.near(at));
                drawn.mark(at);
            } else if weight / (weight + f64::from(passes)) <= FREE_SHARE {
                score.free += 1;
                score.free_right += u64::from(truth.free.near(at));
            }
        }
        for place in truth.seen(site, way) {
            score.walls += 1;
            score.walls_found += u64::from(drawn.near(place));
        }
        score
    }

    /// Share of the map's free and occupied cells that are right.
    pub(crate) fn right(&self) -> f64 {
        share(self.free_right + self.occupied_right, self.free + self.occupied)
    }

    pub(crate) fn free_share(&self) -> f64 {
        share(self.free_right, self.free)
    }

    pub(crate) fn occupied_share(&self) -> f64 {
        share(self.occupied_right, self.occupied)
    }

    pub(crate) fn walls_share(&self) -> f64 {
        share(self.walls_found, self.walls)
    }
}

fn share(part: u64, whole: u64) -> f64 {
    if whole == 0 { 0.0 } else { part as f64 / whole as f64 }
}

/// What is really there.
struct Truth {
    surface: Raster,
    /// Where the robot could be taken to without going through a wall or into furniture.
    free: Raster,
}

impl Truth {
    fn of(site: &Site, way: &[Pose2]) -> Self {
        let mut still = surfaces(site);
        let low = [0, 1].map(|k| still.iter().map(|p: &[f64; 2]| p[k]).fold(f64::INFINITY, f64::min) - 1.0);
        let high = [0, 1].map(|k| still.iter().map(|p: &[f64; 2]| p[k]).fold(f64::NEG_INFINITY, f64::max) + 1.0);
        let mut blocked = Raster::new(low, high);
        still.iter().for_each(|&place| blocked.mark(place));
        let free = blocked.reached_from(way.iter().map(|pose| [pose.x, pose.y]));
        let leaves = site.world.doors().iter().flat_map(|door| std::iter::once(door.shut).chain(door.open));
        leaves.for_each(|leaf| still.extend(along(&leaf)));
        let mut surface = Raster::new(low, high);
        still.into_iter().for_each(|place| surface.mark(place));
        Self { surface, free }
    }

    /// Places of surfaces that are in sight and near the way, one a cell.
    fn seen(&self, site: &Site, way: &[Pose2]) -> Vec<[f64; 2]> {
        let mut seen = Raster::like(&self.surface);
        let mut last: Option<Pose2> = None;
        for pose in way {
            if last.is_some_and(|last| last.distance(*pose) < LOOK_EVERY_M) {
                continue;
            }
            last = Some(*pose);
            let moment = site.world.at(0.0, [pose.x, pose.y], SEEN_WITHIN_M);
            for k in 0..LOOK_DIRECTIONS {
                let (sin, cos) = mapwright_geom::sin_cos(TAU * f64::from(k) / f64::from(LOOK_DIRECTIONS));
                let range_m = moment.cast([pose.x, pose.y], [cos, sin]);
                if range_m <= SEEN_WITHIN_M {
                    seen.mark([pose.x + range_m * cos, pose.y + range_m * sin]);
                }
            }
        }
        seen.places()
    }
}

/// Points of all that stands still, close enough together to leave no hole.
fn surfaces(site: &Site) -> Vec<[f64; 2]> {
    let mut points: Vec<[f64; 2]> = site.world.segments().iter().flat_map(along).collect();
    for circle in site.world.circles() {
        let steps = (TAU * circle.radius_m / (0.4 * CELL_M)).ceil().max(8.0) as u32;
        points.extend((0..steps).map(|k| {
            let (sin, cos) = mapwright_geom::sin_cos(TAU * f64::from(k) / f64::from(steps));
            [circle.center[0] + circle.radius_m * cos, circle.center[1] + circle.radius_m * sin]
        }));
    }
    points
}

fn along(segment: &Segment) -> Vec<[f64; 2]> {
    let steps = (segment.length_m() / (0.4 * CELL_M)).ceil().max(1.0) as u32;
    let at = |k: u32| {
        let share = f64::from(k) / f64::from(steps);
        [0, 1].map(|axis| segment.a[axis] + share * (segment.b[axis] - segment.a[axis]))
    };
    (0..=steps).map(at).collect()
}

/// Cells of the plane that are marked.
struct Raster {
    low: [f64; 2],
    size: [usize; 2],
    cells: Vec<bool>,
}

impl Raster {
    fn new(low: [f64; 2], high: [f64; 2]) -> Self {
        let size = [0, 1].map(|k| (((high[k] - low[k]) / CELL_M).ceil().clamp(1.0, 10_000.0)) as usize);
        Self { low, size, cells: vec![false; size[0] * size[1]] }
    }

    fn like(other: &Self) -> Self {
        Self { cells: vec![false; other.cells.len()], ..*other }
    }

    fn cell(&self, place: [f64; 2]) -> Option<[usize; 2]> {
        let cell = [0, 1].map(|k| ((place[k] - self.low[k]) / CELL_M).floor());
        let is_inside = (0..2).all(|k| cell[k] >= 0.0 && cell[k] < self.size[k] as f64);
        is_inside.then(|| cell.map(|cells| cells as usize))
    }

    fn mark(&mut self, place: [f64; 2]) {
        if let Some([x, y]) = self.cell(place) {
            self.cells[y * self.size[0] + x] = true;
        }
    }

    /// Whether a marked cell lies within the tolerance.
    fn near(&self, place: [f64; 2]) -> bool {
        let Some([x, y]) = self.cell(place) else { return false };
        let reach = (WITHIN_M / CELL_M).round() as usize;
        let around = |at: usize, size: usize| at.saturating_sub(reach)..(at + reach + 1).min(size);
        let is_within = |i: usize, j: usize| i.abs_diff(x).pow(2) + j.abs_diff(y).pow(2) <= reach.pow(2);
        around(y, self.size[1])
            .any(|j| around(x, self.size[0]).any(|i| is_within(i, j) && self.cells[j * self.size[0] + i]))
    }

    fn places(&self) -> Vec<[f64; 2]> {
        let marked = self.cells.iter().enumerate().filter(|(_, marked)| **marked);
        let centre = |k: usize, cell: usize| self.low[k] + (cell as f64 + 0.5) * CELL_M;
        marked.map(|(at, _)| [centre(0, at % self.size[0]), centre(1, at / self.size[0])]).collect()
    }

    /// All cells that are connected with these places, none of them marked here.
    fn reached_from(&self, places: impl Iterator<Item = [f64; 2]>) -> Self {
        let mut reached = Self::like(self);
        let mut open: Vec<usize> =
            places.filter_map(|place| self.cell(place)).map(|[x, y]| y * self.size[0] + x).collect();
        let width = self.size[0];
        while let Some(at) = open.pop() {
            if reached.cells[at] || self.cells[at] {
                continue;
            }
            reached.cells[at] = true;
            let (x, y) = (at % width, at / width);
            let neighbours = [
                (x > 0, at.wrapping_sub(1)),
                (x + 1 < width, at + 1),
                (y > 0, at.wrapping_sub(width)),
                (y + 1 < self.size[1], at + width),
            ];
            open.extend(neighbours.into_iter().filter(|(is_inside, _)| *is_inside).map(|(_, next)| next));
        }
        reached
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_grid::Change;
    use mapwright_sensor::SweepPoints;
    use mapwright_sim::{Route, World};

    /// A closed room of 4 by 4 m, drawn with its walls shifted by so much.
    fn room(shift_m: f64) -> CellScore {
        let corners = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]];
        let walls = (0..4).map(|k| Segment { a: corners[k], b: corners[(k + 1) % 4] }).collect();
        let site = Site { world: World::new(walls, vec![]), route: Route::new(vec![[2.0, 2.0]]) };
        let (mut map, mut touched) = (CountGrid::new(0.1), Vec::new());
        for k in 0..400 {
            let (sin, cos) = mapwright_geom::sin_cos(TAU * f64::from(k) / 400.0);
            let range_m = (2.0 + shift_m) / sin.abs().max(cos.abs());
            let hit = [2.0 + range_m * cos, 2.0 + range_m * sin];
            let points =
                SweepPoints { hits: vec![hit], normals: vec![[0.0; 2]], origin: [2.0, 2.0], ..SweepPoints::default() };
            map.draw(&points, Pose2::IDENTITY, Change::Add, &mut touched);
        }
        CellScore::of(&map, 5, Pose2::IDENTITY, &site, &[Pose2::new(2.0, 2.0, 0.0)])
    }

    #[test]
    fn cells_are_right_within_the_tolerance_and_not_beyond() {
        let exact = room(0.0);
        assert!(exact.right() > 0.99 && exact.walls_share() > 0.99, "{exact:?}");
        let off = room(0.4);
        assert!(off.occupied_share() < 0.01 && off.walls_share() < 0.01, "{off:?}");
        assert!(off.free_share() < 0.95 && off.free_right < off.free, "{off:?}");
    }
}
