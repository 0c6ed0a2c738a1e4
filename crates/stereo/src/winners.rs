//! Which disparity costs least.

use crate::lanes::{LANES, Lanes};
use crate::paths::Sink;

/// Keeps the sums of the first pass.
pub(crate) struct Keep<'a> {
    /// Sums of a row, disparity by disparity of pixel by pixel.
    pub(crate) sums: &'a mut [u8],
}

impl Sink for Keep<'_> {
    #[inline(always)]
    fn take<L: Lanes>(&mut self, _: L, x: usize, sums: &[[u8; LANES]], disparities: usize) {
        let to = self.sums[x * disparities..][..disparities].as_chunks_mut::<LANES>().0;
        to.copy_from_slice(sums);
    }
}

/// What is known of a pixel's best disparity.
#[derive(Debug, Default, Clone, Copy, PartialEq)]
pub(crate) struct Winner {
    /// The disparity, pixels.
    pub(crate) disparity: u16,
    /// What it costs, half the sum over all paths.
    pub(crate) least: u16,
    /// What the disparities below and above it cost; the most that there is where there is none.
    pub(crate) beside: [u16; 2],
    /// The least that one costs that is not beside it, a quarter of the sum over all paths; 255 where nobody asked.
    pub(crate) second: u8,
}

/// Adds the sums of the second pass to those of the first, and finds the best of each pixel.
pub(crate) struct Choose<'a> {
    /// Sums of the first pass.
    pub(crate) first: &'a [u8],
    /// Whether the second best disparity is asked for.
    pub(crate) is_second_asked: bool,
    /// Room for the sums of a pixel.
    pub(crate) totals: &'a mut [u8],
    /// What was found.
    pub(crate) found: &'a mut [Winner],
}

impl Sink for Choose<'_> {
    #[inline(always)]
    fn take<L: Lanes>(&mut self, lanes: L, x: usize, second: &[[u8; LANES]], disparities: usize) {
        let first = self.first[x * disparities..][..disparities].as_chunks::<LANES>().0;
        let totals = self.totals[..disparities].as_chunks_mut::<LANES>().0;
        let mut low = lanes.all_bytes(u8::MAX);
        let second = &second[..totals.len()];
        for lane in 0..totals.len() {
            let sum = lanes.mean_bytes(lanes.bytes(&first[lane]), lanes.bytes(&second[lane]));
            lanes.store_bytes(sum, &mut totals[lane]);
            low = lanes.min_bytes(low, sum);
        }
        let best = first_of(lanes, totals, lanes.lowest_byte(low));
        let next = if self.is_second_asked { next_to(lanes, totals, best) } else { u8::MAX };
        let (first, second) = (first.as_flattened(), second.as_flattened());
        let cost = |d: usize| if d < first.len() { u16::from(first[d]) + u16::from(second[d]) } else { u16::MAX };
        // means are rounded: one beside it may cost a little less
        let best = if cost(best.wrapping_sub(1)) < cost(best) { best - 1 } else { best };
        let best = if cost(best + 1) < cost(best) { best + 1 } else { best };
        self.found[x] = Winner {
            disparity: best as u16,
            least: cost(best),
            beside: [cost(best.wrapping_sub(1)), cost(best + 1)],
            second: next,
        };
    }
}

/// The first of the disparities that cost `least`.
#[inline(always)]
fn first_of<L: Lanes>(lanes: L, totals: &[[u8; LANES]], least: u8) -> usize {
    let least = lanes.all_bytes(least);
    for lane in 0..totals.len() {
        let same = lanes.same(lanes.bytes(&totals[lane]), least);
        if same != 0 {
            return lane * LANES + same.trailing_zeros() as usize;
        }
    }
    0
}

/// The least that a disparity costs that is further than a step from the best.
#[inline(always)]
fn next_to<L: Lanes>(lanes: L, totals: &[[u8; LANES]], best: usize) -> u8 {
    const NUMBERS: [u8; LANES] = {
        let mut numbers = [0; LANES];
        let mut k = 0;
        while k < LANES {
            numbers[k] = k as u8;
            k += 1;
        }
        numbers
    };
    let (numbers, never) = (lanes.bytes(&NUMBERS), lanes.all_bytes(u8::MAX));
    let mut low = never;
    for lane in 0..totals.len() {
        let totals = lanes.bytes(&totals[lane]);
        let at = lane * LANES;
        let is_near = best + 1 >= at && best < at + LANES + 1;
        // from one below the best on, as counted from this register's first
        let from = lanes.all_bytes(best.wrapping_sub(at).wrapping_sub(1) as u8);
        let others = if is_near { lanes.where_near(numbers, from, never, totals) } else { totals };
        low = lanes.min_bytes(low, others);
    }
    lanes.lowest_byte(low)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn winner(totals: &[u8]) -> (usize, u8) {
        let least = *totals.iter().min().unwrap();
        let (lanes, totals) = (crate::lanes::Plain, totals.as_chunks().0);
        let best = first_of(lanes, totals, least);
        (best, next_to(lanes, totals, best))
    }

    #[test]
    fn the_first_of_the_best() {
        let mut sums = [90_u8; 2 * LANES];
        (sums[0], sums[40], sums[41], sums[42], sums[60]) = (31, 30, 20, 35, 25);
        assert_eq!(winner(&sums), (41, 25));
        sums[32] = 19;
        sums[31] = 18;
        assert_eq!(winner(&sums), (31, 20));
        (sums[0], sums[1]) = (17, 17);
        assert_eq!(winner(&sums), (0, 18));
        sums[63] = 10;
        assert_eq!(winner(&sums), (63, 17));
    }
}
