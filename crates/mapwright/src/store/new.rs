//! What stages hand over to be written.

use super::NodeId;
use crate::patches::Spacing;
use mapwright_geom::{Cov3, Pose2, Stamp};
use mapwright_record::{Beams, Detection, Edge, Evidence, LeftOutReason, Verdict};
use mapwright_sensor::Sweep;
use std::sync::Arc;

/// A keyframe to be written.
#[derive(Debug, Clone)]
pub(crate) struct NewKeyframe {
    pub(crate) stamp: Stamp,
    /// All that was seen,
    pub(crate) sweep: Arc<Sweep>,
    /// and what of it is not drawn.
    pub(crate) left_out: Option<(Beams, LeftOutReason)>,
    pub(crate) hardly_fits: bool,
    pub(crate) local_from_keyframe: Pose2,
    /// Covariance relative to the anchor,
    pub(crate) covariance: Cov3,
    /// relative to the keyframe before by odometry alone,
    pub(crate) odometry: Cov3,
    /// and by odometry and scan together.
    pub(crate) fused: Cov3,
    /// What the scan was matched with, and the information of that.
    pub(crate) matched: Option<(NodeId, Cov3)>,
}

/// How a keyframe hangs on those before it.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Link {
    /// By odometry on the one before.
    Odometry,
    /// Odometry does not lead there: by a place that the robot was found at, and how certain that is.
    Relocalised { from: NodeId, covariance: Cov3 },
}

/// A keyframe that was written.
#[derive(Debug, Clone)]
pub(crate) struct Written {
    pub(crate) node: NodeId,
    /// The keyframes that it is linked with, and its covariance relative to each.
    pub(crate) links: Vec<(NodeId, Cov3)>,
    pub(crate) spacing: Spacing,
    /// A match with an old place that nobody has looked at.
    pub(crate) unjudged: Option<Edge>,
}

/// A finding as a candidate that has no number yet.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Judged {
    pub(crate) from: NodeId,
    pub(crate) to: NodeId,
    pub(crate) detection: Detection,
    pub(crate) evidence: Evidence,
    pub(crate) verdict: Verdict,
    pub(crate) from_from_to: Option<Pose2>,
    pub(crate) covariance: Cov3,
}

/// A slip that scans have told, and how it is corrected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Slipped {
    /// The first keyframe that is misplaced; the next one where none is.
    pub(crate) from: NodeId,
    /// By how far, metres.
    pub(crate) metres: f64,
    /// What is moved is moved by this, in the front end's frame.
    pub(crate) new_from_old: Pose2,
    /// Where the robot is.
    pub(crate) local_from_robot: Pose2,
    /// What the wheels were wrong by, as a covariance.
    pub(crate) slip: Cov3,
}

impl Slipped {
    /// What is left of the wheels' information on the step that slipped.
    pub(crate) fn weakened(&self, information: Cov3) -> Cov3 {
        let covariance = information.try_inverse().map(|covariance| covariance + self.slip);
        covariance.and_then(|covariance| covariance.try_inverse()).unwrap_or(information)
    }
}
