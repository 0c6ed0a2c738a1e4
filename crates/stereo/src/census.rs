//! The census transform, and how far pixels of two images differ by it.
//!
//! Zabih and Woodfill, "Non-parametric local transforms for computing visual correspondence", ECCV 1994.

use crate::image::GreyImage;
use crate::lanes::{Kernel, LANES, Lanes, lanes_for};

/// Pixels that the window reaches to the left and right of its centre, and above and below it.
pub(crate) const REACH: [usize; 2] = [4, 3];
/// Bits in a byte; each plane of a transformed row holds so many comparisons of every pixel.
const BYTE: usize = 8;

/// Two pixels that are compared, each as columns and rows from the centre.
pub(crate) type Compared = [[i8; 2]; 2];

/// An image whose rows have room on either side, where their last value goes on.
#[derive(Debug, Default)]
pub(crate) struct Padded {
    pixels: Vec<u16>,
    stride: usize,
    height: usize,
}

impl Padded {
    pub(crate) fn set(&mut self, image: &GreyImage) {
        let [width, height] = image.size().map(|side| side as usize);
        let [left, _] = REACH;
        self.stride = lanes_for(width) + 2 * left;
        self.height = height;
        self.pixels.resize(self.stride * height, 0);
        for (y, row) in self.pixels.chunks_exact_mut(self.stride).enumerate() {
            let from = image.row(y);
            row[..left].fill(from[0]);
            row[left..left + width].copy_from_slice(from);
            row[left + width..].fill(from[width - 1]);
        }
    }

    /// The values at some columns and rows from those of a row, from its first column on.
    pub(crate) fn row(&self, y: usize, [right, down]: [i8; 2]) -> &[u16] {
        let y = y.saturating_add_signed(isize::from(down)).min(self.height - 1);
        let [reach, _] = REACH;
        let from = reach.saturating_add_signed(isize::from(right));
        let len = self.stride - 2 * reach;
        &self.pixels[y * self.stride + from..][..len]
    }

    /// The values of a row, from its first column on, and whatever fills it up to whole lanes.
    pub(crate) fn values(&self, y: usize) -> &[u16] {
        self.row(y, [0, 0])
    }
}

/// A transformed row: a byte of comparisons of every pixel, `PLANES` times.
#[derive(Debug)]
pub(crate) struct Planes<const PLANES: usize>([Vec<u8>; PLANES]);

impl<const PLANES: usize> Default for Planes<PLANES> {
    fn default() -> Self {
        Self(std::array::from_fn(|_| Vec::new()))
    }
}

impl<const PLANES: usize> Planes<PLANES> {
    /// Transforms a row of an image; `compared` are at most eight comparisons for each plane.
    pub(crate) fn set(&mut self, compared: &[Compared], image: &Padded, smoothed: &Padded, y: usize, dead: u16) {
        for (plane, compared) in self.0.iter_mut().zip(compared.chunks(BYTE)) {
            let row = |which: usize| {
                std::array::from_fn(|bit| {
                    // a comparison that is missing compares a pixel with itself
                    compared.get(bit).map_or_else(|| image.values(y), |pair| if pair[which] == [0, 0] { smoothed.values(y) } else { image.row(y, pair[which]) })
                })
            };
            let (a, b): ([&[u16]; BYTE], [&[u16]; BYTE]) = (row(0), row(1));
            plane.resize(a[0].len(), 0);
            crate::lanes::run(Compare { a, b, plane, dead });
        }
    }

    /// The same row from its last pixel to its first, and behind it as much room as disparities ask for.
    pub(crate) fn mirror(&self, width: usize, room: usize, to: &mut Self) {
        for (from, to) in self.0.iter().zip(&mut to.0) {
            to.resize(width + room, 0);
            for (to, from) in to.iter_mut().zip(from[..width].iter().rev()) {
                *to = *from;
            }
        }
    }
}

struct Compare<'a> {
    a: [&'a [u16]; BYTE],
    b: [&'a [u16]; BYTE],
    plane: &'a mut [u8],
    dead: u16,
}

impl Kernel for Compare<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        let Self { a, b, plane, dead } = self;
        let plane = plane.as_chunks_mut::<LANES>().0;
        for lane in 0..plane.len() {
            let mut bits = [0_u8; LANES];
            for bit in 0..BYTE {
                let (Some(a), Some(b)) =
                    (a[bit][lane * LANES..].first_chunk::<LANES>(), b[bit][lane * LANES..].first_chunk::<LANES>())
                else {
                    return;
                };
                for k in 0..LANES {
                    bits[k] |= u8::from(a[k].saturating_add(dead) < b[k]) << bit;
                }
            }
            plane[lane] = bits;
        }
    }
}

/// What is compared, and what it costs.
pub(crate) struct Costs<'a, const PLANES: usize> {
    /// The row of the left image.
    pub(crate) left: &'a Planes<PLANES>,
    /// The same row of the right one, mirrored.
    pub(crate) right: &'a Planes<PLANES>,
    /// Pixels of a row.
    pub(crate) width: usize,
    /// Disparities that are asked for.
    pub(crate) asked: usize,
    /// The same in whole lanes.
    pub(crate) disparities: usize,
    /// Costs of a disparity outside of the image.
    pub(crate) outside: u8,
    /// Costs of one that is not asked for.
    pub(crate) unasked: u8,
    /// Out come the costs, disparity by disparity of pixel by pixel.
    pub(crate) costs: &'a mut [u8],
}

impl<const PLANES: usize> Kernel for Costs<'_, PLANES> {
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { left, right, width, asked, disparities, outside, unasked, costs } = self;
        for x in 0..width {
            let costs = &mut costs[x * disparities..][..disparities];
            let from = width - 1 - x;
            let registers = costs.as_chunks_mut::<LANES>().0;
            for lane in 0..registers.len() {
                let mut sum = lanes.all_bytes(0);
                for plane in 0..PLANES {
                    let left = lanes.all_bytes(left.0[plane][x]);
                    let Some(right) = right.0[plane][from + lane * LANES..].first_chunk::<LANES>() else { return };
                    sum = lanes.add_bytes(sum, lanes.differing_bits(left, lanes.bytes(right)));
                }
                lanes.store_bytes(sum, &mut registers[lane]);
            }
            if x + 1 < asked {
                costs[x + 1..asked].fill(outside);
            }
            costs[asked..].fill(unasked);
        }
    }
}
