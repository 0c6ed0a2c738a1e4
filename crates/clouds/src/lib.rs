//! x
mod error;
mod folder;
mod image;
mod notes;
mod packets;
mod pcd;
mod ply;
mod points;
mod poses;
mod scalar;
mod text;
pub use error::CloudError;
pub use folder::Folder;
pub use notes::{Note, NoteKind, Noted, Notes};
pub use pcd::read_pcd;
pub use ply::read_ply;
pub use points::Points;
