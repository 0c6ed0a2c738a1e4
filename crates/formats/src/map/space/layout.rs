//! Where everything is in the picture: storeys seen from above beside each other, below them the view from the side, below that what colours stand for.

use super::scene::Scene;
use super::section::Section;
use super::view::View;
use super::{CLOSURE, height_colour};
use crate::map::footer::{Footer, Item};
use crate::map::options::{LEGEND_PX, pen_of};
use crate::map::palette::MARGIN_PX;

/// Between two views, pixels.
const GAP_PX: usize = 20;
/// The line of a caption, widths of a pen.
const CAPTION: f32 = 24.0;
/// So many storeys stand beside each other at most; more begin another row.
const COLUMNS_MOST: usize = 3;

pub(super) struct Layout {
    sizes: Sizes,
    /// From above, of each storey from the lowest up; and from the side.
    pub(super) views: Vec<View>,
}

impl Layout {
    /// With as many lines below the views as their width needs.
    pub(super) fn of(scene: &Scene<'_>, side_px: usize) -> Self {
        let mut sizes = Sizes::of(scene, side_px, 0);
        loop {
            // The heights follow from what is shown; their words are no wider than these.
            let needed_px = sizes.footer(scene, [-888.8, 888.8]).height_px();
            if needed_px <= sizes.strip_px || sizes.strip_px >= side_px / 2 {
                return Self::with(scene, sizes);
            }
            sizes = Sizes::of(scene, side_px, needed_px);
        }
    }

    /// Without lines below the views, but room for a scale bar that is drawn over it.
    pub(super) fn bare(scene: &Scene<'_>, side_px: usize) -> Self {
        Self::with(scene, Sizes::of(scene, side_px, caption_px(side_px)))
    }

    pub(super) fn width(&self) -> usize {
        self.sizes.width
    }

    pub(super) fn height(&self) -> usize {
        self.sizes.height
    }

    pub(super) fn px_per_metre(&self) -> f32 {
        self.sizes.px_per_metre
    }

    pub(super) fn footer(&self, scene: &Scene<'_>, heights: [f32; 2]) -> Footer {
        self.sizes.footer(scene, heights)
    }

    /// From which height to which the colours reach: of what is seen from above, without the last hundredth at each end.
    pub(super) fn heights(&self, scene: &Scene<'_>) -> [f32; 2] {
        let is_seen = |p: &&[f32; 3]| self.views.iter().any(|view| view.is_above() && view.shows(**p));
        let mut seen: Vec<f32> = scene.points.iter().filter(is_seen).map(|p| p[2]).collect();
        if seen.is_empty() {
            return [0.0, 1.0];
        }
        let cut = seen.len() / 100;
        let last = seen.len() - 1 - cut;
        let low = *seen.select_nth_unstable_by(cut, f32::total_cmp).1;
        let high = *seen.select_nth_unstable_by(last, f32::total_cmp).1;
        [low, high.max(low + 0.1)]
    }

    fn with(scene: &Scene<'_>, sizes: Sizes) -> Self {
        let Sizes { px_per_metre, across_px, above_px, beside_px, columns, caption_px, .. } = sizes;
        let (low, high, storeys) = (scene.low, scene.high, scene.storeys());
        let corner = |number: usize| {
            let (row, column) = (number / columns, number % columns);
            [MARGIN_PX + column * (across_px + GAP_PX), MARGIN_PX + caption_px + row * (above_px + GAP_PX + caption_px)]
        };
        let above = |(number, &heights): (usize, &[f32; 2])| {
            let is_within = |p: &&[f32; 3]| p[2] >= heights[0] && p[2] < heights[1];
            let points: Vec<[f32; 3]> = scene.points.iter().filter(is_within).copied().collect();
            let way: Vec<[f32; 3]> = scene.way.iter().filter(is_within).copied().collect();
            let caption = match storeys.len() {
                1 => "from above".to_owned(),
                all => format!("from above, storey {} of {all}", number + 1),
            };
            View {
                vertical: 1,
                origin: [low[0], high[1]],
                corner: corner(number),
                size: [across_px, above_px],
                px_per_metre,
                section: Section::from_above(&points, &way, low, high),
                heights,
                caption,
            }
        };
        let mut views: Vec<View> = storeys.iter().enumerate().map(above).collect();
        let rows = storeys.len().div_ceil(columns);
        views.push(View {
            vertical: 2,
            origin: [low[0], high[2]],
            corner: corner(rows * columns),
            size: [across_px, beside_px],
            px_per_metre,
            section: Section::from_side(&scene.way, low, high),
            heights: [f32::NEG_INFINITY, f32::INFINITY],
            caption: "from the side".to_owned(),
        });
        Self { sizes, views }
    }
}

/// The height of a line of words.
fn caption_px(side_px: usize) -> usize {
    (CAPTION * pen_of(side_px)) as usize
}

/// How large everything is in the picture, pixels.
#[derive(Clone, Copy)]
struct Sizes {
    px_per_metre: f32,
    width: usize,
    height: usize,
    across_px: usize,
    /// Heights of the views from above and of the one from the side.
    above_px: usize,
    beside_px: usize,
    /// Views from above beside each other.
    columns: usize,
    caption_px: usize,
    strip_px: usize,
}

impl Sizes {
    fn of(scene: &Scene<'_>, side_px: usize, strip_px: usize) -> Self {
        let storeys = scene.parted.len() + 1;
        let columns = storeys.min(COLUMNS_MOST);
        let rows = storeys.div_ceil(columns);
        let caption_px = caption_px(side_px);
        let room = |used: usize| side_px.saturating_sub(used).max(50) as f32;
        let across = 2 * MARGIN_PX + (columns - 1) * GAP_PX;
        let down = 2 * MARGIN_PX + rows * GAP_PX + (rows + 1) * caption_px + strip_px;
        let by_width = room(across) / (columns as f32 * scene.size(0));
        let by_height = room(down) / (rows as f32 * scene.size(1) + scene.size(2));
        let px_per_metre = by_width.min(by_height);
        let side = |axis: usize| ((scene.size(axis) * px_per_metre).round() as usize).max(1);
        // What the longest side leaves, lest roundings lose or win a pixel.
        let beside_px =
            if by_height <= by_width { (room(down) as usize).saturating_sub(rows * side(1)).max(1) } else { side(2) };
        let across_px = if by_height > by_width { (room(across) as usize / columns).max(1) } else { side(0) };
        // Room for what stands below, however narrow the map.
        let width = (columns * across_px + across).max(LEGEND_PX.min(side_px));
        let height = rows * side(1) + beside_px + down;
        Self { px_per_metre, width, height, across_px, above_px: side(1), beside_px, columns, caption_px, strip_px }
    }

    /// What stands below the views.
    fn footer(&self, scene: &Scene<'_>, [low_m, high_m]: [f32; 2]) -> Footer {
        let heights = Item::Heights { colour_at: |share| height_colour(share, [0.0, 1.0]), low_m, high_m };
        let outside = 100.0 * scene.outside_share();
        let items = [
            Some(Item::ScaleBar { px_per_metre: f64::from(self.px_per_metre) }),
            (!scene.way.is_empty()).then_some(Item::Way),
            (!scene.closures.is_empty()).then_some(Item::Lines(CLOSURE, "closures")),
            scene.colours.is_empty().then_some(heights),
            (outside >= 0.05).then(|| Item::Words(format!("{outside:.1} % of the points lie outside"))),
        ];
        Footer::of(items.into_iter().flatten().collect(), self.width, pen_of(self.width.max(self.height)))
    }
}
