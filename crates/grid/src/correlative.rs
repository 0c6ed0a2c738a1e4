//! Multi-resolution correlative search: the best pose of a lattice, exactly.
//!
//! The score of a pose is the sum over the end points of `s(cell)`, `s` the likelihood of the cell's distance to its
//! nearest obstacle in 255 steps (Olson 2009). Branch and bound finds its maximum (Hess et al. 2016, section V): grids of
//! maxima over `2^h x 2^h` cells bound the score of as many translations at once, and a block whose bound cannot win is
//! dropped unseen. The result is that of an exhaustive search.
//!
//! Unlike there, levels above the second are stored at every `2^(h-2)`-th cell only and bound up to a quarter more cells
//! along each axis than they must; together they take a third of the memory of the scores and stay in the cache.

mod lattice;
mod pyramid;
mod rough;

use crate::local_map::LocalMap;
use lattice::{Block, Lattice, Zone};
use mapwright_geom::Pose2;
use pyramid::{HeadingCells, Pyramid};
use std::cmp::Reverse;

/// Score cells a search may hold; a window that needs more is searched in steps of 2, 4 or 8 cells. About 27 MB in all.
pub const MAX_SEARCH_CELLS: usize = 1 << 23;
/// Blocks a search may start from, with the same consequence. 24 bytes each.
pub const MAX_SEARCH_BLOCKS: usize = 1 << 20;
const MAX_DOUBLINGS: u32 = 3;
const FULL_SCORE: u32 = 255;

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
    /// Rivals that score less than this share of the best pose are not looked for, which makes clear cases cheap.
    pub least_rival_share: f64,
    /// Poses and blocks of poses that are scored at most. Where more were to be told apart nothing counts as found: what fits everywhere
    /// alike takes millions, and its place is not known by the best of them.
    pub scored_at_most: u64,
}

impl Default for SearchSettings {
    fn default() -> Self {
        Self { sigma_m: 0.1, reach_m: 30.0, least_share: 0.0, least_rival_share: 0.0, scored_at_most: u64::MAX }
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
/// use mapwright_grid::{Change, CorrelativeSearch, LocalMap, LocalMapSettings, SearchWindow};
/// use mapwright_sensor::SweepPoints;
///
/// // An L-shaped wall, seen once from the origin.
/// let wall = (0..40).map(|k| 0.05 * f64::from(k));
/// let hits: Vec<_> = wall.clone().map(|m| [2.0, m]).chain(wall.map(|m| [m, 2.0])).collect();
/// let points = SweepPoints { normals: vec![[0.0; 2]; hits.len()], hits, ..SweepPoints::default() };
/// let mut map = LocalMap::new(LocalMapSettings::default());
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
    /// `None` where nothing reaches the least share, where more would have to be scored than the settings allow, where no point is finite and within reach, where the window is not finite, lies
    /// beyond 10^6 m or, even in steps of 8 cells, takes more than [`MAX_SEARCH_CELLS`] or [`MAX_SEARCH_BLOCKS`] (about 550 m of half
    /// width and reach together at 5 cm).
    #[must_use]
    pub fn search(
        &mut self,
        map: &LocalMap,
        points: &[[f64; 2]],
        window: &SearchWindow,
        separation: Option<Separation>,
    ) -> Option<SearchResult> {
        self.search_worth_rival(map, points, window, separation, |_| true)
    }

    /// As [`CorrelativeSearch::search`]; the rival is looked for only where `is_worth` says so of the best pose, for where that is
    /// refused for another reason nobody asks for its rival, and in a corridor that is most of the work.
    #[must_use]
    pub fn search_worth_rival(
        &mut self,
        map: &LocalMap,
        points: &[[f64; 2]],
        window: &SearchWindow,
        separation: Option<Separation>,
        is_worth: impl FnOnce(&Peak) -> bool,
    ) -> Option<SearchResult> {
        self.scored = 0;
        let farthest_m = self.keep_usable(points)?;
        let lattice = Lattice::new(window, map.settings.resolution_m, farthest_m, 0)?;
        let best = self.search_best(map, &lattice)?;
        let separation = separation.filter(|_| is_worth(&lattice.peak(&best)));
        let rival = separation.and_then(|separation| self.rival_of(&lattice, &best, separation));
        (self.scored <= self.settings.scored_at_most).then(|| SearchResult {
            best: lattice.peak(&best),
            rival: rival.map(|block| lattice.peak(&block)),
            points_used: self.points.len() as u32,
            step_m: lattice.step_m,
            step_rad: lattice.step_rad,
            scored: self.scored,
        })
    }

    /// Poses and blocks of poses that the last search scored: the work done.
    #[must_use]
    pub fn scored(&self) -> u64 {
        self.scored
    }

    fn search_best(&mut self, map: &LocalMap, lattice: &Lattice) -> Option<Block> {
        self.heading.forget();
        self.pyramid.build(map, lattice, &self.points, self.settings.sigma_m);
        self.bound_blocks(lattice, 1);
        self.descend(lattice, self.least_score(), None)
    }

    fn least_score(&self) -> u32 {
        (self.settings.least_share * f64::from(self.full_score())).ceil() as u32
    }

    fn rival_of(&mut self, lattice: &Lattice, best: &Block, separation: Separation) -> Option<Block> {
        let least = (self.settings.least_rival_share * f64::from(best.bound.0)).ceil() as u32;
        self.descend(lattice, least, Some(&Zone::new(lattice, best, separation)))
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

    /// Covers the window, at every so many headings from the middle on, with the largest blocks and bounds them, best first.
    fn bound_blocks(&mut self, lattice: &Lattice, every: u32) {
        self.blocks.clear();
        let side = 1 << lattice.top_level;
        let is_taken = |heading: &u32| heading.abs_diff(lattice.middle_heading).is_multiple_of(every);
        for heading in (0..lattice.headings).filter(is_taken) {
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
    fn descend(&mut self, lattice: &Lattice, least: u32, excluded: Option<&Zone>) -> Option<Block> {
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
                } else if self.scored > self.settings.scored_at_most {
                    self.stack.clear();
                    return None;
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

#[cfg(test)]
mod tests {
    use super::pyramid::{scores_by_distance2, shift};
    use super::*;
    use crate::{Change, LocalMapSettings};
    use mapwright_sensor::SweepPoints;
    use mapwright_sim::Rng;

    const CELL_M: f64 = 0.05;
    const SIGMA_M: f64 = 0.1;

    fn random_points(rng: &mut Rng, count: usize, range_m: f64) -> Vec<[f64; 2]> {
        (0..count).map(|_| [rng.uniform(-range_m, range_m), rng.uniform(-range_m, range_m)]).collect()
    }

    fn random_map(rng: &mut Rng) -> LocalMap {
        let mut map = LocalMap::new(LocalMapSettings { resolution_m: CELL_M, ..LocalMapSettings::default() });
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
    fn score_by_definition(map: &LocalMap, doublings: u32, [x, y]: [i32; 2]) -> u8 {
        let scores = scores_by_distance2(CELL_M / SIGMA_M);
        let side = 1 << doublings;
        let cells = (0..side * side).map(|k| (x * side + k % side, y * side + k / side));
        cells.filter_map(|(x, y)| map.field().nearest_cell(x, y)).map(|(d2, _)| scores[d2 as usize]).max().unwrap_or(0)
    }

    #[test]
    fn a_search_that_takes_more_than_it_may_finds_nothing() {
        let mut rng = Rng::new(5);
        let map = random_map(&mut rng);
        let points = random_points(&mut rng, 20, 3.0);
        let whole = CorrelativeSearch::default().search(&map, &points, &window(1.0), None).unwrap();
        let search = |scored_at_most| {
            let settings = SearchSettings { scored_at_most, ..SearchSettings::default() };
            let mut searcher = CorrelativeSearch::new(settings);
            let found = searcher.search(&map, &points, &window(1.0), None);
            (found.map(|found| found.best), searcher.scored())
        };
        assert_eq!(search(whole.scored), (Some(whole.best), whole.scored));
        for most in [0, whole.scored / 2, whole.scored - 1] {
            let (found, scored) = search(most);
            assert!(found.is_none() && scored <= whole.scored, "{most}: {scored}");
        }
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
            let best = searcher.search_best(&map, &lattice).unwrap();
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
