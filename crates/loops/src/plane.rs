//! Submaps of lasers in the plane, as closing asks for them.

use crate::cascade::{Finding, VerifySettings};
use crate::places::PlaceIndex;
use crate::plane_ends::{Ends, end_points};
use crate::plane_submap::{PlaneSubmap, PlaneSubmapSettings};
use crate::plane_verify::{PlaneVerifier, is_wide};
use crate::submaps::{Closes, ClosingPolicy, SUBMAP_M, Submaps, Window};
use crate::views::View;
use mapwright_geom::{Pose2, wrap_angle};
use mapwright_grid::{Matcher, MatcherSettings, SearchWindow};
use mapwright_record::NodeId;
use mapwright_sensor::Sweep;
use std::f64::consts::PI;

/// A robot at a place that looks like this one is within so much of where that was seen from, metres and radians to either side.
const LIKENESS_WINDOW_M: f64 = 3.0;
const LIKENESS_WINDOW_RAD: f64 = 0.3;

/// Submaps of what lasers have seen in the plane.
#[derive(Debug, Clone)]
pub struct PlaneSubmaps {
    /// How they are drawn.
    pub settings: PlaneSubmapSettings,
    verifier: PlaneVerifier,
}

impl PlaneSubmaps {
    /// Submaps drawn so, looked for so, and refined by such a matcher.
    #[must_use]
    pub fn new(settings: PlaneSubmapSettings, verify: VerifySettings, matcher: MatcherSettings) -> Self {
        Self { settings, verifier: PlaneVerifier::new(verify, Matcher { settings: matcher }) }
    }
}

impl Closes for mapwright_sensor::Sweep {
    type Submaps = PlaneSubmaps;
}

impl Submaps for PlaneSubmaps {
    type Measurement = Sweep;
    type Submap = PlaneSubmap;
    type Places = PlaceIndex;

    /// A chain states too little: it does not confess failed matches and slips, so the quantile of a true chi-square (16.3 at 99.9 %) refuses
    /// true closures by the dozen (docs/decisions/0011-closing-loops.md); it holds for what a match is supported by. 99.99 %: 21.1.
    const POLICY: ClosingPolicy = ClosingPolicy {
        query_m: SUBMAP_M,
        doubts_chain: true,
        contradicts_chi2: 150.0,
        match_contradicts_chi2: 16.3,
        strained_chi2: 25.0,
    };

    fn draw(&self, views: &[View]) -> PlaneSubmap {
        PlaneSubmap::new(views, &self.settings)
    }

    fn look_for(&mut self, query: &PlaneSubmap, target: &PlaneSubmap, window: &Window<Pose2>) -> Finding {
        let Window { target_from_query: world_from_robot, half_width_m, half_width_rad, .. } = *window;
        self.verifier.look_for(query, target, &SearchWindow { world_from_robot, half_width_m, half_width_rad })
    }

    fn rule_out(&mut self, query: &PlaneSubmap, target: &[View], window: &Window<Pose2>) -> Option<Finding> {
        let Window { target_from_query: world_from_robot, half_width_m, half_width_rad, .. } = *window;
        let window = SearchWindow { world_from_robot, half_width_m, half_width_rad };
        if !is_wide(&window) || self.verifier.may_find(query, &end_points(target), &window) {
            return None;
        }
        Some(self.verifier.nothing_of(query))
    }

    fn fit_at(&mut self, query: &PlaneSubmap, target: &PlaneSubmap, target_from_query: Pose2) -> Finding {
        self.verifier.fit_at(query, target, target_from_query)
    }

    fn fits_plainly(&self, query: &[View], target: &[View], target_from_query: Pose2) -> bool {
        Ends::of(target).likelihood(query, target_from_query) >= self.verifier.settings.least_score
    }

    fn scored(&self) -> u64 {
        self.verifier.scored()
    }

    fn remember(&self, places: &mut PlaceIndex, node: NodeId, views: &[View]) {
        places.add(node, &end_points(views));
    }

    fn remembered(places: &PlaceIndex) -> &[NodeId] {
        places.nodes()
    }

    fn alike(
        &self,
        places: &mut PlaceIndex,
        views: &[View],
        at_most: usize,
        allow: impl Fn(NodeId) -> bool,
    ) -> Vec<(NodeId, Window<Pose2>)> {
        let hits = places.query(&end_points(views), at_most, allow);
        hits.iter().flat_map(|hit| around(hit.heading_rad).map(|window| (hit.node, window))).collect()
    }
}

/// Both ways around in which a place may look alike.
fn around(heading_rad: Option<f64>) -> impl Iterator<Item = Window<Pose2>> {
    let turns = if heading_rad.is_some() { 2 } else { 1 };
    let half_width_rad = if heading_rad.is_some() { LIKENESS_WINDOW_RAD } else { PI };
    (0..turns).map(move |half| Window {
        target_from_query: Pose2::new(0.0, 0.0, wrap_angle(heading_rad.unwrap_or(0.0) + f64::from(half) * PI)),
        half_width_m: LIKENESS_WINDOW_M,
        half_height_m: 0.0,
        half_width_rad,
    })
}
