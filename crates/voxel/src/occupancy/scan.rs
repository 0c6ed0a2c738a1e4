//! What one cloud says: the set of voxels that it hits, and the set that its rays pass.

use super::ray::Ray;
use super::sets::{BLOCK_BITS, BLOCK_SIDE, BlockSets, UNKNOWN};
use crate::key::{Key, key_of, pack, unpack};
use rustc_hash::FxHashMap;

/// Collects one cloud after the other; keeps its buffers.
#[derive(Debug, Clone, Default)]
pub(super) struct Scan {
    origin: [f64; 3],
    range_voxels: f64,
    places: FxHashMap<Key, u32>,
    blocks: Vec<BlockSets>,
    /// The block met last, its key and number.
    last: Option<(Key, u32)>,
    /// Voxels that rays go to.
    ends: Vec<Key>,
    /// Those of rays that ended at the greatest range: nothing is seen there.
    far_ends: Vec<Key>,
}

impl Scan {
    /// Begins a cloud seen from a place, voxels.
    pub(super) fn begin(&mut self, origin: [f64; 3], range_voxels: f64) {
        (self.origin, self.range_voxels, self.last) = (origin, range_voxels, None);
        self.places.clear();
        self.blocks.clear();
        self.ends.clear();
        self.far_ends.clear();
    }

    /// Adds a point, voxels.
    pub(super) fn add_point(&mut self, at: [f64; 3]) {
        let way = [0, 1, 2].map(|k| at[k] - self.origin[k]);
        let range = way.iter().map(|v| v * v).sum::<f64>().sqrt();
        if range > self.range_voxels {
            let cut = self.range_voxels / range;
            let end = [0, 1, 2].map(|k| self.origin[k] + cut * way[k]);
            self.far_ends.extend(key_of(end).filter(|_| range.is_finite()));
        } else if let Some(key) = key_of(at) {
            self.hit(key);
        }
    }

    fn hit(&mut self, key: Key) {
        let index = unpack(key);
        let block = self.block_of(index);
        let [x, y, z] = index.map(|v| v & (BLOCK_SIDE - 1));
        let bit = 1 << (x | y << BLOCK_BITS);
        let word = &mut self.blocks[block as usize].hits[z as usize];
        if *word & bit == 0 {
            *word |= bit;
            self.ends.push(key);
        }
    }

    /// Casts the rays; what is hit is not passed.
    pub(super) fn cast_rays(&mut self) {
        self.far_ends.sort_unstable();
        self.far_ends.dedup();
        let Some(start) = key_of(self.origin).map(unpack) else { return };
        let first = self.block_of(start);
        for lists in [std::mem::take(&mut self.ends), std::mem::take(&mut self.far_ends)] {
            lists.iter().for_each(|&end| self.cast(Ray::new(self.origin, start, unpack(end)), first));
        }
        for block in &mut self.blocks {
            (0..block.passes.len()).for_each(|k| block.passes[k] &= !block.hits[k]);
        }
    }

    fn cast(&mut self, mut ray: Ray, mut block: u32) {
        while let Some(side) = ray.cross(&mut self.blocks[block as usize].passes) {
            let known = self.blocks[block as usize].beside[side];
            block = if known == UNKNOWN { self.look_beside(block, side) } else { known };
        }
    }

    #[cold]
    fn look_beside(&mut self, block: u32, side: usize) -> u32 {
        let step = [1_u64 << 42, 1 << 21, 1][side / 2];
        let key = self.blocks[block as usize].key;
        let beside = self.number_of(if side & 1 == 0 { key + step } else { key - step });
        self.blocks[block as usize].beside[side] = beside;
        self.blocks[beside as usize].beside[side ^ 1] = block;
        beside
    }

    /// The block that a voxel lies in.
    fn block_of(&mut self, index: [i32; 3]) -> u32 {
        let key = pack(index.map(|v| i64::from(v >> BLOCK_BITS)));
        if let Some((last, number)) = self.last
            && last == key
        {
            return number;
        }
        let number = self.number_of(key);
        self.last = Some((key, number));
        number
    }

    fn number_of(&mut self, key: Key) -> u32 {
        *self.places.entry(key).or_insert_with(|| {
            self.blocks.push(BlockSets::new(key));
            self.blocks.len() as u32 - 1
        })
    }

    /// What was collected, block by block.
    pub(super) fn sets(&self) -> impl Iterator<Item = &BlockSets> {
        self.blocks.iter()
    }
}
