//! Whether two images are a rectified pair: which is the left one, and whether rows lie beside each other.
//!
//! Corners of the left image (Shi and Tomasi, "Good features to track", CVPR 1994) are looked for in the right one, to both sides and
//! some rows up and down, by the normalised correlation of their surroundings.

use crate::error::StereoError;
use crate::image::GreyImage;

/// Images are halved until they are no wider: enough to see which way things move, and to a fraction of a pixel.
const WIDTH_MOST: usize = 400;
/// Corners that are looked for: the best of each of so many parts of the image, across and down.
const PARTS: [usize; 2] = [16, 12];
/// Pixels from the centre of what is compared to its edge.
const REACH: usize = 5;
/// Columns that a corner may have moved, and rows, as a share of the image's width and height.
const FARTHEST: [f64; 2] = [0.25, 0.1];
/// Correlation of the same corner in both images, at least.
const SAME: f32 = 0.8;
/// By so much the next best place has to be worse.
const MARGIN: f32 = 0.1;
/// So many corners tell something: a median of fewer may lie anywhere.
const MATCHES_LEAST: usize = 12;
/// Rows further apart than this, pixels, are not beside each other: a window of the census is then compared with another.
const OFFSET_MOST_PX: f32 = 1.0;

/// What was measured of two images.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pairing {
    /// Corners of the left image that were looked for.
    pub corners: usize,
    /// Those that were found in the right one, at one place only.
    pub matched: usize,
    /// Matched corners that are a pixel or more from where they would be at infinity.
    pub moved: usize,
    /// Those of them that moved to the side to which they can move only if left and right are swapped.
    pub moved_wrongly: usize,
    /// The median of the disparities of matched corners, pixels; NaN if there are none.
    pub disparity_px: f32,
    /// The median of how much lower the right image shows a corner than the left one, pixels; NaN if there are none.
    pub lower_px: f32,
    /// The median of how far single corners are from that, pixels: it is large where one camera is rolled against the other.
    pub lower_spread_px: f32,
}

impl Pairing {
    /// Compares two images; `infinity_px` is the disparity of what is infinitely far, `cx - cx_right` of a
    /// [`StereoCamera`](crate::StereoCamera).
    ///
    /// # Errors
    /// [`StereoError::Size`] where they have not the same size.
    pub fn of(left: &GreyImage, right: &GreyImage, infinity_px: f64) -> Result<Self, StereoError> {
        if left.size() != right.size() {
            return Err(StereoError::Size { what: "right image", expected: left.size(), found: right.size() });
        }
        let (mut images, mut scale) = ([Small::of(left), Small::of(right)], 1.0);
        while images[0].width > WIDTH_MOST {
            images = images.map(|image| image.halved());
            scale *= 2.0;
        }
        let [left, right] = &images;
        let corners = left.corners();
        let mut found: Vec<[f32; 2]> = corners.iter().filter_map(|corner| right.find(left, *corner)).collect();
        for shift in found.iter_mut().flatten() {
            *shift *= scale;
        }
        let moved = |by: &[f32; 2]| Some(by[0] - infinity_px as f32).filter(|by| by.abs() >= 1.0);
        let lower_px = median(found.iter().map(|shift| shift[1]));
        Ok(Self {
            corners: corners.len(),
            matched: found.len(),
            moved: found.iter().filter_map(moved).count(),
            moved_wrongly: found.iter().filter_map(moved).filter(|by| *by < 0.0).count(),
            disparity_px: median(found.iter().map(|shift| shift[0])),
            lower_px,
            lower_spread_px: median(found.iter().map(|shift| (shift[1] - lower_px).abs())),
        })
    }

    /// Whether most of what moved did so to the wrong side.
    #[must_use]
    pub fn is_swapped(&self) -> bool {
        self.moved >= MATCHES_LEAST && 4 * self.moved_wrongly > 3 * self.moved
    }

    /// Whether rows of the right image lie beside other rows of the left one.
    #[must_use]
    pub fn is_misaligned(&self) -> bool {
        self.matched >= MATCHES_LEAST && self.lower_px.abs().max(self.lower_spread_px) > OFFSET_MOST_PX
    }

    /// What speaks against the pair, in words; nothing if nothing does.
    #[must_use]
    pub fn words(&self) -> Vec<String> {
        let mut words = Vec::new();
        let Self { corners, matched, moved, moved_wrongly, lower_px, lower_spread_px, .. } = self;
        if *matched < MATCHES_LEAST {
            words.push(format!(
                "of {corners} corners of the left image {matched} were found in the right one: do both show the same, at the same time?"
            ));
        }
        if self.is_swapped() {
            words.push(format!(
                "{moved_wrongly} of {moved} corners lie further right in the right image than in the left one: left and right are swapped"
            ));
        }
        if self.is_misaligned() {
            words.push(format!(
                "the right image shows corners {lower_px:.1} pixels lower than the left one (median of {matched}; single ones differ by {lower_spread_px:.1}): rows should agree to {OFFSET_MOST_PX} pixel, so the images are not rectified, or with another calibration"
            ));
        }
        words
    }
}

/// An image as it is compared.
struct Small {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Small {
    fn of(image: &GreyImage) -> Self {
        let [width, height] = image.size().map(|side| side as usize);
        Self { width, height, values: image.pixels().iter().map(|value| f32::from(*value)).collect() }
    }

    fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, (self.height / 2).max(1));
        let at = |x: usize, y: usize| self.values[y.min(self.height - 1) * self.width + x];
        let mean = |x: usize, y: usize| 0.25 * (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1));
        let values =
            (0..height).flat_map(|y| (0..width).map(move |x| (2 * x, 2 * y))).map(|(x, y)| mean(x, y)).collect();
        Self { width, height, values }
    }

    fn row(&self, x: usize, y: usize) -> &[f32] {
        &self.values[y * self.width + x - REACH..][..=2 * REACH]
    }

    /// Whether all around a pixel lies in the image, with one pixel to spare.
    fn has_room(&self, x: usize, y: usize) -> bool {
        let room = REACH + 1..;
        room.contains(&x) && room.contains(&y) && x + REACH + 1 < self.width && y + REACH + 1 < self.height
    }

    /// The best corner of each part of the image that has one.
    fn corners(&self) -> Vec<[usize; 2]> {
        let part = [self.width.div_ceil(PARTS[0]), self.height.div_ceil(PARTS[1])];
        let mut corners = Vec::new();
        for top in (0..self.height).step_by(part[1]) {
            for left in (0..self.width).step_by(part[0]) {
                let mut best = (0.0, [0, 0]);
                for y in (top..top + part[1]).step_by(2) {
                    for x in (left..left + part[0]).step_by(2).filter(|x| self.has_room(*x, y)) {
                        let strength = self.strength(x, y);
                        if strength > best.0 {
                            best = (strength, [x, y]);
                        }
                    }
                }
                if best.0 > 0.0 {
                    corners.push(best.1);
                }
            }
        }
        corners
    }

    /// The smaller eigenvalue of the sum of gradients' squares around a pixel.
    fn strength(&self, x: usize, y: usize) -> f32 {
        let (mut xx, mut xy, mut yy) = (0.0_f32, 0.0_f32, 0.0_f32);
        for y in y - 3..=y + 3 {
            for x in x - 3..=x + 3 {
                let at = y * self.width + x;
                let across = self.values[at + 1] - self.values[at - 1];
                let down = self.values[at + self.width] - self.values[at - self.width];
                xx += across * across;
                xy += across * down;
                yy += down * down;
            }
        }
        0.5 * (xx + yy - ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt())
    }

    /// How far left and down of its place in another image a corner is found in this one.
    fn find(&self, other: &Self, [x, y]: [usize; 2]) -> Option<[f32; 2]> {
        let patch = Patch::of(other, x, y)?;
        let [across, down] = [(self.width, FARTHEST[0]), (self.height, FARTHEST[1])]
            .map(|(side, share)| ((side as f64 * share) as isize).max(2));
        let likeness = |[dx, dy]: [isize; 2]| {
            let (Some(x), Some(y)) = (x.checked_add_signed(-dx), y.checked_add_signed(dy)) else { return -1.0 };
            if self.has_room(x, y) { patch.likeness(self, x, y) } else { -1.0 }
        };
        let shifts = (-down..=down).flat_map(|dy| (-across..=across).map(move |dx| [dx, dy]));
        let all: Vec<(f32, [isize; 2])> = shifts.map(|shift| (likeness(shift), shift)).collect();
        let best = all.iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
        let [dx, dy] = best.1;
        let is_other = |shift: &[isize; 2]| (shift[0] - dx).abs().max((shift[1] - dy).abs()) > 3;
        let next = all.iter().filter(|(_, shift)| is_other(shift)).map(|(likeness, _)| *likeness).fold(-1.0, f32::max);
        if best.0 < SAME || next > best.0 - MARGIN {
            return None;
        }
        let fine = |a: f32, b: f32| if a > -1.0 && b > -1.0 { vertex(a, best.0, b) } else { 0.0 };
        let sideways = fine(likeness([dx - 1, dy]), likeness([dx + 1, dy]));
        let downwards = fine(likeness([dx, dy - 1]), likeness([dx, dy + 1]));
        Some([dx as f32 + sideways, dy as f32 + downwards])
    }
}

/// Where between two neighbours a parabola through three values has its vertex.
fn vertex(before: f32, at: f32, behind: f32) -> f32 {
    let bend = 2.0 * at - before - behind;
    if bend > 0.0 { (0.5 * (behind - before) / bend).clamp(-0.5, 0.5) } else { 0.0 }
}

/// What is around a corner, less its mean.
struct Patch {
    rows: [[f32; 2 * REACH + 1]; 2 * REACH + 1],
    norm: f32,
}

const PATCH_PIXELS: f32 = ((2 * REACH + 1) * (2 * REACH + 1)) as f32;

impl Patch {
    fn of(image: &Small, x: usize, y: usize) -> Option<Self> {
        let mut rows = [[0.0; 2 * REACH + 1]; 2 * REACH + 1];
        for (k, row) in rows.iter_mut().enumerate() {
            row.copy_from_slice(image.row(x, y + k - REACH));
        }
        let mean = rows.iter().flatten().sum::<f32>() / PATCH_PIXELS;
        for value in rows.iter_mut().flatten() {
            *value -= mean;
        }
        let norm = rows.iter().flatten().map(|value| value * value).sum::<f32>().sqrt();
        (norm > 0.0).then_some(Self { rows, norm })
    }

    /// The normalised correlation with what is around a pixel, from -1 to 1.
    fn likeness(&self, image: &Small, x: usize, y: usize) -> f32 {
        let (mut sum, mut squares, mut product) = (0.0_f32, 0.0_f32, 0.0_f32);
        for (k, row) in self.rows.iter().enumerate() {
            for (a, b) in row.iter().zip(image.row(x, y + k - REACH)) {
                sum += b;
                squares += b * b;
                product += a * b;
            }
        }
        let variance = squares - sum * sum / PATCH_PIXELS;
        if variance > 0.0 { product / (self.norm * variance.sqrt()) } else { -1.0 }
    }
}

fn median(values: impl Iterator<Item = f32>) -> f32 {
    let mut values: Vec<f32> = values.collect();
    values.sort_by(f32::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f32::NAN)
}
