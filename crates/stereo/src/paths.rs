//! Costs along paths through the image.
//!
//! Hirschmueller, "Stereo processing by semiglobal matching and mutual information", PAMI 30(2), 2008, equation 13: from
//! pixel `p - r` to pixel `p` of a path, costs `L` of a disparity `d` are
//! `L(p, d) = C(p, d) + min(L(p-r, d), L(p-r, d+-1) + P1, min L(p-r) + P2) - min L(p-r)`.
//!
//! Half of the eight paths run down the image and half run up; the half that runs up is the other one, turned by 180
//! degrees, as Spangenberg et al., "Large scale semi-global matching on the CPU", IV 2014, do. What is called left here
//! is then right.

use crate::lanes::{Kernel, LANES, Lanes};

/// Paths of one pass: from the left, from above left, from above, from above right.
pub(crate) const PATHS: usize = 4;
/// Bytes between the costs of neighbours, more than any costs are, so that no disparity below the first or behind the last is chosen.
const GAP: usize = 16;
/// What stands there.
const NEVER: u8 = u8::MAX;

/// The costs of one path along a row of pixels, with one pixel more on either side where a path has not begun.
#[derive(Debug, Default, Clone)]
struct PathRow {
    costs: Vec<u8>,
    least: Vec<u8>,
}

impl PathRow {
    fn reset(&mut self, width: usize, disparities: usize) {
        let block = disparities + GAP;
        self.least.clear();
        self.least.resize(width + 2, 0);
        self.costs.clear();
        self.costs.resize(GAP + (width + 2) * block, NEVER);
        for costs in self.costs[GAP..].chunks_exact_mut(block) {
            costs[..disparities].fill(0);
        }
    }
}

/// The costs of all paths of a pass, of the row before and of this one.
#[derive(Debug, Default)]
pub(crate) struct Front {
    before: [PathRow; PATHS - 1],
    now: [PathRow; PATHS - 1],
    level: PathRow,
}

impl Front {
    /// As before the first row: where a path begins, what was costs nothing.
    pub(crate) fn reset(&mut self, width: usize, disparities: usize) {
        for row in self.before.iter_mut().chain(&mut self.now).chain([&mut self.level]) {
            row.reset(width, disparities);
        }
    }

    /// What is now is what was before.
    pub(crate) fn next_row(&mut self) {
        std::mem::swap(&mut self.before, &mut self.now);
    }
}

/// What is done with the sums of a pixel's costs.
pub(crate) trait Sink {
    /// Half of the sum of a pixel's costs over the paths of the pass, disparity by disparity, at most 255.
    fn take<L: Lanes>(&mut self, lanes: L, x: usize, sums: &[[u8; LANES]], disparities: usize);
}

/// One row of a pass.
pub(crate) struct PassRow<'a, S> {
    /// The paths; the row is their `now`.
    pub(crate) front: &'a mut Front,
    /// Costs of the row, disparity by disparity of pixel by pixel.
    pub(crate) costs: &'a [u8],
    /// Disparities, in whole lanes.
    pub(crate) disparities: usize,
    /// What a step of one disparity costs.
    pub(crate) small: u8,
    /// What a larger one costs, by path and pixel.
    pub(crate) large: &'a [Vec<u8>; PATHS],
    /// Whether this is the pass that runs up.
    pub(crate) turned: bool,
    /// Room for the sums of a pixel.
    pub(crate) sums: &'a mut [u8],
    /// Where the sums go.
    pub(crate) sink: S,
}

impl<S: Sink> Kernel for PassRow<'_, S> {
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        // numbers that the compiler knows make loops of registers straight
        match self.disparities {
            32 => self.pass(lanes, 32),
            64 => self.pass(lanes, 64),
            128 => self.pass(lanes, 128),
            disparities => self.pass(lanes, disparities),
        }
    }
}

impl<S: Sink> PassRow<'_, S> {
    #[inline(always)]
    fn pass<L: Lanes>(self, lanes: L, disparities: usize) {
        let Self { front, costs, small, large, turned, sums, mut sink, .. } = self;
        let sums = sums[..disparities].as_chunks_mut::<LANES>().0;
        let block = disparities + GAP;
        let width = costs.len() / disparities;
        let [of_level, of_above_left, of_above, of_above_right] = large;
        let large: [&[u8]; PATHS] =
            [&of_level[..width], &of_above_left[..width], &of_above[..width], &of_above_right[..width]];
        let Front { before: [b0, b1, b2], now: [n0, n1, n2], level } = front;
        let least_before = [&b0.least[..width + 2], &b1.least[..width + 2], &b2.least[..width + 2]];
        let (least0, least1, least2) =
            (&mut n0.least[..width + 2], &mut n1.least[..width + 2], &mut n2.least[..width + 2]);
        let small = lanes.all_bytes(small);
        for i in 0..width {
            let x = if turned { width - 1 - i } else { i };
            let costs = &costs[x * disparities..][..disparities];
            // block i + 1 is this pixel's; a path's costs begin one before those of the first disparity
            let at = (i + 1) * block + GAP;
            let (level_before, level_now) = level.costs.split_at_mut(at - 1);
            let from: [&[u8]; PATHS] = [
                &level_before[at - block - 1..][..disparities + 2],
                &b0.costs[at - block - 1..][..disparities + 2],
                &b1.costs[at - 1..][..disparities + 2],
                &b2.costs[at + block - 1..][..disparities + 2],
            ];
            let least = [level.least[i], least_before[0][i], least_before[1][i + 1], least_before[2][i + 2]];
            let to: [&mut [u8]; PATHS] = [
                &mut level_now[1..][..disparities],
                &mut n0.costs[at..][..disparities],
                &mut n1.costs[at..][..disparities],
                &mut n2.costs[at..][..disparities],
            ];
            let mut lows = [lanes.all_bytes(NEVER); PATHS];
            let mut steps = [(lanes.all_bytes(0), lanes.all_bytes(0)); PATHS];
            for path in 0..PATHS {
                let jump = least[path].saturating_add(large[path][x]);
                steps[path] = (lanes.all_bytes(jump), lanes.all_bytes(least[path]));
            }
            let costs = &costs.as_chunks::<LANES>().0[..sums.len()];
            for lane in 0..sums.len() {
                let cost = lanes.bytes(&costs[lane]);
                let mut all = [cost; PATHS];
                let at = lane * LANES;
                for path in 0..PATHS {
                    let from = &from[path][at..at + LANES + 2];
                    let (Some(below), Some(same), Some(above), Some(to)) = (
                        from.first_chunk::<LANES>(),
                        from[1..].first_chunk::<LANES>(),
                        from[2..].first_chunk::<LANES>(),
                        to[path][at..].first_chunk_mut::<LANES>(),
                    ) else {
                        return;
                    };
                    let near = lanes.min_bytes(lanes.bytes(below), lanes.bytes(above));
                    let (jump, least) = steps[path];
                    let best = lanes.min_bytes(lanes.bytes(same), lanes.min_bytes(lanes.add_bytes(near, small), jump));
                    let now = lanes.add_bytes(cost, lanes.sub_bytes(best, least));
                    lanes.store_bytes(now, to);
                    lows[path] = lanes.min_bytes(lows[path], now);
                    all[path] = now;
                }
                let sum = lanes.add_bytes(lanes.mean_bytes(all[0], all[1]), lanes.mean_bytes(all[2], all[3]));
                lanes.store_bytes(sum, &mut sums[lane]);
            }
            level.least[i + 1] = lanes.lowest_byte(lows[0]);
            least0[i + 1] = lanes.lowest_byte(lows[1]);
            least1[i + 1] = lanes.lowest_byte(lows[2]);
            least2[i + 1] = lanes.lowest_byte(lows[3]);
            sink.take(lanes, x, sums, disparities);
        }
    }
}
