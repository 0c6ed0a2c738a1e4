//! How well different visits to the same places agree in a finished map: it tells a map that is drawn over itself from a sound one, and
//! needs no reference.
//!
//! What a keyframe and its neighbours have seen is laid on what an earlier visit saw there, both as the finished map has them, and
//! matched: by how much the match moves it is by how much the map contradicts itself. Neither odometry nor any edge takes part.

use crate::settings::Settings;
use crate::store::way_m;
use mapwright_geom::{Pose, TangentMatrix};
use mapwright_grid::{Matcher, Prior};
use mapwright_loops::{LEFT_M, PlaneSubmap, VerifySettings, views_along};
use mapwright_record::{Measurement, NodeId, Past, SeparateMap, Session};
use std::collections::HashMap;

/// Comparisons at most, and keyframes of which earlier visits are looked for at most, evenly spread.
pub(crate) const COMPARED: usize = 120;
const LOOKED_AT: usize = 1000;
/// An earlier visit counts where it passed within so much, metres; one that looked elsewhere counts as farther, metres for a radian.
const WITHIN_M: f64 = 1.5;
const TURN_M: f64 = 0.5;
/// Either side is made of so much way, metres.
const SIDE_M: f64 = 1.0;
/// What does not fit wherever it is moved counts as if it were so far off, metres, and nothing counts for more.
pub const MISFIT_M: f64 = 0.5;
/// A turn moves what is so far away, metres.
const LEVER_M: f64 = 5.0;

/// How the visits of a map agree.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Visits {
    /// Comparisons of two visits that had seen the same.
    pub compared: usize,
    /// Those that do not fit each other, moved or not.
    pub misfits: usize,
    /// By how much visits would have to be moved to fit each other, metres: mean over the comparisons, a misfit counting as 0.5 m; zero
    /// without comparisons.
    pub mean_m: f64,
    /// Nine of ten by less.
    pub percentile_90_m: f64,
}

impl Visits {
    /// Those of one map of a session.
    #[must_use]
    pub fn of_map(session: &Session, map: &SeparateMap, settings: &Settings) -> Self {
        let way_m = way_m(session);
        let past =
            Past { session, drawn: session.drawn(), local_from_keyframe: session.map_from_keyframe(), way_m: &way_m };
        let pairs = pairs(past, &drawn_nodes(session, map));
        let matcher = Matcher { settings: settings.matcher() };
        let every = pairs.len().div_ceil(COMPARED).max(1);
        let mut moves_m: Vec<f64> =
            pairs.iter().step_by(every).filter_map(|&pair| compare(past, pair, settings, &matcher)).collect();
        moves_m.sort_unstable_by(f64::total_cmp);
        let Some(&percentile_90_m) = moves_m.get(moves_m.len() * 9 / 10) else { return Self::default() };
        let misfits = moves_m.iter().filter(|&&moved_m| moved_m >= MISFIT_M).count();
        let mean_m = moves_m.iter().sum::<f64>() / moves_m.len() as f64;
        Self { compared: moves_m.len(), misfits, mean_m, percentile_90_m }
    }
}

/// Keyframes of a map, by their places in the session, each with the nearest one of an earlier visit before it; evenly spread, so many at most.
#[must_use]
pub fn visit_pairs<M: Measurement>(session: &Session<M>, map: &SeparateMap, at_most: usize) -> Vec<[usize; 2]> {
    let way_m = way_m(session);
    let past =
        Past { session, drawn: session.drawn(), local_from_keyframe: session.map_from_keyframe(), way_m: &way_m };
    let pairs = pairs(past, &drawn_nodes(session, map));
    let every = pairs.len().div_ceil(at_most.max(1)).max(1);
    pairs.iter().step_by(every).map(|pair| pair.map(NodeId::index)).collect()
}

fn drawn_nodes<M: Measurement>(session: &Session<M>, map: &SeparateMap) -> Vec<NodeId> {
    let is_drawn = |place: &usize| session.drawn().get(*place).is_some_and(Option::is_some);
    map.places().filter(is_drawn).map(NodeId::at).collect()
}

/// Keyframes with the nearest of an earlier visit.
pub(crate) fn pairs<M: Measurement>(past: Past<'_, M>, nodes: &[NodeId]) -> Vec<[NodeId; 2]> {
    let square = |pose: M::Pose| pose.translation().map(|metres| (metres / WITHIN_M).floor() as i64);
    let mut squares: HashMap<[i64; 3], Vec<NodeId>> = HashMap::new();
    let mut pairs = Vec::new();
    let every = nodes.len().div_ceil(LOOKED_AT).max(1);
    for (number, &later) in nodes.iter().enumerate() {
        let (pose, [x, y, z]) = (past.pose(later), square(past.pose(later)));
        if number.is_multiple_of(every) {
            let beside = (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| [x + dx, y + dy]));
            let above_too = beside.flat_map(|[x, y]| (-1..=1).map(move |dz| [x, y, z + dz]));
            let earlier = above_too.filter_map(|square| squares.get(&square)).flatten().copied();
            let away_m = |earlier: NodeId| {
                let between = past.pose(earlier).between(pose);
                between.length() + TURN_M * between.angle()
            };
            let other_visit = earlier.filter(|&earlier| past.way_between_m(earlier, later) >= LEFT_M);
            let nearest = other_visit
                .map(|earlier| (away_m(earlier), earlier))
                .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            pairs.extend(nearest.filter(|&(away_m, _)| away_m <= WITHIN_M).map(|(_, earlier)| [earlier, later]));
        }
        squares.entry([x, y, z]).or_default().push(later);
    }
    pairs
}

/// By how much a match moves what a later visit saw, metres; none where the two have seen too little in common, or where what they have seen
/// leaves a direction open.
fn compare(past: Past<'_>, [earlier, later]: [NodeId; 2], settings: &Settings, matcher: &Matcher) -> Option<f64> {
    let [target, query] =
        [earlier, later].map(|node| PlaneSubmap::new(&views_along(past, node, true, SIDE_M), &settings.submaps()));
    let as_mapped = past.pose(earlier).between(past.pose(later));
    let prior = Prior { world_from_robot: as_mapped, variances: [1.0, 1.0, 0.1], tail: 1e8 };
    let matched = matcher.gauss_newton(&target.map, &query.hits, &prior, as_mapped);
    let verify = VerifySettings::default();
    let there = target.map.agreement(&query.hits, matched.world_from_robot);
    if there.known_share() < verify.least_overlap {
        return None;
    }
    let contradicting = f64::from(there.contradicting) / query.hits.len().max(1) as f64;
    if there.inlier_share() < verify.least_inlier_share || contradicting > verify.most_contradiction {
        return Some(MISFIT_M);
    }
    if verify.covariance(&matched.hessian).position_variance_m2() > verify.open_m * verify.open_m {
        return None;
    }
    let moved = as_mapped.between(matched.world_from_robot);
    Some((moved.x.hypot(moved.y) + LEVER_M * moved.theta.abs()).min(MISFIT_M))
}
