//! The bytes that stand for kinds and reasons.

use super::bytes::{Coded, Cursor, coded};
use crate::closure::{Detection, Objection, Verdict};
use crate::entry::FragmentStart;
use crate::error::EntryError;
use crate::keyframe::EdgeKind;
use crate::left_out::LeftOutReason;

/// Kinds of entries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Run,
    Sensor,
    Scan,
    Keyframe,
    Fragment,
    Edge,
    Remeasured,
    Withdrawn,
    Candidate,
    Verdict,
    LeftOut,
    WheelSlip,
    OdometryOrigin,
    Snapshot,
    Checkpoint,
    Gravity,
    BackTo,
    ResultTakenIn,
}

coded!(Kind: Run = 1, Sensor = 2, Scan = 3, Keyframe = 4, Fragment = 5, Edge = 6, Remeasured = 7, Withdrawn = 8,
    Candidate = 9, Verdict = 10, LeftOut = 11, WheelSlip = 12, Snapshot = 13, OdometryOrigin = 14,
    Checkpoint = 15, Gravity = 16, BackTo = 17, ResultTakenIn = 18);
coded!(FragmentStart: SwitchedOn = 0, Relocalised = 1, Resumed = 2, Uncertain = 3, Blind = 4, Lost = 5,
    Contradicted = 6);
coded!(EdgeKind: Odometry = 0, Match = 1, Closure = 2);
coded!(Detection: Pose = 0, Place = 1, Match = 2, Sighting = 3);
coded!(Objection: NoMatch = 1, LittleOverlap = 2, Ambiguous = 3, Unconstrained = 4, Contradiction = 5, Improbable = 6,
    Alone = 7, Outvoted = 8);
coded!(LeftOutReason: InTheWay = 0, ContradictsTheMap = 1, OnTrial = 2, Asked = 3);

impl Kind {
    /// Name for reports.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Run => "run",
            Self::Sensor => "sensor",
            Self::Scan => "scan",
            Self::Keyframe => "keyframe",
            Self::Fragment => "fragment",
            Self::Edge => "edge",
            Self::Remeasured => "remeasured edge",
            Self::Withdrawn => "withdrawn edge",
            Self::Candidate => "candidate",
            Self::Verdict => "verdict",
            Self::LeftOut => "beams left out",
            Self::WheelSlip => "wheel slip",
            Self::OdometryOrigin => "odometry origin",
            Self::Snapshot => "snapshot",
            Self::Checkpoint => "checkpoint",
            Self::Gravity => "gravity",
            Self::BackTo => "return to a run",
            Self::ResultTakenIn => "result taken in",
        }
    }
}

/// What was decided, and what speaks against it; zero where nothing does.
pub(super) fn put_verdict(out: &mut Vec<u8>, verdict: Verdict) {
    out.push(match verdict {
        Verdict::Accepted => 0,
        Verdict::Waiting(_) => 1,
        Verdict::Refused(_) => 2,
        Verdict::Withdrawn(_) => 3,
    });
    out.push(verdict.objection().map_or(0, Coded::code));
}

pub(super) fn take_verdict(cursor: &mut Cursor<'_>) -> Result<Verdict, EntryError> {
    let expected = "a verdict and what speaks against it";
    let codes: [u8; 2] = cursor.array(expected)?;
    let objection = Objection::from_code(codes[1]);
    let verdict = match (codes, objection) {
        ([0, 0], _) => Some(Verdict::Accepted),
        ([1, _], Some(why)) => Some(Verdict::Waiting(why)),
        ([2, _], Some(why)) => Some(Verdict::Refused(why)),
        ([3, _], Some(why)) => Some(Verdict::Withdrawn(why)),
        _ => None,
    };
    verdict.ok_or_else(|| EntryError { expected, found: format!("{codes:?}") })
}
