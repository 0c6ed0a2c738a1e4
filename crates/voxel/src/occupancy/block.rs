//! Blocks of 8 x 8 x 8 voxels, found by their places.

use super::counts::Counts;
use super::sets::{BLOCK_BITS, BLOCK_SIDE, BLOCK_VOXELS, BlockSets, Mask};
use super::{Change, VoxelCounts};
use crate::key::{Key, pack, unpack};
use rustc_hash::FxHashMap;

/// What is known of the voxels of one block.
#[derive(Debug, Clone)]
pub(crate) struct Block {
    key: Key,
    hits: Option<Box<Counts>>,
    passes: Option<Box<Counts>>,
}

impl Block {
    /// Hits and passes of a voxel, by its place within the block.
    pub(crate) fn counts(&self, voxel: usize) -> (u32, u32) {
        let of = |counts: &Option<Box<Counts>>| counts.as_ref().map_or(0, |counts| counts.get(voxel));
        (of(&self.hits), of(&self.passes))
    }

    /// Voxels that something is known of, in order.
    pub(crate) fn voxels(&self) -> impl Iterator<Item = VoxelCounts> + '_ {
        let [x, y, z] = unpack(self.key).map(|v| v << BLOCK_BITS);
        let within = |voxel: usize, k: u32| voxel as i32 >> (k * BLOCK_BITS) & (BLOCK_SIDE - 1);
        (0..BLOCK_VOXELS).filter_map(move |voxel| {
            let (hits, passes) = self.counts(voxel);
            let index = [x + within(voxel, 0), y + within(voxel, 1), z + within(voxel, 2)];
            (hits > 0 || passes > 0).then_some(VoxelCounts { index, hits, passes })
        })
    }

    fn is_empty(&self) -> bool {
        self.hits.is_none() && self.passes.is_none()
    }
}

/// Counts a set in or out; counts that are all zero are none.
fn count(counts: &mut Option<Box<Counts>>, set: &Mask, change: Change) {
    if set.iter().all(|&word| word == 0) {
        return;
    }
    let present = counts.get_or_insert_with(|| Box::new(Counts::NONE));
    match change {
        Change::Add => present.add(set),
        Change::Remove => present.remove(set),
    }
    // Only what was taken out, now or before, leaves zeros behind.
    if (change == Change::Remove || present.has_rest()) && present.trim() {
        *counts = None;
    }
}

/// All blocks.
#[derive(Debug, Clone, Default)]
pub(super) struct Blocks {
    places: FxHashMap<Key, u32>,
    blocks: Vec<Block>,
    /// Blocks that are empty and may be used again.
    empty: Vec<u32>,
}

impl Blocks {
    /// The block with such a place, in blocks.
    pub(super) fn get(&self, place: [i32; 3]) -> Option<&Block> {
        self.places.get(&pack(place.map(i64::from))).map(|&block| &self.blocks[block as usize])
    }

    /// Those that are not empty, by their keys.
    pub(super) fn sorted(&self) -> Vec<(Key, &Block)> {
        let mut sorted: Vec<_> = self.blocks.iter().filter(|b| !b.is_empty()).map(|b| (b.key, b)).collect();
        sorted.sort_unstable_by_key(|(key, _)| *key);
        sorted
    }

    /// Counts what a cloud says in or out.
    pub(super) fn apply<'a>(&mut self, sets: impl Iterator<Item = &'a BlockSets>, change: Change) {
        for set in sets.filter(|set| !set.is_empty()) {
            let at = self.get_or_make(set.key);
            let block = &mut self.blocks[at as usize];
            count(&mut block.hits, &set.hits, change);
            count(&mut block.passes, &set.passes, change);
            if block.is_empty() {
                self.places.remove(&set.key);
                self.empty.push(at);
            }
        }
    }

    fn get_or_make(&mut self, key: Key) -> u32 {
        *self.places.entry(key).or_insert_with(|| {
            let block = Block { key, hits: None, passes: None };
            match self.empty.pop() {
                Some(at) => {
                    self.blocks[at as usize] = block;
                    at
                }
                None => {
                    self.blocks.push(block);
                    self.blocks.len() as u32 - 1
                }
            }
        })
    }
}
