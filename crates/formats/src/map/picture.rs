//! A picture of a map, with the way the robot went.

use super::GridImage;
use super::canvas::{Canvas, Colour, blend};
use super::confidence::{Confidence, Tint, draw_place};
use super::footer::{Footer, Item};
use super::palette::{END, MARGIN_PX, START, UNSEEN, way_colour};
use crate::error::FormatError;
use mapwright_geom::{Pose2, sin_cos};
use std::io::Write;

const FREE: Colour = [253, 253, 250];
const WALL: Colour = [24, 30, 42];

/// Narrower pictures get margins for what stands below the map, pixels; smaller ones have a scale bar alone.
pub(super) const LEGEND_PX: usize = 320;

/// Largest factor by which small maps are enlarged.
const MAX_ENLARGEMENT: usize = 16;

/// What is drawn besides the map, and how large.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Picture<'a> {
    /// Poses in the order of time, drawn as a line whose colour changes along it.
    pub world_from_robot: &'a [Pose2],
    /// Direction in the map's own frame that becomes horizontal, radians, such as
    /// [`dominant_wall_angle`](super::dominant_wall_angle) finds; zero leaves the map as it is.
    pub level_rad: f64,
    /// How certain the map is, as a tint of its free space, and numbered places.
    pub confidence: Option<Confidence<'a>>,
    /// Whether a scale bar stands below the map, and what the colours and marks stand for.
    pub scale_bar: bool,
    /// What part of the world is shown; otherwise all that is known of the map, and the way.
    pub frame: Option<Frame>,
    /// The longer side, margins included, has exactly so many pixels; otherwise the scale is a whole number of pixels a cell, or of cells a
    /// pixel, as the two sides below say.
    pub side_px: Option<usize>,
    /// Smaller maps are enlarged by a whole factor until their longer side has so many pixels.
    pub min_side_px: usize,
    /// Larger maps are reduced by a whole factor until their longer side, margins included, has at most so many pixels.
    pub max_side_px: usize,
}

/// A part of the world, along axes that a picture turns to be level: least and greatest place on each, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    low_m: [f64; 2],
    high_m: [f64; 2],
}

impl Frame {
    /// What a picture of a map with the way shows by itself.
    #[must_use]
    pub fn of(map: &GridImage, world_from_robot: &[Pose2], level_rad: f64) -> Self {
        let picture = Picture { level_rad, ..Picture::default() };
        let view = View::of(map, &way_in_cells(map, world_from_robot), &picture);
        let corner = view.corner_of_map(map);
        let in_world = |place: [f64; 2]| [0, 1].map(|k: usize| (place[k] + corner[k]) * map.resolution_m);
        Self { low_m: in_world(view.low), high_m: in_world(view.high) }
    }

    /// With all of another frame along the same axes.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            low_m: [0, 1].map(|k: usize| self.low_m[k].min(other.low_m[k])),
            high_m: [0, 1].map(|k: usize| self.high_m[k].max(other.high_m[k])),
        }
    }
}

impl Default for Picture<'_> {
    fn default() -> Self {
        Self {
            world_from_robot: &[],
            level_rad: 0.0,
            confidence: None,
            scale_bar: true,
            frame: None,
            side_px: None,
            min_side_px: 800,
            max_side_px: 4096,
        }
    }
}

/// Writes the known part of the map as a PNG: white free space, dark walls by probability, grey-blue where nothing has
/// been seen, the way from dark blue to orange, a green disc at its start and a red one at its end. What they mean stands below it.
///
/// The same map gives the same bytes.
///
/// # Errors
///
/// As [`GridImage::validate`]; [`FormatError::Png`].
pub fn write_png(map: &GridImage, picture: &Picture<'_>, writer: impl Write) -> Result<(), FormatError> {
    map.validate()?;
    let way = way_in_cells(map, picture.world_from_robot);
    let mut view = View::of(map, &way, picture);
    let tint = picture.confidence.as_ref().and_then(|confidence| Tint::of(map, confidence));
    let places = picture.confidence.map_or(&[][..], |confidence| confidence.places);
    let footer = view.choose_scale(picture, |view, size_px| {
        let [width_px, height_px] = size_px;
        let pen = pen_of(width_px.max(height_px)).min(2);
        let px_per_metre = view.px_per_cell / map.resolution_m;
        let legend = [
            (!way.is_empty()).then_some(Item::Way),
            (!places.is_empty()).then_some(Item::Places),
            tint.as_ref().map(|tint| Item::Uncertainty { full_m: tint.full_m }),
        ];
        let legend = legend.into_iter().flatten().filter(|_| width_px.max(height_px) >= LEGEND_PX);
        let items = std::iter::once(Item::ScaleBar { px_per_metre }).chain(legend);
        Footer::of(items.filter(|_| picture.scale_bar).collect(), width_px, pen)
    });
    let mut canvas = view.paint(map, tint.as_ref());
    draw_way(&mut canvas, &view, &way);
    draw_places(&mut canvas, &view, map, places);
    footer.draw(&mut canvas);
    encode(&canvas, writer)
}

/// Writes what was drawn as a PNG.
pub(super) fn encode(canvas: &Canvas, writer: impl Write) -> Result<(), FormatError> {
    encode_as(canvas, png::Compression::Fast, writer)
}

/// The same with more time for fewer bytes.
pub(super) fn encode_as(canvas: &Canvas, compression: png::Compression, writer: impl Write) -> Result<(), FormatError> {
    let mut encoder = png::Encoder::new(writer, canvas.width as u32, canvas.height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(compression);
    let mut image = encoder.write_header()?;
    image.write_image_data(canvas.pixels.as_flattened())?;
    Ok(image.finish()?)
}

/// The poses' places in cells from the map's corner; what is not finite or far off the map is left out.
fn way_in_cells(map: &GridImage, world_from_robot: &[Pose2]) -> Vec<[f64; 2]> {
    let map_from_world = map.world_from_map.inverse();
    let far = 4.0 * (map.width + map.height) as f64;
    let in_cells = |pose: &Pose2| map_from_world.transform([pose.x, pose.y]).map(|v| v / map.resolution_m);
    world_from_robot.iter().map(in_cells).filter(|p| p.iter().all(|v| v.abs() <= far)).collect()
}

/// Which part of the map is shown, how it is turned, and how large.
#[derive(Debug, Clone, Copy)]
struct View {
    /// Sine and cosine of the turn from cells to picture.
    sin_cos: (f64, f64),
    /// Least and greatest place shown, in cells along the turned axes.
    low: [f64; 2],
    high: [f64; 2],
    px_per_cell: f64,
    /// Cells that share a pixel of the raster.
    cells_per_px: usize,
    turned: bool,
    known: Window,
    /// Size of the picture, and where in it the map's upper left corner lies, pixels.
    size_px: [usize; 2],
    corner_px: [usize; 2],
}

/// A rectangle of cells, the upper bounds exclusive.
#[derive(Debug, Clone, Copy)]
struct Window {
    low: [usize; 2],
    high: [usize; 2],
}

impl View {
    fn of(map: &GridImage, way: &[[f64; 2]], picture: &Picture<'_>) -> Self {
        let turned = picture.level_rad.is_finite() && picture.level_rad != 0.0;
        let sin_cos = if turned { sin_cos(-picture.level_rad) } else { (0.0, 1.0) };
        let mut view = Self {
            sin_cos,
            low: [f64::INFINITY; 2],
            high: [f64::NEG_INFINITY; 2],
            px_per_cell: 1.0,
            cells_per_px: 1,
            turned,
            known: Window { low: [map.width, map.height], high: [0, 0] },
            size_px: [1, 1],
            corner_px: [MARGIN_PX; 2],
        };
        view.include_known(map);
        way.iter().for_each(|&place| view.include(place));
        if let Some(frame) = &picture.frame {
            let corner = view.corner_of_map(map);
            let in_cells = |world_m: [f64; 2]| [0, 1].map(|k: usize| world_m[k] / map.resolution_m - corner[k]);
            (view.low, view.high) = (in_cells(frame.low_m), in_cells(frame.high_m));
        }
        view
    }

    /// Where the map's own corner lies along the turned axes from the world's origin, cells.
    fn corner_of_map(&self, map: &GridImage) -> [f64; 2] {
        let Pose2 { x, y, theta } = map.world_from_map;
        let (s, c) = sin_cos(-theta);
        self.turn([c * x - s * y, s * x + c * y].map(|m| m / map.resolution_m))
    }

    /// A place in cells along the turned axes.
    fn turn(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let (s, c) = self.sin_cos;
        [c * u - s * v, s * u + c * v]
    }

    fn include(&mut self, place: [f64; 2]) {
        let turned = self.turn(place);
        for k in 0..2 {
            self.low[k] = self.low[k].min(turned[k].floor());
            self.high[k] = self.high[k].max(turned[k].ceil());
        }
    }

    /// Makes room for every known cell, or for the whole map where none is.
    fn include_known(&mut self, map: &GridImage) {
        for (v, row) in map.cells.chunks_exact(map.width).enumerate() {
            let known = |cell: &u8| *cell <= 100;
            if let (Some(first), Some(last)) = (row.iter().position(known), row.iter().rposition(known)) {
                self.include_cells(Window { low: [first, v], high: [last + 1, v + 1] });
            }
        }
        if self.known.low[0] >= self.known.high[0] {
            self.include_cells(Window { low: [0, 0], high: [map.width, map.height] });
        }
    }

    fn include_cells(&mut self, cells: Window) {
        for k in 0..2 {
            self.known.low[k] = self.known.low[k].min(cells.low[k]);
            self.known.high[k] = self.known.high[k].max(cells.high[k]);
        }
        let Window { low: [u0, v0], high: [u1, v1] } = cells;
        for [u, v] in [[u0, v0], [u1, v0], [u0, v1], [u1, v1]] {
            self.include([u as f64, v as f64]);
        }
    }

    /// Chooses the scale so that the map and what stands below it have room, and lays both out. `footer` says what stands there of this view
    /// in a picture of such a size.
    fn choose_scale(&mut self, picture: &Picture<'_>, footer: impl Fn(&Self, [usize; 2]) -> Footer) -> Footer {
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
            self.size_px = [width_px, map_px[1] + 2 * MARGIN_PX + strip_px];
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
    fn pixel(&self, place: [f64; 2]) -> [f32; 2] {
        let [a, b] = self.turn(place);
        let [left, top] = self.corner_px.map(|px| px as f64);
        let x = left + (a - self.low[0]) * self.px_per_cell;
        let y = top + (self.high[1] - b) * self.px_per_cell;
        [x as f32, y as f32]
    }

    /// The place in cells of a place along the turned axes.
    fn turn_back(&self, [a, b]: [f64; 2]) -> [f64; 2] {
        let (s, c) = self.sin_cos;
        [c * a + s * b, c * b - s * a]
    }

    /// Paints the map on a canvas with room for margins and what stands below.
    fn paint(&self, map: &GridImage, tint: Option<&Tint>) -> Canvas {
        let mut canvas = Canvas::new(self.size_px[0], self.size_px[1], UNSEEN);
        let mut raster = Raster::of(map, self.known, self.cells_per_px);
        if let Some(tint) = tint {
            raster.tint(tint);
        }
        let ([left, top], [width_px, height_px]) = (self.corner_px, self.map_px());
        for y in 0..height_px.min(canvas.height.saturating_sub(top)) {
            let row = &mut canvas.row(top + y)[left..];
            let width_px = width_px.min(row.len());
            self.paint_row(&raster, y, &mut row[..width_px]);
        }
        canvas
    }

    fn paint_row(&self, raster: &Raster, y: usize, row: &mut [Colour]) {
        let step_cells = 1.0 / self.px_per_cell;
        let b = self.high[1] - (y as f64 + 0.5) * step_cells;
        let to_raster = 1.0 / raster.cells_per_px as f64;
        let [u, v] = self.turn_back([self.low[0] + 0.5 * step_cells, b]);
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

/// A window of the map in colours, perhaps reduced; row of the smallest y first.
#[derive(Debug)]
struct Raster {
    width: usize,
    height: usize,
    cells_per_px: usize,
    /// Where in the map its lower left corner lies, cells.
    corner: [f64; 2],
    pixels: Vec<Colour>,
}

impl Raster {
    fn of(map: &GridImage, window: Window, cells_per_px: usize) -> Self {
        let shades: [Colour; 256] = std::array::from_fn(|cell| shade(cell as u8));
        let Window { low: [u0, v0], high: [u1, v1] } = window;
        let rows: Vec<&[u8]> = (v0..v1).map(|v| &map.cells[v * map.width..][u0..u1]).collect();
        let (width, height) = ((u1 - u0).div_ceil(cells_per_px), (v1 - v0).div_ceil(cells_per_px));
        let pixels = if cells_per_px == 1 {
            rows.into_iter().flatten().map(|&cell| shades[usize::from(cell)]).collect()
        } else {
            let reduce = |rows: &[&[u8]]| reduced_row(rows, cells_per_px, &shades);
            rows.chunks(cells_per_px).flat_map(reduce).collect()
        };
        Self { width, height, cells_per_px, corner: [u0 as f64, v0 as f64], pixels }
    }

    fn tint(&mut self, tint: &Tint) {
        let cells_per_px = self.cells_per_px as f64;
        for (y, row) in self.pixels.chunks_exact_mut(self.width.max(1)).enumerate() {
            tint.apply(row, [self.corner[0], self.corner[1] + y as f64 * cells_per_px], cells_per_px);
        }
    }

    /// Cells as crisp squares, along a row of the map.
    fn sample_nearest(&self, row: &mut [Colour], [u, v]: [f64; 2], du: f64) {
        if v < 0.0 || v >= self.height as f64 {
            return;
        }
        let cells = &self.pixels[v as usize * self.width..][..self.width];
        for (x, pixel) in row.iter_mut().enumerate() {
            let u = u + x as f64 * du;
            if u >= 0.0 && u < self.width as f64 {
                *pixel = cells[u as usize];
            }
        }
    }

    /// Bilinear between the centres of pixels, in fixed point with 16 binary places. Enlarged, they are mixed over a pixel of the picture at
    /// their edges alone: cells stay crisp at any angle.
    fn sample_between(&self, row: &mut [Colour], [u, v]: [f64; 2], step: [f64; 2]) {
        let fixed = |w: f64| (w * 65_536.0).round() as i64;
        let (mut u, mut v) = (fixed(u - 0.5), fixed(v - 0.5));
        let (du, dv) = (fixed(step[0]), fixed(step[1]));
        let enlarged = (1.0 / step[0].hypot(step[1])).clamp(1.0, 1e3);
        let steepness = (256.0 * enlarged).round() as i64;
        let share = |w: i64| (((((w >> 8 & 255) - 128) * steepness) >> 8) + 128).clamp(0, 256) as u32;
        for pixel in row {
            let (column, line) = (u >> 16, v >> 16);
            // One beyond each side, so that the map's edge fades into what is unseen.
            if (-1..self.width as i64).contains(&column) && (-1..self.height as i64).contains(&line) {
                *pixel = self.between(column, line, share(u), share(v));
            }
            u += du;
            v += dv;
        }
    }

    fn between(&self, column: i64, line: i64, right: u32, up: u32) -> Colour {
        let [a, b] = self.pair(column, line);
        let [c, d] = self.pair(column, line + 1);
        if a == b && a == c && a == d {
            return a;
        }
        let mix = |k: usize| {
            let low = u32::from(a[k]) * (256 - right) + u32::from(b[k]) * right;
            let high = u32::from(c[k]) * (256 - right) + u32::from(d[k]) * right;
            ((low * (256 - up) + high * up + (1 << 15)) >> 16) as u8
        };
        [mix(0), mix(1), mix(2)]
    }

    /// The pixels at a column and the one to its right; unseen beyond the map.
    fn pair(&self, column: i64, line: i64) -> [Colour; 2] {
        if line < 0 || line >= self.height as i64 {
            return [UNSEEN; 2];
        }
        let cells = &self.pixels[line as usize * self.width..][..self.width];
        let at = |column: i64| usize::try_from(column).ok().and_then(|c| cells.get(c)).copied().unwrap_or(UNSEEN);
        [at(column), at(column + 1)]
    }
}

/// Rows of cells as one row of pixels.
fn reduced_row(rows: &[&[u8]], cells_per_px: usize, shades: &[Colour; 256]) -> Vec<Colour> {
    let width = rows.first().map_or(0, |row| row.len().div_ceil(cells_per_px));
    let mut blocks = vec![Block::default(); width];
    for row in rows {
        for (block, cells) in blocks.iter_mut().zip(row.chunks(cells_per_px)) {
            cells.iter().for_each(|&cell| block.add(cell));
        }
    }
    blocks.iter().map(|block| block.colour(cells_per_px, shades)).collect()
}

/// The colour of a cell: from free to wall along a smooth step, so that doubtful cells show as such.
fn shade(cell: u8) -> Colour {
    if cell > 100 {
        return UNSEEN;
    }
    let t = ((f32::from(cell) - 15.0) / 75.0).clamp(0.0, 1.0);
    blend(FREE, WALL, t * t * (3.0 - 2.0 * t))
}

/// The cells that share a pixel.
#[derive(Debug, Clone, Copy, Default)]
struct Block {
    known: u32,
    unseen: u32,
    sum: u64,
    most: u8,
}

impl Block {
    fn add(&mut self, cell: u8) {
        if cell > 100 {
            self.unseen += 1;
        } else {
            self.known += 1;
            self.sum += u64::from(cell);
            self.most = self.most.max(cell);
        }
    }

    /// The mean of what is known, drawn to its most occupied cell so that thin walls survive, over what is unseen.
    fn colour(&self, cells_per_px: usize, shades: &[Colour; 256]) -> Colour {
        if self.known == 0 {
            return UNSEEN;
        }
        let mean = shades[(self.sum / u64::from(self.known)) as usize];
        let wall = self.most >= super::OCCUPIED_FROM;
        let known = if wall { blend(mean, shades[usize::from(self.most)], 0.7) } else { mean };
        // A row of cells across the pixel is enough to make it known.
        let share = if self.unseen == 0 { 1.0 } else { self.known as f32 / cells_per_px as f32 };
        blend(UNSEEN, known, share.min(1.0))
    }
}

fn draw_way(canvas: &mut Canvas, view: &View, way: &[[f64; 2]]) {
    let (Some(&first), Some(&last)) = (way.first(), way.last()) else { return };
    let half_width = 0.9 * pen_scale(canvas) as f32;
    let mut from = view.pixel(first);
    for (index, &place) in way.iter().enumerate() {
        let to = view.pixel(place);
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        // Shorter strokes would only cover each other.
        if dx * dx + dy * dy >= 1.0 {
            canvas.stroke(from, to, half_width, way_colour(index as f32 / way.len() as f32));
            from = to;
        }
    }
    canvas.marker(view.pixel(first), 5.0 * half_width, START);
    canvas.marker(view.pixel(last), 5.0 * half_width, END);
}

/// The last place first, so that the first one lies on top.
fn draw_places(canvas: &mut Canvas, view: &View, map: &GridImage, places: &[[f64; 2]]) {
    let pen = pen_scale(canvas);
    for (index, &[x, y]) in places.iter().enumerate().rev() {
        for &place in &way_in_cells(map, &[Pose2 { x, y, theta: 0.0 }]) {
            draw_place(canvas, view.pixel(place), index + 1, pen);
        }
    }
}

/// How much larger lines and letters are drawn in large pictures.
pub(super) fn pen_scale(canvas: &Canvas) -> usize {
    pen_of(canvas.width.max(canvas.height))
}

/// The same by the longer side, pixels.
pub(super) fn pen_of(side_px: usize) -> usize {
    (side_px / 1200).max(1)
}

#[cfg(test)]
mod tests {
    use super::super::palette::INK;
    use super::*;
    use crate::UNKNOWN;

    fn decode(bytes: &[u8]) -> (usize, usize, Vec<u8>) {
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        (info.width as usize, info.height as usize, pixels)
    }

    fn draw(map: &GridImage, picture: &Picture<'_>) -> Vec<u8> {
        let mut out = Vec::new();
        write_png(map, picture, &mut out).unwrap();
        out
    }

    fn room(width: usize, height: usize) -> GridImage {
        let wall = |at: usize, side: usize| at == 2 || at == side - 3;
        let cells = (0..width * height).map(|i| {
            let (x, y) = (i % width, i / width);
            let outside = x < 2 || y < 2 || x > width - 3 || y > height - 3;
            if outside {
                UNKNOWN
            } else if wall(x, width) || wall(y, height) {
                97
            } else {
                3
            }
        });
        GridImage {
            width,
            height,
            resolution_m: 0.05,
            world_from_map: Pose2::new(-1.0, -2.0, 0.3),
            cells: cells.collect(),
        }
    }

    #[test]
    fn small_maps_are_enlarged_and_large_ones_reduced() {
        let bare = Picture { scale_bar: false, ..Picture::default() };
        let (width, height, _) = decode(&draw(&room(104, 54), &bare));
        assert_eq!((width, height), (800 + 2 * MARGIN_PX, 400 + 2 * MARGIN_PX));
        let (width, height, pixels) = decode(&draw(&room(6_004, 3_004), &bare));
        assert!(width <= 4096 && height <= 4096 && width > 2900);
        let dark = pixels.chunks(3).filter(|p| p[0] < 120).count();
        assert!(dark > 2 * (width + height) - 400, "thin walls survive reduction: {dark}");
    }

    #[test]
    fn any_trajectory_and_any_angle_can_be_drawn_and_give_the_same_bytes_again() {
        let map = room(60, 40);
        let odd = [f64::NAN, f64::INFINITY, 1e300, -1e5, 0.0, 1.0].map(|v| Pose2 { x: v, y: 0.5, theta: v });
        for level_rad in [0.0, 0.4, -2.0, f64::NAN, f64::INFINITY] {
            let picture = Picture { world_from_robot: &odd, level_rad, ..Picture::default() };
            assert_eq!(draw(&map, &picture), draw(&map, &picture));
        }
    }

    #[test]
    fn a_map_of_nothing_and_a_map_of_one_cell_have_pictures_too() {
        for cells in [vec![UNKNOWN], vec![0], vec![100], vec![180]] {
            let map = GridImage { width: 1, height: 1, cells, ..room(6, 6) };
            decode(&draw(&map, &Picture::default()));
        }
        let sides = Picture { min_side_px: 0, max_side_px: 0, ..Picture::default() };
        decode(&draw(&room(300, 20), &sides));
    }

    #[test]
    fn a_side_that_is_asked_for_is_the_longer_one_to_the_pixel() {
        for (width, height) in [(104, 54), (54, 104), (100, 100), (7, 900), (900, 7), (2000, 1500)] {
            let map = room(width.max(7), height.max(7));
            let way = [Pose2::new(-0.5, -1.0, 0.0), Pose2::new(0.4, 0.4, 0.0)];
            let seen_from = [([0.0, 0.0], 0.1)];
            let confidence = Some(Confidence { seen_from: &seen_from, places: &[[0.2, 0.1]] });
            for side_px in [100, 333, 800, 801, 1999] {
                for level_rad in [0.0, 0.7] {
                    let picture = Picture {
                        world_from_robot: &way,
                        confidence,
                        level_rad,
                        side_px: Some(side_px),
                        ..Picture::default()
                    };
                    let (w, h, _) = decode(&draw(&map, &picture));
                    assert_eq!(w.max(h), side_px, "{width} x {height}, {level_rad}");
                }
            }
        }
    }

    #[test]
    fn cells_stay_crisp_when_they_are_turned() {
        let bare = Picture { scale_bar: false, level_rad: 0.3, ..Picture::default() };
        let (_, _, pixels) = decode(&draw(&room(54, 44), &bare));
        let shades: Vec<Colour> = [3, 97].map(shade).into_iter().chain([UNSEEN]).collect();
        let pixels = pixels.as_chunks::<3>().0;
        let mixed = pixels.iter().filter(|pixel| !shades.contains(pixel)).count();
        // A wall of a cell is 15 pixels wide here and has two edges: blurred over whole cells a third of all would be mixed.
        assert!(mixed * 14 < pixels.len(), "{mixed} of {}", pixels.len());
    }

    #[test]
    fn maps_in_one_frame_have_pictures_of_one_size_that_lie_over_each_other() {
        let (one, other) = (room(60, 40), GridImage { world_from_map: Pose2::new(2.0, -1.0, 0.3), ..room(30, 70) });
        for level_rad in [0.0, 0.4] {
            let frame = Frame::of(&one, &[], level_rad).and(Frame::of(&other, &[], level_rad));
            let at = [Pose2::new(0.5, -0.5, 0.0)];
            let [a, b] = [&one, &other].map(|map| {
                let picture = Picture { world_from_robot: &at, level_rad, frame: Some(frame), ..Picture::default() };
                decode(&draw(map, &picture))
            });
            assert_eq!((a.0, a.1), (b.0, b.1));
            let discs = [&a, &b].map(|(_, _, pixels)| {
                let end = |pixel: &[u8; 3]| (0..3).all(|k| pixel[k].abs_diff(END[k]) < 4);
                pixels.as_chunks::<3>().0.iter().position(end)
            });
            assert!(discs[0].is_some() && discs[0] == discs[1], "{discs:?}");
        }
    }

    #[test]
    fn the_legend_stands_below_the_map() {
        let way = [Pose2::new(-0.5, -1.0, 0.0), Pose2::new(0.4, 0.4, 0.0)];
        let (width, height, pixels) =
            decode(&draw(&room(104, 54), &Picture { world_from_robot: &way, ..Picture::default() }));
        let strip = &pixels.as_chunks::<3>().0[(height - 40) * width..];
        for colour in [START, END, INK, way_colour(0.5)] {
            let near = |p: &&Colour| (0..3).all(|k| p[k].abs_diff(colour[k]) < 6);
            assert!(strip.iter().filter(near).count() > 8, "{colour:?}");
        }
    }
}
