//! A parallel view onto points, lit by their depths.

use crate::map::canvas::{Canvas, Colour};

/// Pixels of a panel along each side of one of the picture: edges are smooth, and noise of single points is averaged.
pub(super) const FINE: usize = 2;
/// A gap is filled where so many of the eight pixels around it are not.
const FILL_FROM: usize = 5;
/// Rounds of filling, so many fine pixels from each side.
const FILL_ROUNDS: usize = 4;
/// Pixels at these distances to all eight sides throw shadows, as multiples of a point's side,
const RADII: [usize; 3] = [1, 2, 4];
/// where they stand nearer to the viewer by more than this share of it, which is noise,
const NOISE_SHARE: f32 = 0.4;
/// the full one where they stand nearer to the viewer by so many times the distance,
const FULL_SLOPE: f32 = 4.0;
/// and all of them together darken so much.
const STRENGTH: f32 = 5.0;

/// Depths away from the viewer, metres, infinite where nothing is, and colours; the top row first.
#[derive(Debug)]
pub(super) struct Panel {
    width: usize,
    height: usize,
    depths_m: Vec<f32>,
    colours: Vec<Colour>,
}

impl Panel {
    /// A panel for so many pixels of the picture.
    pub(super) fn new(width: usize, height: usize) -> Self {
        let (width, height) = (width * FINE, height * FINE);
        Self { width, height, depths_m: vec![f32::INFINITY; width * height], colours: vec![[0; 3]; width * height] }
    }

    /// Draws a square point of so many fine pixels about a place given in pixels of the picture.
    pub(super) fn point(&mut self, [x, y]: [f32; 2], side: usize, depth_m: f32, colour: Colour) {
        let corner = |v: f32| (v * FINE as f32 - 0.5 * side as f32 + 0.5).floor();
        let (left, top) = (corner(x), corner(y));
        let range = |from: f32, limit: usize| {
            // Casts saturate.
            let end = (from + side as f32).max(0.0) as usize;
            (from.max(0.0) as usize).min(limit)..end.min(limit)
        };
        let columns = range(left, self.width);
        for row in range(top, self.height) {
            for at in row * self.width + columns.start..row * self.width + columns.end {
                if depth_m < self.depths_m[at] {
                    (self.depths_m[at], self.colours[at]) = (depth_m, colour);
                }
            }
        }
    }

    /// Closes small gaps between points with what is around them.
    pub(super) fn fill_gaps(&mut self) {
        for _ in 0..FILL_ROUNDS {
            let mut filled = Vec::new();
            for y in 1..self.height.saturating_sub(1) {
                for x in 1..self.width.saturating_sub(1) {
                    let at = y * self.width + x;
                    if self.depths_m[at] == f32::INFINITY {
                        filled.extend(self.mean_around(at).map(|(depth, colour)| (at, depth, colour)));
                    }
                }
            }
            for (at, depth, colour) in filled {
                (self.depths_m[at], self.colours[at]) = (depth, colour);
            }
        }
    }

    /// The mean of the pixels around one, where they are enough.
    fn mean_around(&self, at: usize) -> Option<(f32, Colour)> {
        let w = self.width;
        let around = [at - w - 1, at - w, at - w + 1, at - 1, at + 1, at + w - 1, at + w, at + w + 1];
        let (mut count, mut depth, mut sums) = (0_usize, 0.0, [0_u32; 3]);
        for other in around {
            if self.depths_m[other] < f32::INFINITY {
                count += 1;
                depth += self.depths_m[other];
                (0..3).for_each(|k| sums[k] += u32::from(self.colours[other][k]));
            }
        }
        let colour = || sums.map(|sum| (sum / count as u32) as u8);
        (count >= FILL_FROM).then(|| (depth / count as f32, colour()))
    }

    /// Darkens what lies behind its surroundings, as seen by the viewer ("eye-dome lighting", Boucheny 2009): edges, corners and steps
    /// show without any normals.
    pub(super) fn light(&mut self, px_per_metre: f32, side: usize) {
        let per_m = px_per_metre * FINE as f32;
        let noise_m = NOISE_SHARE * side as f32 / per_m;
        let radii = RADII.map(|radius| radius * side.max(2));
        let (width, height) = (self.width as isize, self.height as isize);
        for y in 0..height {
            for x in 0..width {
                let at = (y * width + x) as usize;
                let depth = self.depths_m[at];
                if depth == f32::INFINITY {
                    continue;
                }
                let shadow = self.shadow([x, y], depth - noise_m, radii, per_m);
                let light = 1.0 / (1.0 + STRENGTH * shadow);
                self.colours[at] = self.colours[at].map(|v| (f32::from(v) * light) as u8);
            }
        }
    }

    /// How much stands before a depth on all eight sides, from 0 to 1.
    fn shadow(&self, [x, y]: [isize; 2], depth_m: f32, radii: [usize; 3], px_per_metre: f32) -> f32 {
        let (width, height) = (self.width as isize, self.height as isize);
        let mut shadow = 0.0;
        for radius in radii {
            let full = px_per_metre / (FULL_SLOPE * radius as f32);
            let r = radius as isize;
            for (dx, dy) in [(-r, -r), (0, -r), (r, -r), (-r, 0), (r, 0), (-r, r), (0, r), (r, r)] {
                let (u, v) = (x + dx, y + dy);
                if u >= 0 && v >= 0 && u < width && v < height {
                    let nearer = depth_m - self.depths_m[(v * width + u) as usize];
                    shadow += (nearer * full).clamp(0.0, 1.0);
                }
            }
        }
        shadow / (8 * RADII.len()) as f32
    }

    /// Paints it into a picture.
    pub(super) fn paint(&self, canvas: &mut Canvas, left: usize, top: usize) {
        for y in 0..self.height / FINE {
            for x in 0..self.width / FINE {
                let Some(pixel) = canvas.row(top + y).get_mut(left + x) else { continue };
                let mut sums = [0_u32; 3];
                for at in (0..FINE * FINE).map(|k| (y * FINE + k / FINE) * self.width + x * FINE + k % FINE) {
                    let is_seen = self.depths_m[at] < f32::INFINITY;
                    let colour = if is_seen { self.colours[at] } else { *pixel };
                    (0..3).for_each(|k| sums[k] += u32::from(colour[k]));
                }
                *pixel = sums.map(|sum| ((sum + 2) / (FINE * FINE) as u32) as u8);
            }
        }
    }
}
