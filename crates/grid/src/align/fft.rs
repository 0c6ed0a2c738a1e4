//! Fourier transforms of complex images whose sides are powers of two, and the correlation of two images for all shifts at once.

use mapwright_geom::sin_cos;
use std::f64::consts::TAU;

/// A complex image, row by row; real and imaginary parts apart, so that a row is worked on as vectors.
#[derive(Debug, Clone, Default)]
pub(super) struct Image {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) re: Vec<f32>,
    pub(super) im: Vec<f32>,
}

impl Image {
    pub(super) fn new(width: usize, height: usize) -> Self {
        Self { width, height, re: vec![0.0; width * height], im: vec![0.0; width * height] }
    }

    pub(super) fn clear(&mut self) {
        self.re.fill(0.0);
        self.im.fill(0.0);
    }
}

/// Transforms of images of one size, with what they need besides.
#[derive(Debug)]
pub(super) struct Transform {
    /// For columns of the image and of the transposed one.
    columns: [Vec<(f32, f32)>; 2],
    spare: Image,
}

impl Transform {
    /// For images of so many columns and rows, both powers of two.
    pub(super) fn new(width: usize, height: usize) -> Self {
        let twiddles = |n: usize| {
            let turn = |k: usize| sin_cos(-TAU * k as f64 / n as f64);
            (0..n / 2).map(|k| (turn(k).1 as f32, turn(k).0 as f32)).collect()
        };
        Self { columns: [twiddles(height), twiddles(width)], spare: Image::new(height, width) }
    }

    /// The transform of an image, transposed.
    pub(super) fn forward(&mut self, image: &mut Image, into: &mut Image) {
        along_columns(image, &self.columns[0]);
        transpose(image, into);
        along_columns(into, &self.columns[1]);
    }

    /// `sum_x a(x + t) conj(b(x))` for all shifts `t`, cyclic, times the number of pixels, of two images' transforms. Its real
    /// part lies in `into.re`; the imaginary part is of no use to anyone.
    pub(super) fn correlation(&mut self, a: &Image, b: &Image, into: &mut Image) {
        // The inverse transform is the forward one of the conjugate, conjugated: conj(a) b goes in.
        let spare = &mut self.spare;
        for k in 0..a.re.len() {
            let (ar, ai, br, bi) = (a.re[k], a.im[k], b.re[k], b.im[k]);
            spare.re[k] = ar * br + ai * bi;
            spare.im[k] = ar * bi - ai * br;
        }
        along_columns(spare, &self.columns[1]);
        transpose(spare, into);
        along_columns(into, &self.columns[0]);
    }
}

/// Transforms every column: radix 2, decimation in time, rows as vectors.
fn along_columns(image: &mut Image, twiddles: &[(f32, f32)]) {
    let (width, height) = (image.width, image.height);
    reorder_rows(image);
    let mut half = 1;
    while half < height {
        for first in (0..height).step_by(2 * half) {
            for k in 0..half {
                let twiddle = twiddles[k * (height / 2 / half)];
                butterfly(&mut image.re, &mut image.im, width, [first + k, first + k + half], twiddle);
            }
        }
        half *= 2;
    }
}

fn butterfly(re: &mut [f32], im: &mut [f32], width: usize, [upper, lower]: [usize; 2], (wr, wi): (f32, f32)) {
    let (re_above, re_below) = re.split_at_mut(lower * width);
    let (im_above, im_below) = im.split_at_mut(lower * width);
    let (ar, br) = (&mut re_above[upper * width..][..width], &mut re_below[..width]);
    let (ai, bi) = (&mut im_above[upper * width..][..width], &mut im_below[..width]);
    for k in 0..width {
        let (tr, ti) = (wr * br[k] - wi * bi[k], wr * bi[k] + wi * br[k]);
        (br[k], bi[k]) = (ar[k] - tr, ai[k] - ti);
        (ar[k], ai[k]) = (ar[k] + tr, ai[k] + ti);
    }
}

/// Rows in the order of their numbers' reversed bits.
fn reorder_rows(image: &mut Image) {
    let (width, height) = (image.width, image.height);
    let bits = height.trailing_zeros();
    for row in 0..height {
        let other = row.reverse_bits().checked_shr(usize::BITS - bits).unwrap_or(0);
        if row < other {
            for part in [&mut image.re, &mut image.im] {
                let (above, below) = part.split_at_mut(other * width);
                above[row * width..][..width].swap_with_slice(&mut below[..width]);
            }
        }
    }
}

fn transpose(from: &Image, into: &mut Image) {
    const BLOCK: usize = 16;
    let (width, height) = (from.width, from.height);
    for (source, target) in [(&from.re, &mut into.re), (&from.im, &mut into.im)] {
        for y0 in (0..height).step_by(BLOCK) {
            for x0 in (0..width).step_by(BLOCK) {
                for x in x0..(x0 + BLOCK).min(width) {
                    for y in y0..(y0 + BLOCK).min(height) {
                        target[x * height + y] = source[y * width + x];
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_sim::Rng;

    #[test]
    fn a_correlation_is_the_sum_over_all_shifts() {
        let (width, height) = (8, 4);
        let mut rng = Rng::new(1);
        let mut random = || {
            let mut image = Image::new(width, height);
            image.re.iter_mut().chain(&mut image.im).for_each(|value| *value = rng.uniform(-1.0, 1.0) as f32);
            image
        };
        let (a, b) = (random(), random());
        let mut transform = Transform::new(width, height);
        let (mut of_a, mut of_b) = (Image::new(height, width), Image::new(height, width));
        transform.forward(&mut a.clone(), &mut of_a);
        transform.forward(&mut b.clone(), &mut of_b);
        let mut found = Image::new(width, height);
        transform.correlation(&of_a, &of_b, &mut found);
        for (dx, dy) in (0..width).flat_map(|dx| (0..height).map(move |dy| (dx, dy))) {
            let mut expected = 0.0;
            for (x, y) in (0..width).flat_map(|x| (0..height).map(move |y| (x, y))) {
                let (at, moved) = (y * width + x, (y + dy) % height * width + (x + dx) % width);
                expected += a.re[moved] * b.re[at] + a.im[moved] * b.im[at];
            }
            let got = found.re[dy * width + dx] / (width * height) as f32;
            assert!((got - expected).abs() < 1e-4, "{dx} {dy}: {got} {expected}");
        }
    }
}
