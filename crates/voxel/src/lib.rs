//! Maps of space on hashed voxels, and scans matched against them in six degrees of freedom.
//!
//! - [`SurfelMap`] is matched against, by [`Matcher`].
//! - [`RangeImage`] says what a sensor has seen through.
//! - [`Occupancy`] counts where points were seen and where rays passed; [`Octree`] and [`floor_cells`] are made of it.

mod eigen;
mod floor_plan;
mod key;
mod matcher;
mod occupancy;
mod octree;
mod range_image;
mod surfel;
mod surfel_map;
mod thin;

pub use floor_plan::{FloorCell, floor_cells};
pub use matcher::{
    Ascent, BentFit, Descent, Fit, HELD_SHARE, Matcher, MatcherSettings, Prior, Seen, Start, TwistPrior,
};
pub use occupancy::{Occupancy, OccupancySettings, VoxelCounts, log_odds};
pub use octree::{BtCounts, Leaf, Leaves, Octree, OctreeError, State, write_bt};
pub use range_image::RangeImage;
pub use surfel::{Surfel, TELLING_POINTS};
pub use surfel_map::{Change, SurfelMap, SurfelMapSettings};
pub use thin::{PointColumns, Thinner};
