//! What a change of disparity from one pixel to the next costs.
//!
//! Depth often jumps where brightness does. Hirschmueller (2008, section 2.3) divides the penalty of a jump by the step in brightness;
//! Banz et al., "Real-time stereo vision system using semi-global matching disparity estimation", SAMOS 2010, let it fall
//! linearly to a least one, which does as well and takes no division.

use crate::census::{BITS, Padded};
use crate::lanes::{Kernel, Lanes};
use crate::paths::PATHS;

/// A change by one: as much as a pixel costs that contradicts in all its bits.
pub(crate) const SMALL: u8 = BITS as u8;
/// A larger change where brightness does not change, four such pixels: with the bits of a pixel it has to fit a byte.
const LARGE: u8 = 4 * SMALL;
/// The same at an edge of brightness: a little more than a change by one, as it must be (Hirschmueller 2008, section 2.3).
const LARGE_AT_EDGES: u8 = SMALL + SMALL / 5;
/// At so many mean steps of brightness between neighbours in a row the penalty is the least.
const EDGE_STEPS: u64 = 4;
/// Bits behind the point of the slope.
const FRACTION: u32 = 12;

const _: () = assert!(LARGE as usize + 2 * BITS <= u8::MAX as usize, "costs along a path fit a byte");

/// The penalty as a function of the step in brightness, `max(LARGE_AT_EDGES, LARGE - slope * step)`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Penalties {
    slope: u32,
}

impl Penalties {
    /// Of an image; steps are measured by the mean step in it, so that gain and bits of a camera do not matter.
    pub(crate) fn of(image: &Padded, width: usize, height: usize) -> Self {
        let mut sum = 0_u64;
        for y in 0..height {
            let (here, next) = (&image.row(y, [0, 0])[..width], &image.row(y, [1, 0])[..width]);
            sum += here.iter().zip(next).map(|(a, b)| u64::from(a.abs_diff(*b))).sum::<u64>();
        }
        let range = EDGE_STEPS * sum.max(1);
        let slope = (u64::from(LARGE - LARGE_AT_EDGES) << FRACTION) * (width * height) as u64 / range;
        // a step has 16 bits, so that their product has 31 at most
        Self { slope: slope.min(1 << 15) as u32 }
    }

    /// Penalties along the paths of a pass, by path and column.
    pub(crate) fn set_row(self, image: &Padded, y: usize, turned: bool, large: &mut [Vec<u8>; PATHS]) {
        let back = if turned { 1 } else { -1 };
        // from the side, from before on this side, from straight before, from before on the other side
        let from = [[back, 0], [back, back], [0, back], [-back, back]];
        let here = image.row(y, [0, 0]);
        for (offset, large) in from.into_iter().zip(large) {
            large.resize(here.len(), 0);
            crate::lanes::run(PenaltyRow { slope: self.slope, here, there: image.row(y, offset), large });
        }
    }
}

struct PenaltyRow<'a> {
    slope: u32,
    here: &'a [u16],
    there: &'a [u16],
    large: &'a mut [u8],
}

impl Kernel for PenaltyRow<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        let (count, large) = (self.large.len(), self.large);
        let (here, there) = (&self.here[..count], &self.there[..count]);
        for x in 0..count {
            let fall = (u32::from(here[x].abs_diff(there[x])) * self.slope) >> FRACTION;
            large[x] = u32::from(LARGE).saturating_sub(fall).max(u32::from(LARGE_AT_EDGES)) as u8;
        }
    }
}
