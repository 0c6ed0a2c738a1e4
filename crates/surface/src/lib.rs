//! Surfaces of space from clouds and depth images: truncated signed distances in hashed blocks, and their meshes.
//!
//! - [`Surface`] keeps keyframes, draws them at their poses, and draws anew those that a correction moved.
//! - [`Volume`] is what it is made of: [`Patch`]es, prepared once of each keyframe's [`View`], are added to it and taken out exactly, in any order.
//! - [`Mesh`] is the surface as triangles; [`write_ply`] and [`write_glb`] write it.
//!
//! [`Surface`] shows how they go together.

mod block;
mod error;
mod glb;
mod key;
mod mesh;
mod patch;
mod plane;
mod ply;
mod pyramid;
mod settings;
mod sketch;
mod surface;
mod view;
mod volume;

pub use block::Change;
pub use error::SurfaceError;
pub use glb::write_glb;
pub use mesh::{EdgeCounts, Mesh, MeshSettings};
pub use patch::Patch;
pub use ply::write_ply;
pub use settings::SurfaceSettings;
pub use surface::{Surface, Updated};
pub use view::{PointCounts, View};
pub use volume::{Volume, VoxelDistance};
