//! A picture of a map of space, from above and from the side, with the way the robot went.

mod panel;
mod section;
mod upright;
mod vectors;

pub use upright::upward;

use super::canvas::{Canvas, Colour, blend};
use super::footer::{Footer, Item};
use super::frame::ViewPlacement;
use super::options::{LEGEND_PX, pen_of, pen_scale};
use super::palette::{END, MARGIN_PX, START, way_colour};
use super::picture::{encode, encode_as};
use super::walls::dominant_wall_angle;
use crate::error::FormatError;
use mapwright_geom::sin_cos;
use panel::{FINE, Panel};
use section::Section;
use std::io::Write;
use vectors::{dot, horizontals, unit};

const GROUND: Colour = super::palette::UNSEEN;
const INK: Colour = super::palette::INK;
const CLOSURE: Colour = [224, 122, 16];
/// Between the two views, pixels.
const GAP_PX: usize = 20;
/// An arrow of the axes, and that much around its foot.
const ARROW_PX: f32 = 30.0;
/// Share of the points that may lie beyond the picture on each side: single far returns would make it small.
const CUT_SHARE: f64 = 0.004;
/// Around what is shown, as a share of its longer side.
const RIM_SHARE: f32 = 0.01;
/// Heights as colours, even steps apart: floors as light as free space in pictures of the plane, walls dark; after YlGnBu by Brewer, 2003,
/// whose lightness falls evenly, but for its darkest, on which light and shadow would not show.
const HEIGHTS: [Colour; 7] =
    [[255, 253, 232], [237, 246, 178], [190, 228, 178], [115, 200, 189], [52, 170, 195], [29, 125, 182], [36, 82, 158]];

/// A map of space and what is drawn over it. All places are in the frame of the map, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpacePicture<'a> {
    /// The map; what is not finite is left out.
    pub points_m: &'a [[f32; 3]],
    /// A colour each, as a camera saw them; where there are none, heights are shown as colours.
    pub colours: &'a [[u8; 3]],
    /// Where the robot was, in the order of time.
    pub way_m: &'a [[f64; 3]],
    /// Both ends of each closure.
    pub closures_m: &'a [[[f64; 3]; 2]],
    /// The direction that is up in the map, such as [`upward`] finds.
    pub up: [f64; 3],
    /// How far apart neighbouring points are on a surface, metres; they are drawn so large.
    pub point_m: f64,
    /// The picture's longer side, pixels.
    pub side_px: usize,
}

impl Default for SpacePicture<'_> {
    fn default() -> Self {
        Self {
            points_m: &[],
            colours: &[],
            way_m: &[],
            closures_m: &[],
            up: [0.0, 0.0, 1.0],
            point_m: 0.05,
            side_px: 1600,
        }
    }
}

/// Writes a map of space as a PNG: from above, and below that from the side, at the same scale, turned so that walls are
/// parallel to the picture's sides. Ceilings and the walls nearest to the viewer are cut away (see the module `section`), depth is shown by
/// light. Over it the way from dark blue to red, a green triangle at its start and a red square at its end, closures, the directions of the
/// map's axes, a scale bar and what the colours stand for, heights above the map's origin among them.
///
/// The same map gives the same bytes.
///
/// # Errors
///
/// [`FormatError::Png`].
pub fn write_space_png(picture: &SpacePicture<'_>, writer: impl Write) -> Result<(), FormatError> {
    let scene = Scene::of(picture);
    let layout = Layout::of(&scene, picture.side_px.clamp(200, 16_384));
    let mut canvas = Canvas::new(layout.width, layout.height, GROUND);
    let heights = scene.heights(&layout);
    for view in &layout.views {
        view.draw_points(&mut canvas, &scene, heights, &layout);
        view.draw_lines(&mut canvas, &scene);
        view.draw_axes(&mut canvas, &scene);
    }
    layout.sizes.footer(&scene, heights).draw(&mut canvas);
    encode(&canvas, writer)
}

/// Writes the same picture with nothing drawn over the points, for who draws over it, and says where it has what.
///
/// # Errors
///
/// [`FormatError::Png`].
pub fn write_bare_space_png(picture: &SpacePicture<'_>, writer: impl Write) -> Result<SpacePlacement, FormatError> {
    let scene = Scene::of(picture);
    let layout = Layout::of(&scene, picture.side_px.clamp(200, 16_384));
    let mut canvas = Canvas::new(layout.width, layout.height, GROUND);
    let heights = scene.heights(&layout);
    layout.views.iter().for_each(|view| view.draw_points(&mut canvas, &scene, heights, &layout));
    encode_as(&canvas, png::Compression::Balanced, writer)?;
    Ok(SpacePlacement::of(&scene, &layout))
}

/// Where a picture of a map of space has what.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpacePlacement {
    /// Width and height, pixels.
    pub size_px: [usize; 2],
    /// The scale of both views.
    pub px_per_metre: f64,
    /// The view from above and the one from the side.
    pub views: [ViewPlacement; 2],
}

impl SpacePlacement {
    fn of(scene: &Scene<'_>, layout: &Layout) -> Self {
        let px_per_metre = f64::from(layout.px_per_metre);
        let placed = |view: &View| {
            let along = |axis: usize, sign: f64| scene.axes[axis].map(|v| sign * px_per_metre * v);
            let origin = view.pixel([0.0; 3]);
            ViewPlacement { px_from_map: [along(0, 1.0), along(view.vertical, -1.0)], offset_px: origin.map(f64::from) }
        };
        let [above, beside] = &layout.views;
        Self { size_px: [layout.width, layout.height], px_per_metre, views: [placed(above), placed(beside)] }
    }
}

/// Points and lines along the picture's axes: to the right, away from who looks from the side, and up; metres.
struct Scene<'a> {
    points: Vec<[f32; 3]>,
    colours: Vec<&'a Colour>,
    way: Vec<[f32; 3]>,
    closures: Vec<[[f32; 3]; 2]>,
    /// The picture's axes in the map's frame.
    axes: [[f64; 3]; 3],
    low: [f32; 3],
    high: [f32; 3],
    point_m: f32,
}

impl<'a> Scene<'a> {
    fn of(picture: &SpacePicture<'a>) -> Self {
        let axes = axes_of(picture);
        let turned = |p: [f64; 3]| axes.map(|axis| dot(axis, p) as f32);
        let is_far = |p: &[f64; 3]| !p.iter().all(|v| v.abs() < 1e6);
        let finite = || picture.points_m.iter().enumerate().filter(|(_, p)| !is_far(&p.map(f64::from)));
        let is_coloured = picture.colours.len() == picture.points_m.len();
        let mut scene = Self {
            points: finite().map(|(_, p)| turned(p.map(f64::from))).collect(),
            colours: if is_coloured { finite().map(|(at, _)| &picture.colours[at]).collect() } else { Vec::new() },
            way: picture.way_m.iter().filter(|p| !is_far(p)).map(|&p| turned(p)).collect(),
            closures: picture
                .closures_m
                .iter()
                .filter(|ends| !ends.iter().any(is_far))
                .map(|ends| ends.map(turned))
                .collect(),
            axes,
            low: [0.0; 3],
            high: [1.0; 3],
            point_m: picture.point_m as f32,
        };
        scene.frame();
        scene
    }

    /// What is shown: nearly all points, and the whole way.
    fn frame(&mut self) {
        for k in 0..3 {
            let mut along: Vec<f32> = self.points.iter().map(|p| p[k]).collect();
            let way = self.way.iter().map(|p| p[k]);
            let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
            if !along.is_empty() {
                let cut = (CUT_SHARE * along.len() as f64) as usize;
                let last = along.len() - 1 - cut;
                low = *along.select_nth_unstable_by(cut, f32::total_cmp).1;
                high = *along.select_nth_unstable_by(last, f32::total_cmp).1;
            }
            (low, high) = way.fold((low, high), |(low, high), v| (low.min(v), high.max(v)));
            if low <= high {
                (self.low[k], self.high[k]) = (low, high);
            }
        }
        let rim = RIM_SHARE * (0..3).map(|k| self.high[k] - self.low[k]).fold(1.0, f32::max);
        for k in 0..3 {
            self.low[k] -= rim;
            self.high[k] += rim;
        }
    }

    fn extent(&self, axis: usize) -> f32 {
        self.high[axis] - self.low[axis]
    }

    /// From which height to which the colours reach: of what is seen from above, without the last hundredth at each end.
    fn heights(&self, layout: &Layout) -> [f32; 2] {
        let above = &layout.views[0];
        let mut seen: Vec<f32> = self.points.iter().filter(|p| above.shows(**p)).map(|p| p[2]).collect();
        if seen.is_empty() {
            return [0.0, 1.0];
        }
        let cut = seen.len() / 100;
        let last = seen.len() - 1 - cut;
        let low = *seen.select_nth_unstable_by(cut, f32::total_cmp).1;
        let high = *seen.select_nth_unstable_by(last, f32::total_cmp).1;
        [low, high.max(low + 0.1)]
    }
}

/// The picture's axes: up as said, the others along the walls, the longer side to the right, and so that more lies behind the
/// way than before it.
fn axes_of(picture: &SpacePicture<'_>) -> [[f64; 3]; 3] {
    let up = unit(picture.up).unwrap_or([0.0, 0.0, 1.0]);
    let [first, second] = horizontals(up);
    let step = picture.points_m.len().div_ceil(20_000).max(1);
    let finite = |p: &&[f32; 3]| p.iter().all(|v| v.abs() < 1e6);
    let sample = || picture.points_m.iter().step_by(step).filter(finite).map(|p| p.map(f64::from));
    let ground: Vec<[f64; 2]> = sample().map(|p| [dot(p, first), dot(p, second)]).collect();
    let (s, c) = sin_cos(dominant_wall_angle(&ground, picture.point_m.max(0.02)));
    let right: [f64; 3] = std::array::from_fn(|k| c * first[k] + s * second[k]);
    let away: [f64; 3] = std::array::from_fn(|k| c * second[k] - s * first[k]);
    let spread = |axis: [f64; 3]| {
        let mut along: Vec<f64> = sample().map(|p| dot(p, axis)).collect();
        along.sort_unstable_by(f64::total_cmp);
        let cut = along.len() / 100;
        if along.is_empty() { 0.0 } else { along[along.len() - 1 - cut] - along[cut] }
    };
    let (right, away) = if spread(away) > spread(right) { (away, right.map(|v| -v)) } else { (right, away) };
    let middle = |mut along: Vec<f64>| {
        along.sort_unstable_by(f64::total_cmp);
        along.get(along.len() / 2).copied().unwrap_or(0.0)
    };
    let way = picture.way_m.iter().filter(|p| p.iter().all(|v| v.is_finite()));
    let is_before = middle(sample().map(|p| dot(p, away)).collect()) < middle(way.map(|&p| dot(p, away)).collect());
    let turn = if is_before { -1.0 } else { 1.0 };
    [right.map(|v| turn * v), away.map(|v| turn * v), up]
}

/// Where everything is in the picture.
struct Layout {
    width: usize,
    height: usize,
    px_per_metre: f32,
    sizes: Sizes,
    views: [View; 2],
}

impl Layout {
    /// With as many lines below the views as their width needs.
    fn of(scene: &Scene<'_>, side_px: usize) -> Self {
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

    fn with(scene: &Scene<'_>, sizes: Sizes) -> Self {
        let Sizes { px_per_metre, across_px, heights_px: [above_px, beside_px], .. } = sizes;
        let (low, high) = (scene.low, scene.high);
        let above = View {
            vertical: 1,
            origin: [low[0], high[1]],
            corner: [MARGIN_PX, MARGIN_PX],
            size: [across_px, above_px],
            px_per_metre,
            section: Section::from_above(&scene.points, &scene.way, low, high),
        };
        let beside = View {
            vertical: 2,
            origin: [low[0], high[2]],
            corner: [MARGIN_PX, MARGIN_PX + above_px + GAP_PX],
            size: [across_px, beside_px],
            px_per_metre,
            section: Section::from_side(&scene.way, low, high),
        };
        Self { width: sizes.width, height: sizes.height, px_per_metre, sizes, views: [above, beside] }
    }
}

/// How large everything is in the picture, pixels.
#[derive(Clone, Copy)]
struct Sizes {
    px_per_metre: f32,
    width: usize,
    height: usize,
    across_px: usize,
    /// Of the two views.
    heights_px: [usize; 2],
    strip_px: usize,
}

impl Sizes {
    fn of(scene: &Scene<'_>, side_px: usize, strip_px: usize) -> Self {
        let room = |used: usize| side_px.saturating_sub(used).max(50) as f32;
        let (across, down) = (2 * MARGIN_PX, 2 * MARGIN_PX + GAP_PX + strip_px);
        let by_width = room(across) / scene.extent(0);
        let by_height = room(down) / (scene.extent(1) + scene.extent(2));
        let px_per_metre = by_width.min(by_height);
        let side = |axis: usize| ((scene.extent(axis) * px_per_metre).round() as usize).max(1);
        // What the longest side leaves, lest two roundings lose or win a pixel.
        let beside_px =
            if by_height <= by_width { (room(down) as usize).saturating_sub(side(1)).max(1) } else { side(2) };
        // Room for what stands below, however narrow the map.
        let width = (side(0) + across).max(LEGEND_PX.min(side_px));
        let height = side(1) + beside_px + down;
        Self { px_per_metre, width, height, across_px: side(0), heights_px: [side(1), beside_px], strip_px }
    }

    /// What stands below the views.
    fn footer(&self, scene: &Scene<'_>, [low_m, high_m]: [f32; 2]) -> Footer {
        let heights = Item::Heights { colour_at: |share| height_colour(share, [0.0, 1.0]), low_m, high_m };
        let items = [
            Some(Item::ScaleBar { px_per_metre: f64::from(self.px_per_metre) }),
            (!scene.way.is_empty()).then_some(Item::Way),
            (!scene.closures.is_empty()).then_some(Item::Lines(CLOSURE, "closures")),
            scene.colours.is_empty().then_some(heights),
        ];
        Footer::of(items.into_iter().flatten().collect(), self.width, pen_of(self.width.max(self.height)))
    }
}

/// One of the two views.
struct View {
    /// The axis that points upwards in the picture: 1 from above, 2 from the side.
    vertical: usize,
    /// What lies in the upper left corner, metres along the picture's axes,
    origin: [f32; 2],
    /// where that is, pixels,
    corner: [usize; 2],
    size: [usize; 2],
    px_per_metre: f32,
    section: Section,
}

impl View {
    fn is_above(&self) -> bool {
        self.vertical == 1
    }

    /// Whether a point is not cut away.
    fn shows(&self, p: [f32; 3]) -> bool {
        if self.is_above() { p[2] <= self.section.limit([p[0], p[1]]) } else { p[1] >= self.section.limit([p[0], 0.0]) }
    }

    /// A place in pixels of the view.
    fn place(&self, p: [f32; 3]) -> [f32; 2] {
        [(p[0] - self.origin[0]) * self.px_per_metre, (self.origin[1] - p[self.vertical]) * self.px_per_metre]
    }

    fn pixel(&self, p: [f32; 3]) -> [f32; 2] {
        let [x, y] = self.place(p);
        [x + self.corner[0] as f32, y + self.corner[1] as f32]
    }

    fn draw_points(&self, canvas: &mut Canvas, scene: &Scene<'_>, heights: [f32; 2], layout: &Layout) {
        let mut panel = Panel::new(self.size[0], self.size[1]);
        let side = point_side(scene.point_m * layout.px_per_metre);
        for (at, &point) in scene.points.iter().enumerate().filter(|(_, p)| self.shows(**p)) {
            let depth = if self.is_above() { -point[2] } else { point[1] };
            let colour = scene.colours.get(at).map_or_else(|| height_colour(point[2], heights), |colour| **colour);
            panel.point(self.place(point), side, depth, colour);
        }
        panel.fill_gaps();
        panel.light(layout.px_per_metre, side);
        panel.paint(canvas, self.corner[0], self.corner[1]);
    }

    fn draw_lines(&self, canvas: &mut Canvas, scene: &Scene<'_>) {
        let pen = pen_scale(canvas);
        for [from, to] in &scene.closures {
            canvas.stroke(self.pixel(*from), self.pixel(*to), 0.8 * pen, CLOSURE);
        }
        let way: Vec<[f32; 2]> = scene.way.iter().map(|&p| self.pixel(p)).collect();
        let (Some(&first), Some(&last)) = (way.first(), way.last()) else { return };
        let strokes = strokes_of(&way);
        // A white rim first, so that the way stands out from points of any colour.
        strokes.iter().for_each(|&(from, to, _)| canvas.stroke(from, to, 2.2 * pen, [255; 3]));
        strokes.iter().for_each(|&(from, to, colour)| canvas.stroke(from, to, 1.2 * pen, colour));
        canvas.triangle(first, 5.5 * pen, START);
        canvas.square(last, 4.5 * pen, END);
    }

    /// The map's axes as arrows, but for one that points to the viewer.
    fn draw_axes(&self, canvas: &mut Canvas, scene: &Scene<'_>) {
        let centre = self.corner.map(|corner| corner as f32 + 1.5 * ARROW_PX * pen_scale(canvas));
        // The rims of all first, so that none covers another.
        for (rim_px, colour) in [(2.0, GROUND), (0.0, INK)] {
            for (axis, name) in ["x", "y", "z"].iter().enumerate() {
                let along = [scene.axes[0][axis] as f32, -scene.axes[self.vertical][axis] as f32];
                draw_arrow(canvas, centre, along, name, rim_px, colour);
            }
        }
    }
}

/// The way in strokes of at least a pixel and a half, for shorter ones would only cover each other.
fn strokes_of(way: &[[f32; 2]]) -> Vec<([f32; 2], [f32; 2], Colour)> {
    let mut strokes = Vec::new();
    let Some(mut from) = way.first().copied() else { return strokes };
    for (index, &to) in way.iter().enumerate() {
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        if dx * dx + dy * dy >= 2.25 {
            strokes.push((from, to, way_colour(index as f32 / way.len() as f32)));
            from = to;
        }
    }
    strokes
}

/// An axis of which `along` is seen, one where it lies in the picture's plane; not drawn where it is too short to tell.
fn draw_arrow(canvas: &mut Canvas, centre: [f32; 2], along: [f32; 2], name: &str, rim_px: f32, colour: Colour) {
    let seen = (along[0] * along[0] + along[1] * along[1]).sqrt();
    if seen < 0.35 {
        return;
    }
    let pen = pen_scale(canvas);
    let (length, half_width) = (ARROW_PX * pen, (1.0 + rim_px) * pen);
    let end = [0, 1].map(|k| centre[k] + length * along[k]);
    canvas.stroke(centre, end, half_width, colour);
    for side in [-0.5, 0.5] {
        let back = [-along[0] - side * along[1], -along[1] + side * along[0]];
        let barb = [0, 1].map(|k| end[k] + 0.25 * length * back[k] / seen);
        canvas.stroke(end, barb, half_width, colour);
    }
    let middle = [0, 1].map(|k| end[k] + 13.0 * pen * along[k] / seen);
    if rim_px > 0.0 {
        canvas.stroke(middle, middle, 8.0 * pen, colour);
    }
    canvas.text_about(name, middle, 0.85 * pen, colour);
}

/// Fine pixels of a point's side: neighbours touch, those at the far corners of their cubes as well.
fn point_side(point_px: f32) -> usize {
    // Casts saturate.
    ((1.6 * point_px * FINE as f32).ceil() as usize).clamp(2, 24)
}

fn height_colour(height_m: f32, [low, high]: [f32; 2]) -> Colour {
    let at = ((height_m - low) / (high - low)).clamp(0.0, 1.0) * (HEIGHTS.len() - 1) as f32;
    let below = (at as usize).min(HEIGHTS.len() - 2);
    blend(HEIGHTS[below], HEIGHTS[below + 1], at - below as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Image {
        width: usize,
        pixels: Vec<Colour>,
    }

    fn draw(picture: &SpacePicture<'_>) -> Image {
        let mut out = Vec::new();
        write_space_png(picture, &mut out).unwrap();
        let mut again = Vec::new();
        write_space_png(picture, &mut again).unwrap();
        assert_eq!(out, again);
        let mut reader = png::Decoder::new(std::io::Cursor::new(out)).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut bytes).unwrap();
        let pixels = bytes.as_chunks::<3>().0.to_vec();
        Image { width: info.width as usize, pixels }
    }

    impl Image {
        fn height(&self) -> usize {
            self.pixels.len() / self.width
        }

        /// How many pixels of the upper part, the view from above, are like this colour.
        fn above_like(&self, colour: Colour) -> usize {
            let near = |p: &&Colour| (0..3).all(|k| p[k].abs_diff(colour[k]) < 25);
            self.pixels[..self.width * self.height() / 2].iter().filter(near).count()
        }
    }

    /// A room of 8 by 4 by 2.5 m with a red floor, blue walls and a green ceiling.
    fn room() -> (Vec<[f32; 3]>, Vec<Colour>) {
        let (mut points, mut colours) = (Vec::new(), Vec::new());
        let mut add = |point: [f32; 3], colour: Colour| {
            points.push(point);
            colours.push(colour);
        };
        for i in 0..=160 {
            let x = i as f32 * 0.05;
            for j in 0..=80 {
                let y = j as f32 * 0.05;
                add([x, y, 0.0], [220, 30, 30]);
                add([x, y, 2.5], [30, 220, 30]);
            }
            for k in 0..=50 {
                let z = k as f32 * 0.05;
                add([x, 0.0, z], [30, 30, 220]);
                add([x, 4.0, z], [30, 30, 220]);
            }
        }
        (points, colours)
    }

    const WAY: [[f64; 3]; 2] = [[2.0, 2.0, 1.4], [6.0, 2.0, 1.4]];

    #[test]
    fn a_low_ceiling_does_not_hide_the_room() {
        let (points_m, colours) = room();
        let picture = SpacePicture { points_m: &points_m, colours: &colours, way_m: &WAY, ..SpacePicture::default() };
        let image = draw(&picture);
        assert_eq!(image.width.max(image.height()), 1600);
        assert!(image.above_like([220, 30, 30]) > 100_000, "{}", image.above_like([220, 30, 30]));
        assert_eq!(image.above_like([30, 220, 30]), 0);
        // without a way nothing is cut away
        let image = draw(&SpacePicture { way_m: &[], ..picture });
        assert!(image.above_like([30, 220, 30]) > 100_000);
    }

    #[test]
    fn heights_are_colours_where_there_are_none_and_walls_throw_shadows() {
        let (points_m, _) = room();
        let closures_m = [[[1.0, 1.0, 1.0], [7.0, 3.0, 1.0]]];
        let picture =
            SpacePicture { points_m: &points_m, way_m: &WAY, closures_m: &closures_m, ..SpacePicture::default() };
        let image = draw(&picture);
        assert!(image.above_like(HEIGHTS[0]) > 100_000 && image.above_like(CLOSURE) > 500);
        // along a column through the floor it is darker beside the wall than in the middle
        let column: Vec<_> = (0..image.height() / 2).map(|y| image.pixels[y * image.width + image.width / 4]).collect();
        let light = |p: &Colour| p.iter().map(|&v| u32::from(v)).sum::<u32>();
        let shadow = |p: &&Colour| p[0] >= p[2] && light(p) < light(&HEIGHTS[0]) * 9 / 10;
        assert!(column.iter().filter(shadow).count() >= 4);
    }

    #[test]
    fn a_bare_picture_says_where_the_way_would_be() {
        let (points_m, _) = room();
        let picture = SpacePicture { points_m: &points_m, way_m: &WAY, ..SpacePicture::default() };
        let drawn = draw(&picture);
        let placement = write_bare_space_png(&picture, Vec::new()).unwrap();
        assert_eq!(placement.size_px, [drawn.width, drawn.height()]);
        for (place, colour) in WAY.iter().zip([START, END]) {
            for view in placement.views {
                let pixel = [0, 1].map(|k| {
                    view.offset_px[k] + (0..3).map(|axis| view.px_from_map[k][axis] * place[axis]).sum::<f64>()
                });
                assert_eq!(drawn.pixels[pixel[1] as usize * drawn.width + pixel[0] as usize], colour);
            }
        }
    }

    #[test]
    fn anything_can_be_drawn() {
        let odd = [[f32::NAN, 0.0, 0.0], [1e30, 0.0, 0.0], [1.0, 2.0, 3.0]];
        let way = [[f64::INFINITY, 0.0, 0.0], [0.5, 0.0, -3.0]];
        for points_m in [&odd[..], &odd[..2], &[]] {
            for (up, side_px) in [([0.0; 3], 0), ([f64::NAN; 3], 300), ([1.0, 0.0, 0.0], 5000)] {
                for way_m in [&way[..], &[]] {
                    let closures_m = [[way[0], way[1]], [way[1], way[1]]];
                    let picture = SpacePicture {
                        points_m,
                        way_m,
                        closures_m: &closures_m,
                        up,
                        side_px,
                        ..SpacePicture::default()
                    };
                    draw(&picture);
                }
            }
            draw(&SpacePicture { points_m, point_m: f64::NAN, ..SpacePicture::default() });
        }
    }
}
