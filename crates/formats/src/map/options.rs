//! What a picture shows besides the map, and how large.

use super::GridImage;
use super::canvas::Canvas;
use super::confidence::Confidence;
use super::frame::Frame;
use super::runs::Runs;
use mapwright_geom::Pose2;

/// Narrower pictures get margins for what stands below the map, pixels; smaller ones have a scale bar alone.
pub(super) const LEGEND_PX: usize = 320;

/// So many pixels of a picture's longer side are seen on a screen: larger pictures are looked at smaller, so that their lines, marks and
/// letters grow along.
const SCREEN_PX: f32 = 1000.0;

/// What is drawn besides the map, and how large.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Picture<'a> {
    /// Poses in the order of time, drawn as a line whose colour changes along it.
    pub world_from_robot: &'a [Pose2],
    /// Ways of several robots instead, in a colour each.
    pub runs: Option<Runs<'a>>,
    /// Direction in the map's own frame that becomes horizontal, radians, such as
    /// [`dominant_wall_angle`](super::dominant_wall_angle) finds; zero leaves the map as it is.
    pub level_rad: f64,
    /// How many readings tell of each cell of the map, in its order, at most 255: what few tell of is pale. Without, or where they are not as
    /// many as the cells, all is shown alike.
    pub seen: Option<&'a [u8]>,
    /// How certain the map is, as a tint of its free space, and numbered places.
    pub confidence: Option<Confidence<'a>>,
    /// Whether a scale bar stands below the map, and what the colours and marks stand for.
    pub scale_bar: bool,
    /// What part of the world is shown; otherwise the map's walls and the way ([`Frame::of`]).
    pub frame: Option<Frame>,
    /// The longer side, margins included, has exactly so many pixels; otherwise the scale is a whole number of pixels a cell, or of cells a
    /// pixel, as the two sides below say.
    pub side_px: Option<usize>,
    /// Smaller maps are enlarged by a whole factor until their longer side has so many pixels.
    pub min_side_px: usize,
    /// Larger maps are reduced by a whole factor until their longer side, margins included, has at most so many pixels.
    pub max_side_px: usize,
}

impl Default for Picture<'_> {
    fn default() -> Self {
        Self {
            world_from_robot: &[],
            runs: None,
            level_rad: 0.0,
            seen: None,
            confidence: None,
            scale_bar: true,
            frame: None,
            side_px: None,
            min_side_px: 800,
            max_side_px: 2400,
        }
    }
}

impl<'a> Picture<'a> {
    /// The poses' places in cells from the map's corner; what is not finite or far off the map is left out.
    pub(super) fn way_in_cells(&self, map: &GridImage) -> Vec<[f64; 2]> {
        in_cells(map, self.world_from_robot.iter().map(|pose| [pose.x, pose.y]))
    }

    /// The same of all ways that are shown.
    pub(super) fn ways_in_cells(&self, map: &GridImage) -> Vec<[f64; 2]> {
        let runs = self.runs.iter().flat_map(Runs::places);
        in_cells(map, self.world_from_robot.iter().map(|pose| [pose.x, pose.y]).chain(runs))
    }

    /// How many readings tell of each cell, where that is known.
    pub(super) fn seen_of(&self, map: &GridImage) -> Option<&'a [u8]> {
        self.seen.filter(|seen| seen.len() == map.cells.len())
    }
}

/// Places of the world in cells from the map's corner; what is not finite or far off the map is left out.
pub(super) fn in_cells(map: &GridImage, places: impl Iterator<Item = [f64; 2]>) -> Vec<[f64; 2]> {
    let map_from_world = map.world_from_map.inverse();
    let far = 4.0 * (map.width + map.height) as f64;
    let in_cells = |place: [f64; 2]| map_from_world.transform(place).map(|v| v / map.resolution_m);
    places.map(in_cells).filter(|p| p.iter().all(|v| v.abs() <= far)).collect()
}

/// The width of a pen, pixels: a pixel in small pictures, and more in those that are larger than a screen.
pub(super) fn pen_scale(canvas: &Canvas) -> f32 {
    pen_of(canvas.width.max(canvas.height))
}

/// The same by the longer side, pixels.
pub(super) fn pen_of(side_px: usize) -> f32 {
    (side_px as f32 / SCREEN_PX).max(1.0)
}
