//! Distances of a block and of what follows it, for cells that reach over its border.

use crate::block::{Block, Colour, Near};
use crate::key::{BLOCK_BITS, BLOCK_SIDE, pack, unpack, within_block};
use crate::sketch::{STEPS_PER_VOXEL, WEIGHT_MOST};
use crate::volume::Volume;

/// Corners of a block's cells along an axis.
const CORNERS: usize = BLOCK_SIDE as usize + 1;

/// Of a voxel that says a surface lies before it, rays of so many views that pass it count as much as one that sees the surface from
/// near: for an occupied place twice as much is said by a hit as by a pass (Hornung et al. 2013, "OctoMap", section 4: 0.85 and -0.4), and a ray may pass a whole voxel's half diagonal beside the middle.
const PASSES_PER_VIEW: i64 = 4;

/// Distances at the corners of a block's cells, in steps; not a number where it is not known.
pub(super) struct Grid<'a> {
    distances: [f32; CORNERS * CORNERS * CORNERS],
    weights: [u32; CORNERS * CORNERS * CORNERS],
    /// The block and those that follow it, by a bit for each axis.
    blocks: [Option<&'a Block>; 8],
}

/// The number of a corner.
const fn corner_at([x, y, z]: [usize; 3]) -> usize {
    x + CORNERS * (y + CORNERS * z)
}

impl<'a> Grid<'a> {
    pub(super) fn of(volume: &'a Volume, block: &'a Block) -> Self {
        let mut distances = [f32::NAN; CORNERS * CORNERS * CORNERS];
        let mut weights = [0; CORNERS * CORNERS * CORNERS];
        let place = unpack(block.key);
        let blocks: [Option<&Block>; 8] = std::array::from_fn(|part| {
            let key = pack([0, 1, 2].map(|k| place[k] + (part >> k & 1) as i32));
            if part == 0 { Some(block) } else { volume.block(key) }
        });
        for (part, block) in blocks.iter().enumerate() {
            let ahead = [part & 1, part >> 1 & 1, part >> 2];
            let Some(block) = block else { continue };
            let side = BLOCK_SIDE as usize;
            let range = |k: usize| if ahead[k] == 1 { side..CORNERS } else { 0..side };
            for (x, y, z) in range(2).flat_map(|z| range(1).flat_map(move |y| range(0).map(move |x| (x, y, z)))) {
                let voxel = within_block([x, y, z].map(|v| v as i32));
                distances[corner_at([x, y, z])] = distance(block, voxel);
                weights[corner_at([x, y, z])] = block.near(voxel).weight;
            }
        }
        Self { distances, weights, blocks }
    }

    /// Colour sums of a corner.
    pub(super) fn colour(&self, corner: [usize; 3]) -> Colour {
        let part = (0..3).fold(0, |bits, k| bits | corner[k] >> BLOCK_BITS << k);
        let colours = self.blocks[part].and_then(|block| block.colours.as_ref());
        colours.map_or(Colour::default(), |colours| colours[within_block(corner.map(|v| v as i32))])
    }

    /// Distances of the eight corners of a cell, if all are known and the one that was seen best is worth the weight: those behind a surface count for less.
    pub(super) fn cell(&self, [x, y, z]: [usize; 3], least_weight: f64) -> Option<[f32; 8]> {
        let first = corner_at([x, y, z]);
        let place = |k: usize| first + (k & 1) + CORNERS * ((k >> 1 & 1) + CORNERS * (k >> 2));
        let corners: [f32; 8] = std::array::from_fn(|k| self.distances[place(k)]);
        let is_known = corners.iter().all(|it| !it.is_nan());
        let best = (0..8).map(|k| self.weights[place(k)]).max().unwrap_or(0);
        (is_known && f64::from(best) >= least_weight).then_some(corners)
    }
}

/// The mean distance of a voxel, in steps; one voxel before a surface where it lies behind one that rays have passed.
fn distance(block: &Block, voxel: usize) -> f32 {
    let Near { distance, weight } = block.near(voxel);
    if weight == 0 {
        return f32::NAN;
    }
    let passed = i64::from(block.passes(voxel)) * i64::from(WEIGHT_MOST);
    if distance < 0 && passed > PASSES_PER_VIEW * i64::from(weight) {
        return STEPS_PER_VOXEL;
    }
    distance as f32 / weight as f32
}
