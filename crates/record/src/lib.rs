//! What lasts of a mapping run (keyframes and edges), and what is told to the outside (updates).
//!
//! A run is a sequence of [`Entry`]s: an [`Update`] carries those of one scan, a [`Session`] is what all of them amount to, and
//! the file of a session holds them in order. A keyframe is immutable; poses live apart from it, and every map is a function of
//! both.

mod adoption;
mod closure;
mod entry;
mod error;
mod id;
mod keyframe;
mod left_out;
mod log;
mod names;
mod node;
mod numbers;
mod past;
mod pose;
#[cfg(test)]
mod samples;
mod session;
mod update;

pub use adoption::{Adoption, Grows, groups, place_of};
pub use closure::{Candidate, Detection, Evidence, Objection, Verdict};
pub use entry::{
    Checkpoint, Entry, Fragment, FragmentStart, Gravity, OdometryOrigin, RecordedEdge, Run, ScanPose, Snapshot,
    WheelSlip,
};
pub use error::EntryError;
pub use id::{KeyframeId, RunId};
pub use keyframe::{Edge, EdgeKind, Keyframe, Measurement};
pub use left_out::{Beams, LeftOut, LeftOutReason};
pub use log::{
    EntryReader, LogError, LogLoss, LogReport, LogWriter, SESSION_MAGIC, checkpoint_end, read_entries, read_log,
};
pub use node::NodeId;
pub use past::Past;
pub use pose::is_sound;
pub use session::{OdometryLink, Piece, SeparateMap, Session, SessionEdge, TrajectoryPose};
pub use update::{LocalMapReport, Localisation, MatchReport, Status, Update};
