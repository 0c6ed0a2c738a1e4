//! One submap looked for in another: the steps of the cascade that need no graph.
//!
//! Each step may only refuse or postpone. The search is exact within its window (Hess et al. 2016, section V), so a rival
//! that it does not find is not there.

use crate::submap::Submap;
use mapwright_geom::{Cov3, Pose2};
use mapwright_grid::{CorrelativeSearch, Matcher, Prior, SearchWindow, Separation};
use mapwright_record::{Evidence, Objection};

/// Rivals with a smaller share of the best score are not looked for.
const LEAST_AMBIGUITY: f64 = 0.75;

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
    /// Standard deviations of the best-known direction of the match, and of its heading, that no fit is better than.
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
pub struct Finding {
    /// Pose of the submap that was looked for in the one it was looked for in.
    pub target_from_query: Option<Pose2>,
    /// Covariance of its right perturbation.
    pub covariance: Cov3,
    /// The numbers.
    pub evidence: Evidence,
    /// What speaks against it.
    pub objection: Option<Objection>,
}

impl Finding {
    fn none(evidence: Evidence, objection: Objection) -> Self {
        Self { target_from_query: None, covariance: Cov3::zeros(), evidence, objection: Some(objection) }
    }
}

/// Looks for submaps in others; keeps its buffers.
#[derive(Debug, Clone, Default)]
pub struct Verifier {
    /// Its settings.
    pub settings: VerifySettings,
    /// Refines what the search has found.
    pub matcher: Matcher,
    searcher: CorrelativeSearch,
    points: Vec<[f64; 2]>,
}

impl Verifier {
    /// A verifier.
    #[must_use]
    pub fn new(settings: VerifySettings, matcher: Matcher) -> Self {
        Self { settings, matcher, ..Self::default() }
    }

    /// Poses and blocks of poses that the last search scored: most of its work.
    #[must_use]
    pub fn scored(&self) -> u64 {
        self.searcher.scored()
    }

    /// Looks for `query` in `target` at the poses of a window.
    #[must_use]
    pub fn look_for(&mut self, query: &Submap, target: &Submap, window: &SearchWindow) -> Finding {
        let VerifySettings { search_points, least_score, separation, .. } = self.settings;
        let mut evidence = Evidence { points: query.hits.len() as u32, ..Evidence::default() };
        self.points.clear();
        let every = query.hits.len().div_ceil(search_points.max(1)).max(1);
        self.points.extend(query.hits.iter().step_by(every));
        self.searcher.settings.least_share = least_score;
        self.searcher.settings.least_rival_share = LEAST_AMBIGUITY;
        let found = self.searcher.search(&target.map, &self.points, window, Some(separation));
        let Some(found) = found else { return Finding::none(evidence, Objection::NoMatch) };
        evidence.score = Some(found.share());
        evidence.ambiguity = Some(found.ambiguity().max(LEAST_AMBIGUITY));
        let prior = Prior { world_from_robot: found.best.world_from_robot, variances: [1.0, 1.0, 0.1], tail: 1e8 };
        let refined = self.matcher.gauss_newton(&target.map, &query.hits, &prior, found.best.world_from_robot);
        let target_from_query = refined.world_from_robot;
        let there = target.map.agreement(&query.hits, target_from_query);
        let back = query.map.agreement(&target.hits, target_from_query.inverse());
        evidence.overlap = Some(there.known_share());
        evidence.inlier_share = Some(there.inlier_share().min(back.inlier_share()));
        let share = |contradicting: u32, all: usize| f64::from(contradicting) / all.max(1) as f64;
        let contradiction =
            share(there.contradicting, query.hits.len()).max(share(back.contradicting, target.hits.len()));
        evidence.contradiction = Some(contradiction);
        let covariance = self.covariance(&refined.hessian);
        let objection = self.objection(&evidence, &covariance);
        Finding { target_from_query: Some(target_from_query), covariance, evidence, objection }
    }

    /// Of the curvature, with floors for what bends within the submaps.
    fn covariance(&self, hessian: &Cov3) -> Cov3 {
        let VerifySettings { floor_m, floor_rad, .. } = self.settings;
        let weak = Cov3::from_diagonal(&nalgebra::Vector3::new(1e-2, 1e-2, 1e-2));
        let scan = (hessian * 0.1 + weak).try_inverse().unwrap_or_else(|| Cov3::identity() * 100.0);
        scan + Cov3::from_diagonal(&nalgebra::Vector3::new(floor_m * floor_m, floor_m * floor_m, floor_rad * floor_rad))
    }

    fn objection(&self, evidence: &Evidence, covariance: &Cov3) -> Option<Objection> {
        let s = &self.settings;
        let value = |share: Option<f64>| share.unwrap_or(0.0);
        let open = covariance.fixed_view::<2, 2>(0, 0).symmetric_eigenvalues().max() > s.open_m * s.open_m;
        if value(evidence.overlap) < s.least_overlap {
            Some(Objection::LittleOverlap)
        } else if value(evidence.contradiction) > s.most_contradiction
            || value(evidence.inlier_share) < s.least_inlier_share
        {
            Some(Objection::Contradiction)
        } else if value(evidence.ambiguity) > s.most_ambiguity {
            Some(Objection::Ambiguous)
        } else if open {
            Some(Objection::Unconstrained)
        } else {
            None
        }
    }
}
