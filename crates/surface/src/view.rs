//! What is drawn: the points of a keyframe.

use crate::error::SurfaceError;

/// The points of a cloud or a depth image in the frame of its keyframe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View<'a> {
    /// Points, metres.
    pub points_m: &'a [[f32; 3]],
    /// Where the sensor was when it saw them, metres: one place for all of them, or one each.
    pub origins_m: &'a [[f32; 3]],
    /// Red, green and blue of each, or none.
    pub colours: &'a [[u8; 3]],
}

impl View<'_> {
    /// Whether its columns belong together.
    pub(crate) fn validate(&self) -> Result<(), SurfaceError> {
        let points = self.points_m.len();
        let check = |what, found: usize, few: usize, expected| {
            let is_right = found == few || found == points;
            if is_right { Ok(()) } else { Err(SurfaceError::Columns { what, found, points, expected }) }
        };
        check("origins", self.origins_m.len(), 1, "one, or one for each point")?;
        check("colours", self.colours.len(), 0, "none, or one for each point")
    }
}

/// What became of the points of a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PointCounts {
    /// Points of the view.
    pub points: usize,
    /// Not finite, or seen from a place that is not.
    pub not_finite: usize,
    /// Nearer to the sensor than a voxel is wide: what sensors write where they saw nothing.
    pub near: usize,
    /// More than half a million voxels from the keyframe.
    pub far: usize,
}
