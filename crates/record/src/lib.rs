//! What lasts of a mapping run (keyframes and edges), and what is told to the outside (updates).
//!
//! A [`Session`] holds all of the former as bytes. A keyframe is immutable; poses live apart from it, and every map is a function of both.

mod closure;
mod keyframe;
mod session;
mod update;

pub use closure::{Candidate, Detection, Evidence, Objection, Verdict};
pub use keyframe::{Edge, EdgeKind, Keyframe, KeyframeId};
pub use session::{Session, SessionError, SessionScan};
pub use update::{MatchReport, Status, Update};
