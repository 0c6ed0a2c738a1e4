//! Disparities once more, by brightness: what bits leave open of the part of a pixel.
//!
//! A bit says which of two pixels is brighter, not by how much. Errors of the census are therefore those of whole patches: next to nothing of
//! them is left by the mean of a patch. The right image, moved by the disparities that are known, differs from the left one by what these are
//! off, along its slope (Lucas and Kanade, "An iterative image registration technique", IJCAI 1981), besides noise, gain and offset of the
//! exposure. Least squares over the pixels around say all three. What the bits say and what brightness does is weighted by the
//! variances. Both see the same noise: what is said of how far a disparity may be off stays as it was.

use crate::clean::SMOOTH_PX;
use crate::disparity::DisparityMap;
use crate::image::GreyImage;
use crate::lanes::{Kernel, Lanes, run};
use crate::refine::LEAST_PX;

/// Pixels to each side that are compared, across and down, and those whose disparities are taken together before.
const AROUND: usize = 3;
const TOGETHER: usize = 1;
const WIDE: usize = 2 * TOGETHER + 1;
/// Rows that are compared.
const ROWS: usize = 2 * AROUND + 1;
/// Sums over the pixels around: how many there are, their brightness in both images and its slope, and the products of these.
const SUMS: usize = 10;
/// Noise of neighbours is alike where disparities are, and the right image is a mean of neighbours: variances are so many times those of
/// pixels that err by themselves (measured on simulated pairs).
const ALIKE: f32 = 3.0;
/// Bits and brightness that differ by more standard deviations are of two surfaces; bits know the edges.
const GATE: f32 = 2.0;

/// Memory that is used again.
#[derive(Debug, Default)]
pub(crate) struct Polish {
    /// Disparities, each the mean of those around it on the same surface.
    smooth: Vec<f32>,
    /// Of the rows that are compared, one after the other, over and over.
    terms: [Vec<f32>; SUMS],
    columns: Vec<f32>,
    sums: [Vec<f32>; SUMS],
}

impl Polish {
    /// Corrects disparities by less than a pixel.
    pub(crate) fn polish(&mut self, left: &GreyImage, right: &GreyImage, map: &mut DisparityMap) {
        let (width, height) = (map.width() as usize, map.height() as usize);
        if width <= 2 * TOGETHER || height <= 2 * TOGETHER {
            return;
        }
        self.smooth.clone_from(&map.disparity);
        for y in TOGETHER..height - TOGETHER {
            let rows = std::array::from_fn(|k| &map.disparity[(y + k - TOGETHER) * width..][..width]);
            run(Smooth { rows, out: &mut self.smooth[y * width + TOGETHER..(y + 1) * width - TOGETHER] });
        }
        for terms in &mut self.terms {
            terms.clear();
            terms.resize(ROWS * width, 0.0);
        }
        for sums in &mut self.sums {
            sums.resize(width, 0.0);
        }
        for y in 0..height + AROUND {
            self.compare(y, [left, right].map(|image| image.pixels().get(y * width..(y + 1) * width)), width);
            if let Some(y) = y.checked_sub(AROUND) {
                let row = y * width..(y + 1) * width;
                run(Sum { terms: &self.terms, columns: &mut self.columns, sums: &mut self.sums, width });
                run(Solve {
                    sums: &self.sums,
                    smooth: &self.smooth[row.clone()],
                    disparities: &mut map.disparity[row.clone()],
                    sigmas: &map.sigma[row],
                });
            }
        }
    }

    /// What the pixels of a row add to the sums; nothing below the image.
    fn compare(&mut self, y: usize, rows: [Option<&[u16]>; 2], width: usize) {
        let at = y % ROWS * width;
        for terms in &mut self.terms {
            terms[at..at + width].fill(0.0);
        }
        let [Some(left), Some(right)] = rows else { return };
        let smooth = &self.smooth[y * width..][..width];
        for x in 1..width - 1 {
            let place = x as f32 - smooth[x];
            if place < 1.0 || place.is_nan() {
                continue;
            }
            let first = place as usize;
            let part = place - first as f32;
            let Some(&[a, b, c, d]) = right.get(first - 1..).and_then(|values| values.first_chunk::<4>()) else {
                continue;
            };
            let [a, b, c, d] = [a, b, c, d].map(f32::from);
            // Catmull and Rom 1974; slopes are those of the middle between two pixels' neighbours
            let (square, cube) = (a - 2.5 * b + 2.0 * c - 0.5 * d, 0.5 * (d - a) + 1.5 * (b - c));
            let other = b + part * (0.5 * (c - a) + part * (square + part * cube));
            let of_right = 0.5 * ((c - a) + part * ((d - b) - (c - a)));
            let of_left = 0.5 * (f32::from(left[x + 1]) - f32::from(left[x - 1]));
            let (own, slope) = (f32::from(left[x]), 0.5 * (of_left + of_right));
            let terms = [
                1.0,
                own,
                other,
                slope,
                own * own,
                own * other,
                other * other,
                own * slope,
                other * slope,
                slope * slope,
            ];
            for (row, term) in self.terms.iter_mut().zip(terms) {
                row[at + x] = term;
            }
        }
    }
}

/// The mean of those around that lie on the same surface.
struct Smooth<'a> {
    rows: [&'a [f32]; WIDE],
    out: &'a mut [f32],
}

impl Kernel for Smooth<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        let count = self.out.len();
        let own = &self.rows[TOGETHER][TOGETHER..][..count];
        let mut around = [own; WIDE * WIDE];
        for k in 0..WIDE * WIDE {
            around[k] = &self.rows[k / WIDE][k % WIDE..][..count];
        }
        for x in 0..count {
            let (mut sum, mut known) = (0.0_f32, 0.0_f32);
            for k in 0..WIDE * WIDE {
                let value = around[k][x];
                let is_near = (value - own[x]).abs() <= SMOOTH_PX;
                sum += if is_near { value } else { 0.0 };
                known += if is_near { 1.0 } else { 0.0 };
            }
            // none around: unknown itself
            self.out[x] = sum / known;
        }
    }
}

/// Sums over rows and columns.
struct Sum<'a> {
    terms: &'a [Vec<f32>; SUMS],
    columns: &'a mut Vec<f32>,
    sums: &'a mut [Vec<f32>; SUMS],
    width: usize,
}

impl Kernel for Sum<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        let width = self.width;
        // columns beside the image are empty
        self.columns.clear();
        self.columns.resize(width + 2 * AROUND, 0.0);
        for (terms, sums) in self.terms.iter().zip(self.sums) {
            add(std::array::from_fn(|k| &terms[k * width..]), &mut self.columns[AROUND..][..width]);
            add(std::array::from_fn(|k| &self.columns[k..]), &mut sums[..width]);
        }
    }
}

/// Adds seven rows.
#[inline(always)]
fn add(rows: [&[f32]; ROWS], out: &mut [f32]) {
    let count = out.len();
    let mut cut = rows;
    for k in 0..ROWS {
        cut[k] = &rows[k][..count];
    }
    for x in 0..count {
        let mut sum = 0.0;
        for k in 0..ROWS {
            sum += cut[k][x];
        }
        out[x] = sum;
    }
}

/// The least squares of each pixel.
struct Solve<'a> {
    sums: &'a [Vec<f32>; SUMS],
    smooth: &'a [f32],
    disparities: &'a mut [f32],
    sigmas: &'a [f32],
}

impl Kernel for Solve<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        let count = self.disparities.len();
        let mut sums: [&[f32]; SUMS] = [&[]; SUMS];
        for k in 0..SUMS {
            sums[k] = &self.sums[k][..count];
        }
        let (smooth, sigmas, disparities) =
            (&self.smooth[..count], &self.sigmas[..count], &mut self.disparities[..count]);
        for x in 0..count {
            let own = disparities[x];
            let mut of_pixel = [0.0; SUMS];
            for k in 0..SUMS {
                of_pixel[k] = sums[k][x];
            }
            let (shift, variance) = shift_of(of_pixel);
            let off = smooth[x] + shift - own;
            let of_bits = sigmas[x] * sigmas[x];
            let both = of_bits + variance;
            // not `>`: NaN must fail
            let is_one = off * off <= GATE * GATE * both;
            let corrected = (own + off * of_bits / both).max(0.0);
            disparities[x] = if is_one { corrected } else { own };
        }
    }
}

/// By how much more to the left the right image has what the left one does, pixels, and the variance of that; NaN where nothing says it.
#[inline(always)]
fn shift_of([count, l, r, s, ll, lr, rr, ls, rs, ss]: [f32; SUMS]) -> (f32, f32) {
    let share = 1.0 / count;
    let (ll, lr, rr) = (ll - l * l * share, lr - l * r * share, rr - r * r * share);
    let (ls, rs, ss) = (ls - l * s * share, rs - r * s * share, ss - s * s * share);
    // left = gain * right + by_slope * slope + offset
    let determinant = rr * ss - rs * rs;
    let gain = (lr * ss - ls * rs) / determinant;
    let by_slope = (ls * rr - lr * rs) / determinant;
    // the slope is the mean of the left image's, which is `gain` times the right one's, and that
    let shift_per_slope = -0.5 * (gain + 1.0) / gain;
    let left_over = (ll - gain * lr - by_slope * ls).max(0.0) / (count - 3.0);
    let variance = ALIKE * left_over * rr / determinant * (shift_per_slope * shift_per_slope) + LEAST_PX * LEAST_PX;
    let shift = by_slope * shift_per_slope;
    let is_told = count >= (ROWS * ROWS / 2) as f32 && determinant > 0.0 && gain > 0.0 && shift.abs() <= SMOOTH_PX;
    (if is_told { shift } else { f32::NAN }, variance)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;
    use crate::lanes::Plain;

    const WIDTH: usize = 64;
    const HEIGHT: usize = 40;

    /// A pattern with nothing finer than 6 pixels.
    fn brightness(x: f64, y: f64) -> f64 {
        120.0 + 40.0 * (0.9 * x + 0.3 * y).sin() + 30.0 * (0.4 * x - 0.5 * y).cos()
    }

    fn image(value: impl Fn(f64, f64) -> f64) -> GreyImage {
        let at = |k: usize| value((k % WIDTH) as f64, (k / WIDTH) as f64).round() as u16;
        GreyImage::new(WIDTH as u32, HEIGHT as u32, (0..WIDTH * HEIGHT).map(at).collect()).unwrap()
    }

    fn polished(said_px: f32, sigma_px: f32) -> DisparityMap {
        let (left, right) = (image(brightness), image(|x, y| 0.6 * brightness(x + 7.3, y) + 20.0));
        let mut map = DisparityMap::default();
        map.reset([WIDTH as u32, HEIGHT as u32]);
        map.disparity.fill(said_px);
        map.sigma.fill(sigma_px);
        map.disparity[20 * WIDTH + 30] = f32::NAN;
        Polish::default().polish(&left, &right, &mut map);
        map
    }

    #[test]
    fn brightness_says_the_part_of_a_pixel_whatever_the_exposure() {
        for said_px in [7.0, 7.5] {
            let map = polished(said_px, 0.3);
            for (x, y) in (15..56).flat_map(|x| (5..35).map(move |y| (x, y))).filter(|place| *place != (30, 20)) {
                let (found, sigma) = map.at(x, y).unwrap();
                assert!((found - 7.3).abs() < 0.35 * (said_px - 7.3).abs() && sigma == 0.3, "{x} {y}: {found}");
            }
            assert!(map.at(30, 20).is_none());
        }
    }

    #[test]
    fn what_bits_know_better_or_brightness_does_not_know_stays() {
        // off by more than both may be
        assert_eq!(polished(6.7, 0.1).at(30, 10), Some((6.7, 0.1)));
        let flat = image(|_, _| 90.0);
        let mut map = DisparityMap::default();
        map.reset([WIDTH as u32, HEIGHT as u32]);
        map.disparity.fill(5.0);
        map.sigma.fill(0.5);
        let before = map.clone();
        Polish::default().polish(&flat, &flat, &mut map);
        assert_eq!(map, before);
    }

    #[test]
    fn all_processors_say_the_same() {
        let sums: [Vec<f32>; SUMS] =
            std::array::from_fn(|k| (0..77).map(|x| 30.0 + ((x * 37 + k * 101) % 89) as f32).collect());
        let smooth: Vec<f32> = (0..77).map(|x| if x == 9 { f32::NAN } else { 7.0 + 0.01 * x as f32 }).collect();
        let (sigmas, [mut a, mut b]) = (vec![0.4; 77], [(); 2].map(|()| vec![7.1; 77]));
        run(Solve { sums: &sums, smooth: &smooth, disparities: &mut a, sigmas: &sigmas });
        Solve { sums: &sums, smooth: &smooth, disparities: &mut b, sigmas: &sigmas }.run(Plain);
        let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&a), bits(&b));
        let (mut a, mut b) = (vec![0.0; 73], vec![0.0; 73]);
        run(Smooth { rows: [&smooth; WIDE], out: &mut a });
        Smooth { rows: [&smooth; WIDE], out: &mut b }.run(Plain);
        assert_eq!(bits(&a), bits(&b));
    }
}
