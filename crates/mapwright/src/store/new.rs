//! What stages hand over to be written.

use crate::patches::Spacing;
use mapwright_geom::{Pose, Pose2, Stamp, TangentMatrix};
use mapwright_record::{Beams, Edge, FragmentStart, LeftOutReason, Measurement, NodeId};
use mapwright_sensor::Sweep;
use std::sync::Arc;

/// A keyframe to be written.
#[derive(Debug, Clone)]
pub struct NewKeyframe<M: Measurement = Sweep> {
    pub(crate) stamp: Stamp,
    /// All that was seen,
    pub(crate) sweep: Arc<M>,
    /// and what of it is not drawn.
    pub(crate) left_out: Option<(Beams, LeftOutReason)>,
    pub(crate) hardly_fits: bool,
    pub(crate) local_from_keyframe: M::Pose,
    /// Covariance relative to the anchor,
    pub(crate) covariance: <M::Pose as Pose>::Matrix,
    /// relative to the keyframe before by odometry alone,
    pub(crate) odometry: <M::Pose as Pose>::Matrix,
    /// and by odometry and scan together.
    pub(crate) fused: <M::Pose as Pose>::Matrix,
    /// What the scan was matched with, and the information of that.
    pub(crate) matched: Option<(NodeId, <M::Pose as Pose>::Matrix)>,
}

/// How a keyframe hangs on those before it.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Link {
    /// By odometry on the one before.
    Odometry,
    /// By odometry as well, but over a break: a fragment begins.
    Break(FragmentStart),
}

/// A keyframe that was written.
#[derive(Debug, Clone)]
pub struct Written<P: Pose = Pose2> {
    pub(crate) node: NodeId,
    /// The keyframes that it is linked with, and its covariance relative to each.
    pub(crate) links: Vec<(NodeId, P::Matrix)>,
    pub(crate) spacing: Spacing,
    /// A match with an old place that nobody has looked at.
    pub(crate) unjudged: Option<Edge<P>>,
}

/// A slip that scans have told, and how it is corrected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slipped<P: Pose = Pose2> {
    /// The first keyframe that is misplaced; the next one where none is.
    pub(crate) from: NodeId,
    /// By how far, metres.
    pub(crate) metres: f64,
    /// What is moved is moved by this, in the front end's frame.
    pub(crate) new_from_old: P,
    /// Where the robot is.
    pub(crate) local_from_robot: P,
    /// What the wheels were wrong by, as a covariance.
    pub(crate) slip: P::Matrix,
}

impl<P: Pose> Slipped<P> {
    /// What is left of the wheels' information on the step that slipped.
    pub(crate) fn weakened(&self, information: P::Matrix) -> P::Matrix {
        let covariance = information.inverted().map(|covariance| covariance + self.slip);
        covariance.and_then(|covariance| covariance.inverted()).unwrap_or(information)
    }
}
