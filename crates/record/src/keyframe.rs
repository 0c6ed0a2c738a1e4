//! Keyframes and the edges between them.

use mapwright_geom::{Cov3, Pose2, Stamp};
use mapwright_sensor::Sweep;

/// Name of a keyframe for ever and across robots. Order within a session is `seq`; stamps are neither unique nor ordered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct KeyframeId {
    /// Who took it.
    pub robot: u128,
    /// Which run of that robot.
    pub session: u32,
    /// Place in that run's order.
    pub seq: u32,
}

/// A prepared measurement that the map is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct Keyframe {
    /// Its name.
    pub id: KeyframeId,
    /// When it was taken.
    pub stamp: Stamp,
    /// Number of the scan in arrival order, from zero.
    pub scan: u64,
    /// What the laser saw.
    pub sweep: Sweep,
}

/// Where an edge's knowledge comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EdgeKind {
    /// The motion model alone.
    Odometry,
    /// A scan matched against the live map, to the keyframe that supplied most of the matched points; the scan alone.
    Match,
    /// A verified return to a place seen before.
    Closure,
}

/// A relative pose of two keyframes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// The keyframe it starts at.
    pub from: KeyframeId,
    /// The keyframe it leads to.
    pub to: KeyframeId,
    /// Where its knowledge comes from.
    pub kind: EdgeKind,
    /// Pose of `to` in the frame of `from`.
    pub from_from_to: Pose2,
    /// Information of its tangent (right perturbation; 1/m^2, 1/(m rad), 1/rad^2).
    pub information: Cov3,
}
