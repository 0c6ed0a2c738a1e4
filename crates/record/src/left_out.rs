//! What maps leave out, and why: keyframes themselves never change.

use crate::id::KeyframeId;

/// Beams of a keyframe.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Beams {
    /// All of them.
    All,
    /// These, by their places in the sweep.
    These(Vec<u32>),
}

/// Why beams of a keyframe are not drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum LeftOutReason {
    /// They end where other beams have passed, and many do: somebody stood in the way, or the match was wrong.
    InTheWay,
    /// The scan hardly fitted, and the finished map contradicts it.
    ContradictsTheMap,
    /// The robot thought that it knew where it is, which nothing has borne out yet.
    OnTrial,
    /// Somebody asked for it.
    Asked,
}

impl LeftOutReason {
    /// The reason in words.
    #[must_use]
    pub fn in_words(self) -> &'static str {
        match self {
            Self::InTheWay => "it ends where other beams have passed",
            Self::ContradictsTheMap => "the scan hardly fitted and contradicts the others",
            Self::OnTrial => "the robot was not yet known to be there",
            Self::Asked => "it was asked for",
        }
    }
}

/// Beams of a keyframe that maps leave out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LeftOut {
    /// The keyframe.
    pub keyframe: KeyframeId,
    /// Which of its beams.
    pub beams: Beams,
    /// Why.
    pub reason: LeftOutReason,
}
