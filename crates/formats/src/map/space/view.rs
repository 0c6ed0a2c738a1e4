//! One of the views of a picture.

use super::panel::{FINE, Panel};
use super::scene::Scene;
use super::section::Section;
use super::{CLOSURE, GROUND, INK, SpaceView, height_colour};
use crate::map::canvas::{Canvas, Colour};
use crate::map::frame::ViewPlacement;
use crate::map::options::pen_scale;
use crate::map::palette::{END, START, way_colour};

/// An arrow of the axes, and where its foot stands in the view, such lengths from its corner: the name of an axis that points up stays
/// clear of the caption.
const ARROW_PX: f32 = 30.0;
const ARROWS_FOOT: [f32; 2] = [1.5, 2.1];
/// A caption stands so far above its view; a unit of its letters; widths of a pen.
const CAPTION_UP: f32 = 7.0;
const CAPTION_UNIT: f32 = 0.8;

/// One of the views.
pub(super) struct View {
    /// The axis that points upwards in the picture: 1 from above, 2 from the side.
    pub(super) vertical: usize,
    /// What lies in the upper left corner, metres along the picture's axes,
    pub(super) origin: [f32; 2],
    /// where that is, pixels,
    pub(super) corner: [usize; 2],
    pub(super) size: [usize; 2],
    pub(super) px_per_metre: f32,
    pub(super) section: Section,
    /// From which height to below which it shows points and the way, metres.
    pub(super) heights: [f32; 2],
    pub(super) caption: String,
}

impl View {
    pub(super) fn is_above(&self) -> bool {
        self.vertical == 1
    }

    /// Whether a point is not cut away.
    pub(super) fn shows(&self, p: [f32; 3]) -> bool {
        let is_before = if self.is_above() {
            p[2] <= self.section.limit([p[0], p[1]])
        } else {
            p[1] >= self.section.limit([p[0], 0.0])
        };
        is_before && self.is_of_storey(p)
    }

    fn is_of_storey(&self, p: [f32; 3]) -> bool {
        p[2] >= self.heights[0] && p[2] < self.heights[1]
    }

    /// A place in pixels of the view.
    fn place(&self, p: [f32; 3]) -> [f32; 2] {
        [(p[0] - self.origin[0]) * self.px_per_metre, (self.origin[1] - p[self.vertical]) * self.px_per_metre]
    }

    pub(super) fn placed(&self, scene: &Scene<'_>) -> SpaceView {
        let px_per_metre = f64::from(self.px_per_metre);
        let along = |axis: usize, sign: f64| scene.axes[axis].map(|v| sign * px_per_metre * v);
        SpaceView {
            placement: ViewPlacement {
                px_from_map: [along(0, 1.0), along(self.vertical, -1.0)],
                offset_px: self.pixel([0.0; 3]).map(f64::from),
            },
            heights_m: self.heights.map(f64::from),
            caption: self.caption.clone(),
        }
    }

    fn pixel(&self, p: [f32; 3]) -> [f32; 2] {
        let [x, y] = self.place(p);
        [x + self.corner[0] as f32, y + self.corner[1] as f32]
    }

    /// Single points are drawn last and throw no shadows: a speck above a floor has no halo.
    pub(super) fn draw_points(&self, canvas: &mut Canvas, scene: &Scene<'_>, heights: [f32; 2]) {
        let mut panel = Panel::new(self.size[0], self.size[1]);
        let side = point_side(scene.point_m * self.px_per_metre);
        let draw = |panel: &mut Panel, are_single: bool| {
            let shown = |(at, p): &(usize, &[f32; 3])| scene.single[*at] == are_single && self.shows(**p);
            for (at, &point) in scene.points.iter().enumerate().filter(shown) {
                let depth = if self.is_above() { -point[2] } else { point[1] };
                let colour = scene.colours.get(at).map_or_else(|| height_colour(point[2], heights), |colour| **colour);
                panel.point(self.place(point), side, depth, colour);
            }
        };
        draw(&mut panel, false);
        panel.fill_gaps();
        panel.light(self.px_per_metre, side);
        draw(&mut panel, true);
        panel.paint(canvas, self.corner[0], self.corner[1]);
    }

    pub(super) fn draw_lines(&self, canvas: &mut Canvas, scene: &Scene<'_>) {
        let pen = pen_scale(canvas);
        for [from, to] in scene.closures.iter().filter(|ends| ends.iter().all(|&end| self.is_of_storey(end))) {
            canvas.stroke(self.pixel(*from), self.pixel(*to), 0.8 * pen, CLOSURE);
        }
        let strokes = self.strokes_of(&scene.way);
        // A white rim first, so that the way stands out from points of any colour.
        strokes.iter().for_each(|&(from, to, _)| canvas.stroke(from, to, 2.2 * pen, [255; 3]));
        strokes.iter().for_each(|&(from, to, colour)| canvas.stroke(from, to, 1.2 * pen, colour));
        let shown = |end: Option<&[f32; 3]>| end.filter(|&&end| self.is_of_storey(end)).map(|&end| self.pixel(end));
        shown(scene.way.first()).into_iter().for_each(|first| canvas.triangle(first, 5.5 * pen, START));
        shown(scene.way.last()).into_iter().for_each(|last| canvas.square(last, 4.5 * pen, END));
    }

    /// The way within the storey, in strokes of at least a pixel and a half, for shorter ones would only cover each other.
    fn strokes_of(&self, way: &[[f32; 3]]) -> Vec<([f32; 2], [f32; 2], Colour)> {
        let mut strokes = Vec::new();
        let mut from: Option<[f32; 2]> = None;
        for (index, &place) in way.iter().enumerate() {
            if !self.is_of_storey(place) {
                from = None;
                continue;
            }
            let to = self.pixel(place);
            let Some(before) = from else {
                from = Some(to);
                continue;
            };
            let (dx, dy) = (to[0] - before[0], to[1] - before[1]);
            if dx * dx + dy * dy >= 2.25 {
                strokes.push((before, to, way_colour(index as f32 / way.len() as f32)));
                from = Some(to);
            }
        }
        strokes
    }

    pub(super) fn draw_caption(&self, canvas: &mut Canvas) {
        let pen = pen_scale(canvas);
        let foot = [self.corner[0] as f32, self.corner[1] as f32 - CAPTION_UP * pen];
        canvas.text(&self.caption, foot, CAPTION_UNIT * pen, INK);
    }

    /// The map's axes as arrows, but for one that points to the viewer.
    pub(super) fn draw_axes(&self, canvas: &mut Canvas, scene: &Scene<'_>) {
        let pen = pen_scale(canvas);
        let centre = [0, 1].map(|k| self.corner[k] as f32 + ARROWS_FOOT[k] * ARROW_PX * pen);
        // The rims of all first, so that none covers another.
        for (rim_px, colour) in [(2.0, GROUND), (0.0, INK)] {
            for (axis, name) in ["x", "y", "z"].iter().enumerate() {
                let along = [scene.axes[0][axis] as f32, -scene.axes[self.vertical][axis] as f32];
                draw_arrow(canvas, centre, along, name, rim_px, colour);
            }
        }
    }
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
