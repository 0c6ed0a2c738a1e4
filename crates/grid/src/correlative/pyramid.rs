//! Grids of maxima that bound the scores of blocks of poses.

use super::lattice::Lattice;
use crate::field::NO_OBSTACLE;
use crate::local_map::LocalMap;
use crate::tiles::{NO_TILE, TILE_BITS, TILE_SIDE, cell_in_tile, floor_cell};

/// Scores or maxima of scores, row by row.
#[derive(Debug, Clone, Default)]
pub(super) struct Grid {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) values: Vec<u8>,
}

impl Grid {
    pub(super) fn reset(&mut self, width: usize, height: usize) {
        (self.width, self.height) = (width, height);
        self.values.clear();
        self.values.resize(width * height, 0);
    }

    pub(super) fn row(&self, y: usize) -> &[u8] {
        &self.values[y * self.width..(y + 1) * self.width]
    }

    /// At each `stride`th cell the maximum over the cells at `taps` from it along x times those along y.
    pub(super) fn pool(&self, taps: &[usize], stride: usize, scratch: &mut Vec<u8>, into: &mut Self) {
        into.reset(self.width.div_ceil(stride), self.height.div_ceil(stride));
        scratch.clear();
        scratch.resize(self.width + 8, 0);
        for y in 0..into.height {
            let column = &mut scratch[..self.width];
            column.copy_from_slice(self.row(y * stride));
            for &tap in taps.iter().filter(|&tap| *tap > 0 && y * stride + tap < self.height) {
                column.iter_mut().zip(self.row(y * stride + tap)).for_each(|(most, &value)| *most = value.max(*most));
            }
            let row = &mut into.values[y * into.width..(y + 1) * into.width];
            for &tap in taps {
                pool_row(&scratch[tap..], stride, row);
            }
        }
    }
}

pub(super) fn pool_row(from: &[u8], stride: usize, row: &mut [u8]) {
    if stride == 1 {
        row.iter_mut().zip(from).for_each(|(most, &value)| *most = value.max(*most));
    } else {
        row.iter_mut().zip(from.iter().step_by(stride)).for_each(|(most, &value)| *most = value.max(*most));
    }
}

/// Level `h` holds maxima over `2^h x 2^h` cells or, above level 2, over `5t - 1` cells each way at every `t`th cell,
/// `t = 2^(h-2)`: enough for each of the `t` cells it stands for.
#[derive(Debug, Clone, Default)]
pub(super) struct Pyramid {
    pub(super) levels: Vec<Grid>,
    pub(super) scratch: Vec<u8>,
    /// The region's lower corner, steps.
    pub(super) low: [i32; 2],
}

/// How many cells, as a power of two, an entry of a level stands for along an axis.
pub(super) fn shift(level: u32) -> u32 {
    level.saturating_sub(2)
}

impl Pyramid {
    pub(super) fn build(&mut self, map: &LocalMap, lattice: &Lattice, points: &[[f64; 2]], sigma_m: f64) {
        self.begin(lattice, points);
        self.rasterise(map, lattice.doublings, sigma_m);
        self.pool(lattice);
    }

    /// The same of a map whose obstacles are these end points.
    pub(super) fn build_of_ends(&mut self, ends: &[[f64; 2]], lattice: &Lattice, points: &[[f64; 2]], sigma_m: f64) {
        self.begin(lattice, points);
        self.splat(ends, lattice, sigma_m);
        self.pool(lattice);
    }

    /// Makes room for the levels of a window.
    fn begin(&mut self, lattice: &Lattice, points: &[[f64; 2]]) {
        let levels = lattice.top_level as usize + 1;
        if self.levels.len() < levels {
            self.levels.resize_with(levels, Grid::default);
        }
        let [low, high] = lattice.region(points);
        self.low = low;
        self.levels[0].reset((high[0] - low[0] + 1) as usize, (high[1] - low[1] + 1) as usize);
    }

    /// The levels above the first.
    fn pool(&mut self, lattice: &Lattice) {
        for level in 1..=lattice.top_level as usize {
            let (below, this) = self.levels.split_at_mut(level);
            let (taps, stride): (&[usize], usize) = match level {
                1 => (&[0, 1], 1),
                2 => (&[0, 2], 1),
                // Spans of 5t/2 - 1 from 0, 2t and 5t/2 on make one of 5t - 1.
                _ => (&[0, 4, 5], 2),
            };
            below[level - 1].pool(taps, stride, &mut self.scratch, &mut this[0]);
        }
    }

    /// Draws the likelihood of the distances to end points into level 0; steps of several cells get the best of theirs.
    fn splat(&mut self, ends: &[[f64; 2]], lattice: &Lattice, sigma_m: f64) {
        let scores = scores_by_distance2(1.0 / (lattice.cells_per_m * sigma_m.max(1e-6)));
        let mark = Mark::new(&scores, lattice.doublings);
        let (low, grid) = (self.low, &mut self.levels[0]);
        let (width, height) = (grid.width as i32, grid.height as i32);
        for end in ends {
            let cell = end.map(|metres| floor_cell(metres * lattice.cells_per_m) >> lattice.doublings);
            let [x, y] = [cell[0] - low[0], cell[1] - low[1]];
            let is_inside = (0..width).contains(&x) && (0..height).contains(&y);
            let columns = (x - mark.reach).max(0)..(x + mark.reach + 1).min(width);
            if columns.is_empty() || is_inside && grid.values[(y * width + x) as usize] == scores[0] {
                continue;
            }
            let left_out = (columns.start - (x - mark.reach)) as usize;
            for (row, mark) in (y - mark.reach..).zip(mark.rows()).filter(|(row, _)| (0..height).contains(row)) {
                let first = (row * width + columns.start) as usize;
                let cells = &mut grid.values[first..first + columns.len()];
                cells.iter_mut().zip(&mark[left_out..]).for_each(|(value, &score)| *value = score.max(*value));
            }
        }
    }

    /// Draws the likelihood of the distances into level 0; steps of several cells get the best of theirs.
    pub(super) fn rasterise(&mut self, map: &LocalMap, doublings: u32, sigma_m: f64) {
        let scores = scores_by_distance2(map.settings.resolution_m / sigma_m.max(1e-6));
        let grid = &mut self.levels[0];
        let first = self.low.map(|edge| edge << doublings);
        let end = [(self.low[0] + grid.width as i32) << doublings, (self.low[1] + grid.height as i32) << doublings];
        let (field, counts) = (map.field(), map.counts());
        for tile_y in first[1] >> TILE_BITS..=(end[1] - 1) >> TILE_BITS {
            for tile_x in first[0] >> TILE_BITS..=(end[0] - 1) >> TILE_BITS {
                let number = field.tile_number((tile_x, tile_y));
                if number == NO_TILE {
                    continue;
                }
                let nearest = &field.tiles[number as usize].nearest;
                let (base_x, base_y) = (tile_x << TILE_BITS, tile_y << TILE_BITS);
                for y in base_y.max(first[1])..(base_y + TILE_SIDE).min(end[1]) {
                    let row = ((y >> doublings) - self.low[1]) as usize * grid.width;
                    for x in base_x.max(first[0])..(base_x + TILE_SIDE).min(end[0]) {
                        let slot = nearest[cell_in_tile(x, y)];
                        if slot == NO_OBSTACLE {
                            continue;
                        }
                        let obstacle = counts.cell(slot);
                        let distance2 = (obstacle.x - x).pow(2) + (obstacle.y - y).pow(2);
                        let value = &mut grid.values[row + ((x >> doublings) - self.low[0]) as usize];
                        *value = (*value).max(scores[distance2 as usize & 255]);
                    }
                }
            }
        }
    }
}

/// What an end point makes of the steps around it at most, wherever in its own it lies.
struct Mark {
    /// Steps to either side.
    reach: i32,
    scores: Vec<u8>,
}

impl Mark {
    fn new(scores: &[u8; 256], doublings: u32) -> Self {
        let reach_cells = scores.iter().take_while(|score| **score > 0).count().isqrt() as i32;
        let (side, reach) = (1_i32 << doublings, (reach_cells >> doublings) + 1);
        let steps = || -reach..=reach;
        // From the nearest cell of one step to that of another.
        let away = |step: i32| (step.abs() * side - (side - 1)).max(0);
        let score = |x: i32, y: i32| scores.get((x * x + y * y) as usize).copied().unwrap_or(0);
        let scores = steps().flat_map(|v| steps().map(move |u| score(away(u), away(v)))).collect();
        Self { reach, scores }
    }

    fn rows(&self) -> impl Iterator<Item = &[u8]> {
        self.scores.chunks(2 * self.reach as usize + 1)
    }
}

/// `255 exp(-d^2 / (2 sigma^2))` by squared distance in cells.
pub(super) fn scores_by_distance2(cell_per_sigma: f64) -> [u8; 256] {
    std::array::from_fn(|d2| (255.0 * (-0.5 * d2 as f64 * cell_per_sigma * cell_per_sigma).exp()).round() as u8)
}

/// Where the points fall at one heading and the window's lowest translation, in steps from the region's corner.
#[derive(Debug, Clone, Default)]
pub(super) struct HeadingCells {
    pub(super) heading: Option<u32>,
    pub(super) cells: Vec<[u32; 2]>,
}

impl HeadingCells {
    pub(super) fn forget(&mut self) {
        self.heading = None;
    }

    pub(super) fn turn_to(&mut self, heading: u32, lattice: &Lattice, points: &[[f64; 2]], pyramid: &Pyramid) {
        if self.heading == Some(heading) {
            return;
        }
        self.heading = Some(heading);
        let corner = pyramid.low.map(|low| low + lattice.half_steps as i32);
        self.cells.clear();
        self.cells.extend(
            lattice.cells(heading, points).map(|cell| [(cell[0] - corner[0]) as u32, (cell[1] - corner[1]) as u32]),
        );
    }

    /// A level's sum for the block at a translation: its bound.
    pub(super) fn sum(&self, pyramid: &Pyramid, level: u32, [u, v]: [u32; 2]) -> u32 {
        let grid = &pyramid.levels[level as usize];
        let (shift, width) = (shift(level), grid.width);
        let offset = (v >> shift) as usize * width + (u >> shift) as usize;
        let index = |cell: &[u32; 2]| (cell[1] >> shift) as usize * width + (cell[0] >> shift) as usize + offset;
        self.cells.iter().map(|cell| u32::from(grid.values[index(cell)])).sum()
    }

    /// The sums of the four blocks of a level at a translation and one block on along x, y and both.
    pub(super) fn sums_of_quarters(&self, pyramid: &Pyramid, level: u32, [u, v]: [u32; 2], last: u32) -> [u32; 4] {
        let grid = &pyramid.levels[level as usize];
        let (shift, width) = (shift(level), grid.width);
        let offset = (v >> shift) as usize * width + (u >> shift) as usize;
        // Quarters outside of the window are nobody's business: they read what is inside.
        let on = |from: u32| if from + (1 << level) > last { 0 } else { (1_usize << level) >> shift };
        let (right, up) = (on(u), on(v) * width);
        let mut sums = [0; 4];
        for cell in &self.cells {
            let index = (cell[1] >> shift) as usize * width + (cell[0] >> shift) as usize + offset;
            sums[0] += u32::from(grid.values[index]);
            sums[1] += u32::from(grid.values[index + right]);
            sums[2] += u32::from(grid.values[index + up]);
            sums[3] += u32::from(grid.values[index + up + right]);
        }
        sums
    }
}
