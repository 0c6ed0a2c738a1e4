//! What is known of the voxels of a block, in integers: adding and taking away are exact, in any order.

use crate::key::{BLOCK_VOXELS, Key};
use crate::sketch::{Mask, Reading, STEPS_MOST, WEIGHT_MOST};

/// Whether a view is added or taken away again, exactly.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// It is added.
    Add,
    /// It is taken away.
    Remove,
}

/// So many views may be drawn: a voxel's sum of weighted distances, of at most `1023 * 31` each, stays within 32 bits, its passes within 16.
pub(crate) const VIEWS_MOST: u32 = u16::MAX as u32;
const _: () = assert!((VIEWS_MOST as i64) * (STEPS_MOST as i64) * (WEIGHT_MOST as i64) < i32::MAX as i64);

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
    /// Views of which rays passed: bit `k` of the voxels' counts is `passes[k]`, so that a view is added to 64 voxels at once. The last is not empty.
    pub(crate) passes: Vec<Mask>,
}

/// Bytes of a block's sums, colours and passes.
const BYTES: [usize; 2] = [BLOCK_VOXELS * size_of::<Near>(), BLOCK_VOXELS * size_of::<Colour>()];
/// Of passes while they are few.
const PASSES_BYTES: usize = 4 * size_of::<Mask>();

impl Block {
    pub(crate) fn new(key: Key) -> Self {
        Self { key, near: None, colours: None, passes: Vec::new() }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.near.is_none() && self.passes.is_empty()
    }

    /// What it takes with what it lacks of these: sums, colours.
    pub(crate) fn bytes_with(block: Option<&Self>, needs: [bool; 2]) -> usize {
        let has = block.map_or([false; 2], |block| [block.near.is_some(), block.colours.is_some()]);
        let passes = block.map_or(PASSES_BYTES, |block| PASSES_BYTES.max(block.passes.len() * size_of::<Mask>()));
        (0..2).filter(|&k| has[k] || needs[k]).map(|k| BYTES[k]).sum::<usize>() + passes + size_of::<Self>()
    }

    /// What it takes.
    pub(crate) fn bytes(&self) -> usize {
        Self::bytes_with(Some(self), [false; 2])
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
            let Some([red, green, blue]) = colour else { continue };
            let [red, green, blue] = [u32::from(red), u32::from(green), u32::from(blue)];
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
        let mut carried = *mask;
        for plane in 0..u16::BITS as usize {
            if carried.iter().all(|&word| word == 0) {
                break;
            }
            if self.passes.len() <= plane {
                self.passes.push(Mask::default());
            }
            for (bits, carried) in self.passes[plane].iter_mut().zip(&mut carried) {
                let before = *bits;
                *bits ^= *carried;
                *carried &= if change == Change::Add { before } else { !before };
            }
        }
    }

    /// Drops what is all zero again.
    pub(crate) fn trim(&mut self) {
        self.near.take_if(|near| near.iter().all(|it| *it == Near::default()));
        self.colours.take_if(|colours| colours.iter().all(|it| *it == Colour::default()));
        while self.passes.pop_if(|plane| plane.iter().all(|&word| word == 0)).is_some() {}
    }

    /// What is known of a voxel.
    pub(crate) fn near(&self, voxel: usize) -> Near {
        self.near.as_ref().map_or(Near::default(), |near| near[voxel])
    }

    /// Views of which rays passed a voxel.
    pub(crate) fn passes(&self, voxel: usize) -> u16 {
        let bit = |plane: &Mask| (plane[voxel / 64] >> (voxel % 64) & 1) as u16;
        self.passes.iter().rev().fold(0, |count, plane| count << 1 | bit(plane))
    }
}
