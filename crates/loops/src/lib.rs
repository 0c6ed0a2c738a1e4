//! Recognising places seen before, and refusing what only looks like them.

mod atlas;
mod places;
mod submap;
mod verify;

pub use atlas::{Atlas, Effort, Sighting};
pub use places::{PlaceHit, PlaceIndex};
pub use submap::{Submap, SubmapSettings, View};
pub use verify::{Finding, Verifier, VerifySettings};
