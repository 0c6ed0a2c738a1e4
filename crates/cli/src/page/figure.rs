//! A map as a picture, and where it has what.

use mapwright_formats::ViewPlacement;

/// A picture of a map that lines are drawn over.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Figure {
    /// Which of the run's maps it shows.
    pub(super) map: usize,
    /// What it shows, in words.
    pub(super) words: String,
    pub(super) png: Vec<u8>,
    pub(super) size_px: [usize; 2],
    pub(super) px_per_metre: f64,
    /// From above; of maps of space from the side as well.
    pub(super) views: Vec<ViewPlacement>,
    /// The direction in the frame of a map of the plane that is level in the picture, radians; none of maps of space.
    pub(super) level_rad: Option<f64>,
    /// Whether it has colours of its own; otherwise it is grey.
    pub(super) is_coloured: bool,
}

impl Figure {
    /// The horizontal axes of the view from above, in the map's frame: to the right and up in the picture.
    pub(super) fn horizontals(&self) -> [[f64; 3]; 2] {
        let Some(above) = self.views.first() else { return [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] };
        let scale = 1.0 / self.px_per_metre.max(f64::MIN_POSITIVE);
        [above.px_from_map[0].map(|v| v * scale), above.px_from_map[1].map(|v| -v * scale)]
    }
}

/// Where a place of the map is in a view, pixels.
pub(super) fn pixel(view: &ViewPlacement, place: [f64; 3]) -> [f64; 2] {
    [0, 1].map(|k: usize| view.offset_px[k] + dot(view.px_from_map[k], place))
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
