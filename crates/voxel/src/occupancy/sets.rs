//! Sets of voxels, block by block.

use crate::key::Key;

/// Bits of a coordinate within a block.
pub(crate) const BLOCK_BITS: u32 = 3;
/// Voxels along the side of a block.
pub(crate) const BLOCK_SIDE: i32 = 1 << BLOCK_BITS;
/// Voxels of a block.
pub(super) const BLOCK_VOXELS: usize = 1 << (3 * BLOCK_BITS);
/// A set of voxels of a block: a word a layer, lowest z first, in it a byte a row, lowest y first, in it a bit a voxel.
pub(super) type Mask = [u64; BLOCK_VOXELS / 64];

/// Not looked up yet.
pub(super) const UNKNOWN: u32 = u32::MAX;

/// The sets within a block.
#[derive(Debug, Clone)]
pub(super) struct BlockSets {
    pub(super) passes: Mask,
    pub(super) hits: Mask,
    pub(super) key: Key,
    /// The blocks beside it, by the sides of a ray, where known: a ray goes on without hashing.
    pub(super) beside: [u32; 6],
}

impl BlockSets {
    pub(super) fn new(key: Key) -> Self {
        Self { passes: [0; 8], hits: [0; 8], key, beside: [UNKNOWN; 6] }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.passes.iter().chain(&self.hits).all(|&word| word == 0)
    }
}
