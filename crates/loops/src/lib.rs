//! Recognising places seen before, and refusing what only looks like them.

mod places;
mod submap;
mod verify;

pub use places::{PlaceHit, PlaceIndex};
pub use submap::{Submap, SubmapSettings, View};
pub use verify::{Finding, Verifier, VerifySettings};
