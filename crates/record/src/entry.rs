//! What a run consists of, entry by entry: the log, the stream of updates and a mapper's store are the same entries.

use crate::closure::{Candidate, Verdict};
use crate::id::{KeyframeId, RunId};
use crate::keyframe::{Edge, Keyframe, Measurement};
use crate::left_out::LeftOut;
use mapwright_geom::{Pose, Pose2, Stamp};
use mapwright_sensor::Sweep;
use std::sync::Arc;

/// One thing that happened. Numbers of edges and candidates count those of the log, from zero.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Entry<M: Measurement = Sweep> {
    /// A run begins: what comes next was recorded by this robot.
    Run(Run),
    /// What comes next is of this run again, which has begun before: of several robots that drive at the same time.
    BackTo(RunId),
    /// A scan was taken in.
    Scan(ScanPose<M::Pose>),
    /// A keyframe was made.
    Keyframe {
        /// The keyframe.
        keyframe: Arc<Keyframe<M>>,
        /// Its pose in the map then.
        map_from_keyframe: M::Pose,
    },
    /// A fragment begins with the keyframe that was made last.
    Fragment(Fragment),
    /// An edge was found.
    Edge(RecordedEdge<M::Pose>),
    /// An edge says something else than before.
    Remeasured {
        /// The edge.
        number: u32,
        /// What it says of its ends, which stay the same.
        from_from_to: M::Pose,
        /// Information of its tangent.
        information: <M::Pose as Pose>::Matrix,
    },
    /// An edge says nothing any more.
    Withdrawn {
        /// The edge.
        number: u32,
    },
    /// A place the robot may have come back to was looked at.
    Candidate(Candidate<M::Pose>),
    /// More evidence has changed what is thought of a candidate.
    Verdict {
        /// The candidate.
        number: u32,
        /// What was decided.
        verdict: Verdict,
        /// Other candidates that agree with it.
        agreeing: u32,
    },
    /// Beams of a keyframe are not drawn.
    LeftOut(LeftOut),
    /// The wheels have slipped, and what was mapped since was moved.
    WheelSlip(WheelSlip),
    /// The result of a job that was handed out was taken in, before the scan of this number: in that order the run can be replayed.
    ResultTakenIn {
        /// As many scans had been taken in.
        scan: u64,
    },
    /// Where the odometry of the scans from one on has its own origin.
    OdometryOrigin(OdometryOrigin<M::Pose>),
    /// Where down is at a keyframe.
    Gravity(Gravity),
    /// Keyframes were moved by a correction.
    Snapshot(Snapshot<M::Pose>),
    /// What its mapper knows here beside all this.
    Checkpoint(Checkpoint),
}

/// The beginning of a run.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Run {
    /// Its name.
    pub id: RunId,
    /// The run's settings in whatever words its program has for them.
    pub settings: String,
}

/// Where the robot was at a scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScanPose<P: Pose = Pose2> {
    /// The scan's stamp.
    pub stamp: Stamp,
    /// The keyframe whose corrections it follows; none before the first.
    pub keyframe: Option<KeyframeId>,
    /// Pose of the robot in that keyframe's frame, or in the map where there is none.
    pub keyframe_from_robot: P,
    /// Pose of the robot by odometry alone; never jumps.
    pub odom_from_robot: P,
}

/// Keyframes that tracking links without a break, from one on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fragment {
    /// The first of them.
    pub first: KeyframeId,
    /// What came before it.
    pub start: FragmentStart,
}

/// Why a fragment begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum FragmentStart {
    /// The robot was switched on.
    SwitchedOn,
    /// It was lost, and has found itself in the map.
    Relocalised,
    /// A session is continued.
    Resumed,
    /// After a gap between scans or scans that did not fit it may be anywhere within what odometry is uncertain by.
    Uncertain,
    /// It saw nothing for a while, and may have been carried.
    Blind,
    /// Scans fitted nowhere for a while.
    Lost,
    /// What the robot saw there does not fit what it saw on the way, where it says it was: said by who has taken its keyframes in.
    Contradicted,
}

impl FragmentStart {
    /// Whether the robot went on unseen: what links the fragment to what was mapped before is odometry over a break. Where a fragment begins
    /// with a robot that was switched on, [`crate::Session::is_break`] knows whether anything was mapped before.
    #[must_use]
    pub fn is_break(self) -> bool {
        matches!(self, Self::Uncertain | Self::Blind | Self::Lost | Self::Contradicted)
    }

    /// Lower-case name for reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::SwitchedOn => "switched on",
            Self::Relocalised => "found again",
            Self::Resumed => "resumed",
            Self::Uncertain => "uncertain",
            Self::Blind => "blind",
            Self::Lost => "lost",
            Self::Contradicted => "contradicted by what was seen",
        }
    }
}

/// An edge and what it was made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RecordedEdge<P: Pose = Pose2> {
    /// The edge.
    pub edge: Edge<P>,
    /// For a verified closure the number of its candidate.
    pub candidate: Option<u32>,
}

/// A slip of the wheels along a corridor that scans have told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WheelSlip {
    /// The scan that settled it.
    pub scan: u64,
    /// The first keyframe that was moved; the next one where none was.
    pub from: KeyframeId,
    /// By how far, metres.
    pub metres: f64,
}

/// Where odometry that a robot brought along has its origin: poses by odometry begin at the identity with each
/// run that does not go on from a checkpoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OdometryOrigin<P: Pose = Pose2> {
    /// The first scan that this holds for.
    pub from_scan: u64,
    /// Where the run began, in the frame of the robot's own odometry.
    pub odom_from_start: P,
}

/// A gravity edge: the direction of gravity that inertial readings have told, which binds a keyframe's roll and pitch to the map, whose
/// z axis is up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gravity {
    /// The keyframe.
    pub keyframe: KeyframeId,
    /// Where down is, in the keyframe's frame; of length one.
    pub down_in_keyframe: [f64; 3],
    /// Standard deviation of its angle about any level axis, radians.
    pub sigma_rad: f64,
}

/// What a mapper knows that keyframes and edges do not say: how it moves, what scans are matched against. With it a run goes on as
/// if it had never stopped. It holds for the session as it is then, and for nothing that comes after.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Checkpoint {
    /// In whatever bytes its program has for it.
    pub state: Arc<[u8]>,
}

/// Poses of keyframes in the map as a correction has left them.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot<P: Pose = Pose2> {
    /// Corrections so far, this one among them.
    pub number: u32,
    /// Those that have moved.
    pub map_from_keyframe: Vec<(KeyframeId, P)>,
}
