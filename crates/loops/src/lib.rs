//! Recognising places seen before, and refusing what only looks like them.

mod submap;
mod verify;

pub use submap::{Submap, SubmapSettings, View};
pub use verify::{Finding, Verifier, VerifySettings};
