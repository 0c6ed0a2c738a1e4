//! The census transform, and in how many bits pixels of two images differ by it.
//!
//! Zabih and Woodfill, "Non-parametric local transforms for computing visual correspondence", ECCV 1994. Only whether a neighbour is
//! darker than the centre counts, so that gain and offset between the cameras do not matter.

use crate::image::GreyImage;
use crate::lanes::{Kernel, LANES, Lanes, lanes_for};

/// Pixels that the window reaches to the left and right of its centre, and above and below it: 7 x 5, the largest whose bits leave
/// room for penalties in a byte, and wider than high, as disparities are measured across.
const REACH: [usize; 2] = [3, 2];
/// Pixels of the window.
pub(crate) const WINDOW: usize = (2 * REACH[0] + 1) * (2 * REACH[1] + 1);
/// Neighbours that are compared with the centre.
pub(crate) const BITS: usize = WINDOW - 1;
/// Bits of a byte.
const BYTE: usize = 8;
/// Bytes of a transformed pixel.
const PLANES: usize = BITS.div_ceil(BYTE);

/// Columns and rows from the centre of all neighbours, and of the centre where a byte has bits to spare.
const NEIGHBOURS: [[isize; 2]; PLANES * BYTE] = {
    let mut neighbours = [[0, 0]; PLANES * BYTE];
    let (mut at, mut k) = (0, 0);
    let [across, down] = [REACH[0] as isize, REACH[1] as isize];
    while at < WINDOW {
        let place = at as isize;
        let neighbour = [place % (2 * across + 1) - across, place / (2 * across + 1) - down];
        if neighbour[0] != 0 || neighbour[1] != 0 {
            neighbours[k] = neighbour;
            k += 1;
        }
        at += 1;
    }
    neighbours
};

/// An image whose rows have room on either side, where their last value goes on. It is smoothed along rows by (1 2 1) / 4: a texture
/// finer than two pixels looks different half a pixel further, so that it cannot be matched (Szeliski and Scharstein, "Sampling the
/// disparity space image", PAMI 26(3), 2004).
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
            let [first, last] = [from[0], from[width - 1]];
            row[..left].fill(first);
            row[left..left + width].copy_from_slice(from);
            if width > 2 {
                crate::lanes::run(Smooth { from, to: &mut row[left + 1..left + width - 1] });
                row[left] = smoothed([first, first, from[1]]);
                row[left + width - 1] = smoothed([from[width - 2], last, last]);
            }
            row[left + width..].fill(last);
        }
    }

    /// The values at some columns and rows from those of a row, from its first column on, in whole lanes.
    pub(crate) fn row(&self, y: usize, [right, down]: [isize; 2]) -> &[u16] {
        let y = y.saturating_add_signed(down).min(self.height - 1);
        let [reach, _] = REACH;
        let from = reach.saturating_add_signed(right);
        let len = self.stride - 2 * reach;
        &self.pixels[y * self.stride + from..][..len]
    }
}

/// Smooths all values of a row but the first and the last.
struct Smooth<'a> {
    from: &'a [u16],
    to: &'a mut [u16],
}

impl Kernel for Smooth<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        let (count, to) = (self.to.len(), self.to);
        let (before, at, behind) = (&self.from[..count], &self.from[1..=count], &self.from[2..count + 2]);
        for x in 0..count {
            to[x] = smoothed([before[x], at[x], behind[x]]);
        }
    }
}

#[inline(always)]
fn smoothed([before, at, behind]: [u16; 3]) -> u16 {
    ((u32::from(before) + 2 * u32::from(at) + u32::from(behind)) >> 2) as u16
}

/// A transformed row: a byte of comparisons of every pixel, several times.
#[derive(Debug, Default)]
pub(crate) struct Planes([Vec<u8>; PLANES]);

impl Planes {
    /// Transforms a row of an image.
    pub(crate) fn set(&mut self, image: &Padded, y: usize) {
        let centre = image.row(y, [0, 0]);
        for (plane, of_plane) in self.0.iter_mut().zip(NEIGHBOURS.as_chunks::<BYTE>().0) {
            let neighbours = of_plane.map(|neighbour| image.row(y, neighbour));
            plane.resize(centre.len(), 0);
            crate::lanes::run(Compare { neighbours, centre, plane });
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

/// Sets a bit where a neighbour is no darker than the centre.
struct Compare<'a> {
    neighbours: [&'a [u16]; BYTE],
    centre: &'a [u16],
    plane: &'a mut [u8],
}

impl Kernel for Compare<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { neighbours, centre, plane } = self;
        let plane = plane.as_chunks_mut::<LANES>().0;
        let centre = &centre.as_chunks::<LANES>().0[..plane.len()];
        for lane in 0..plane.len() {
            let mut bits = lanes.all_bytes(0);
            for bit in 0..BYTE {
                let Some(neighbour) = neighbours[bit][lane * LANES..].first_chunk::<LANES>() else { return };
                bits = lanes.mark(bits, 1 << bit, neighbour, &centre[lane]);
            }
            lanes.store_bytes(bits, &mut plane[lane]);
        }
    }
}

/// What is compared, and what it costs.
pub(crate) struct Costs<'a> {
    /// The row of the left image.
    pub(crate) left: &'a Planes,
    /// The same row of the right one, mirrored.
    pub(crate) right: &'a Planes,
    /// Pixels of a row.
    pub(crate) width: usize,
    /// Disparities that are asked for.
    pub(crate) asked: usize,
    /// The same in whole lanes.
    pub(crate) disparities: usize,
    /// Out come the costs, disparity by disparity of pixel by pixel.
    pub(crate) costs: &'a mut [u8],
}

impl Costs<'_> {
    /// Costs of a disparity that leads out of the right image: those of two pixels that have nothing in common.
    const OUTSIDE: u8 = (BITS / 2) as u8;
    /// Costs of one that is not asked for: more than any can have.
    const UNASKED: u8 = (2 * BITS) as u8;
}

impl Kernel for Costs<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { left, right, width, asked, disparities, costs } = self;
        let (mut of_left, mut of_right) = ([&[0_u8][..]; PLANES], [&[0_u8][..]; PLANES]);
        for plane in 0..PLANES {
            of_left[plane] = &left.0[plane][..width];
            of_right[plane] = &right.0[plane][..width + disparities];
        }
        for x in 0..width {
            let costs = &mut costs[x * disparities..][..disparities];
            let from = width - 1 - x;
            let registers = costs.as_chunks_mut::<LANES>().0;
            for lane in 0..registers.len() {
                let mut sum = lanes.all_bytes(0);
                for plane in 0..PLANES {
                    let left = lanes.all_bytes(of_left[plane][x]);
                    let Some(right) = of_right[plane][from + lane * LANES..].first_chunk::<LANES>() else { return };
                    sum = lanes.add_bytes(sum, lanes.differing_bits(left, lanes.bytes(right)));
                }
                lanes.store_bytes(sum, &mut registers[lane]);
            }
            if x + 1 < asked {
                costs[x + 1..asked].fill(Self::OUTSIDE);
            }
            costs[asked..].fill(Self::UNASKED);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn costs_are_the_bits_that_differ() {
        let (width, height) = (9, 3);
        let value = |at: u32| (at * 7919 % 251) as u16;
        let left = GreyImage::new(width, height, (0..27).map(value).collect()).unwrap();
        // the right image shows everything two pixels further left, darker
        let right = GreyImage::new(width, height, (0..27).map(|at| value(at + 2) / 2).collect()).unwrap();
        let mut images = [Padded::default(), Padded::default()];
        images[0].set(&left);
        images[1].set(&right);
        let (mut planes, mut mirrored) = ([Planes::default(), Planes::default()], Planes::default());
        planes[0].set(&images[0], 1);
        planes[1].set(&images[1], 1);
        planes[1].mirror(9, LANES, &mut mirrored);
        let mut costs = vec![0; 9 * LANES];
        let [of_left, _] = &planes;
        let (asked, disparities) = (4, LANES);
        let kernel = Costs { left: of_left, right: &mirrored, width: 9, asked, disparities, costs: &mut costs };
        crate::lanes::run(kernel);
        let bits = |image: &Padded, x: isize| {
            NEIGHBOURS.map(|[dx, dy]| {
                let at =
                    |x: isize, y: isize| image.pixels[(1 + y).clamp(0, 2) as usize * image.stride + (x + 3) as usize];
                at(x + dx, dy) < at(x, 0)
            })
        };
        for x in 0..9 {
            for d in 0..4 {
                let [a, b] = [bits(&images[0], x), bits(&images[1], (x - d).max(0))];
                let differing = a.iter().zip(&b).filter(|(a, b)| a != b).count() as u8;
                let expected = if d > x { 17 } else { differing };
                assert_eq!(costs[x as usize * LANES + d as usize], expected, "{x} {d}");
            }
            assert_eq!(costs[x as usize * LANES + 4], 68);
        }
    }
}
