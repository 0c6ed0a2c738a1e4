//! One submap of the plane looked for in another. The search is exact within its window (Hess et al. 2016, section V), so a rival
//! that it does not find is not there.

use crate::cascade::{Finding, VerifySettings};
use crate::plane_submap::PlaneSubmap;
use mapwright_geom::Pose2;
use mapwright_grid::{CorrelativeSearch, Matcher, Prior, SearchWindow};
use mapwright_record::{Evidence, Objection};

/// Rivals with a smaller share of the best score are not looked for.
const LEAST_AMBIGUITY: f64 = 0.75;
/// A submap that fits everywhere alike is nowhere: after so many poses and blocks nothing counts as found. On real logs one search in
/// thousands gets there, and half of that is rare.
const SCORED_AT_MOST: u64 = 300_000;

/// In windows wider than this to either side nine of ten places are not found, metres: there it is asked beforehand what end points alone rule out.
const WIDE_M: f64 = 1.0;

/// Whether a window is wide.
pub(crate) fn is_wide(window: &SearchWindow) -> bool {
    window.half_width_m > WIDE_M
}

/// Looks for submaps in others; keeps its buffers.
#[derive(Debug, Clone, Default)]
pub struct PlaneVerifier {
    /// Its settings.
    pub settings: VerifySettings,
    /// Refines what the search has found.
    pub matcher: Matcher,
    searcher: CorrelativeSearch,
    points: Vec<[f64; 2]>,
}

impl PlaneVerifier {
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

    /// What fits of `query` in `target` about a pose.
    #[must_use]
    pub fn fit_at(&self, query: &PlaneSubmap, target: &PlaneSubmap, target_from_query: Pose2) -> Finding {
        fit(&self.settings, &self.matcher, query, target, target_from_query)
    }

    /// Whether `query` may be found among the end points of a target that nobody has drawn.
    pub(crate) fn may_find(&mut self, query: &PlaneSubmap, target: &[[f64; 2]], window: &SearchWindow) -> bool {
        self.prepare(query);
        self.searcher.may_find(target, query.map.settings.resolution_m, &self.points, window)
    }

    /// What is found where nothing is.
    pub(crate) fn nothing_of(&self, query: &PlaneSubmap) -> Finding {
        Finding::none(Evidence { points: query.hits.len() as u32, ..Evidence::default() }, Objection::NoMatch)
    }

    fn prepare(&mut self, query: &PlaneSubmap) {
        let VerifySettings { search_points, least_score, .. } = self.settings;
        self.points.clear();
        let every = query.hits.len().div_ceil(search_points.max(1)).max(1);
        self.points.extend(query.hits.iter().step_by(every));
        self.searcher.settings.least_share = least_score;
        self.searcher.settings.least_rival_share = LEAST_AMBIGUITY;
        self.searcher.settings.scored_at_most = SCORED_AT_MOST;
    }

    /// Looks for `query` in `target` at the poses of a window.
    #[must_use]
    pub fn look_for(&mut self, query: &PlaneSubmap, target: &PlaneSubmap, window: &SearchWindow) -> Finding {
        self.prepare(query);
        let separation = self.settings.separation;
        let Self { settings, matcher, searcher, points } = self;
        let mut finding = None;
        let found = searcher.search_worth_rival(&target.map, points, window, Some(separation), |best| {
            let refined = fit(settings, matcher, query, target, best.world_from_robot);
            finding.insert(refined).objection.is_none()
        });
        let Some((found, mut finding)) = found.zip(finding) else {
            return self.nothing_of(query);
        };
        finding.evidence.score = Some(found.share());
        if finding.objection.is_none() {
            finding.evidence.ambiguity = Some(found.ambiguity().max(LEAST_AMBIGUITY));
            finding.objection = settings.objection(&finding.evidence, &finding.covariance);
        }
        finding
    }
}

/// The best pose of a search, refined, and what was seen from there.
fn fit(
    settings: &VerifySettings,
    matcher: &Matcher,
    query: &PlaneSubmap,
    target: &PlaneSubmap,
    target_from_query: Pose2,
) -> Finding {
    let prior = Prior { world_from_robot: target_from_query, variances: [1.0, 1.0, 0.1], tail: 1e8 };
    let refined = matcher.gauss_newton(&target.map, &query.hits, &prior, target_from_query);
    let target_from_query = refined.world_from_robot;
    let there = target.map.agreement(&query.hits, target_from_query);
    let back = query.map.agreement(&target.hits, target_from_query.inverse());
    let share = |contradicting: u32, all: usize| f64::from(contradicting) / all.max(1) as f64;
    let contradiction = share(there.contradicting, query.hits.len()).max(share(back.contradicting, target.hits.len()));
    let evidence = Evidence {
        points: query.hits.len() as u32,
        overlap: Some(there.known_share()),
        inlier_share: Some(there.inlier_share().min(back.inlier_share())),
        contradiction: Some(contradiction),
        ..Evidence::default()
    };
    let objection = settings.objection_to_fit(&evidence);
    Finding {
        target_from_query: Some(target_from_query),
        covariance: settings.covariance(&refined.hessian),
        evidence,
        objection,
    }
}
