//! How certain the map is, as a tint of its free space, and numbered places.

use super::GridImage;
use super::canvas::{Canvas, Colour, blend};
use std::collections::BTreeMap;

/// What free space turns to where the map is most uncertain.
pub(super) const UNCERTAIN: Colour = [255, 190, 92];
pub(super) const CERTAIN: Colour = [253, 253, 250];
pub(super) const PLACE: Colour = [24, 98, 196];
/// What is no brighter in red than ground that was never seen is not tinted, and what is free is so in full.
const UNSEEN_RED: f32 = 196.0;
const FREE_RED: f32 = 253.0;
/// Side of the squares whose uncertainty is one, metres.
const SQUARE_M: f64 = 1.0;
/// Squares at most along a side.
const SQUARES: f64 = 512.0;
/// The tint's scale ends here at least, metres: a certain map stays white.
const LEAST_FULL_M: f32 = 0.5;

/// How certain the map is, and where to go to make it more so.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Confidence<'a> {
    /// Where something was seen from, metres in the world, and its standard deviation, metres. Free space has the tint
    /// of the nearest.
    pub seen_from: &'a [([f64; 2], f64)],
    /// Places that get a number, from 1 on, metres in the world.
    pub places: &'a [[f64; 2]],
}

/// Standard deviations by squares, smooth between their middles.
#[derive(Debug)]
pub(super) struct Tint {
    width: usize,
    height: usize,
    cells_per_square: f64,
    sigmas_m: Vec<f32>,
    /// Where the tint is full, metres.
    pub(super) full_m: f32,
}

impl Tint {
    /// None where nothing is known.
    pub(super) fn of(map: &GridImage, confidence: &Confidence<'_>) -> Option<Self> {
        let longest = map.width.max(map.height) as f64;
        let cells_per_square = (SQUARE_M / map.resolution_m).max(longest / SQUARES).max(1.0);
        let [width, height] = [map.width, map.height].map(|side| (side as f64 / cells_per_square).ceil() as usize);
        let mut known: BTreeMap<usize, f32> = BTreeMap::new();
        for &(place, sigma_m) in confidence.seen_from {
            let [u, v] = map.world_from_map.inverse().transform(place).map(|m| m / map.resolution_m / cells_per_square);
            if sigma_m.is_finite() && (0.0..width as f64).contains(&u) && (0.0..height as f64).contains(&v) {
                let square = known.entry(v as usize * width + u as usize).or_insert(0.0);
                *square = square.max(sigma_m as f32);
            }
        }
        let worst_m = known.values().copied().fold(0.0, f32::max);
        let mut tint = Self { width, height, cells_per_square, sigmas_m: Vec::new(), full_m: full(worst_m) };
        tint.sigmas_m = tint.spread(&known)?;
        (0..2).for_each(|_| tint.smooth());
        Some(tint)
    }

    /// Every square takes over from the nearest known one, in steps between neighbours.
    fn spread(&self, known: &BTreeMap<usize, f32>) -> Option<Vec<f32>> {
        known.first_key_value()?;
        let mut sigmas_m = vec![f32::NAN; self.width * self.height];
        known.iter().for_each(|(&square, &sigma_m)| sigmas_m[square] = sigma_m);
        let mut front: Vec<usize> = known.keys().copied().collect();
        while !front.is_empty() {
            let mut next = Vec::new();
            for square in front {
                for other in self.neighbours(square) {
                    if sigmas_m[other].is_nan() {
                        sigmas_m[other] = sigmas_m[square];
                        next.push(other);
                    }
                }
            }
            front = next;
        }
        Some(sigmas_m)
    }

    fn neighbours(&self, square: usize) -> impl Iterator<Item = usize> {
        let (u, v) = (square % self.width, square / self.width);
        let sides = [
            (u > 0).then(|| square - 1),
            (u + 1 < self.width).then_some(square + 1),
            (v > 0).then(|| square - self.width),
            (v + 1 < self.height).then_some(square + self.width),
        ];
        sides.into_iter().flatten()
    }

    fn smooth(&mut self) {
        let smoothed = |square: usize| {
            let (sum, count) =
                self.neighbours(square).fold((2.0 * self.sigmas_m[square], 2.0), |(sum, count), other| {
                    (sum + self.sigmas_m[other], count + 1.0)
                });
            sum / count
        };
        self.sigmas_m = (0..self.sigmas_m.len()).map(smoothed).collect();
    }

    /// Tints a row of pixels, the first of which is `corner` cells from the map's corner.
    pub(super) fn apply(&self, row: &mut [Colour], corner: [f64; 2], cells_per_px: f64) {
        let place =
            |cells: f64, side: usize| (cells / self.cells_per_square - 0.5).clamp(0.0, (side - 1) as f64) as f32;
        let v = place(corner[1] + 0.5 * cells_per_px, self.height);
        let below = &self.sigmas_m[v as usize * self.width..][..self.width];
        let above = &self.sigmas_m[(v as usize + 1).min(self.height - 1) * self.width..][..self.width];
        for (x, pixel) in row.iter_mut().enumerate() {
            let free = (f32::from(pixel[0]) - UNSEEN_RED) / (FREE_RED - UNSEEN_RED);
            if free <= 0.0 {
                continue;
            }
            let u = place(corner[0] + (x as f64 + 0.5) * cells_per_px, self.width);
            let (left, right) = (u as usize, (u as usize + 1).min(self.width - 1));
            let [low, high] = [below, above].map(|row| row[left] + (row[right] - row[left]) * u.fract());
            let sigma_m = low + (high - low) * v.fract();
            let share = (sigma_m / self.full_m).min(1.0) * free.min(1.0);
            *pixel = blend(*pixel, UNCERTAIN, share);
        }
    }
}

/// The end of the scale: 1, 2 or 5 times a power of ten.
fn full(worst_m: f32) -> f32 {
    let ends = (-1..7).flat_map(|power| [1.0, 2.0, 5.0].map(|lead: f32| lead * 10_f32.powi(power)));
    ends.into_iter().find(|&end| end >= worst_m.max(LEAST_FULL_M)).unwrap_or(1e7)
}

/// A numbered disc.
pub(super) fn draw_place(canvas: &mut Canvas, centre: [f32; 2], number: usize, pen: f32) {
    canvas.marker(centre, 10.0 * pen, PLACE);
    canvas.text_about(&number.to_string(), centre, 0.85 * pen, [255; 3]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Picture, write_png};
    use mapwright_geom::Pose2;

    fn hall() -> GridImage {
        let world_from_map = Pose2::new(-1.0, -2.0, 0.0);
        GridImage { width: 200, height: 100, resolution_m: 0.1, world_from_map, cells: vec![2; 20_000] }
    }

    #[test]
    fn free_space_is_warm_where_it_is_uncertain_and_walls_and_unseen_ground_stay() {
        let seen_from = [([0.0, 0.0], 0.0), ([18.0, 5.0], 0.4)];
        let tint = Tint::of(&hall(), &Confidence { seen_from: &seen_from, places: &[] }).unwrap();
        assert_eq!(tint.full_m, 0.5);
        let mut row = vec![CERTAIN; 200];
        (row[198], row[199]) = ([24, 30, 42], [196, 207, 220]);
        tint.apply(&mut row, [0.0, 70.0], 1.0);
        assert_eq!((row[0], row[198], row[199]), (CERTAIN, [24, 30, 42], [196, 207, 220]));
        assert!(row.windows(2).take(196).all(|pair| pair[1][2] <= pair[0][2]), "no steps back");
        assert!(row[197][2] < 140, "{:?}", row[197]);
    }

    #[test]
    fn anything_can_be_confident_and_gives_the_same_bytes_again() {
        let odd = [f64::NAN, f64::INFINITY, 1e300, -5.0, 0.0, 2.0];
        let seen_from: Vec<_> = odd.iter().flat_map(|&x| odd.map(|sigma| ([x, 0.5], sigma))).collect();
        let places = odd.map(|x| [x, 1.0]);
        for seen_from in [&seen_from[..], &seen_from[..1], &[]] {
            for level_rad in [0.0, 0.4] {
                let confidence = Some(Confidence { seen_from, places: &places });
                let draw = || {
                    let mut out = Vec::new();
                    write_png(&hall(), &Picture { confidence, level_rad, ..Picture::default() }, &mut out).unwrap();
                    out
                };
                assert_eq!(draw(), draw());
            }
        }
    }

    #[test]
    fn the_scale_ends_at_a_round_number() {
        assert_eq!([0.0, 0.1, 0.6, 1.3, 7.0].map(full), [0.5, 0.5, 1.0, 2.0, 10.0]);
    }
}
