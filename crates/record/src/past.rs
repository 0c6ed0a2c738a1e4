//! A session as the stages of a pipeline see it: keyframes by their places, in the frame in which the newest one never jumps.

use crate::id::KeyframeId;
use crate::keyframe::Measurement;
use crate::node::NodeId;
use crate::session::Session;
use mapwright_geom::Pose;
use mapwright_sensor::Sweep;
use std::sync::Arc;

/// The poses and measurements of all keyframes, by node.
#[derive(Debug)]
pub struct Past<'a, M: Measurement = Sweep> {
    /// All that lasts.
    pub session: &'a Session<M>,
    /// What is drawn of each keyframe, if anything is.
    pub drawn: &'a [Option<Arc<M>>],
    /// Where each is in the front end's frame.
    pub local_from_keyframe: &'a [M::Pose],
    /// Length of the way up to each, metres.
    pub way_m: &'a [f64],
}

impl<M: Measurement> Clone for Past<'_, M> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<M: Measurement> Copy for Past<'_, M> {}

impl<M: Measurement> Past<'_, M> {
    /// The newest keyframe.
    #[must_use]
    pub fn newest(self) -> Option<NodeId> {
        self.local_from_keyframe.len().checked_sub(1).map(NodeId::at)
    }

    /// The keyframe before this one on the robot's way ([`Session::before`]).
    #[must_use]
    pub fn before(self, node: NodeId) -> Option<NodeId> {
        self.session.before(node.index()).map(NodeId::at)
    }

    /// The keyframe after this one on the robot's way, if there is one yet ([`Session::after`]).
    #[must_use]
    pub fn after(self, node: NodeId) -> Option<NodeId> {
        self.session.after(node.index()).map(NodeId::at).filter(|&next| self.has(next))
    }

    /// Where a keyframe is in the front end's frame.
    #[must_use]
    pub fn pose(self, node: NodeId) -> M::Pose {
        self.local_from_keyframe[node.index()]
    }

    /// Whether there is such a keyframe.
    #[must_use]
    pub fn has(self, node: NodeId) -> bool {
        node.index() < self.local_from_keyframe.len()
    }

    /// The nodes of two keyframes, if they are there.
    #[must_use]
    pub fn nodes(self, [a, b]: [KeyframeId; 2]) -> Option<[NodeId; 2]> {
        Some([NodeId::at(self.session.place(a)?), NodeId::at(self.session.place(b)?)])
    }

    /// Straight from the keyframe before to this one, metres.
    #[must_use]
    pub fn step_m(self, node: usize) -> f64 {
        self.local_from_keyframe[node - 1].distance(self.local_from_keyframe[node])
    }

    /// Length of the way between two keyframes, metres.
    #[must_use]
    pub fn way_between_m(self, a: NodeId, b: NodeId) -> f64 {
        (self.way_m[a.index()] - self.way_m[b.index()]).abs()
    }

    /// Length of the way up to the newest keyframe, metres.
    #[must_use]
    pub fn length_m(self) -> f64 {
        self.way_m.last().copied().unwrap_or(0.0)
    }

    /// Only the first keyframes.
    #[must_use]
    pub fn until(self, count: usize) -> Self {
        let (drawn, local_from_keyframe) = (&self.drawn[..count], &self.local_from_keyframe[..count]);
        Self { drawn, local_from_keyframe, way_m: &self.way_m[..count], ..self }
    }
}
