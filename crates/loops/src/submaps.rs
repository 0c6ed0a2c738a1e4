//! What closing asks of a kind of map, and nothing else: the one place where the plane and space differ.

use crate::cascade::Finding;
use crate::views::View;
use mapwright_geom::{Pose, Stored};
use mapwright_record::{Measurement, NodeId};
use std::fmt::Debug;

/// Poses of a kind of submaps.
pub type PoseOf<S> = <<S as Submaps>::Measurement as Measurement>::Pose;

/// A measurement whose cycles can be closed.
pub trait Closes: Measurement {
    /// What is drawn from it.
    type Submaps: Submaps<Measurement = Self>;
}

/// Poses among which a submap is looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window<P: Pose> {
    /// The middle.
    pub target_from_query: P,
    /// To either side along each axis, of space those of the ground, metres.
    pub half_width_m: f64,
    /// Up and down, metres; of no meaning in the plane.
    pub half_height_m: f64,
    /// To either side, radians.
    pub half_width_rad: f64,
}

/// Length of way that makes a submap, to one side, metres.
pub const SUBMAP_M: f64 = 8.0;

/// What closing keeps to with a kind of submaps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosingPolicy {
    /// What is looked for is made of no more way than this, metres.
    pub query_m: f64,
    /// Whether findings may say that the chain is wrong, by not being there or by being elsewhere.
    pub doubts_chain: bool,
    /// A finding that contradicts the chain of edges by more than this chi-square counts only with as many others as outvote it.
    pub contradicts_chi2: f64,
    /// The same of what a match is supported by: that is in the local map, and certain relative to the robot as the gate has it.
    pub match_contradicts_chi2: f64,
    /// A closure that the optimum strains by more than this is withdrawn: 1.18 times the 99.99 % quantile, for a chain states too little
    /// (docs/decisions/0011-closing-loops.md).
    pub strained_chi2: f64,
}

/// A kind of submaps: how they are drawn, looked for in each other, and recognised. [`PlaneSubmaps`](crate::PlaneSubmaps) are
/// those of lasers in the plane, [`SpaceSubmaps`](crate::SpaceSubmaps) those of clouds.
pub trait Submaps: Clone + Debug + Send {
    /// What they are drawn from.
    type Measurement: Measurement;
    /// One of them.
    type Submap: Clone + Debug + Send;
    /// What places look like.
    type Places: Clone + Debug + Default + Send + Stored;

    /// What closing keeps to with them.
    const POLICY: ClosingPolicy;

    /// Draws views.
    #[must_use]
    fn draw(&self, views: &[View<Self::Measurement>]) -> Self::Submap;

    /// Looks for one in another: where it fits best, and what speaks for that and against it. A search is exact within the
    /// window, so a rival that it does not find is not there.
    #[must_use]
    fn look_for(
        &mut self,
        query: &Self::Submap,
        target: &Self::Submap,
        window: &Window<PoseOf<Self>>,
    ) -> Finding<PoseOf<Self>>;

    /// What is found where it is plain that nothing is, before the target is drawn; none where that is not plain.
    fn rule_out(
        &mut self,
        _query: &Self::Submap,
        _target: &[View<Self::Measurement>],
        _window: &Window<PoseOf<Self>>,
    ) -> Option<Finding<PoseOf<Self>>> {
        None
    }

    /// One in another about where it is said to be, and nowhere else: what fits there. It is not searched for.
    #[must_use]
    fn fit_at(
        &mut self,
        query: &Self::Submap,
        target: &Self::Submap,
        target_from_query: PoseOf<Self>,
    ) -> Finding<PoseOf<Self>>;

    /// Whether it is plain, before either is drawn, that one fits another where it is said to be: then a search there finds something.
    #[must_use]
    fn fits_plainly(
        &self,
        _query: &[View<Self::Measurement>],
        _target: &[View<Self::Measurement>],
        _target_from_query: PoseOf<Self>,
    ) -> bool {
        false
    }

    /// Poses and blocks of poses that the last search scored: most of its work.
    #[must_use]
    fn scored(&self) -> u64;

    /// Remembers what it looks like around a keyframe, in whose frame the views are.
    fn remember(&self, places: &mut Self::Places, node: NodeId, views: &[View<Self::Measurement>]);

    /// The keyframes around which it is known what it looks like.
    fn remembered(places: &Self::Places) -> &[NodeId];

    /// The places that look most like these views among those allowed, the most alike first, each with the windows in which the
    /// views' frame may be, seen from its keyframe.
    #[must_use]
    fn alike(
        &self,
        places: &mut Self::Places,
        views: &[View<Self::Measurement>],
        at_most: usize,
        allow: impl Fn(NodeId) -> bool,
    ) -> Vec<(NodeId, Window<PoseOf<Self>>)>;
}
