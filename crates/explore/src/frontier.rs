//! Frontiers: where free space borders on the unknown (Yamauchi 1997), and what would be seen from there.

use crate::map::{Cell, OccupancyMap};
use crate::travel::Terrain;
use std::collections::BTreeSet;
use std::f64::consts::TAU;

/// Directions that are looked into from a place.
const RAYS: usize = 72;
/// Side of a block of cells: new area is counted in blocks, whose distance rays keep up to a few metres out.
const BLOCK: usize = 4;

/// A piece of frontier and where to see it from.
#[derive(Debug, Clone)]
pub(crate) struct Frontier {
    pub(crate) cells: Vec<usize>,
    /// The member nearest to the middle.
    pub(crate) middle: usize,
}

/// All frontiers, each no longer than `most_m` so that robots can share long ones.
pub(crate) fn frontiers(map: &OccupancyMap, most_m: f64) -> Vec<Frontier> {
    const OTHER: u8 = 0;
    const FRONTIER: u8 = 1;
    let (mut kind, mut seeds) = (vec![OTHER; map.cells().len()], Vec::new());
    for index in map.inner() {
        if is_frontier(map, index) {
            kind[index] = FRONTIER;
            seeds.push(index);
        }
    }
    let mut found = Vec::new();
    for seed in seeds {
        if kind[seed] != FRONTIER {
            continue;
        }
        kind[seed] = OTHER;
        let (mut cells, mut next) = (vec![seed], 0);
        while let Some(&cell) = cells.get(next) {
            next += 1;
            for near in map.around(cell) {
                if kind[near] == FRONTIER && map.between_m(near, seed) <= most_m {
                    kind[near] = OTHER;
                    cells.push(near);
                }
            }
        }
        let middle = middle_of(map, &cells);
        found.push(Frontier { cells, middle });
    }
    found
}

/// Whether a cell is free and borders on the unknown.
#[inline]
fn is_frontier(map: &OccupancyMap, index: usize) -> bool {
    map.cells()[index] == Cell::Free && map.sides(index).iter().any(|&side| map.cells()[side] == Cell::Unknown)
}

/// Whether there is any frontier within a distance of a point.
pub(crate) fn has_frontier(map: &OccupancyMap, point_m: [f64; 2], within_m: f64) -> bool {
    let cells = (within_m / map.resolution_m()).ceil() as i64;
    let offset_m = |k: i64| k as f64 * map.resolution_m();
    let mut around = (-cells..=cells).flat_map(|y| (-cells..=cells).map(move |x| [offset_m(x), offset_m(y)]));
    around.any(|[x, y]| {
        map.index_of([point_m[0] + x, point_m[1] + y])
            .is_some_and(|index| x.hypot(y) <= within_m && is_frontier(map, index))
    })
}

/// The member nearest to the mean.
fn middle_of(map: &OccupancyMap, cells: &[usize]) -> usize {
    let mut mean = [0.0; 2];
    for center in cells.iter().map(|&cell| map.center_m(cell)) {
        (0..2).for_each(|k| mean[k] += center[k] / cells.len() as f64);
    }
    let away = |&cell: &usize| {
        let [x, y] = map.center_m(cell);
        (x - mean[0]).hypot(y - mean[1])
    };
    cells.iter().copied().min_by(|a, b| away(a).total_cmp(&away(b))).unwrap_or(0)
}

impl Frontier {
    /// Length, metres.
    pub(crate) fn length_m(&self, map: &OccupancyMap) -> f64 {
        self.cells.len() as f64 * map.resolution_m()
    }

    /// Where robots can stand to look beyond it, the place nearest to the middle first: those nearest to the frontier that free cells lead to,
    /// within two robots' widths. None where there is no room.
    pub(crate) fn stands(&self, map: &OccupancyMap, terrain: &Terrain) -> Vec<usize> {
        let steps = (4.0 * terrain.radius_m() / map.resolution_m()).ceil() as usize + 1;
        let mut reached: Vec<usize> = self.cells.clone();
        let mut seen: BTreeSet<usize> = self.cells.iter().copied().collect();
        for _ in 0..=steps {
            let mut open: Vec<usize> = reached.iter().copied().filter(|&cell| terrain.is_roomy(cell)).collect();
            if !open.is_empty() {
                open.sort_by(|&a, &b| map.between_m(a, self.middle).total_cmp(&map.between_m(b, self.middle)));
                return open;
            }
            let mut next = Vec::new();
            for near in reached.iter().flat_map(|&cell| map.around(cell)) {
                if map.cells()[near] == Cell::Free && seen.insert(near) {
                    next.push(near);
                }
            }
            reached = next;
        }
        Vec::new()
    }
}

/// Counts what a sensor would newly see from places of a map.
#[derive(Debug)]
pub(crate) struct Views<'a> {
    map: &'a OccupancyMap,
    directions: Vec<[f64; 2]>,
    blocks_wide: usize,
    /// Unknown area of each block, square metres.
    unknown_m2: Vec<f32>,
    stamps: Vec<u32>,
    stamp: u32,
}

impl<'a> Views<'a> {
    pub(crate) fn new(map: &'a OccupancyMap) -> Self {
        let [width, height] = map.size();
        let blocks_wide = width.div_ceil(BLOCK);
        let mut unknown_m2 = vec![0.0; blocks_wide * height.div_ceil(BLOCK)];
        let cell_m2 = (map.resolution_m() * map.resolution_m()) as f32;
        for (row, cells) in map.cells().chunks_exact(width).enumerate() {
            for (column, cell) in cells.iter().enumerate() {
                if *cell == Cell::Unknown {
                    unknown_m2[row / BLOCK * blocks_wide + column / BLOCK] += cell_m2;
                }
            }
        }
        let direction = |ray: usize| {
            let (sin, cos) = mapwright_geom::sin_cos(TAU * ray as f64 / RAYS as f64);
            [cos, sin]
        };
        let stamps = vec![0; unknown_m2.len()];
        Self { map, directions: (0..RAYS).map(direction).collect(), blocks_wide, unknown_m2, stamps, stamp: 0 }
    }

    /// The blocks with unknown cells that a sensor would see from a cell. A ray ends at what is occupied, at the sensor's reach, and
    /// `into_m` deep in the unknown: so far one sees here.
    pub(crate) fn seen_from(&mut self, cell: usize, reach_m: f64, into_m: f64) -> Vec<u32> {
        self.stamp += 1;
        let ([width, height], cells) = (self.map.size(), self.map.cells());
        let [reach, into] = [reach_m, into_m].map(|m| m / self.map.resolution_m());
        let start = [(cell % width) as f64 + 0.5, (cell / width) as f64 + 0.5];
        let mut blocks = Vec::new();
        for ray in 0..RAYS {
            let direction = self.directions[ray];
            let (mut x, mut y) = (start[0], start[1]);
            let (mut along, mut unknown) = (0.0, 0.0);
            while along < reach && unknown < into {
                along += 1.0;
                x += direction[0];
                y += direction[1];
                if x < 0.0 || y < 0.0 || x >= width as f64 || y >= height as f64 {
                    break;
                }
                let (x, y) = (x as usize, y as usize);
                match cells[y * width + x] {
                    Cell::Occupied => break,
                    Cell::Free => {}
                    Cell::Unknown => {
                        unknown += 1.0;
                        let block = y / BLOCK * self.blocks_wide + x / BLOCK;
                        if self.stamps[block] != self.stamp {
                            self.stamps[block] = self.stamp;
                            blocks.push(block as u32);
                        }
                    }
                }
            }
        }
        blocks
    }

    /// How far one sees from a cell in the middle, metres: half of all directions meet something before that, or the unknown.
    pub(crate) fn sight_m(&self, cell: usize, reach_m: f64) -> f64 {
        let width = self.map.size()[0];
        let start = [(cell % width) as f64 + 0.5, (cell / width) as f64 + 0.5];
        let length = |direction: &[f64; 2]| {
            let mut along = 0.0;
            while along * self.map.resolution_m() < reach_m {
                let [x, y] = [0, 1].map(|k| start[k] + (along + 1.0) * direction[k]);
                let at = (y.max(0.0) as usize) * width + x.max(0.0) as usize;
                if self.map.cells().get(at).is_none_or(|cell| *cell != Cell::Free) {
                    break;
                }
                along += 1.0;
            }
            along * self.map.resolution_m()
        };
        let mut lengths: Vec<f64> = self.directions.iter().map(length).collect();
        lengths.sort_by(f64::total_cmp);
        lengths[RAYS / 2]
    }

    /// Unknown area of a block, square metres.
    pub(crate) fn unknown_m2(&self, block: u32) -> f64 {
        f64::from(self.unknown_m2[block as usize])
    }

    pub(crate) fn blocks(&self) -> usize {
        self.unknown_m2.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A corridor 2 m wide and 10 m long, open at its right end, in unknown space.
    fn corridor() -> OccupancyMap {
        let (width, height) = (240, 60);
        let cell = |index: usize| match (index % width, index / width) {
            (10..=110, 20 | 40) | (10, 20..=40) => Cell::Occupied,
            (11..=110, 21..=39) => Cell::Free,
            _ => Cell::Unknown,
        };
        OccupancyMap::new([0.0; 2], 0.1, width, (0..width * height).map(cell).collect()).unwrap()
    }

    #[test]
    fn the_open_end_of_a_corridor_is_its_frontier() {
        let map = corridor();
        let terrain = Terrain::new(&map, 0.22);
        let found = frontiers(&map, 4.0);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].cells.len(), 19);
        let [x, y] = map.center_m(found[0].stands(&map, &terrain)[0]);
        assert!((x - 11.05).abs() < 0.11 && (y - 3.05).abs() < 0.11, "{x} {y}");
        assert!(frontiers(&map, 0.5).len() > 2, "long ones are shared");
        assert!(found[0].stands(&map, &Terrain::new(&map, 1.5)).is_empty(), "too wide a robot");
    }

    #[test]
    fn what_is_expected_grows_with_the_depth_that_is_seen() {
        let map = corridor();
        let stand = map.index_of([11.0, 3.0]).unwrap();
        let mut views = Views::new(&map);
        let mut area_m2 = |into_m: f64| {
            let blocks = views.seen_from(stand, 12.0, into_m);
            blocks.iter().map(|&block| views.unknown_m2(block)).sum::<f64>()
        };
        // Half a disc.
        assert!((area_m2(2.0) / (0.5 * std::f64::consts::PI * 4.0) - 1.0).abs() < 0.35, "{}", area_m2(2.0));
        assert!(area_m2(4.0) > 2.5 * area_m2(2.0));
        let sight_m = views.sight_m(map.index_of([6.0, 3.0]).unwrap(), 12.0);
        assert!((1.0..2.0).contains(&sight_m), "{sight_m}");
    }
}
