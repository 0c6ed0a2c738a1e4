//! A picture of a map of space, from above and from the side, with the way the robot went.

mod extent;
mod layout;
mod panel;
mod scene;
mod section;
mod single;
mod storeys;
#[cfg(test)]
mod tests;
mod upright;
mod vectors;
mod view;

pub use upright::upward;

use super::canvas::{Canvas, Colour, blend};
use super::frame::ViewPlacement;
use super::picture::{encode, encode_as};
use crate::error::FormatError;
use layout::Layout;
use scene::Scene;
use std::io::Write;

const GROUND: Colour = super::palette::UNSEEN;
const INK: Colour = super::palette::INK;
const CLOSURE: Colour = [224, 122, 16];
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
/// parallel to the picture's sides. Storeys that lie over each other (see the module `storeys`) are seen from above beside each other. Ceilings and the walls nearest to the viewer are cut
/// away (see the module `section`), depth is shown by light, and what is shown is where nearly all points lie: how many lie outside is said. Over it the way from dark blue to
/// red, a green triangle at its start and a red square at its end, closures, the directions of the map's axes, a caption for each view, a scale bar and what the colours
/// stand for, heights above the map's origin among them.
///
/// The same map gives the same bytes.
///
/// # Errors
///
/// [`FormatError::Png`].
pub fn write_space_png(picture: &SpacePicture<'_>, writer: impl Write) -> Result<(), FormatError> {
    let scene = Scene::of(picture);
    let layout = Layout::of(&scene, picture.side_px.clamp(200, 16_384));
    let mut canvas = Canvas::new(layout.width(), layout.height(), GROUND);
    let heights = layout.heights(&scene);
    for (number, view) in layout.views.iter().enumerate() {
        view.draw_points(&mut canvas, &scene, heights);
        view.draw_lines(&mut canvas, &scene);
        let is_first_of_kind = number == 0 || !view.is_above();
        if is_first_of_kind {
            view.draw_axes(&mut canvas, &scene);
        }
        view.draw_caption(&mut canvas);
    }
    layout.footer(&scene, heights).draw(&mut canvas);
    encode(&canvas, writer)
}

/// Writes the same views with nothing but captions drawn over the points and no lines below, for who draws over it, and says where it has what.
///
/// # Errors
///
/// [`FormatError::Png`].
pub fn write_bare_space_png(picture: &SpacePicture<'_>, writer: impl Write) -> Result<SpacePlacement, FormatError> {
    let scene = Scene::of(picture);
    let layout = Layout::bare(&scene, picture.side_px.clamp(200, 16_384));
    let mut canvas = Canvas::new(layout.width(), layout.height(), GROUND);
    let heights_m = layout.heights(&scene);
    for view in &layout.views {
        view.draw_points(&mut canvas, &scene, heights_m);
        view.draw_caption(&mut canvas);
    }
    encode_as(&canvas, png::Compression::Balanced, writer)?;
    Ok(SpacePlacement {
        size_px: [layout.width(), layout.height()],
        px_per_metre: f64::from(layout.px_per_metre()),
        views: layout.views.iter().map(|view| view.placed(&scene)).collect(),
        axes: scene.axes,
        low_m: scene.low.map(f64::from),
        high_m: scene.high.map(f64::from),
        heights_m: heights_m.map(f64::from),
        outside_share: scene.outside_share(),
    })
}

/// Where a picture of a map of space has what.
#[derive(Debug, Clone, PartialEq)]
pub struct SpacePlacement {
    /// Width and height, pixels.
    pub size_px: [usize; 2],
    /// The scale of all views.
    pub px_per_metre: f64,
    /// From above, of each storey from the lowest up; and from the side, the last.
    pub views: Vec<SpaceView>,
    /// The picture's axes in the frame of the map, of length one: to the right, away from who looks from the side, and up.
    pub axes: [[f64; 3]; 3],
    /// Where what is shown begins along these axes, metres,
    pub low_m: [f64; 3],
    /// and where it ends.
    pub high_m: [f64; 3],
    /// From which height to which colours reach, metres along the axis up.
    pub heights_m: [f64; 2],
    /// Share of the points that lie outside.
    pub outside_share: f64,
}

/// One of the views of a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct SpaceView {
    /// Where it has what.
    pub placement: ViewPlacement,
    /// From which height to below which it shows the way, metres along the axis up; infinite where there is no limit.
    pub heights_m: [f64; 2],
    /// What it is, in words.
    pub caption: String,
}

/// The colour of a height where heights are shown as colours from `low` to `high`, metres.
#[must_use]
pub fn height_colour(height_m: f32, [low, high]: [f32; 2]) -> [u8; 3] {
    let at = ((height_m - low) / (high - low)).clamp(0.0, 1.0) * (HEIGHTS.len() - 1) as f32;
    let below = (at as usize).min(HEIGHTS.len() - 2);
    blend(HEIGHTS[below], HEIGHTS[below + 1], at - below as f32)
}
