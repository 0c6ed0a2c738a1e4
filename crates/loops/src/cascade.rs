//! The steps of the cascade that need no graph, whatever the map is made of. Each may only refuse or postpone.

use mapwright_geom::{Pose, Pose2, TangentMatrix};
use mapwright_grid::Separation;
use mapwright_record::{Evidence, Objection};

/// What a candidate has to show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VerifySettings {
    /// Points of a search at most; the match uses all.
    pub search_points: usize,
    /// Least share of the full score.
    pub least_score: f64,
    /// A pose elsewhere must score at most this share of the best one.
    pub most_ambiguity: f64,
    /// Elsewhere is farther than this.
    pub separation: Separation,
    /// Least share of the points that end in known territory.
    pub least_overlap: f64,
    /// Of these as many must fit, seen from either submap.
    pub least_inlier_share: f64,
    /// At most this share of all points ends in the other's free space.
    pub most_contradiction: f64,
    /// Standard deviations of the best-known direction of the match, and of its rotation, that no fit is better than.
    pub floor_m: f64,
    /// See above.
    pub floor_rad: f64,
    /// A direction that is less certain than this is open, metres.
    pub open_m: f64,
}

impl Default for VerifySettings {
    fn default() -> Self {
        Self {
            search_points: 400,
            least_score: 0.45,
            most_ambiguity: 0.9,
            separation: Separation { distance_m: 0.5, angle_rad: 0.35 },
            least_overlap: 0.5,
            least_inlier_share: 0.85,
            most_contradiction: 0.12,
            floor_m: 0.015,
            floor_rad: 0.003,
            open_m: 0.25,
        }
    }
}

/// The pose that was found and what speaks for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Finding<P: Pose = Pose2> {
    /// Pose of the submap that was looked for in the one it was looked for in.
    pub target_from_query: Option<P>,
    /// Covariance of its right perturbation.
    pub covariance: P::Matrix,
    /// The numbers.
    pub evidence: Evidence,
    /// What speaks against it.
    pub objection: Option<Objection>,
}

impl<P: Pose> Finding<P> {
    /// Nothing was found.
    #[must_use]
    pub fn none(evidence: Evidence, objection: Objection) -> Self {
        Self { target_from_query: None, covariance: P::Matrix::zero(), evidence, objection: Some(objection) }
    }
}

impl VerifySettings {
    /// In space. Surfels are as large as a chair: of submaps that are rightly joined 0.82 to 0.92 fit, of one storey upon another 0.74 to 0.85; what
    /// is left the chain tells apart (docs/decisions/0023-space.md).
    #[must_use]
    pub fn in_space() -> Self {
        Self { least_inlier_share: 0.8, ..Self::default() }
    }

    /// Covariance of a fit whose points curve the objective so: they are correlated, so a tenth of what they claim; with floors
    /// for what bends within the submaps.
    #[must_use]
    pub fn covariance<M: TangentMatrix>(&self, information: &M) -> M {
        let Self { floor_m, floor_rad, .. } = *self;
        let weak = M::from_variances(1e-2, 1e-2);
        let scan = (*information * 0.1 + weak).inverted().unwrap_or_else(|| M::from_variances(100.0, 100.0));
        scan + M::from_variances(floor_m * floor_m, floor_rad * floor_rad)
    }

    /// What speaks against a fit by what was seen there, whatever else might fit.
    #[must_use]
    pub fn objection_to_fit(&self, evidence: &Evidence) -> Option<Objection> {
        let value = |share: Option<f64>| share.unwrap_or(0.0);
        if value(evidence.overlap) < self.least_overlap {
            Some(Objection::LittleOverlap)
        } else if value(evidence.contradiction) > self.most_contradiction
            || value(evidence.inlier_share) < self.least_inlier_share
        {
            Some(Objection::Contradiction)
        } else {
            None
        }
    }

    /// What speaks against a fit of such evidence.
    #[must_use]
    pub fn objection(&self, evidence: &Evidence, covariance: &impl TangentMatrix) -> Option<Objection> {
        let value = |share: Option<f64>| share.unwrap_or(0.0);
        let to_fit = self.objection_to_fit(evidence);
        if to_fit.is_some() {
            to_fit
        } else if value(evidence.ambiguity) > self.most_ambiguity {
            Some(Objection::Ambiguous)
        } else if covariance.position_variance_m2() > self.open_m * self.open_m {
            Some(Objection::Unconstrained)
        } else {
            None
        }
    }
}
