//! Maps and paths.

use super::{Header, Pose, PoseStamped, message};
use crate::slice::Slice;
use mapwright_geom::Stamp;

message! {
    /// Where a map's cells are.
    MapMetaData = ["nav_msgs/MapMetaData"];
    /// When the map was loaded.
    map_load_time: Stamp,
    /// Side of a cell, metres.
    resolution: f32,
    /// Cells along x.
    width: u32,
    /// Cells along y.
    height: u32,
    /// Pose of the outer corner of the first cell.
    origin: Pose,
}

message! {
    /// A map of cells.
    OccupancyGrid<'a> = ["nav_msgs/OccupancyGrid"];
    /// When and in which frame.
    header: Header<'a>,
    /// Where the cells are.
    info: MapMetaData,
    /// Probability in percent that a cell is occupied, -1 where not known; rows along x from the origin on.
    data: Slice<'a, i8>,
}

message! {
    /// Cells of a map that changed.
    OccupancyGridUpdate<'a> = ["map_msgs/OccupancyGridUpdate"];
    /// When and in which frame.
    header: Header<'a>,
    /// Column of the first.
    x: i32,
    /// Row of the first.
    y: i32,
    /// Cells along x.
    width: u32,
    /// Cells along y.
    height: u32,
    /// As in [`OccupancyGrid`].
    data: Slice<'a, i8>,
}

message! {
    /// Poses in the order in which they were passed.
    Path<'a> = ["nav_msgs/Path"];
    /// When and in which frame.
    header: Header<'a>,
    /// The poses.
    poses: Vec<PoseStamped<'a>>,
}
