//! Which part of a map a picture shows, how it is turned, and how large.

use super::GridImage;
use super::canvas::{Canvas, Colour};
use super::confidence::Tint;
use super::footer::Footer;
use super::frame::{Bounds, Frame, Window, wall_cells};
use super::options::{LEGEND_PX, Picture, pen_of};
use super::palette::{MARGIN_PX, UNSEEN};
use super::raster::{Raster, Shades};
use mapwright_geom::{Pose2, sin_cos};

/// Largest factor by which small maps are enlarged.
const MAX_ENLARGEMENT: usize = 16;

/// A wall is at least so wide, pixels, and so many widths of a pen, for large pictures are looked at small.
const WALL_PX: f32 = 2.0;
const WALL_PEN: f32 = 1.2;
/// So much of the margins is painted as well, pixels.
const BLEED_PX: usize = 2;

/// Which part of the map is shown, how it is turned, and how large.
#[derive(Debug, Clone, Copy)]
pub(super) struct View {
    /// Sine and cosine of the turn from cells to picture.
    sin_cos: (f64, f64),
    /// Least and greatest place shown, in cells along the turned axes.
    low: [f64; 2],
    high: [f64; 2],
    pub(super) px_per_cell: f64,
    /// Cells that share a pixel of the raster.
    pub(super) cells_per_px: usize,
    turned: bool,
    /// The cells that are drawn.
    pub(super) shown: Window,
    /// Size of the picture, and where in it the map's upper left corner lies, pixels.
    size_px: [usize; 2],
    corner_px: [usize; 2],
}

impl View {
    pub(super) fn of(map: &GridImage, picture: &Picture<'_>) -> Self {
        let turned = picture.level_rad.is_finite() && picture.level_rad != 0.0;
        let sin_cos = if turned { sin_cos(-picture.level_rad) } else { (0.0, 1.0) };
        let mut view = Self {
            sin_cos,
            low: [0.0; 2],
            high: [1.0; 2],
            px_per_cell: 1.0,
            cells_per_px: 1,
            turned,
            shown: Window { low: [0, 0], high: [map.width, map.height] },
            size_px: [1, 1],
            corner_px: [MARGIN_PX; 2],
        };
        let bounds = match &picture.frame {
            Some(frame) => view.bounds_of(map, frame),
            None => view.bounds_of_walls_and_way(map, picture),
        };
        (view.low, view.high) = (bounds.low, bounds.high);
        view.shown = view.window_of(map);
        view
    }

    /// Where the map's own corner lies along the turned axes from the world's origin, cells.
    fn corner_of_map(&self, map: &GridImage) -> [f64; 2] {
        let Pose2 { x, y, theta } = map.world_from_map;
        let (s, c) = sin_cos(-theta);
        self.turn([c * x - s * y, s * x + c * y].map(|m| m / map.resolution_m))
    }

    fn bounds_of(&self, map: &GridImage, frame: &Frame) -> Bounds {
        let corner = self.corner_of_map(map);
        // A frame that was whole cells is so again.
        let whole = |cells: f64| if (cells - cells.round()).abs() < 1e-6 { cells.round() } else { cells };
        let in_cells = |world_m: [f64; 2]| [0, 1].map(|k: usize| whole(world_m[k] / map.resolution_m - corner[k]));
        Bounds { low: in_cells(frame.low_m), high: in_cells(frame.high_m) }
    }

    /// What is shown, as a part of the world.
    pub(super) fn frame(&self, map: &GridImage) -> Frame {
        let corner = self.corner_of_map(map);
        let in_world = |place: [f64; 2]| [0, 1].map(|k: usize| (place[k] + corner[k]) * map.resolution_m);
        Frame { low_m: in_world(self.low), high_m: in_world(self.high) }
    }

    fn bounds_of_walls_and_way(&self, map: &GridImage, picture: &Picture<'_>) -> Bounds {
        let known = self.bounds_of_known(map);
        let mut bounds = Bounds::NONE;
        for [u, v] in wall_cells(map, picture.seen_of(map)) {
            self.include_cells(&mut bounds, Window { low: [u, v], high: [u + 1, v + 1] });
        }
        let mut bounds = if bounds.is_none() { known } else { bounds };
        picture.ways_in_cells(map).iter().for_each(|&place| bounds.include(self.turn(place)));
        bounds.widened_within(&known).whole()
    }

    /// Of every known cell, or of the whole map where none is.
    fn bounds_of_known(&self, map: &GridImage) -> Bounds {
        let mut bounds = Bounds::NONE;
        for (v, row) in map.cells.chunks_exact(map.width).enumerate() {
            let known = |cell: &u8| *cell <= 100;
            if let (Some(first), Some(last)) = (row.iter().position(known), row.iter().rposition(known)) {
                self.include_cells(&mut bounds, Window { low: [first, v], high: [last + 1, v + 1] });
            }
        }
        if bounds.is_none() {
            self.include_cells(&mut bounds, Window { low: [0, 0], high: [map.width, map.height] });
        }
        bounds
    }

    fn include_cells(&self, bounds: &mut Bounds, cells: Window) {
        let Window { low: [u0, v0], high: [u1, v1] } = cells;
        for [u, v] in [[u0, v0], [u1, v0], [u0, v1], [u1, v1]] {
            bounds.include(self.turn([u as f64, v as f64]));
        }
    }

    /// The cells within what is shown.
    fn window_of(&self, map: &GridImage) -> Window {
        let ([a0, b0], [a1, b1]) = (self.low, self.high);
        let mut bounds = Bounds::NONE;
        [[a0, b0], [a1, b0], [a0, b1], [a1, b1]].iter().for_each(|&place| bounds.include(self.turn_back(place)));
        let sides = [map.width, map.height];
        // Casts saturate. One more on each side, for what is mixed from neighbours.
        let low = [0, 1].map(|k: usize| ((bounds.low[k] - 1.0).max(0.0) as usize).min(sides[k] - 1));
        let high = [0, 1].map(|k: usize| ((bounds.high[k] + 2.0).max(0.0) as usize).clamp(low[k] + 1, sides[k]));
        Window { low, high }
    }

    /// A place in cells along the turned axes.
    fn turn(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let (s, c) = self.sin_cos;
        [c * u - s * v, s * u + c * v]
    }

    /// Chooses the scale so that the map and what stands below it have room, and lays both out. `footer` says what stands there of this view
    /// in a picture of such a size.
    pub(super) fn choose_scale(
        &mut self,
        picture: &Picture<'_>,
        footer: impl Fn(&Self, [usize; 2]) -> Footer,
    ) -> Footer {
        let longest_px = picture.side_px.unwrap_or(picture.max_side_px).clamp(100, 16_384);
        let mut strip_px = 0;
        loop {
            match picture.side_px {
                Some(_) => self.fill(longest_px, strip_px),
                None => self.choose_whole_scale(picture.min_side_px, longest_px, strip_px),
            }
            let map_px = self.map_px();
            let width_px = (map_px[0] + 2 * MARGIN_PX).max(LEGEND_PX.min(longest_px));
            let below = footer(self, [width_px, map_px[1] + 2 * MARGIN_PX + strip_px]);
            // More lines leave less room for the map, whose width may then need more lines; never fewer.
            if below.height_px() > strip_px && strip_px < longest_px / 2 {
                strip_px = below.height_px();
                continue;
            }
            // At a smaller scale fewer lines may do in the end.
            self.size_px = [width_px, map_px[1] + 2 * MARGIN_PX + below.height_px()];
            if picture.side_px.is_some() {
                let longer = usize::from(self.size_px[1] > self.size_px[0]);
                self.size_px[longer] = longest_px;
            }
            self.corner_px = [(self.size_px[0].saturating_sub(map_px[0])) / 2, MARGIN_PX];
            return below;
        }
    }

    fn side_cells(&self) -> [f64; 2] {
        [0, 1].map(|k: usize| (self.high[k] - self.low[k]).max(1.0))
    }

    fn map_px(&self) -> [usize; 2] {
        self.side_cells().map(|cells| (cells * self.px_per_cell - 1e-6).ceil().max(1.0) as usize)
    }

    /// Room within the margins, pixels.
    fn room_px(longest_px: usize, strip_px: usize) -> [f64; 2] {
        [2 * MARGIN_PX, 2 * MARGIN_PX + strip_px].map(|taken| longest_px.saturating_sub(taken).max(1) as f64)
    }

    /// The scale at which the longer side is full.
    fn fill(&mut self, longest_px: usize, strip_px: usize) {
        let (room_px, cells) = (Self::room_px(longest_px, strip_px), self.side_cells());
        self.px_per_cell = (room_px[0] / cells[0]).min(room_px[1] / cells[1]);
        self.cells_per_px = (1.0 / self.px_per_cell).round().max(1.0) as usize;
    }

    /// A whole number of pixels a cell, or of cells a pixel.
    fn choose_whole_scale(&mut self, min_side_px: usize, longest_px: usize, strip_px: usize) {
        let [_, room_px] = Self::room_px(longest_px, strip_px).map(|px| px as usize);
        let [width, height] = self.side_cells();
        let side_cells = width.max(height) as usize;
        if side_cells > room_px {
            self.cells_per_px = side_cells.div_ceil(room_px);
            self.px_per_cell = 1.0 / self.cells_per_px as f64;
        } else {
            let wanted = min_side_px.div_ceil(side_cells).clamp(1, MAX_ENLARGEMENT);
            self.px_per_cell = wanted.min(room_px / side_cells).max(1) as f64;
            self.cells_per_px = 1;
        }
    }

    /// Whether each pixel of the picture is one of the raster, or each of the raster a square of them.
    fn is_on_raster(&self) -> bool {
        let px_per_raster = self.px_per_cell * self.cells_per_px as f64;
        !self.turned
            && px_per_raster.fract() == 0.0
            && self.low.iter().chain(&self.high).all(|cells| cells.fract() == 0.0)
    }

    /// A place given in cells, in pixels of the picture.
    pub(super) fn pixel(&self, place: [f64; 2]) -> [f32; 2] {
        self.exact_pixel(place).map(|px| px as f32)
    }

    pub(super) fn exact_pixel(&self, place: [f64; 2]) -> [f64; 2] {
        let [a, b] = self.turn(place);
        let [left, top] = self.corner_px.map(|px| px as f64);
        [left + (a - self.low[0]) * self.px_per_cell, top + (self.high[1] - b) * self.px_per_cell]
    }

    pub(super) fn turned(&self) -> bool {
        self.turned
    }

    /// The place in cells of a place along the turned axes.
    fn turn_back(&self, [a, b]: [f64; 2]) -> [f64; 2] {
        let (s, c) = self.sin_cos;
        [c * a + s * b, c * b - s * a]
    }

    /// Paints the map on a canvas with room for margins and what stands below.
    pub(super) fn paint(&self, map: &GridImage, shades: &Shades<'_>, tint: Option<&Tint>) -> Canvas {
        let mut canvas = Canvas::new(self.size_px[0], self.size_px[1], UNSEEN);
        let mut raster = Raster::of(map, self.shown, self.cells_per_px, shades);
        let wall_px = (WALL_PEN * pen_of(self.size_px[0].max(self.size_px[1]))).max(WALL_PX);
        raster.widen_walls((f64::from(wall_px) / (self.px_per_cell * self.cells_per_px as f64) - 1e-6).ceil() as usize);
        if let Some(tint) = tint {
            raster.tint(tint);
        }
        // With a little of the margins, for walls at the edge that were made wider.
        let [left, top] = self.corner_px.map(|px| px.saturating_sub(BLEED_PX));
        let [width_px, height_px] = self.map_px().map(|px| px + 2 * BLEED_PX);
        for y in 0..height_px.min(canvas.height.saturating_sub(top)) {
            let row = &mut canvas.row(top + y)[left..];
            let width_px = width_px.min(row.len());
            self.paint_row(&raster, y, &mut row[..width_px]);
        }
        canvas
    }

    fn paint_row(&self, raster: &Raster, y: usize, row: &mut [Colour]) {
        let step_cells = 1.0 / self.px_per_cell;
        let bleed_cells = BLEED_PX as f64 * step_cells;
        let b = self.high[1] + bleed_cells - (y as f64 + 0.5) * step_cells;
        let to_raster = 1.0 / raster.cells_per_px as f64;
        let [u, v] = self.turn_back([self.low[0] - bleed_cells + 0.5 * step_cells, b]);
        let [u, v] = [(u - raster.corner[0]) * to_raster, (v - raster.corner[1]) * to_raster];
        let (s, c) = self.sin_cos;
        let [du, dv] = [c * step_cells * to_raster, -s * step_cells * to_raster];
        if self.is_on_raster() {
            raster.sample_nearest(row, [u, v], du);
        } else {
            raster.sample_between(row, [u, v], [du, dv]);
        }
    }
}
