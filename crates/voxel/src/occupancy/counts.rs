//! Counts of the voxels of a block.

use super::sets::{BLOCK_VOXELS, Mask};

/// One count a voxel: its lowest eight bits, and the rest beside them where any voxel has more. A count below zero, of what
/// was taken out before it came in, has a rest of -1.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Counts {
    low: [u8; BLOCK_VOXELS],
    rest: Option<Box<[i32; BLOCK_VOXELS]>>,
}

impl Counts {
    pub(super) const NONE: Self = Self { low: [0; BLOCK_VOXELS], rest: None };

    /// The count of a voxel, zero where it is below.
    pub(super) fn get(&self, voxel: usize) -> u32 {
        let rest = self.rest.as_ref().map_or(0, |rest| rest[voxel]);
        (i64::from(rest) << 8 | i64::from(self.low[voxel])).clamp(0, i64::from(u32::MAX)) as u32
    }

    /// One more for every voxel of the set.
    pub(super) fn add(&mut self, set: &Mask) {
        for voxel in members(set) {
            self.low[voxel] = self.low[voxel].wrapping_add(1);
            if self.low[voxel] == 0 {
                self.rest_of(voxel, 1);
            }
        }
    }

    /// One less.
    pub(super) fn remove(&mut self, set: &Mask) {
        for voxel in members(set) {
            if self.low[voxel] == 0 {
                self.rest_of(voxel, -1);
            }
            self.low[voxel] = self.low[voxel].wrapping_sub(1);
        }
    }

    #[cold]
    fn rest_of(&mut self, voxel: usize, step: i32) {
        let rest = self.rest.get_or_insert_with(|| Box::new([0; BLOCK_VOXELS]));
        rest[voxel] = rest[voxel].wrapping_add(step);
    }

    /// Forgets a rest of zeros, so that equal counts are equal bytes; whether all is zero.
    pub(super) fn trim(&mut self) -> bool {
        if self.rest.as_ref().is_some_and(|rest| rest.iter().all(|&v| v == 0)) {
            self.rest = None;
        }
        self.rest.is_none() && self.low.iter().all(|&v| v == 0)
    }

    pub(super) fn has_rest(&self) -> bool {
        self.rest.is_some()
    }
}

/// The voxels of a set, in order.
fn members(set: &Mask) -> impl Iterator<Item = usize> + '_ {
    set.iter().enumerate().flat_map(|(word, &bits)| {
        let mut left = bits;
        std::iter::from_fn(move || {
            let bit = left.trailing_zeros() as usize;
            (left != 0).then(|| {
                left &= left - 1;
                word * 64 + bit
            })
        })
    })
}
