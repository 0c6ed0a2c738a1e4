//! How certain each part of the map is relative to its start, and where to drive next to make it more so.
//!
//! Certainty is that of the best path over the graph ([`CertaintyGraph`]). A place is judged by what a visit would add: a
//! link from the robot to it, as uncertain as the drive there, and links to what lies beside it and is not linked yet.

use crate::patches::{Spacing, accumulating};
use crate::pose::map_floor;
use crate::store::spacing;
use mapwright_geom::{Cov3, Pose2};
use mapwright_graph::{CertaintyGraph, Gate, Uncertainty};
use mapwright_loops::LEFT_M;
use mapwright_record::{EdgeKind, KeyframeId, SeparateMap, Session};

/// A link of which nothing is known, m^2 and rad^2.
const UNKNOWN_VARIANCE: f64 = 100.0;
/// What a closure usually knows: 0.02 m and 0.003 rad.
const CLOSURE: Uncertainty = Uncertainty { displacement_m2: 4e-4, rotation_rad2: 9e-6 };
/// Places are so far apart along the way at least, metres,
const PLACE_EVERY_M: f64 = 2.0;
/// and so many at most.
const PLACES_AT_MOST: usize = 2048;
/// Places tried at most.
const TRIED: usize = 64;
/// From a place everything up to here is seen, metres, and is news where it was left (`LEFT_M`).
const SEEN_FROM_M: f64 = 4.0;
/// Places recommended at most.
const RECOMMENDED: usize = 4;
/// They are so far apart at least: metres, and share of the map's extent.
const APART_M: f64 = 5.0;
const APART_SHARE: f64 = 0.08;
/// A visit pays where it takes away so much of the mean: share, and metres.
const PAYS_SHARE: f64 = 0.05;
const PAYS_M: f64 = 0.01;
/// A heading's error counts as if it were made so far away at least, metres.
const LEVER_M: f64 = 5.0;

/// How certain the map is, and where to drive next.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Advice {
    /// For every keyframe the larger standard deviation of its position relative to the first one, metres; infinite
    /// where nothing links the two.
    pub keyframe_sigmas_m: Vec<f64>,
    /// Mean of the finite ones, metres.
    pub mean_sigma_m: f64,
    /// The largest finite one, metres.
    pub worst_sigma_m: f64,
    /// The places whose revisit makes the map most certain, best first; none where nothing is to be gained.
    pub places: Vec<Place>,
}

/// A place to drive to.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// The keyframe that was made there.
    pub keyframe: KeyframeId,
    /// Where it is in the map, metres.
    pub at: [f64; 2],
    /// Straight from the newest keyframe, metres.
    pub away_m: f64,
    /// From the newest keyframe along known ones, at most some metres apart, to the place; empty where there is no way.
    pub way: Vec<[f64; 2]>,
    /// Expected mean of the standard deviations after a visit, metres.
    pub mean_sigma_after_m: f64,
}

impl Place {
    /// Length of the known way, metres; none where there is no way.
    #[must_use]
    pub fn way_m(&self) -> Option<f64> {
        (!self.way.is_empty()).then(|| self.way.windows(2).map(|pair| distance(pair[0], pair[1])).sum())
    }
}

impl Advice {
    /// For the map as it is now.
    #[must_use]
    pub fn of(session: &Session) -> Self {
        let at: Vec<[f64; 2]> = session.map_from_keyframe().iter().map(|pose| [pose.x, pose.y]).collect();
        Self::over(&at, &links(session), |k| session.keyframes()[k].id)
    }

    /// For one of the session's maps ([`Session::maps`]): deviations are those of its own keyframes, in order, relative to the first of them.
    /// There is nowhere to drive to in a map that the robot is not in.
    #[must_use]
    pub fn of_map(session: &Session, map: &SeparateMap) -> Self {
        let places: Vec<usize> = map.places().filter(|&place| place < session.keyframes().len()).collect();
        let own = |place: usize| places.binary_search(&place).ok();
        let own_link = |link: Link| Some(Link { from: own(link.from)?, to: own(link.to)?, ..link });
        let links: Vec<Link> = links(session).into_iter().filter_map(own_link).collect();
        let at: Vec<[f64; 2]> =
            places.iter().map(|&place| session.map_from_keyframe()[place]).map(|p| [p.x, p.y]).collect();
        if session.keyframes().len().checked_sub(1).is_some_and(|newest| map.has(newest)) {
            return Self::over(&at, &links, |k| session.keyframes()[places[k]].id);
        }
        Self::certainty(Certainty::sigmas_of(&at, &links))
    }

    fn certainty(keyframe_sigmas_m: Vec<f64>) -> Self {
        Self {
            mean_sigma_m: mean(&keyframe_sigmas_m),
            worst_sigma_m: keyframe_sigmas_m.iter().copied().filter(|sigma| sigma.is_finite()).fold(0.0, f64::max),
            keyframe_sigmas_m,
            places: Vec::new(),
        }
    }

    /// For keyframes at `at` and the links between them.
    fn over(at: &[[f64; 2]], links: &[Link], id: impl Fn(usize) -> KeyframeId) -> Self {
        let Some(newest) = at.len().checked_sub(1) else { return Self::default() };
        let certainty = Certainty::of(at, links);
        let sigmas_m = certainty.sigmas_m(&[]);
        let mean_sigma_m = mean(&sigmas_m);
        let route = Route::of(at);
        let drift = Drift::of(at, links);
        let mut tried: Vec<(f64, usize)> = promising(&route, &sigmas_m, &drift)
            .into_iter()
            .map(|visit| {
                let after_m = certainty.sigmas_m(&visit.links(&route, newest, &drift));
                let least_m: Vec<f64> =
                    sigmas_m.iter().zip(after_m).map(|(&before, after)| before.min(after)).collect();
                (mean(&least_m), visit.place)
            })
            .filter(|(after_m, _)| mean_sigma_m - after_m >= PAYS_M.max(PAYS_SHARE * mean_sigma_m))
            .collect();
        tried.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let apart_m = APART_M.max(APART_SHARE * extent_m(at));
        let places = spread_out(&tried, &route, apart_m, RECOMMENDED);
        let places = places.into_iter().map(|(after_m, place)| route.place(place, after_m, &id)).collect();
        Self { places, ..Self::certainty(sigmas_m) }
    }
}

/// Two keyframes and what is known of one relative to the other.
#[derive(Debug, Clone, Copy)]
struct Link {
    from: usize,
    to: usize,
    uncertainty: Uncertainty,
    /// Where the heading's error is made.
    pivot: [f64; 2],
}

/// Every link that stands: to the keyframe before by wheels and scan together, to the one matched with, and closures.
fn links(session: &Session) -> Vec<Link> {
    let poses = session.map_from_keyframe();
    let mut links: Vec<Link> = Vec::with_capacity(session.recorded_edges().len());
    let mut by_wheels = None;
    for known in session.recorded_edges().iter().filter(|known| !known.withdrawn) {
        let (edge, [from, to]) = (&known.recorded.edge, known.ends.map(|end| end as usize));
        let spacing = spacing(session.keyframes(), to, poses[to.saturating_sub(1)].distance(poses[to]));
        let link = |covariance: Option<Cov3>| Link {
            from,
            to,
            uncertainty: uncertainty(covariance, spacing),
            pivot: [poses[to].x, poses[to].y],
        };
        let covariance = edge.information.try_inverse();
        match edge.kind {
            EdgeKind::Odometry => {
                by_wheels = Some(edge);
                links.push(link(covariance));
            }
            EdgeKind::Match => {
                if let (Some(wheels), Some(last)) = (by_wheels.filter(|wheels| wheels.to == edge.to), links.last_mut())
                {
                    last.uncertainty = uncertainty((wheels.information + edge.information).try_inverse(), spacing);
                }
                // To the keyframe before, wheels and scan together are all that is known.
                if from + 1 != to {
                    let away_m = poses[from].distance(poses[to]);
                    links.push(link(covariance.map(|covariance| covariance + map_floor::<Cov3>(away_m))));
                }
            }
            EdgeKind::Closure => links.push(link(covariance)),
        }
    }
    links
}

fn uncertainty(covariance: Option<Cov3>, spacing: Spacing) -> Uncertainty {
    let known = covariance.filter(|c| c.iter().all(|v| v.is_finite()) && (0..3).all(|k| c[(k, k)] >= 0.0));
    let Uncertainty { displacement_m2, rotation_rad2 } =
        accumulating(&known.unwrap_or_else(|| Cov3::identity() * UNKNOWN_VARIANCE), spacing);
    Uncertainty {
        displacement_m2: displacement_m2.min(UNKNOWN_VARIANCE),
        rotation_rad2: rotation_rad2.min(UNKNOWN_VARIANCE),
    }
}

/// The graph that is searched from the first keyframe.
struct Certainty {
    graph: CertaintyGraph,
    lever_m: f64,
}

impl Certainty {
    fn of(at: &[[f64; 2]], links: &[Link]) -> Self {
        let squares: f64 = at.iter().map(|&place| distance(place, at[0]).powi(2)).sum();
        let lever_m = (squares / at.len() as f64).sqrt().max(LEVER_M);
        let mut certainty = Self { graph: CertaintyGraph::default(), lever_m };
        for &place in at {
            certainty.graph.add_node(place);
        }
        links.iter().for_each(|link| add(&mut certainty.graph, link, lever_m));
        certainty
    }

    /// Standard deviation of each keyframe relative to the first; none where there are no keyframes.
    fn sigmas_of(at: &[[f64; 2]], links: &[Link]) -> Vec<f64> {
        if at.is_empty() { Vec::new() } else { Self::of(at, links).sigmas_m(&[]) }
    }

    /// Standard deviation of each keyframe relative to the first, were there `more` links.
    fn sigmas_m(&self, more: &[Link]) -> Vec<f64> {
        let mut graph = self.graph.clone();
        more.iter().for_each(|link| add(&mut graph, link, self.lever_m));
        let gate = Gate { sigma_m: f64::INFINITY, lever_m: self.lever_m, reach_m: f64::INFINITY };
        graph.begin(0, Uncertainty::default(), gate);
        while !graph.advance(usize::MAX, usize::MAX) {}
        let mut sigmas_m = vec![f64::INFINITY; graph.len()];
        for reached in graph.reached() {
            sigmas_m[reached.node as usize] = reached.uncertainty.displacement_m2.sqrt();
        }
        sigmas_m
    }
}

fn add(graph: &mut CertaintyGraph, link: &Link, lever_m: f64) {
    graph.add_link(link.from as u32, link.to as u32, link.uncertainty, link.pivot, lever_m);
}

/// What a metre of way costs.
struct Drift {
    per_metre: Uncertainty,
}

impl Drift {
    fn of(at: &[[f64; 2]], links: &[Link]) -> Self {
        let (mut sum, mut way_m) = (Uncertainty::default(), 0.0);
        for link in links.iter().filter(|link| link.from + 1 == link.to) {
            sum = sum.then(link.uncertainty, 0.0);
            way_m += distance(at[link.from], at[link.to]);
        }
        let per = 1.0 / f64::max(way_m, 1.0);
        let per_metre =
            Uncertainty { displacement_m2: per * sum.displacement_m2, rotation_rad2: per * sum.rotation_rad2 };
        Self { per_metre }
    }

    /// Of a closure at the end of a drive straight from one place to another.
    fn link(&self, [from, to]: [usize; 2], [a, b]: [[f64; 2]; 2]) -> Link {
        let way_m = distance(a, b);
        let Uncertainty { displacement_m2, rotation_rad2 } = self.per_metre;
        let driven = Uncertainty { displacement_m2: way_m * displacement_m2, rotation_rad2: way_m * rotation_rad2 };
        // Headings err all along the way: about its middle, and by a twelfth of its square around that.
        let around_m2 = driven.rotation_rad2 * way_m * way_m / 12.0;
        let mut uncertainty = CLOSURE.then(driven, 0.0);
        uncertainty.displacement_m2 += around_m2;
        Link { from, to, uncertainty, pivot: [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])] }
    }
}

/// A keyframe every few metres of way, and how to get from the last one to each.
struct Route {
    /// Numbers of the keyframes, and where they are.
    keyframes: Vec<usize>,
    at: Vec<[f64; 2]>,
    /// Length of way up to each, metres.
    way_m: Vec<f64>,
    /// The next one on the shortest way to the last one.
    towards_newest: Vec<Option<usize>>,
}

impl Route {
    fn of(at: &[[f64; 2]]) -> Self {
        let mut travelled_m = vec![0.0; at.len()];
        for k in 1..at.len() {
            travelled_m[k] = travelled_m[k - 1] + distance(at[k - 1], at[k]);
        }
        let newest = at.len() - 1;
        let step_m = PLACE_EVERY_M.max(travelled_m[newest] / (PLACES_AT_MOST - 2) as f64);
        let mut keyframes = Vec::new();
        for k in 0..at.len() {
            let far = keyframes.last().is_none_or(|&last: &usize| travelled_m[k] - travelled_m[last] >= step_m);
            if far || k == newest {
                keyframes.push(k);
            }
        }
        let places: Vec<_> = keyframes.iter().map(|&k| at[k]).collect();
        let way_m = keyframes.iter().map(|&k| travelled_m[k]).collect();
        Self { towards_newest: ways(&places, step_m), keyframes, at: places, way_m }
    }

    fn place(&self, place: usize, mean_sigma_after_m: f64, id: impl Fn(usize) -> KeyframeId) -> Place {
        let last = self.at.len() - 1;
        let mut way = vec![self.at[place]];
        let mut here = place;
        while let Some(next) = self.towards_newest[here] {
            way.push(self.at[next]);
            here = next;
        }
        way.reverse();
        if here != last {
            way.clear();
        }
        Place {
            keyframe: id(self.keyframes[place]),
            at: self.at[place],
            away_m: distance(self.at[place], self.at[last]),
            way,
            mean_sigma_after_m,
        }
    }
}

/// For every place the next one on the shortest way to the last one, by steps to the neighbour along the way and to
/// whatever lies as near. Without a queue, for places are few.
fn ways(at: &[[f64; 2]], step_m: f64) -> Vec<Option<usize>> {
    let last = at.len() - 1;
    let mut way_m = vec![f64::INFINITY; at.len()];
    let (mut next, mut done) = (vec![None; at.len()], vec![false; at.len()]);
    way_m[last] = 0.0;
    loop {
        let open = (0..at.len()).filter(|&k| !done[k] && way_m[k].is_finite());
        let Some(here) = open.min_by(|&a, &b| way_m[a].total_cmp(&way_m[b])) else { return next };
        done[here] = true;
        for there in 0..at.len() {
            let reach_m = if there.abs_diff(here) == 1 { 2.0 * step_m } else { step_m };
            let apart_m = distance(at[here], at[there]);
            if !done[there] && apart_m <= reach_m && way_m[here] + apart_m < way_m[there] {
                (way_m[there], next[there]) = (way_m[here] + apart_m, Some(here));
            }
        }
    }
}

/// A visit, by places of the route.
#[derive(Debug, Clone, Copy)]
struct Visit {
    place: usize,
    /// What is seen from there and not linked yet.
    beside: Option<usize>,
    /// The most that the visit can take away, m^2.
    gain_m2: f64,
}

impl Visit {
    fn links(&self, route: &Route, newest: usize, drift: &Drift) -> Vec<Link> {
        let last = route.at.len() - 1;
        let here = drift.link([newest, route.keyframes[self.place]], [route.at[last], route.at[self.place]]);
        let beside = self.beside.map(|beside| Link {
            from: route.keyframes[beside],
            to: route.keyframes[self.place],
            uncertainty: CLOSURE,
            pivot: route.at[self.place],
        });
        beside.into_iter().chain([here]).collect()
    }
}

/// The visits from which most is to be hoped: those that join what is certain with what is not.
fn promising(route: &Route, sigmas_m: &[f64], drift: &Drift) -> Vec<Visit> {
    let last = route.at.len() - 1;
    let variance = |place: usize| sigmas_m[route.keyframes[place]].powi(2);
    let gap_m2 = |a: usize, b: usize| {
        let gap = (variance(a) - variance(b)).abs();
        if gap.is_nan() { 0.0 } else { gap }
    };
    let visits = (0..last).map(|place| {
        let by_way = drift.link([place, last], [route.at[place], route.at[last]]).uncertainty.displacement_m2;
        let unlinked = |&other: &usize| {
            distance(route.at[place], route.at[other]) <= SEEN_FROM_M
                && (route.way_m[place] - route.way_m[other]).abs() >= LEFT_M
        };
        let beside = (0..last).filter(unlinked).max_by(|&a, &b| gap_m2(place, a).total_cmp(&gap_m2(place, b)));
        let by_sight = beside.map_or(0.0, |beside| gap_m2(place, beside) - CLOSURE.displacement_m2);
        Visit { place, beside, gain_m2: by_sight.max(gap_m2(place, last) - by_way) }
    });
    let mut visits: Vec<Visit> = visits.filter(|visit| visit.gain_m2 > 0.0).collect();
    visits.sort_by(|a, b| b.gain_m2.total_cmp(&a.gain_m2).then(a.place.cmp(&b.place)));
    spread_out(&visits.iter().map(|visit| (visit, visit.place)).collect::<Vec<_>>(), route, 0.5 * APART_M, TRIED)
        .into_iter()
        .map(|(&visit, _)| visit)
        .collect()
}

/// The first ones that are so far apart from each other.
fn spread_out<T: Copy>(sorted: &[(T, usize)], route: &Route, apart_m: f64, at_most: usize) -> Vec<(T, usize)> {
    let mut chosen: Vec<(T, usize)> = Vec::new();
    for &(value, place) in sorted {
        let apart = |&(_, other): &(T, usize)| distance(route.at[place], route.at[other]) >= apart_m;
        if chosen.len() < at_most && chosen.iter().all(apart) {
            chosen.push((value, place));
        }
    }
    chosen
}

/// Mean of what is finite.
fn mean(sigmas_m: &[f64]) -> f64 {
    let (sum, count) =
        sigmas_m.iter().filter(|sigma| sigma.is_finite()).fold((0.0, 0.0), |(sum, count), s| (sum + s, count + 1.0));
    sum / f64::max(count, 1.0)
}

fn extent_m(at: &[[f64; 2]]) -> f64 {
    let along = |k: usize| {
        let (low, high) = at
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), place| (place[k].min(low), place[k].max(high)));
        high - low
    };
    along(0).max(along(1))
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    Pose2::new(a[0], a[1], 0.0).distance(Pose2::new(b[0], b[1], 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_record::RunId;

    fn id(k: usize) -> KeyframeId {
        RunId::default().keyframe(k as u32)
    }

    /// A square of 100 m a side, a keyframe a metre, up to `count` of them.
    fn square(count: usize) -> (Vec<[f64; 2]>, Vec<Link>) {
        let corner = |k: usize| match k / 100 {
            0 => [k as f64, 0.0],
            1 => [100.0, (k - 100) as f64],
            2 => [300.0 - k as f64, 100.0],
            _ => [0.0, 400.0 - k as f64],
        };
        let at: Vec<_> = (0..count).map(corner).collect();
        let uncertainty = Uncertainty { displacement_m2: 1e-5, rotation_rad2: 1e-7 };
        let links = (1..count).map(|to| Link { from: to - 1, to, uncertainty, pivot: at[to] }).collect();
        (at, links)
    }

    #[test]
    fn an_open_loop_wants_to_be_closed_where_it_began_and_a_closed_one_nothing() {
        let (at, mut links) = square(390);
        let open = Advice::over(&at, &links, id);
        let best = &open.places[0];
        assert!(best.at[0] + best.at[1] < 15.0, "{best:?}");
        assert!(best.mean_sigma_after_m < 0.75 * open.mean_sigma_m, "{open:?}");
        assert!(best.away_m < 20.0 && best.way_m().is_some_and(|m| m > 350.0), "{best:?}");
        links.push(Link { from: 0, to: 389, uncertainty: CLOSURE, pivot: at[389] });
        let closed = Advice::over(&at, &links, id);
        assert!((closed.mean_sigma_m / best.mean_sigma_after_m - 1.0).abs() < 0.2, "{closed:?}, {best:?}");
        assert!(closed.worst_sigma_m < open.worst_sigma_m && closed.places.is_empty(), "{:?}", closed.places);
    }

    #[test]
    fn places_are_apart_from_each_other_and_the_best_stands_first() {
        let (at, links) = square(360);
        let places = Advice::over(&at, &links, id).places;
        assert!(places.len() > 1);
        for (k, place) in places.iter().enumerate() {
            assert!(places[..k].iter().all(|other| distance(other.at, place.at) >= 5.0));
            assert!(k == 0 || places[k - 1].mean_sigma_after_m <= place.mean_sigma_after_m);
        }
    }

    #[test]
    fn a_map_of_nothing_of_one_keyframe_and_of_unlinked_ones_has_no_advice() {
        assert_eq!(Advice::over(&[], &[], id), Advice::default());
        assert_eq!(Advice::over(&[[1.0, 2.0]], &[], id).keyframe_sigmas_m, [0.0]);
        let apart = Advice::over(&[[0.0; 2], [50.0, 0.0], [1e6, f64::NAN]], &[], id);
        assert_eq!(apart.keyframe_sigmas_m, [0.0, f64::INFINITY, f64::INFINITY]);
        assert!(apart.places.iter().all(|place| place.way_m().is_none()));
        assert_eq!(apart.worst_sigma_m, 0.0);
    }

    #[test]
    fn what_is_not_known_of_a_link_counts_as_much() {
        assert_eq!(
            uncertainty(None, Spacing::default()),
            uncertainty(Some(Cov3::identity() * f64::NAN), Spacing::default())
        );
        assert!(uncertainty(Some(Cov3::identity() * -1.0), Spacing::default()).displacement_m2 >= 1.0);
        assert!(uncertainty(Some(Cov3::identity() * 1e-4), Spacing::default()).displacement_m2 < 1e-4);
    }
}
