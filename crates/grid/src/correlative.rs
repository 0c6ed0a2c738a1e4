//! Multi-resolution correlative search: the best pose of a lattice, exactly.
//!
//! The score of a pose is the sum over the end points of `s(cell)`, `s` the likelihood of the cell's distance to its
//! nearest obstacle in 255 steps (Olson 2009). Branch and bound finds its maximum (Hess et al. 2016, section V): grids of
//! maxima over `2^h x 2^h` cells bound the score of as many translations at once, and a block whose bound cannot win is
//! dropped unseen. The result is that of an exhaustive search.
//!
//! Unlike there, levels above the second are stored at every `2^(h-2)`-th cell only and bound up to a quarter more cells
//! along each axis than they must; together they take a third of the memory of the scores and stay in the cache.

use crate::field::NO_OBSTACLE;
use crate::live::LiveMap;
use crate::tiles::{NO_TILE, TILE_BITS, TILE_SIDE, cell_in_tile};
use mapwright_geom::{Pose2, sin_cos, wrap_angle};
use std::cmp::Reverse;
use std::f64::consts::PI;

/// Score cells a search may hold; a window that needs more is searched in steps of 2, 4 or 8 cells. About 27 MB in all.
pub const MAX_SEARCH_CELLS: usize = 1 << 23;
/// Blocks a search may start from, with the same consequence. 24 bytes each.
pub const MAX_SEARCH_BLOCKS: usize = 1 << 20;
const MAX_DOUBLINGS: u32 = 3;
/// Blocks have sides of at most `2^6` translations.
const MAX_LEVEL: u32 = 6;
const FULL_SCORE: u32 = 255;
/// Poses beyond are refused, metres.
const FARTHEST_POSE_M: f64 = 1e6;
/// The box around the points is taken from every so many headings.
const BOX_STRIDE: u32 = 8;

/// Which poses are tried: `world_from_robot` and all around it, in steps of one cell and of the angle that moves the
/// farthest point by one cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchWindow {
    /// The middle of the window.
    pub world_from_robot: Pose2,
    /// Along x and y, both ways, metres; rounded up to whole steps.
    pub half_width_m: f64,
    /// Both ways, radians; pi or more is a full turn.
    pub half_width_rad: f64,
}

/// Settings of the search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchSettings {
    /// Standard deviation of a hit, metres.
    pub sigma_m: f64,
    /// Points farther from the robot are not used, metres.
    pub reach_m: f64,
    /// Share of the full score (every point on an obstacle) below which nothing counts as found. What is found does not
    /// depend on it, but refusing gets cheaper.
    pub least_share: f64,
}

impl Default for SearchSettings {
    fn default() -> Self {
        Self { sigma_m: 0.1, reach_m: 30.0, least_share: 0.0 }
    }
}

/// How far a pose must be from the best one to be its rival: farther than the one or than the other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Separation {
    /// Metres.
    pub distance_m: f64,
    /// Radians.
    pub angle_rad: f64,
}

impl Default for Separation {
    fn default() -> Self {
        Self { distance_m: 0.5, angle_rad: 20_f64.to_radians() }
    }
}

/// A pose and its score.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// The pose.
    pub world_from_robot: Pose2,
    /// Sum over the points used, 255 each at most.
    pub score: u32,
}

/// What a search found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchResult {
    /// The pose with the best score. Among equals the one with the smallest `i^2 + j^2 + k^2`, where it is `i`, `j` and
    /// `k` steps from the middle along x, y and heading; then that with the smallest `k`, `j`, `i`, in this order.
    pub best: Peak,
    /// The best pose (in the same order) that is separated from `best`, if it was asked for and there is one.
    pub rival: Option<Peak>,
    /// Points the score is over.
    pub points_used: u32,
    /// Step along x and y, metres: the map's cell, or 2, 4 or 8 for windows that are too large.
    pub step_m: f64,
    /// Step in heading, radians.
    pub step_rad: f64,
    /// Poses and blocks of poses that were scored: the work done.
    pub scored: u64,
}

impl SearchResult {
    /// The best pose's share of the full score, 0 to 1.
    #[must_use]
    pub fn share(&self) -> f64 {
        f64::from(self.best.score) / f64::from(self.points_used * FULL_SCORE)
    }

    /// The rival's score relative to the best one's, 0 to 1; 0 without a rival, 1 where nothing scored at all.
    #[must_use]
    pub fn ambiguity(&self) -> f64 {
        let Some(rival) = self.rival else { return 0.0 };
        if self.best.score == 0 { 1.0 } else { f64::from(rival.score) / f64::from(self.best.score) }
    }
}

/// A searcher; it keeps its buffers from search to search.
///
/// ```
/// use mapwright_geom::Pose2;
/// use mapwright_grid::{Change, CorrelativeSearch, LiveMap, LiveMapSettings, SearchWindow};
/// use mapwright_sensor::SweepPoints;
///
/// // An L-shaped wall, seen once from the origin.
/// let wall = (0..40).map(|k| 0.05 * f64::from(k));
/// let hits: Vec<_> = wall.clone().map(|m| [2.0, m]).chain(wall.map(|m| [m, 2.0])).collect();
/// let points = SweepPoints { normals: vec![[0.0; 2]; hits.len()], hits, ..SweepPoints::default() };
/// let mut map = LiveMap::new(LiveMapSettings::default());
/// map.change(&points, Pose2::IDENTITY, Change::Add, 0);
///
/// let lost = Pose2::new(0.4, -0.3, 0.2);
/// let window = SearchWindow { world_from_robot: lost, half_width_m: 0.5, half_width_rad: 0.4 };
/// let found = CorrelativeSearch::default().search(&map, &points.hits, &window, None).unwrap();
/// assert!(found.best.world_from_robot.distance(Pose2::IDENTITY) < 0.1);
/// ```
#[derive(Debug, Clone, Default)]
pub struct CorrelativeSearch {
    /// Its settings.
    pub settings: SearchSettings,
    points: Vec<[f64; 2]>,
    pyramid: Pyramid,
    heading: HeadingCells,
    blocks: Vec<Block>,
    stack: Vec<Block>,
    scored: u64,
}

impl CorrelativeSearch {
    /// A searcher.
    #[must_use]
    pub fn new(settings: SearchSettings) -> Self {
        Self { settings, ..Self::default() }
    }

    /// The best pose of a window for end points in the robot's frame, metres, and its best rival where `separation` is
    /// given.
    ///
    /// `None` where nothing reaches the least share, where no point is finite and within reach, where the window is not
    /// finite, lies beyond 10^6 m or, even in steps of 8 cells, takes more than [`MAX_SEARCH_CELLS`] or
    /// [`MAX_SEARCH_BLOCKS`] (about 550 m of half width and reach together at 5 cm).
    #[must_use]
    pub fn search(
        &mut self,
        map: &LiveMap,
        points: &[[f64; 2]],
        window: &SearchWindow,
        separation: Option<Separation>,
    ) -> Option<SearchResult> {
        let farthest_m = self.keep_usable(points)?;
        let lattice = Lattice::new(window, map.settings.resolution_m, farthest_m)?;
        let (best, rival) = self.search_lattice(map, &lattice, separation)?;
        Some(SearchResult {
            best: lattice.peak(&best),
            rival: rival.map(|block| lattice.peak(&block)),
            points_used: self.points.len() as u32,
            step_m: lattice.step_m,
            step_rad: lattice.step_rad,
            scored: self.scored,
        })
    }

    fn search_lattice(
        &mut self,
        map: &LiveMap,
        lattice: &Lattice,
        separation: Option<Separation>,
    ) -> Option<(Block, Option<Block>)> {
        self.scored = 0;
        self.heading.forget();
        self.pyramid.build(map, lattice, &self.points, self.settings.sigma_m);
        self.bound_blocks(lattice);
        let least = (self.settings.least_share * f64::from(self.full_score())).ceil() as u32;
        let best = self.descend(lattice, least, None)?;
        let rival = separation.and_then(|separation| {
            let around_best = Zone::new(lattice, &best, separation);
            self.descend(lattice, 0, Some(around_best))
        });
        Some((best, rival))
    }

    fn full_score(&self) -> u32 {
        self.points.len() as u32 * FULL_SCORE
    }

    /// Copies the points that are finite and within reach; their farthest distance, or `None` where there are none.
    fn keep_usable(&mut self, points: &[[f64; 2]]) -> Option<f64> {
        let reach2 = self.settings.reach_m * self.settings.reach_m;
        let squared = |p: &[f64; 2]| p[0] * p[0] + p[1] * p[1];
        self.points.clear();
        // 2^24 points of 255 fit into 32 bits.
        self.points.extend(points.iter().filter(|p| squared(p) <= reach2).take(1 << 24));
        let farthest2 = self.points.iter().map(squared).fold(0.0, f64::max);
        (!self.points.is_empty() && farthest2.is_finite()).then(|| farthest2.sqrt())
    }

    /// Covers the window with the largest blocks and bounds them, best first.
    fn bound_blocks(&mut self, lattice: &Lattice) {
        self.blocks.clear();
        let side = 1 << lattice.top_level;
        for heading in 0..lattice.headings {
            self.heading.turn_to(heading, lattice, &self.points, &self.pyramid);
            for v in (0..=lattice.last).step_by(side) {
                for u in (0..=lattice.last).step_by(side) {
                    let bound = self.heading.sum(&self.pyramid, lattice.top_level, [u, v]);
                    self.blocks.push(lattice.block(bound, heading, [u, v], lattice.top_level));
                }
            }
        }
        self.scored += self.blocks.len() as u64;
        self.blocks.sort_unstable();
    }

    /// Depth first, better children first; the best pose outside the zone that scores at least `least`.
    fn descend(&mut self, lattice: &Lattice, least: u32, excluded: Option<Zone>) -> Option<Block> {
        let mut best: Option<Block> = None;
        for k in 0..self.blocks.len() {
            if !self.blocks[k].may_beat(best.as_ref(), least) {
                break;
            }
            self.stack.push(self.blocks[k]);
            while let Some(block) = self.stack.pop() {
                let hopeless = !block.may_beat(best.as_ref(), least);
                if hopeless || excluded.is_some_and(|zone| zone.covers(lattice, &block)) {
                    continue;
                }
                if block.level == 0 {
                    best = Some(block);
                } else {
                    self.split(lattice, &block);
                }
            }
        }
        best
    }

    /// Puts a block's quarters on the stack, the best on top.
    fn split(&mut self, lattice: &Lattice, block: &Block) {
        self.heading.turn_to(block.heading, lattice, &self.points, &self.pyramid);
        let level = block.level - 1;
        let half = 1 << level;
        let bounds = self.heading.sums_of_quarters(&self.pyramid, level, [block.u, block.v], lattice.last);
        let from = self.stack.len();
        for (quarter, bound) in bounds.into_iter().enumerate() {
            let at = [block.u + half * (quarter as u32 & 1), block.v + half * (quarter as u32 >> 1)];
            if at[0] <= lattice.last && at[1] <= lattice.last {
                self.stack.push(lattice.block(bound, block.heading, at, level));
            }
        }
        self.scored += (self.stack.len() - from) as u64;
        self.stack[from..].sort_unstable_by_key(|&child| Reverse(child));
    }
}

/// `2^level x 2^level` translations at one heading, or a pose at level 0. Better blocks are smaller in this order: no
/// pose of a block stands before the block itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Block {
    bound: Reverse<u32>,
    /// Least squared number of steps from the middle.
    least_steps2: u32,
    heading: u32,
    /// Steps from the window's lower corner.
    v: u32,
    u: u32,
    level: u32,
}

impl Block {
    fn may_beat(&self, best: Option<&Self>, least: u32) -> bool {
        self.bound.0 >= least && best.is_none_or(|best| self < best)
    }
}

/// The poses of a window.
#[derive(Debug, Clone, Copy)]
struct Lattice {
    middle: Pose2,
    cells_per_m: f64,
    /// A step is `2^doublings` cells.
    doublings: u32,
    step_m: f64,
    step_rad: f64,
    /// Steps from the middle to the window's edge.
    half_steps: u32,
    /// Number of the last translation, the first being 0, along x and y alike.
    last: u32,
    headings: u32,
    middle_heading: u32,
    full_turn: bool,
    top_level: u32,
}

impl Lattice {
    /// The finest lattice that is not too large.
    fn new(window: &SearchWindow, resolution_m: f64, farthest_m: f64) -> Option<Self> {
        let middle = window.world_from_robot;
        let off_m = middle.x.abs().max(middle.y.abs());
        let sizes = [off_m, window.half_width_m, window.half_width_rad, farthest_m];
        let sane = middle.is_finite() && sizes.iter().all(|size| (0.0..=FARTHEST_POSE_M).contains(size));
        // Cells are counted in 32 bits, with room to spare.
        let fits = (off_m + window.half_width_m + farthest_m) / resolution_m < f64::from(1 << 30);
        if !(sane && fits && resolution_m > 0.0) {
            return None;
        }
        (0..=MAX_DOUBLINGS).find_map(|doublings| Self::with_step(window, resolution_m, farthest_m, doublings))
    }

    fn with_step(window: &SearchWindow, resolution_m: f64, farthest_m: f64, doublings: u32) -> Option<Self> {
        let step_m = resolution_m * f64::from(1_u32 << doublings);
        let half_steps = (window.half_width_m / step_m - 1e-9).ceil().max(0.0);
        let side = 2.0 * (half_steps + (farthest_m / step_m).ceil() + 6.0);
        if side * side > MAX_SEARCH_CELLS as f64 {
            return None;
        }
        let last = 2 * half_steps as u32;
        let top_level = (last + 1).next_power_of_two().trailing_zeros().min(MAX_LEVEL);
        let across = f64::from((last >> top_level) + 1);
        let full_turn = window.half_width_rad >= PI;
        let half_rad = window.half_width_rad.min(PI);
        // The chord of the farthest point is one step (Hess et al. 2016, equation 7).
        let widest_rad = if farthest_m * 2.0 <= step_m { PI } else { 2.0 * (0.5 * step_m / farthest_m).asin() };
        let half_headings = (half_rad / widest_rad - 1e-9).ceil().max(0.0);
        if (2.0 * half_headings + 1.0) * across * across > MAX_SEARCH_BLOCKS as f64 {
            return None;
        }
        let half = half_headings as u32;
        Some(Self {
            middle: window.world_from_robot,
            cells_per_m: 1.0 / resolution_m,
            doublings,
            step_m,
            step_rad: if half == 0 { 0.0 } else { half_rad / half_headings },
            half_steps: half_steps as u32,
            last,
            // A full turn's two ends are one heading.
            headings: if full_turn { 2 * half } else { 2 * half + 1 },
            middle_heading: if full_turn { half - 1 } else { half },
            full_turn,
            top_level,
        })
    }

    fn theta(&self, heading: u32) -> f64 {
        self.middle.theta + f64::from(heading as i32 - self.middle_heading as i32) * self.step_rad
    }

    fn pose(&self, block: &Block) -> Pose2 {
        let metres = |steps: u32| f64::from(steps as i32 - self.half_steps as i32) * self.step_m;
        Pose2::new(self.middle.x + metres(block.u), self.middle.y + metres(block.v), self.theta(block.heading))
    }

    fn peak(&self, block: &Block) -> Peak {
        Peak { world_from_robot: self.pose(block), score: block.bound.0 }
    }

    fn block(&self, bound: u32, heading: u32, [u, v]: [u32; 2], level: u32) -> Block {
        let size = (1 << level) - 1;
        // One of the two is zero, both are where the middle is inside.
        let steps = |from: u32| from.saturating_sub(self.half_steps) + self.half_steps.saturating_sub(from + size);
        let least_steps2 = steps(u).pow(2) + steps(v).pow(2) + heading.abs_diff(self.middle_heading).pow(2);
        Block { bound: Reverse(bound), least_steps2, heading, v, u, level }
    }

    /// Where the points fall at a heading in the middle of the window, in steps.
    fn cells<'a>(&self, heading: u32, points: &'a [[f64; 2]]) -> impl Iterator<Item = [i32; 2]> + use<'a> {
        let (s, c) = sin_cos(self.theta(heading));
        let Self { middle, cells_per_m, doublings, .. } = *self;
        let cell = move |metres: f64| ((metres * cells_per_m).floor() as i32) >> doublings;
        points.iter().map(move |p| [cell(middle.x + (c * p[0] - s * p[1])), cell(middle.y + (s * p[0] + c * p[1]))])
    }

    /// Least and greatest steps that points reach at any heading and translation.
    fn region(&self, points: &[[f64; 2]]) -> [[i32; 2]; 2] {
        let mut low = [i32::MAX; 2];
        let mut high = [i32::MIN; 2];
        let some_headings = (0..self.headings).step_by(BOX_STRIDE as usize).chain([self.headings - 1]);
        for cell in some_headings.flat_map(|heading| self.cells(heading, points)) {
            for axis in 0..2 {
                low[axis] = low[axis].min(cell[axis]);
                high[axis] = high[axis].max(cell[axis]);
            }
        }
        // A point moves by one step at most from one heading to the next, and a step may cross a cell's edge.
        let between = if self.headings > 1 { BOX_STRIDE as i32 / 2 + 1 } else { 0 };
        let margin = between + self.half_steps as i32;
        [low.map(|edge| edge - margin), high.map(|edge| edge + margin)]
    }
}

/// Poses too near to the best one to be its rivals.
#[derive(Debug, Clone, Copy)]
struct Zone {
    best: Block,
    distance2_steps: f64,
    angle_rad: f64,
}

impl Zone {
    fn new(lattice: &Lattice, best: &Block, separation: Separation) -> Self {
        // A hair more, so that what is meant to be at the distance is inside.
        let distance_steps = separation.distance_m / lattice.step_m + 1e-6;
        Self { best: *best, distance2_steps: distance_steps * distance_steps, angle_rad: separation.angle_rad + 1e-9 }
    }

    /// Whether all poses of a block are inside.
    fn covers(&self, lattice: &Lattice, block: &Block) -> bool {
        let turned = f64::from(block.heading as i32 - self.best.heading as i32) * lattice.step_rad;
        let turned = if lattice.full_turn { wrap_angle(turned) } else { turned };
        if turned.abs() > self.angle_rad {
            return false;
        }
        let size = (1 << block.level) - 1;
        let farthest = |from: u32, best: u32| {
            let to = (from + size).min(lattice.last);
            f64::from(from.abs_diff(best).max(to.abs_diff(best)))
        };
        let (du, dv) = (farthest(block.u, self.best.u), farthest(block.v, self.best.v));
        du * du + dv * dv <= self.distance2_steps
    }
}

/// Scores or maxima of scores, row by row.
#[derive(Debug, Clone, Default)]
struct Grid {
    width: usize,
    height: usize,
    values: Vec<u8>,
}

impl Grid {
    fn reset(&mut self, width: usize, height: usize) {
        (self.width, self.height) = (width, height);
        self.values.clear();
        self.values.resize(width * height, 0);
    }

    fn row(&self, y: usize) -> &[u8] {
        &self.values[y * self.width..(y + 1) * self.width]
    }

    /// At each `stride`th cell the maximum over the cells at `taps` from it along x times those along y.
    fn pool(&self, taps: &[usize], stride: usize, scratch: &mut Vec<u8>, into: &mut Self) {
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

fn pool_row(from: &[u8], stride: usize, row: &mut [u8]) {
    if stride == 1 {
        row.iter_mut().zip(from).for_each(|(most, &value)| *most = value.max(*most));
    } else {
        row.iter_mut().zip(from.iter().step_by(stride)).for_each(|(most, &value)| *most = value.max(*most));
    }
}

/// Level `h` holds maxima over `2^h x 2^h` cells or, above level 2, over `5t - 1` cells each way at every `t`th cell,
/// `t = 2^(h-2)`: enough for each of the `t` cells it stands for.
#[derive(Debug, Clone, Default)]
struct Pyramid {
    levels: Vec<Grid>,
    scratch: Vec<u8>,
    /// The region's lower corner, steps.
    low: [i32; 2],
}

/// How many cells, as a power of two, an entry of a level stands for along an axis.
fn shift(level: u32) -> u32 {
    level.saturating_sub(2)
}

impl Pyramid {
    fn build(&mut self, map: &LiveMap, lattice: &Lattice, points: &[[f64; 2]], sigma_m: f64) {
        let levels = lattice.top_level as usize + 1;
        if self.levels.len() < levels {
            self.levels.resize_with(levels, Grid::default);
        }
        let [low, high] = lattice.region(points);
        self.low = low;
        self.levels[0].reset((high[0] - low[0] + 1) as usize, (high[1] - low[1] + 1) as usize);
        self.rasterise(map, lattice.doublings, sigma_m);
        for level in 1..levels {
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

    /// Draws the likelihood of the distances into level 0; steps of several cells get the best of theirs.
    fn rasterise(&mut self, map: &LiveMap, doublings: u32, sigma_m: f64) {
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

/// `255 exp(-d^2 / (2 sigma^2))` by squared distance in cells.
fn scores_by_distance2(cell_per_sigma: f64) -> [u8; 256] {
    std::array::from_fn(|d2| (255.0 * (-0.5 * d2 as f64 * cell_per_sigma * cell_per_sigma).exp()).round() as u8)
}

/// Where the points fall at one heading and the window's lowest translation, in steps from the region's corner.
#[derive(Debug, Clone, Default)]
struct HeadingCells {
    heading: Option<u32>,
    cells: Vec<[u32; 2]>,
}

impl HeadingCells {
    fn forget(&mut self) {
        self.heading = None;
    }

    fn turn_to(&mut self, heading: u32, lattice: &Lattice, points: &[[f64; 2]], pyramid: &Pyramid) {
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
    fn sum(&self, pyramid: &Pyramid, level: u32, [u, v]: [u32; 2]) -> u32 {
        let grid = &pyramid.levels[level as usize];
        let (shift, width) = (shift(level), grid.width);
        let offset = (v >> shift) as usize * width + (u >> shift) as usize;
        let index = |cell: &[u32; 2]| (cell[1] >> shift) as usize * width + (cell[0] >> shift) as usize + offset;
        self.cells.iter().map(|cell| u32::from(grid.values[index(cell)])).sum()
    }

    /// The sums of the four blocks of a level at a translation and one block on along x, y and both.
    fn sums_of_quarters(&self, pyramid: &Pyramid, level: u32, [u, v]: [u32; 2], last: u32) -> [u32; 4] {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Change, LiveMapSettings};
    use mapwright_sensor::SweepPoints;
    use mapwright_sim::Rng;

    const CELL_M: f64 = 0.05;
    const SIGMA_M: f64 = 0.1;

    fn random_points(rng: &mut Rng, count: usize, range_m: f64) -> Vec<[f64; 2]> {
        (0..count).map(|_| [rng.uniform(-range_m, range_m), rng.uniform(-range_m, range_m)]).collect()
    }

    fn random_map(rng: &mut Rng) -> LiveMap {
        let mut map = LiveMap::new(LiveMapSettings { resolution_m: CELL_M, ..LiveMapSettings::default() });
        for hit in random_points(rng, 60, 4.0) {
            let (hits, normals) = (vec![hit], vec![[0.0; 2]]);
            let points = SweepPoints { origin: hit, hits, normals, ..SweepPoints::default() };
            map.change(&points, Pose2::IDENTITY, Change::Add, 0);
        }
        map
    }

    fn window(half_width_m: f64) -> SearchWindow {
        SearchWindow { world_from_robot: Pose2::new(-0.3, 0.2, 1.0), half_width_m, half_width_rad: 0.5 }
    }

    /// Best score of the cells in a step's square.
    fn score_by_definition(map: &LiveMap, doublings: u32, [x, y]: [i32; 2]) -> u8 {
        let scores = scores_by_distance2(CELL_M / SIGMA_M);
        let side = 1 << doublings;
        let cells = (0..side * side).map(|k| (x * side + k % side, y * side + k / side));
        cells.filter_map(|(x, y)| map.field().nearest_cell(x, y)).map(|(d2, _)| scores[d2 as usize]).max().unwrap_or(0)
    }

    #[test]
    fn every_level_holds_the_maxima_it_promises() {
        let mut rng = Rng::new(1);
        for doublings in 0..=MAX_DOUBLINGS {
            let (map, points) = (random_map(&mut rng), random_points(&mut rng, 20, 1.0));
            let lattice = Lattice::with_step(&window(2.0), CELL_M, 1.5, doublings).unwrap();
            let mut pyramid = Pyramid::default();
            pyramid.build(&map, &lattice, &points, SIGMA_M);
            let scores = &pyramid.levels[0];
            for (k, &value) in scores.values.iter().enumerate() {
                let at = [pyramid.low[0] + (k % scores.width) as i32, pyramid.low[1] + (k / scores.width) as i32];
                assert_eq!(value, score_by_definition(&map, doublings, at), "cell {at:?}");
            }
            for level in 1..=lattice.top_level {
                let grid = &pyramid.levels[level as usize];
                let stride = 1 << shift(level);
                let span = if level < 3 { 1 << level } else { 5 * stride - 1 };
                for (k, &value) in grid.values.iter().enumerate() {
                    let (x, y) = (k % grid.width * stride, k / grid.width * stride);
                    let rows = y..(y + span).min(scores.height);
                    let most = rows.flat_map(|row| &scores.row(row)[x..(x + span).min(scores.width)]).max();
                    assert_eq!(Some(&value), most, "level {level}, entry {k}");
                }
            }
        }
    }

    #[test]
    fn wider_steps_are_searched_exactly_too() {
        let mut rng = Rng::new(2);
        let mut searcher = CorrelativeSearch::default();
        for case in 0..12 {
            let (map, points) = (random_map(&mut rng), random_points(&mut rng, 15, 1.5));
            let farthest_m = searcher.keep_usable(&points).unwrap();
            let lattice = Lattice::with_step(&window(1.0), CELL_M, farthest_m, case % (MAX_DOUBLINGS + 1)).unwrap();
            let (best, _) = searcher.search_lattice(&map, &lattice, None).unwrap();
            let mut first = None;
            for heading in 0..lattice.headings {
                let cells: Vec<_> = lattice.cells(heading, &points).collect();
                for (u, v) in (0..=lattice.last).flat_map(|v| (0..=lattice.last).map(move |u| (u, v))) {
                    let moved = [u, v].map(|steps| steps as i32 - lattice.half_steps as i32);
                    let score = |cell: &[i32; 2]| {
                        let at = [cell[0] + moved[0], cell[1] + moved[1]];
                        u32::from(score_by_definition(&map, lattice.doublings, at))
                    };
                    let pose = lattice.block(cells.iter().map(score).sum(), heading, [u, v], 0);
                    first = Some(first.map_or(pose, |known: Block| known.min(pose)));
                }
            }
            assert_eq!(Some(best), first);
        }
    }
}
