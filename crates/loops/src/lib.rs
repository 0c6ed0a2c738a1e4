//! Recognising places seen before, and refusing what only looks like them.

pub mod places;

pub use places::{PlaceHit, PlaceIndex};
