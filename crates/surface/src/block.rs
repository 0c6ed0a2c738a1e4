//! What is known of the voxels of a block, in integers: adding and taking away are exact, in any order.

use crate::key::{BLOCK_VOXELS, Key};
use crate::sketch::{DISTANCE_STEPS, Mask, Reading, WEIGHT_MOST, voxels};

/// Whether a view is added or taken away again, exactly.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// It is added.
    Add,
    /// It is taken away.
    Remove,
}

/// So many views may be drawn: a voxel's sum of weighted distances, of at most `511 * 31` each, stays within 32 bits, its passes within 16.
pub(crate) const VIEWS_MOST: u32 = u16::MAX as u32;
const _: () = assert!((VIEWS_MOST as i64) * (DISTANCE_STEPS as i64) * (WEIGHT_MOST as i64) < i32::MAX as i64);

/// Sums over the views that saw a voxel near a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Near {
    /// Of weight times distance.
    pub(crate) distance: i32,
    /// Of weights: above zero where any view saw it.
    pub(crate) weight: u32,
}

/// Sums of weight times red, green and blue, and of weights.
pub(crate) type Colour = [u32; 4];

/// The voxels of one block. What no view says anything of is not there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Block {
    pub(crate) key: Key,
    pub(crate) near: Option<Box<[Near; BLOCK_VOXELS]>>,
    pub(crate) colours: Option<Box<[Colour; BLOCK_VOXELS]>>,
    /// Views of which rays passed.
    pub(crate) passes: Option<Box<[u16; BLOCK_VOXELS]>>,
}

/// Bytes of a block's sums, colours and passes.
const BYTES: [usize; 3] = [size_of::<Near>(), size_of::<Colour>(), size_of::<u16>()];

impl Block {
    pub(crate) fn new(key: Key) -> Self {
        Self { key, near: None, colours: None, passes: None }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.near.is_none() && self.passes.is_none()
    }

    /// What it takes with what it lacks of these: sums, colours, passes.
    pub(crate) fn bytes_with(block: Option<&Self>, needs: [bool; 3]) -> usize {
        let has = block.map_or([false; 3], Self::has);
        (0..3).filter(|&k| has[k] || needs[k]).map(|k| BYTES[k] * BLOCK_VOXELS).sum::<usize>() + size_of::<Self>()
    }

    /// What it takes.
    pub(crate) fn bytes(&self) -> usize {
        Self::bytes_with(Some(self), [false; 3])
    }

    fn has(&self) -> [bool; 3] {
        [self.near.is_some(), self.colours.is_some(), self.passes.is_some()]
    }

    /// Counts what a view says. Sums wrap, so that even what was never added is taken away without a panic.
    pub(crate) fn count(&mut self, readings: impl Iterator<Item = (usize, Reading)>, change: Change) {
        for (voxel, Reading { distance, weight, colour }) in readings {
            let near = &mut self.near.get_or_insert_with(|| Box::new([Near::default(); BLOCK_VOXELS]))[voxel];
            let weighted = distance * weight as i32;
            (near.distance, near.weight) = match change {
                Change::Add => (near.distance.wrapping_add(weighted), near.weight.wrapping_add(weight)),
                Change::Remove => (near.distance.wrapping_sub(weighted), near.weight.wrapping_sub(weight)),
            };
            let Some([red, green, blue]) = colour.map(|colour| colour.map(u32::from)) else { continue };
            let sums = &mut self.colours.get_or_insert_with(|| Box::new([Colour::default(); BLOCK_VOXELS]))[voxel];
            for (sum, part) in sums.iter_mut().zip([red * weight, green * weight, blue * weight, weight]) {
                *sum = match change {
                    Change::Add => sum.wrapping_add(part),
                    Change::Remove => sum.wrapping_sub(part),
                };
            }
        }
    }

    /// Counts the voxels that rays of a view passed.
    pub(crate) fn count_passes(&mut self, mask: &Mask, change: Change) {
        let passes = self.passes.get_or_insert_with(|| Box::new([0; BLOCK_VOXELS]));
        for voxel in voxels(mask) {
            passes[voxel] = match change {
                Change::Add => passes[voxel].wrapping_add(1),
                Change::Remove => passes[voxel].wrapping_sub(1),
            };
        }
    }

    /// Drops what is all zero again.
    pub(crate) fn trim(&mut self) {
        self.near.take_if(|near| near.iter().all(|it| *it == Near::default()));
        self.colours.take_if(|colours| colours.iter().all(|it| *it == Colour::default()));
        self.passes.take_if(|passes| passes.iter().all(|it| *it == 0));
    }

    /// What is known of a voxel.
    pub(crate) fn near(&self, voxel: usize) -> Near {
        self.near.as_ref().map_or(Near::default(), |near| near[voxel])
    }

    /// Views of which rays passed a voxel.
    pub(crate) fn passes(&self, voxel: usize) -> u16 {
        self.passes.as_ref().map_or(0, |passes| passes[voxel])
    }
}
