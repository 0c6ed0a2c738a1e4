//! A map as a picture, and where it has what.

use super::turning::Turning;
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
    /// From above; of maps of space of each storey, and from the side as well.
    pub(super) views: Vec<FigureView>,
    /// The direction in the frame of a map of the plane that is level in the picture, radians; none of maps of space.
    pub(super) level_rad: Option<f64>,
    /// Whether it has colours of its own; otherwise it is grey.
    pub(super) is_coloured: bool,
    /// The same to be turned, of maps of space.
    pub(super) turning: Option<Turning>,
}

impl Figure {
    /// The horizontal axes of the view from above, in the map's frame: to the right and up in the picture.
    pub(super) fn horizontals(&self) -> [[f64; 3]; 2] {
        let Some(FigureView { placement: above, .. }) = self.views.first() else {
            return [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        };
        let scale = 1.0 / self.px_per_metre.max(f64::MIN_POSITIVE);
        [above.px_from_map[0].map(|v| v * scale), above.px_from_map[1].map(|v| -v * scale)]
    }
}

/// A view of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FigureView {
    pub(super) placement: ViewPlacement,
    /// Of a storey the direction up in the map's frame, and from where to below where along it places are in the view, metres.
    pub(super) storey: Option<([f64; 3], [f64; 2])>,
}

impl FigureView {
    /// Of a map without storeys.
    pub(super) fn whole(placement: ViewPlacement) -> Self {
        Self { placement, storey: None }
    }

    /// Whether a place of the map is in it.
    pub(super) fn shows(&self, place: [f64; 3]) -> bool {
        self.storey.is_none_or(|(up, [from, to])| {
            let height = dot(up, place);
            height >= from && height < to
        })
    }

    /// Where a place of the map is in it, pixels.
    pub(super) fn pixel(&self, place: [f64; 3]) -> [f64; 2] {
        let ViewPlacement { px_from_map, offset_px } = self.placement;
        [0, 1].map(|k: usize| offset_px[k] + dot(px_from_map[k], place))
    }
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
