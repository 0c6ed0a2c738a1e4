//! Disparities to a part of a pixel, and how far they may be off.
//!
//! What a jump costs draws all pixels of a level surface to the same whole disparity, so that the sums along the paths say little of the
//! part. Costs around the pixel are not drawn, but noisy. The mean of both, weighted by their variances, is used. The variance that the
//! paths' minimum would have by its own noise comes on top: it is large where another whole disparity fits as well.

use crate::lanes::{Kernel, Lanes};
use crate::winners::Winner;

/// How many times each bit that is independent of the others is counted, for windows of neighbours overlap, and paths: measured on drawn
/// planes of known noise (`tests/pairs.rs`).
const COUNTED_OFTEN: f32 = 3.0;
/// The variance where costs hardly change, pixels squared: the paths hold a pixel to its neighbours.
const VARIANCE_MOST_PX2: f32 = 1.0;
/// How far sums along paths are drawn to a whole disparity on level planes, root mean square over all parts of a pixel: 0.17 pixels, squared.
const DRAWN_PX2: f32 = 0.03;
/// What remains of errors without any noise, pixels: the residual of a good calibration.
const LEAST_PX: f32 = 0.1;
/// The variance of what may lie anywhere within half a pixel, pixels squared.
const WHOLE_PX2: f32 = 1.0 / 12.0;

/// What is known of the pixels of a row: whole disparities, NaN where there is none, and what those below, at and above cost.
#[derive(Debug, Default)]
pub(crate) struct Refined {
    disparity: Vec<f32>,
    /// Half of the sums along the paths.
    paths: [Vec<f32>; 3],
    /// Sums over the pixels around.
    around: [Vec<f32>; 3],
}

impl Refined {
    /// Nothing is known of a row of so many pixels.
    pub(crate) fn reset(&mut self, width: usize) {
        self.disparity.clear();
        self.disparity.resize(width, f32::NAN);
        for costs in self.paths.iter_mut().chain(&mut self.around) {
            costs.resize(width, 0.0);
        }
    }

    /// What is known of a pixel.
    #[inline(always)]
    pub(crate) fn set(&mut self, x: usize, winner: Winner, around: [u16; 3]) {
        let Self { disparity, paths: [p0, p1, p2], around: [a0, a1, a2] } = self;
        disparity[x] = f32::from(winner.disparity);
        p0[x] = f32::from(winner.beside[0]);
        p1[x] = f32::from(winner.least);
        p2[x] = f32::from(winner.beside[1]);
        a0[x] = f32::from(around[0]);
        a1[x] = f32::from(around[1]);
        a2[x] = f32::from(around[2]);
    }

    /// Writes disparities and standard deviations.
    pub(crate) fn write(&self, disparities: &mut [f32], sigmas: &mut [f32]) {
        crate::lanes::run(Refine { of: self, disparities, sigmas });
    }
}

struct Refine<'a> {
    of: &'a Refined,
    disparities: &'a mut [f32],
    sigmas: &'a mut [f32],
}

impl Kernel for Refine<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        let (disparities, count) = (self.disparities, self.of.disparity.len());
        let (disparities, sigmas) = (&mut disparities[..count], &mut self.sigmas[..count]);
        let [p0, p1, p2] = &self.of.paths;
        let [a0, a1, a2] = &self.of.around;
        let (p0, p1, p2) = (&p0[..count], &p1[..count], &p2[..count]);
        let (a0, a1, a2) = (&a0[..count], &a1[..count], &a2[..count]);
        let whole = &self.of.disparity[..count];
        for x in 0..count {
            let (drawn, drawn_variance) = vertex(p0[x], p1[x], p2[x]);
            let (shift, variance) = vertex(a0[x], a1[x], a2[x]);
            let weight = DRAWN_PX2 / (DRAWN_PX2 + variance);
            let part = drawn + weight * (shift - drawn);
            let both = drawn_variance + LEAST_PX * LEAST_PX + weight * variance;
            // below the first disparity there is nothing, which could say where it lies
            let is_first = whole[x] == 0.0;
            disparities[x] = whole[x] + if is_first { 0.0 } else { part };
            sigmas[x] = (both + if is_first { WHOLE_PX2 } else { 0.0 }).sqrt() + 0.0 * whole[x];
        }
    }
}

/// Where between two whole disparities costs are least, from the middle one of three, pixels; and its variance by the noise of the costs.
///
/// Costs of bits rise about linearly to both sides, so that two lines of the same slope through the three meet at the minimum (Haller and
/// Nedevschi, "Design of interpolation functions for subpixel-accuracy stereo-vision systems", IEEE Trans. Image Processing 21(2), 2012).
/// What the costs are at the minimum is the number of bits that noise has turned, and has its own size for variance.
#[inline(always)]
fn vertex(below: f32, at: f32, above: f32) -> (f32, f32) {
    let slope = (below.max(above) - at).max(1.0);
    let shift = (0.5 * (below - above) / slope).clamp(-0.5, 0.5);
    let turned = (at - slope * shift.abs()).max(1.0);
    (shift, (COUNTED_OFTEN * turned / (slope * slope)).min(VARIANCE_MOST_PX2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_meet_at_the_minimum() {
        // costs of 12 beside a minimum a quarter of a pixel above, with four bits turned
        let (shift, variance) = vertex(19.0, 7.0, 13.0);
        assert!((shift - 0.25).abs() < 1e-6 && (variance - 3.0 * 4.0 / 144.0).abs() < 1e-6, "{shift} {variance}");
        assert_eq!(vertex(5.0, 5.0, 5.0), (0.0, 1.0));
    }

    #[test]
    fn what_is_unknown_stays_so() {
        let mut refined = Refined::default();
        refined.reset(3);
        let winner = Winner { disparity: 7, least: 10, beside: [70, 40], second: 90 };
        refined.set(1, winner, [900, 300, 600]);
        refined.set(2, Winner { disparity: 0, beside: [u16::MAX, 40], ..winner }, [600, 600, 900]);
        let (mut disparities, mut sigmas) = ([0.0; 3], [0.0; 3]);
        refined.write(&mut disparities, &mut sigmas);
        assert!(disparities[0].is_nan() && sigmas[0].is_nan());
        assert!((disparities[1] - 7.25).abs() < 0.01 && (0.1..0.2).contains(&sigmas[1]), "{disparities:?} {sigmas:?}");
        assert!(disparities[2] == 0.0 && sigmas[2] > 0.28, "{disparities:?} {sigmas:?}");
    }
}
