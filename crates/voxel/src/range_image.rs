//! What a sensor saw, as ranges by direction: what it has seen through was not there.

use mapwright_geom::{Stored, stored};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Directions are told apart by two degrees: so many columns around, and rows from pole to pole.
const COLUMNS: usize = 180;
const ROWS: usize = 90;
/// A point is seen through where all that was seen in its direction lies beyond it by so many smallest voxels, and this share of
/// the range.
const THROUGH_VOXELS: f64 = 1.5;
const THROUGH_SHARE: f64 = 0.05;

/// The least range in each direction from where a sensor was, metres.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RangeImage {
    /// Row by row; infinite where nothing came back.
    ranges_m: Vec<f32>,
}

stored!(RangeImage { ranges_m });

impl RangeImage {
    /// Of points in a frame at the sensor, metres.
    #[must_use]
    pub fn of(points_m: impl IntoIterator<Item = [f32; 3]>) -> Self {
        let mut image = Self::default();
        image.see(points_m);
        image
    }

    /// The same in place of what it held, in the room that this has.
    pub fn see(&mut self, points_m: impl IntoIterator<Item = [f32; 3]>) {
        self.ranges_m.clear();
        self.ranges_m.resize(COLUMNS * ROWS, f32::INFINITY);
        for point in points_m {
            if let Some((pixel, range_m)) = pixel(point) {
                self.ranges_m[pixel] = self.ranges_m[pixel].min(range_m);
            }
        }
    }

    /// Goes on as it was; none where these are no such bytes.
    #[must_use]
    pub fn restore(from: &mut &[u8]) -> Option<Self> {
        Self::take(from).filter(|image| image.ranges_m.len() == COLUMNS * ROWS)
    }

    /// Whether the sensor has seen through a point of its frame, metres: all that came back from around its direction lies farther away than
    /// noise and voxels of such a side explain, metres. None where nothing came back from there.
    #[must_use]
    pub fn has_seen_through(&self, point: [f32; 3], voxel_m: f64) -> Option<bool> {
        let (pixel, range_m) = pixel(point)?;
        let margin_m = THROUGH_VOXELS * voxel_m + THROUGH_SHARE * f64::from(range_m);
        let is_seen = self.ranges_m.get(pixel)?.is_finite();
        is_seen.then(|| self.is_beyond(pixel, range_m + margin_m as f32))
    }

    fn is_beyond(&self, pixel: usize, range_m: f32) -> bool {
        let (row, column) = (pixel / COLUMNS, pixel % COLUMNS);
        let rows = row.saturating_sub(1)..=(row + 1).min(ROWS - 1);
        rows.flat_map(|row| [COLUMNS - 1, 0, 1].map(|step| row * COLUMNS + (column + step) % COLUMNS))
            .all(|pixel| self.ranges_m[pixel] > range_m)
    }
}

/// The pixel in whose direction a point lies, and its range; none at the origin.
fn pixel([x, y, z]: [f32; 3]) -> Option<(usize, f32)> {
    let range_m = x.hypot(y).hypot(z);
    if !(range_m > 1e-3 && range_m.is_finite()) {
        return None;
    }
    let (around, up) = (f64::from(y).atan2(f64::from(x)), f64::from(z / range_m).clamp(-1.0, 1.0).asin());
    let column = ((around + PI) / TAU * COLUMNS as f64) as usize % COLUMNS;
    let row = (((up + FRAC_PI_2) / PI * ROWS as f64) as usize).min(ROWS - 1);
    Some((row * COLUMNS + column, range_m))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stands_before_a_wall_was_seen_through_and_what_stands_at_its_edge_was_not() {
        let wall = (-100..=100).flat_map(|y| (-20..=20).map(move |z| [5.0, 0.05 * y as f32, 0.05 * z as f32]));
        let image = RangeImage::of(wall);
        let has_seen_through = |point| image.has_seen_through(point, 0.1);
        assert_eq!(has_seen_through([2.0, 0.0, 0.0]), Some(true));
        assert_eq!(has_seen_through([4.9, 0.0, 0.0]), Some(false), "a part of the wall");
        assert_eq!(has_seen_through([6.0, 0.0, 0.0]), Some(false), "behind it");
        assert_eq!(has_seen_through([-2.0, 0.0, 0.0]), None, "nothing came back from there");
        assert_eq!(has_seen_through([0.0; 3]), None);
        let post = RangeImage::of([[5.0, 0.0, 0.0], [1.0, 0.04, 0.0]]);
        assert_eq!(post.has_seen_through([2.0, 0.0, 0.0], 0.1), Some(false), "something nearer stands beside it");
        assert_eq!(RangeImage::default().has_seen_through([1.0, 0.0, 0.0], 0.1), None);
    }
}
