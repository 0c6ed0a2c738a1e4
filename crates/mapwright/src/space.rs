//! The same pipeline in space: six degrees of freedom, clouds instead of scans, surfels instead of cells. Files bear the names of
//! their likes in the plane; the store, the log, the graph and closing are the same code.

mod front;
mod local_map;
mod render;
mod scale;
mod surface;

pub(crate) use front::SpaceFrontEnd;
pub use front::{ImuMount, ImuReport};
pub use render::{MapPoints, MapSurfel, MapSurfels, SpaceMap, occupancy_of, points_of, points_of_map, surfels_of};
pub use surface::{SurfaceMap, surface_settings, usual_range_m, white_of};
