//! The poses of a search window, and blocks of them.

use super::{MAX_DOUBLINGS, MAX_SEARCH_BLOCKS, MAX_SEARCH_CELLS, Peak, SearchWindow, Separation};
use crate::tiles::floor_cell;
use mapwright_geom::{FARTHEST_M, Pose2, sin_cos, wrap_angle};
use std::cmp::Reverse;
use std::f64::consts::PI;

/// Blocks have sides of at most `2^6` translations.
const MAX_LEVEL: u32 = 6;
/// The box around the points is taken from every so many headings.
const BOX_STRIDE: u32 = 8;

/// `2^level x 2^level` translations at one heading, or a pose at level 0. Better blocks are smaller in this order: no
/// pose of a block stands before the block itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Block {
    pub(super) bound: Reverse<u32>,
    /// Least squared number of steps from the middle.
    pub(super) least_steps2: u32,
    pub(super) heading: u32,
    /// Steps from the window's lower corner.
    pub(super) v: u32,
    pub(super) u: u32,
    pub(super) level: u32,
}

impl Block {
    pub(super) fn may_beat(&self, best: Option<&Self>, least: u32) -> bool {
        self.bound.0 >= least && best.is_none_or(|best| self < best)
    }
}

/// The poses of a window.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lattice {
    pub(super) middle: Pose2,
    pub(super) cells_per_m: f64,
    /// A step is `2^doublings` cells.
    pub(super) doublings: u32,
    pub(super) step_m: f64,
    pub(super) step_rad: f64,
    /// Steps from the middle to the window's edge.
    pub(super) half_steps: u32,
    /// Number of the last translation, the first being 0, along x and y alike.
    pub(super) last: u32,
    pub(super) headings: u32,
    pub(super) middle_heading: u32,
    pub(super) full_turn: bool,
    pub(super) top_level: u32,
}

impl Lattice {
    /// The finest lattice of so many doublings at least that is not too large.
    pub(super) fn new(window: &SearchWindow, resolution_m: f64, farthest_m: f64, doublings: u32) -> Option<Self> {
        let middle = window.world_from_robot;
        let off_m = middle.x.abs().max(middle.y.abs());
        let sizes = [off_m, window.half_width_m, window.half_width_rad, farthest_m];
        let sane = middle.is_finite() && sizes.iter().all(|size| (0.0..=FARTHEST_M).contains(size));
        // Cells are counted in 32 bits, with room to spare.
        let fits = (off_m + window.half_width_m + farthest_m) / resolution_m < f64::from(1 << 30);
        if !(sane && fits && resolution_m > 0.0) {
            return None;
        }
        (doublings..=MAX_DOUBLINGS).find_map(|doublings| Self::with_step(window, resolution_m, farthest_m, doublings))
    }

    pub(super) fn with_step(window: &SearchWindow, resolution_m: f64, farthest_m: f64, doublings: u32) -> Option<Self> {
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

    pub(super) fn theta(&self, heading: u32) -> f64 {
        self.middle.theta + f64::from(heading as i32 - self.middle_heading as i32) * self.step_rad
    }

    pub(super) fn pose(&self, block: &Block) -> Pose2 {
        let metres = |steps: u32| f64::from(steps as i32 - self.half_steps as i32) * self.step_m;
        Pose2::new(self.middle.x + metres(block.u), self.middle.y + metres(block.v), self.theta(block.heading))
    }

    pub(super) fn peak(&self, block: &Block) -> Peak {
        Peak { world_from_robot: self.pose(block), score: block.bound.0 }
    }

    pub(super) fn block(&self, bound: u32, heading: u32, [u, v]: [u32; 2], level: u32) -> Block {
        let size = (1 << level) - 1;
        // One of the two is zero, both are where the middle is inside.
        let steps = |from: u32| from.saturating_sub(self.half_steps) + self.half_steps.saturating_sub(from + size);
        let least_steps2 = steps(u).pow(2) + steps(v).pow(2) + heading.abs_diff(self.middle_heading).pow(2);
        Block { bound: Reverse(bound), least_steps2, heading, v, u, level }
    }

    /// Where the points fall at a heading in the middle of the window, in steps.
    pub(super) fn cells<'a>(&self, heading: u32, points: &'a [[f64; 2]]) -> impl Iterator<Item = [i32; 2]> + use<'a> {
        let (s, c) = sin_cos(self.theta(heading));
        let Self { middle, cells_per_m, doublings, .. } = *self;
        let cell = move |metres: f64| floor_cell(metres * cells_per_m) >> doublings;
        points.iter().map(move |p| [cell(middle.x + (c * p[0] - s * p[1])), cell(middle.y + (s * p[0] + c * p[1]))])
    }

    /// Least and greatest steps that points reach at any heading and translation.
    pub(super) fn region(&self, points: &[[f64; 2]]) -> [[i32; 2]; 2] {
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
pub(super) struct Zone {
    pub(super) best: Block,
    pub(super) distance2_steps: f64,
    pub(super) angle_rad: f64,
}

impl Zone {
    pub(super) fn new(lattice: &Lattice, best: &Block, separation: Separation) -> Self {
        // A hair more, so that what is meant to be at the distance is inside.
        let distance_steps = separation.distance_m / lattice.step_m + 1e-6;
        Self { best: *best, distance2_steps: distance_steps * distance_steps, angle_rad: separation.angle_rad + 1e-9 }
    }

    /// Whether all poses of a block are inside.
    pub(super) fn covers(&self, lattice: &Lattice, block: &Block) -> bool {
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
