//! What is cut away so that a view shows what is around the way: ceilings from above, the near walls from the side.
//!
//! From above: over each place on the ground lies a limit, the height of the way nearest to it and [`CLEARANCE_M`] more. Where the way
//! climbs, the limit climbs with it. Where several storeys are nearly as near (within [`STOREY_REACH_M`]) the highest of them counts, so that
//! it is the upper storey that is seen, and the lower one where nothing was seen above it. A ceiling that is lower than the limit is
//! noticed by its many points at one height above the way, and the limit then lies just below it.
//!
//! From the side: what is nearer to the viewer than the way, by more than [`SIDE_CLEARANCE_M`], is left out, so that one looks onto a section.

/// What lies higher above the way than this is not drawn from above, metres; people and shelves are lower, most ceilings higher.
const CLEARANCE_M: f32 = 1.5;
/// As much stays before the way in the view from the side, metres: the robot and what it passes.
const SIDE_CLEARANCE_M: f32 = 1.0;
/// Ways that are no farther away than the nearest one and this are as near, metres.
const STOREY_REACH_M: f32 = 2.0;
/// A ceiling holds this share of what is higher above the way than [`CEILING_FROM_M`], within a bin's height,
const CEILING_SHARE: f32 = 0.25;
const CEILING_FROM_M: f32 = 0.3;
const CEILING_BIN_M: f32 = 0.15;
/// and what is drawn ends so far below it, metres.
const BELOW_CEILING_M: f32 = 0.2;
/// Places of the way that are looked at; more lie too near to each other to matter.
const WAY_USED: usize = 400;
/// Cells along the longer side.
const CELLS: f32 = 160.0;

/// Up to where things are drawn, over a grid in the plane of the picture.
#[derive(Debug)]
pub(super) struct Section {
    low: [f32; 2],
    cell_m: f32,
    sides: [usize; 2],
    limits: Vec<f32>,
}

impl Section {
    /// The section seen from above, of points and a way along the axes right, away and up.
    pub(super) fn from_above(points: &[[f32; 3]], way: &[[f32; 3]], low: [f32; 3], high: [f32; 3]) -> Self {
        let way = sample(way);
        let mut section = Self::grid([low[0], low[1]], [high[0], high[1]]);
        section.fill(|place| way_height(&way, place));
        let clearance_m = clearance(points, &section);
        section.limits.iter_mut().for_each(|limit| *limit += clearance_m);
        section
    }

    /// The section seen from the side: limits lie along the axis away from the viewer, the same for all heights.
    pub(super) fn from_side(way: &[[f32; 3]], low: [f32; 3], high: [f32; 3]) -> Self {
        let way = sample(way);
        let mut section = Self::grid([low[0], 0.0], [high[0], 0.0]);
        section.fill(|[x, _]| {
            let off = |place: &[f32; 3]| (place[0] - x).abs();
            let near = way.iter().map(off).fold(f32::INFINITY, f32::min) + STOREY_REACH_M;
            let first = way.iter().filter(|place| off(place) <= near).map(|place| place[1]);
            first.fold(f32::INFINITY, f32::min) - SIDE_CLEARANCE_M
        });
        section
    }

    fn grid(low: [f32; 2], high: [f32; 2]) -> Self {
        let cell_m = ((high[0] - low[0]).max(high[1] - low[1]) / CELLS).max(0.05);
        let sides = [0, 1].map(|k| ((high[k] - low[k]) / cell_m).max(0.0) as usize + 1);
        Self { low, cell_m, sides, limits: vec![0.0; sides[0] * sides[1]] }
    }

    fn fill(&mut self, limit: impl Fn([f32; 2]) -> f32) {
        let centre = |k: usize, cell: usize| self.low[k] + (cell as f32 + 0.5) * self.cell_m;
        for (cell, value) in self.limits.iter_mut().enumerate() {
            *value = limit([centre(0, cell % self.sides[0]), centre(1, cell / self.sides[0])]);
        }
    }

    /// The limit over a place in the plane of the picture; beyond the grid that of its nearest cell.
    pub(super) fn limit(&self, place: [f32; 2]) -> f32 {
        // Casts saturate.
        let cell = |k: usize| (((place[k] - self.low[k]) / self.cell_m) as usize).min(self.sides[k] - 1);
        self.limits[cell(1) * self.sides[0] + cell(0)]
    }
}

/// Every n-th place of the way.
fn sample(way: &[[f32; 3]]) -> Vec<[f32; 3]> {
    way.iter().step_by(way.len().div_ceil(WAY_USED).max(1)).copied().collect()
}

/// The height of the way that is nearest, of the highest where several are nearly as near; infinite where there is none.
fn way_height(way: &[[f32; 3]], [x, y]: [f32; 2]) -> f32 {
    let squared = |place: &[f32; 3]| (place[0] - x) * (place[0] - x) + (place[1] - y) * (place[1] - y);
    let near = way.iter().map(squared).fold(f32::INFINITY, f32::min).sqrt() + STOREY_REACH_M;
    let heights = way.iter().filter(|place| squared(place) <= near * near).map(|place| place[2]);
    heights.reduce(f32::max).unwrap_or(f32::INFINITY)
}

/// How far above the way things are drawn, where the section holds the way's heights.
fn clearance(points: &[[f32; 3]], way: &Section) -> f32 {
    let mut bins = [0_u32; 64];
    for point in points {
        let above = point[2] - way.limit([point[0], point[1]]) - CEILING_FROM_M;
        if above >= 0.0 {
            // Casts saturate.
            bins[((above / CEILING_BIN_M) as usize).min(63)] += 1;
        }
    }
    let all: u32 = bins.iter().sum();
    let low = ((CLEARANCE_M + BELOW_CEILING_M - CEILING_FROM_M) / CEILING_BIN_M) as usize;
    let Some((bin, count)) = bins[..=low].iter().copied().enumerate().max_by_key(|(_, count)| *count) else {
        return CLEARANCE_M;
    };
    let is_ceiling = count as f32 > CEILING_SHARE * all as f32;
    let below = CEILING_FROM_M + bin as f32 * CEILING_BIN_M - BELOW_CEILING_M;
    if is_ceiling { below.clamp(0.1, CLEARANCE_M) } else { CLEARANCE_M }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A flat thing of so many metres, half a metre apart.
    fn slab(low: [f32; 2], high: [f32; 2], height: f32) -> Vec<[f32; 3]> {
        let steps = |k: usize| ((high[k] - low[k]) / 0.5) as usize;
        let at = |k: usize, step: usize| low[k] + step as f32 * 0.5;
        (0..=steps(0)).flat_map(|i| (0..=steps(1)).map(move |j| [at(0, i), at(1, j), height])).collect()
    }

    #[test]
    fn the_limit_climbs_with_the_way_and_stays_below_a_low_ceiling() {
        let way: Vec<[f32; 3]> = (0..=40).map(|k| [k as f32 * 0.5, 0.0, if k > 20 { 3.0 } else { 0.0 }]).collect();
        let (low, high) = ([0.0, -5.0, -1.0], [20.0, 5.0, 6.0]);
        let section = Section::from_above(&slab([0.0, -5.0], [20.0, 5.0], -0.5), &way, low, high);
        assert_eq!([section.limit([2.0, 3.0]), section.limit([18.0, -3.0])], [1.5, 4.5]);
        let ceiling = slab([0.0, -5.0], [8.0, 5.0], 1.2);
        let section = Section::from_above(&ceiling, &way[..16], low, high);
        assert!((0.8..1.2).contains(&section.limit([2.0, 3.0])), "{}", section.limit([2.0, 3.0]));
        assert!(Section::from_above(&ceiling, &[], low, high).limit([f32::NAN, 0.0]) == f32::INFINITY);
        assert_eq!(Section::from_side(&way, low, high).limit([3.0, 1.0]), -1.0);
    }
}
