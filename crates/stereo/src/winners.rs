//! Which disparity costs least.

use crate::lanes::{LANES, Lanes, WORDS};
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
    fn lane<L: Lanes>(&mut self, lanes: L, x: usize, lane: usize, sums: [L::Words; 2]) {
        let to = &mut self.sums[x * self.disparities + lane * LANES..][..LANES];
        for (to, sums) in to.as_chunks_mut::<WORDS>().0.iter_mut().zip(sums) {
            lanes.store_words(sums, to);
        }
    }

    #[inline(always)]
    fn pixel<L: Lanes>(&mut self, _: L, _: usize) {}
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
    /// 0, 1, 2 and so on.
    numbers: Vec<u16>,
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
        self.numbers.clear();
        self.numbers.extend((0..disparities).map(|d| d as u16));
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
    fn lane<L: Lanes>(&mut self, lanes: L, x: usize, lane: usize, sums: [L::Words; 2]) {
        let at = lane * LANES;
        let first = self.first[x * self.disparities + at..][..LANES].as_chunks::<WORDS>().0;
        let to = self.found.sums[at..][..LANES].as_chunks_mut::<WORDS>().0;
        for ((to, first), sums) in to.iter_mut().zip(first).zip(sums) {
            lanes.store_words(lanes.add_words(lanes.words(first), sums), to);
        }
    }

    #[inline(always)]
    fn pixel<L: Lanes>(&mut self, lanes: L, x: usize) {
        let RowWinners { left, right_least, right_disparity, sums, numbers } = &mut *self.found;
        let sums = sums[..self.disparities].as_chunks::<WORDS>().0;
        let numbers = numbers[..self.disparities].as_chunks::<WORDS>().0;
        left[x] = winner(lanes, sums, numbers);
        let mirrored = left.len() - 1 - x;
        let right_least = right_least[mirrored..][..self.disparities].as_chunks_mut::<WORDS>().0;
        let right_disparity = right_disparity[mirrored..][..self.disparities].as_chunks_mut::<WORDS>().0;
        for ((sums, numbers), (to_least, to_best)) in sums.iter().zip(numbers).zip(right_least.iter_mut().zip(right_disparity)) {
            let (least, best) = (lanes.words(to_least), lanes.words(to_best));
            let new = lanes.min_words(least, lanes.words(sums));
            lanes.store_words(new, to_least);
            lanes.store_words(lanes.where_same(new, least, best, lanes.words(numbers)), to_best);
        }
    }
}

/// The first of the disparities that cost least.
#[inline(always)]
fn winner<L: Lanes>(lanes: L, sums: &[[u16; WORDS]], numbers: &[[u16; WORDS]]) -> Winner {
    let never = lanes.all_words(u16::MAX);
    let mut low = never;
    for sums in sums {
        low = lanes.min_words(low, lanes.words(sums));
    }
    let least = lanes.lowest_word(low);
    let (same, mut low) = (lanes.all_words(least), never);
    for (sums, numbers) in sums.iter().zip(numbers) {
        low = lanes.min_words(low, lanes.where_same(lanes.words(sums), same, lanes.words(numbers), never));
    }
    let disparity = lanes.lowest_word(low);
    // within one of the best: d - (best - 1) is 0, 1 or 2
    let (from, two, mut low) = (lanes.all_words(disparity.wrapping_sub(1)), lanes.all_words(2), never);
    for (sums, numbers) in sums.iter().zip(numbers) {
        let apart = lanes.sub_words(lanes.words(numbers), from);
        let other = lanes.where_same(apart, lanes.min_words(apart, two), never, lanes.words(sums));
        low = lanes.min_words(low, other);
    }
    let second = lanes.lowest_word(low);
    let (sums, best) = (sums.as_flattened(), usize::from(disparity));
    let below = if best == 0 { u16::MAX } else { sums[best - 1] };
    let above = if best + 1 < sums.len() { sums[best + 1] } else { u16::MAX };
    Winner { disparity, least, beside: [below, above], second }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn winner(sums: &[u16]) -> Winner {
        let numbers: Vec<u16> = (0..sums.len() as u16).collect();
        super::winner(crate::lanes::Plain, sums.as_chunks().0, numbers.as_chunks().0)
    }

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
