//! Rays through voxels, block by block.

use super::sets::{BLOCK_SIDE, Mask};

/// Parts of the way along a ray, in which it is told when it leaves voxels; the lowest two bits of such a time are the axis.
const WHOLE: f64 = (1_u64 << 44) as f64;
const AXIS: u64 = 3;
/// Never.
const NEVER: u64 = 1 << 62;
/// Coordinates within a block lie four bits apart; the fourth is set once the block is left.
const FIELD: u32 = 4;
const LEFT: u32 = 0x888;

/// A ray on its way (Amanatides and Woo 1987), in a frame mirrored such that all coordinates grow.
///
/// A ray ends in the middle of a voxel, so that it crosses no border within half a voxel of its end, and rounding does not change
/// how often it crosses which: after as many steps as there are voxels between its ends it is there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ray {
    /// When it leaves its voxel along each axis, and between two borders.
    next: [u64; 3],
    step: [u64; 3],
    /// Place within the block, mirrored, and which bits are.
    place: u32,
    mirror: u32,
    /// Voxels to go, without the last.
    to_go: u32,
}

impl Ray {
    /// From a place, which lies in the voxel `start`, to the middle of the voxel `end`.
    pub(super) fn new(origin: [f64; 3], start: [i32; 3], end: [i32; 3]) -> Self {
        let mut ray = Self { next: [NEVER; 3], step: [0; 3], place: 0, mirror: 0, to_go: 0 };
        for k in 0..3 {
            let within = (start[k] & (BLOCK_SIDE - 1)) as u32;
            let way = f64::from(end[k]) + 0.5 - origin[k];
            let is_mirrored = end[k] < start[k];
            let flip = if is_mirrored { BLOCK_SIDE as u32 - 1 } else { 0 };
            ray.place |= (within ^ flip) << (FIELD * k as u32);
            ray.mirror |= flip << (FIELD * k as u32);
            let voxels = end[k].abs_diff(start[k]);
            ray.to_go += voxels;
            if voxels > 0 {
                let border = f64::from(start[k]) + if is_mirrored { 0.0 } else { 1.0 };
                let first = (border - origin[k]) / way;
                ray.next[k] = (first * WHOLE) as u64 & !AXIS;
                ray.step[k] = (WHOLE / way.abs()) as u64 & !AXIS;
            }
            ray.next[k] |= k as u64;
        }
        ray
    }

    /// Marks its voxels within the present block. The side by which it leaves, twice the axis and one more where that is
    /// downwards; none where it has come to its end.
    #[inline]
    pub(super) fn cross(&mut self, passes: &mut Mask) -> Option<usize> {
        let [mut x, mut y, mut z] = self.next;
        let [step_x, step_y, step_z] = self.step;
        let (mut place, mut to_go) = (self.place, self.to_go);
        while to_go > 0 {
            let at = place ^ self.mirror;
            passes[(at >> (2 * FIELD) & 7) as usize] |= 1 << (at & 7 | at >> 1 & 0x38);
            let first = x.min(y).min(z);
            let axis = (first & AXIS) as u32;
            x += if first == x { step_x } else { 0 };
            y += if first == y { step_y } else { 0 };
            z += if first == z { step_z } else { 0 };
            place += 1 << (FIELD * axis);
            to_go -= 1;
            if place & LEFT != 0 {
                self.next = [x, y, z];
                self.place = place & !LEFT;
                self.to_go = to_go;
                let is_down = self.mirror >> (FIELD * axis) & 1;
                return (to_go > 0).then_some((2 * axis + is_down) as usize);
            }
        }
        None
    }
}
