//! What a jump of disparity costs.
//!
//! Depth often jumps where brightness does. Hirschmueller (2008, section 2.3) divides the penalty by the step in brightness; Banz
//! et al., "Real-time stereo vision system using semi-global matching disparity estimation", SAMOS 2010, let it fall
//! linearly to a least one, which does as well and takes no division.

use crate::census::Padded;
use crate::image::GreyImage;
use crate::lanes::{Kernel, Lanes};
use crate::paths::PATHS;

/// At so many mean steps between neighbours in a row the penalty is the least.
const STEPS: u32 = 4;
/// Bits behind the point of the slope.
const FRACTION: u32 = 12;

/// The penalty as a function of the step in brightness, `max(least, most - slope * step)`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Penalties {
    most: u32,
    least: u32,
    slope: u32,
}

impl Penalties {
    /// Of an image; steps are measured by the mean step in it, so that gain and bits of a camera do not matter.
    pub(crate) fn of(image: &GreyImage, most: u8, least: u8) -> Self {
        let height = image.height() as usize;
        let (mut sum, mut count) = (0_u64, 0_u64);
        for y in 0..height {
            let row = image.row(y);
            sum += row.windows(2).map(|pair| u64::from(pair[0].abs_diff(pair[1]))).sum::<u64>();
            count += row.len() as u64 - 1;
        }
        let (most, least) = (u32::from(most), u32::from(least));
        let range = u64::from(STEPS) * sum.max(1);
        let slope = (u64::from(most.saturating_sub(least)) << FRACTION) * count.max(1) / range;
        // a step has 16 bits, so that their product has 31 at most
        Self { most, least, slope: slope.min(1 << 15) as u32 }
    }

    /// Penalties along the paths of a pass, by path and column.
    pub(crate) fn set_row(self, image: &Padded, y: usize, turned: bool, large: &mut [Vec<u8>; PATHS]) {
        let back: i8 = if turned { 1 } else { -1 };
        // from the side, from before on this side, from straight before, from before on the other side
        let from = [[back, 0], [back, back], [0, back], [-back, back]];
        for (offset, large) in from.into_iter().zip(large) {
            let (here, there) = (image.values(y), image.row(y, offset));
            crate::lanes::run(PenaltyRow { penalties: self, here, there, large });
        }
    }
}

struct PenaltyRow<'a> {
    penalties: Penalties,
    here: &'a [u16],
    there: &'a [u16],
    large: &'a mut [u8],
}

impl Kernel for PenaltyRow<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        let Penalties { most, least, slope } = self.penalties;
        let (count, large) = (self.large.len(), self.large);
        let (here, there) = (&self.here[..count], &self.there[..count]);
        for x in 0..count {
            let fall = (u32::from(here[x].abs_diff(there[x])) * slope) >> FRACTION;
            large[x] = most.saturating_sub(fall).max(least) as u8;
        }
    }
}
