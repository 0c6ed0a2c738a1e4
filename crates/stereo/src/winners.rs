//! Which disparity costs least.

use crate::lanes::LANES;
use crate::paths::Sink;

/// Keeps the sums of the first pass.
pub(crate) struct Keep<'a> {
    /// Sums of a row, disparity by disparity of pixel by pixel.
    pub(crate) sums: &'a mut [u16],
    /// Disparities, in whole lanes.
    pub(crate) disparities: usize,
}

impl Sink for Keep<'_> {
    #[inline(always)]
    fn lane(&mut self, x: usize, lane: usize, sums: &[u16; LANES]) {
        if let Some(to) = self.sums[x * self.disparities + lane * LANES..].first_chunk_mut::<LANES>() {
            *to = *sums;
        }
    }

    #[inline(always)]
    fn pixel(&mut self, _: usize) {}
}

/// What is known of a pixel's best disparity.
#[derive(Debug, Default, Clone, Copy, PartialEq)]
pub(crate) struct Winner {
    /// The disparity, pixels.
    pub(crate) disparity: u16,
    /// What it costs, over all paths.
    pub(crate) least: u16,
    /// What the disparities below and above it cost, or the most that there is.
    pub(crate) beside: [u16; 2],
    /// The least that any other disparity costs.
    pub(crate) second: u16,
}

/// The best disparities of a row, seen from either image.
#[derive(Debug, Default)]
pub(crate) struct RowWinners {
    /// Of each pixel of the left image.
    pub(crate) left: Vec<Winner>,
    right_least: Vec<u16>,
    right_disparity: Vec<u16>,
    sums: Vec<u16>,
}

impl RowWinners {
    /// Forgets the row before.
    pub(crate) fn reset(&mut self, width: usize, disparities: usize) {
        self.left.clear();
        self.left.resize(width, Winner::default());
        self.right_least.clear();
        self.right_least.resize(width + disparities, u16::MAX);
        self.right_disparity.resize(width + disparities, 0);
        self.sums.resize(disparities, 0);
    }

    /// The best disparity of a pixel of the right image, by the same sums.
    pub(crate) fn of_right(&self, x: usize) -> u16 {
        self.right_disparity[self.left.len() - 1 - x]
    }
}

/// Adds the sums of the second pass to those of the first, and finds the best of each pixel.
pub(crate) struct Choose<'a> {
    /// Sums of the first pass.
    pub(crate) first: &'a [u16],
    /// Disparities, in whole lanes.
    pub(crate) disparities: usize,
    /// What was found.
    pub(crate) found: &'a mut RowWinners,
}

impl Sink for Choose<'_> {
    #[inline(always)]
    fn lane(&mut self, x: usize, lane: usize, sums: &[u16; LANES]) {
        let at = lane * LANES;
        if let (Some(first), Some(to)) = (
            self.first[x * self.disparities + at..].first_chunk::<LANES>(),
            self.found.sums[at..].first_chunk_mut::<LANES>(),
        ) {
            for k in 0..LANES {
                to[k] = first[k] + sums[k];
            }
        }
    }

    #[inline(always)]
    fn pixel(&mut self, x: usize) {
        let RowWinners { left, right_least, right_disparity, sums } = &mut *self.found;
        let sums = &sums[..self.disparities];
        left[x] = winner(sums);
        let mirrored = left.len() - 1 - x;
        let (right_least, right_disparity) = (&mut right_least[mirrored..], &mut right_disparity[mirrored..]);
        for (lane, sums) in sums.as_chunks::<LANES>().0.iter().enumerate() {
            let at = lane * LANES;
            let (Some(least), Some(disparity)) =
                (right_least[at..].first_chunk_mut::<LANES>(), right_disparity[at..].first_chunk_mut::<LANES>())
            else {
                return;
            };
            let (mut new_least, mut new_disparity) = (*least, *disparity);
            for k in 0..LANES {
                new_disparity[k] = if sums[k] < new_least[k] { (at + k) as u16 } else { new_disparity[k] };
                new_least[k] = sums[k].min(new_least[k]);
            }
            (*least, *disparity) = (new_least, new_disparity);
        }
    }
}

/// The first of the disparities that cost least.
#[inline(always)]
fn winner(sums: &[u16]) -> Winner {
    let least = lowest(sums, |_, sum| sum);
    let disparity = lowest(sums, |d, sum| if sum == least { d } else { u16::MAX });
    // within one of the best: d - (best - 1) is 0, 1 or 2
    let from = disparity.wrapping_sub(1);
    let second = lowest(sums, |d, sum| if d.wrapping_sub(from) <= 2 { u16::MAX } else { sum });
    let beside = |d: Option<usize>| d.and_then(|d| sums.get(d)).copied().unwrap_or(u16::MAX);
    let best = usize::from(disparity);
    Winner { disparity, least, beside: [beside(best.checked_sub(1)), beside(Some(best + 1))], second }
}

/// The lowest of what a function makes of all disparities and their sums.
#[inline(always)]
fn lowest(sums: &[u16], of: impl Fn(u16, u16) -> u16) -> u16 {
    let mut lows = [u16::MAX; LANES];
    for (lane, sums) in sums.as_chunks::<LANES>().0.iter().enumerate() {
        for k in 0..LANES {
            lows[k] = lows[k].min(of((lane * LANES + k) as u16, sums[k]));
        }
    }
    lows.iter().fold(u16::MAX, |a, b| a.min(*b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_of_the_best() {
        let mut sums = [90_u16; 2 * LANES];
        (sums[0], sums[40], sums[41], sums[42], sums[60]) = (31, 30, 20, 35, 25);
        assert_eq!(winner(&sums), Winner { disparity: 41, least: 20, beside: [30, 35], second: 25 });
        (sums[0], sums[1]) = (20, 21);
        assert_eq!(winner(&sums), Winner { disparity: 0, least: 20, beside: [u16::MAX, 21], second: 20 });
        sums[63] = 10;
        assert_eq!(winner(&sums), Winner { disparity: 63, least: 10, beside: [90, u16::MAX], second: 20 });
    }
}
