//! Submaps of clouds in space, as closing asks for them.
//!
//! A submap is a map of surfels and what its sensors have seen through, as an image of ranges for each view. It is looked for in
//! another from many headings and places at once, coarse resolutions first ([`Matcher::rough`]), so that a rival shows as well.
//! Places are recognised by what they look like from above, drawn to the scale at which those of the plane are compared.

use crate::cascade::{Finding, VerifySettings};
use crate::places::PlaceIndex;
use crate::submaps::{Closes, ClosingPolicy, Submaps, Window};
use crate::views::View;
use mapwright_geom::{Pose, Pose3};
use mapwright_record::{Evidence, NodeId, Objection};
use mapwright_sensor::SpaceSweep;
use mapwright_voxel::{
    Change, Descent, Fit, Matcher, PointColumns, Prior, RangeImage, Seen, SurfelMap, SurfelMapSettings, Thinner,
};
use nalgebra::{Matrix6, Vector6};
use rustc_hash::FxHashMap;
use std::f64::consts::PI;

/// Points of a submap lie so far apart, of the smallest voxel's side.
const POINT_SHARE: f64 = 0.8;
/// Starts of a search lie so far apart: of the largest voxel's side along the ground and up, and radians.
const START_SHARE: f64 = 0.75;
const START_UP_SHARE: f64 = 0.5;
const START_RAD: f64 = 0.35;
/// and are so many at most, of them so many above and below.
const STARTS_AT_MOST: i32 = 400;
const UP_AT_MOST: i32 = 3;
/// Poses that are compared in the end; one elsewhere is farther than so many smallest voxels, or radians.
const COMPARED: usize = 3;
const ELSEWHERE_VOXELS: f64 = 4.0;
const ELSEWHERE_RAD: f64 = 0.3;
/// What places look like is compared up to 8 m ([`PlaceIndex`]); that stands for so many rms ranges here.
const DESCRIBED_RANGES: f64 = 1.5;
const DESCRIBED_M: f64 = 8.0;
/// Places are described by what stands: where the points over a square of such a side, metres at the scale of the plane, lie at heights so
/// many sides apart. Floors and ceilings say nothing.
const STANDS_ON_M: f64 = 0.3;
const STANDS_SIDES: f64 = 2.0;
/// Share of points seen through up to which submaps are of one place, beside so many times that which each has seen through of its own, which
/// is what moves, glass, and edges: of right closures it is 0.4 % in simulated buildings and 6 times its own in a hall with people, where a
/// ring of corridors is laid on itself turned by 180 degrees 5 to 16 % and 30 times its own (docs/decisions/0044-two-sides-in-space.md).
const SEEN_THROUGH: f64 = 0.01;
const SEEN_THROUGH_TIMES: f64 = 6.0;
/// A robot at a place that looks like this one is within so many rms ranges of where that was seen from.
const LIKENESS_RANGES: f64 = 0.5;

/// Submaps of clouds.
#[derive(Debug, Clone)]
pub struct SpaceSubmaps {
    map: SurfelMapSettings,
    /// Root mean square of the sensor's ranges, metres.
    range_m: f64,
    verify: VerifySettings,
    matcher: Matcher,
    scored: u64,
}

/// A submap of clouds.
#[derive(Debug, Clone)]
pub struct SpaceSubmap {
    map: SurfelMap,
    /// Points, and where each was seen from.
    points: PointColumns,
    /// Where each view's sensor was, a frame at it from the submap's, and what it saw.
    views: Vec<(Pose3, RangeImage)>,
}

impl SpaceSubmaps {
    /// Submaps of such maps, of a sensor that sees so far, root mean square, metres.
    #[must_use]
    pub fn new(map: SurfelMapSettings, range_m: f64, verify: VerifySettings) -> Self {
        Self { map, range_m, verify, matcher: Matcher::default(), scored: 0 }
    }

    /// Poses over the window, the middle first.
    fn starts(&self, window: &Window<Pose3>) -> Vec<Pose3> {
        let coarsest_m = self.map.coarsest_m();
        let half_rad = window.half_width_rad.min(PI);
        let reach = |half: f64, step: f64| ((half / step).floor() as i32).min(STARTS_AT_MOST);
        let mut along = reach(window.half_width_m, START_SHARE * coarsest_m);
        let up = reach(window.half_height_m, START_UP_SHARE * coarsest_m).min(UP_AT_MOST);
        let mut around = reach(half_rad, START_RAD);
        let steps = |either_side: i32| i64::from(2 * either_side + 1);
        let count = |along: i32, around: i32| steps(along).pow(2) * steps(up) * steps(around);
        while count(along, around) > i64::from(STARTS_AT_MOST) && (along > 0 || around > 0) {
            // A window too wide for all is searched more coarsely, the way first.
            if along > 2 || around == 0 { along -= 1 } else { around -= 1 }
        }
        let step = |half: f64, count: i32| if count > 0 { half / f64::from(count) } else { 0.0 };
        let (step_m, step_rad) = (step(window.half_width_m, along), step(half_rad, around));
        let up_m = step(window.half_height_m, up);
        let mut starts = vec![window.target_from_query];
        for (x, y) in (-along..=along).flat_map(|x| (-along..=along).map(move |y| (x, y))) {
            for (z, k) in (-up..=up).flat_map(|z| (-around..=around).map(move |k| (z, k))) {
                if (x, y, z, k) != (0, 0, 0, 0) {
                    let turn = Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, step_rad * f64::from(k));
                    let aside = [step_m * f64::from(x), step_m * f64::from(y), up_m * f64::from(z)];
                    starts.push(window.target_from_query.moved(aside) * Pose3::exp(turn));
                }
            }
        }
        starts
    }

    fn is_elsewhere(&self, a: Pose3, b: Pose3) -> bool {
        a.distance(b) > ELSEWHERE_VOXELS * self.map.resolution_m || a.between(b).angle() > ELSEWHERE_RAD
    }

    /// What stands around a keyframe as seen from above, at the scale of places in the plane.
    fn seen_from_above(&self, views: &[View<SpaceSweep>]) -> Vec<[f64; 2]> {
        let scale = DESCRIBED_M / (DESCRIBED_RANGES * self.range_m);
        let mut heights = FxHashMap::<[i64; 2], [f64; 2]>::default();
        let mut ends = Vec::new();
        for view in views {
            let rotation = view.submap_from_keyframe.rotation.to_rotation_matrix();
            for point in view.sweep.points_m() {
                let at =
                    rotation * nalgebra::Vector3::from(point.map(f64::from)) + view.submap_from_keyframe.translation;
                let [x, y, z] = [scale * at.x, scale * at.y, scale * at.z];
                let [low, high] = heights.entry(square([x, y])).or_insert([z, z]);
                (*low, *high) = (low.min(z), high.max(z));
                ends.push([x, y]);
            }
        }
        let stands = |at: &[f64; 2]| {
            heights.get(&square(*at)).is_some_and(|[low, high]| high - low >= STANDS_SIDES * STANDS_ON_M)
        };
        ends.retain(stands);
        ends
    }
}

/// The square of ground on which something stands.
fn square(at: [f64; 2]) -> [i64; 2] {
    at.map(|v| (v / STANDS_ON_M).floor() as i64)
}

impl Closes for SpaceSweep {
    type Submaps = SpaceSubmaps;
}

impl Submaps for SpaceSubmaps {
    type Measurement = SpaceSweep;
    type Submap = SpaceSubmap;
    type Places = PlaceIndex;

    /// A sensor sees all around, and who comes to an old place from elsewhere has seen on a longer way what nobody saw from there, which speaks
    /// against the place; storeys above each other, too, are told apart better (docs/decisions/0023-space.md). Storeys look
    /// alike from end to end, four standard deviations apart after a kilometre: there agreement tells nothing, the chain alone tells them apart,
    /// and the 99 % quantile of six degrees of freedom holds. 99.99 %: 27.9.
    const POLICY: ClosingPolicy = ClosingPolicy {
        query_m: 4.0,
        doubts_chain: false,
        contradicts_chi2: 16.8,
        match_contradicts_chi2: 16.8,
        strained_chi2: 33.0,
    };

    fn draw(&self, views: &[View<SpaceSweep>]) -> SpaceSubmap {
        let mut map = SurfelMap::new(self.map);
        let (mut all, mut points) = (PointColumns::default(), Vec::<[f32; 3]>::new());
        for view in views {
            points.clear();
            points.extend(view.sweep.points_m());
            map.draw(&points, view.sweep.origin_m(), view.submap_from_keyframe, Change::Add, 0);
            let rotation = view.submap_from_keyframe.rotation.to_rotation_matrix();
            let in_submap = |point: [f64; 3]| {
                let at = rotation * nalgebra::Vector3::from(point) + view.submap_from_keyframe.translation;
                [at.x as f32, at.y as f32, at.z as f32]
            };
            all.points_m.extend(points.iter().map(|point| in_submap(point.map(f64::from))));
            all.origins_m.resize(all.points_m.len(), in_submap(view.sweep.origin_m()));
        }
        map.refresh();
        let mut thinned = PointColumns::default();
        Thinner::default().thin_columns(&all, POINT_SHARE * self.map.resolution_m, &mut thinned);
        let seen = |view: &View<SpaceSweep>| {
            let origin_m = view.sweep.origin_m();
            let keyframe_from_sensor = Pose3 { translation: origin_m.into(), ..Pose3::identity() };
            let from_sensor = |point: [f32; 3]| [0, 1, 2].map(|axis| point[axis] - origin_m[axis] as f32);
            (
                (view.submap_from_keyframe * keyframe_from_sensor).inverse(),
                RangeImage::of(view.sweep.points_m().map(from_sensor)),
            )
        };
        SpaceSubmap { map, points: thinned, views: views.iter().map(seen).collect() }
    }

    fn look_for(&mut self, query: &SpaceSubmap, target: &SpaceSubmap, window: &Window<Pose3>) -> Finding<Pose3> {
        let mut evidence = Evidence { points: query.points.points_m.len() as u32, ..Evidence::default() };
        let starts = self.starts(window);
        self.scored = starts.len() as u64;
        // The window is no measurement; it only must not be left by far.
        let wide_m = [window.half_width_m, window.half_height_m].map(|half| half.max(self.map.resolution_m));
        let wide_rad = window.half_width_rad.max(0.05);
        let [linear, upright, angular] = [wide_m[0], wide_m[1], wide_rad].map(|wide| 1.0 / (4.0 * wide * wide));
        let diagonal = Vector6::new(linear, linear, upright, angular, angular, angular);
        let information = Matrix6::from_diagonal(&diagonal);
        let prior = Prior { map_from_cloud: window.target_from_query, information };
        let rough = self.matcher.rough(&target.map, query.seen(), &prior, starts.into_iter(), Descent::Whole, COMPARED);
        let mut fits: Vec<Fit> =
            rough.into_iter().map(|start| self.matcher.climb(&target.map, query.seen(), &prior, start)).collect();
        fits.sort_by(|a, b| b.log_likelihood.total_cmp(&a.log_likelihood));
        let Some(&best) = fits.first().filter(|best| share(best) >= self.verify.least_score) else {
            return Finding::none(evidence, Objection::NoMatch);
        };
        evidence.score = Some(share(&best));
        let rivals = fits.iter().filter(|fit| self.is_elsewhere(fit.map_from_cloud, best.map_from_cloud));
        let rival = rivals.map(|fit| fit.log_likelihood).fold(0.0, f64::max);
        evidence.ambiguity = Some(if best.log_likelihood > 0.0 { rival / best.log_likelihood } else { 1.0 });
        let target_from_query = best.map_from_cloud;
        let back = self.matcher.judge(&query.map, target.seen(), target_from_query.inverse());
        evidence.overlap = Some(best.known_share.max(back.known_share));
        evidence.inlier_share = Some(best.inlier_share.min(back.inlier_share));
        let resolution_m = self.map.resolution_m;
        let there = target.seen_through(&query.points.points_m, target_from_query, resolution_m);
        let here = query.seen_through(&target.points.points_m, target_from_query.inverse(), resolution_m);
        evidence.contradiction = Some(there.max(here));
        let covariance = self.verify.covariance(&best.information);
        let objection = self.verify.objection(&evidence, &covariance);
        let is_contradicted = || there.max(here) > most_seen_through(query, target, resolution_m);
        let objection = objection.or_else(|| is_contradicted().then_some(Objection::Contradiction));
        Finding { target_from_query: Some(target_from_query), covariance, evidence, objection }
    }

    fn fit_at(&mut self, query: &SpaceSubmap, target: &SpaceSubmap, target_from_query: Pose3) -> Finding<Pose3> {
        let half_width_m = self.map.resolution_m;
        let window = Window { target_from_query, half_width_m, half_height_m: half_width_m, half_width_rad: 0.0 };
        self.look_for(query, target, &window)
    }

    fn scored(&self) -> u64 {
        self.scored
    }

    fn remember(&self, places: &mut PlaceIndex, node: NodeId, views: &[View<SpaceSweep>]) {
        places.add(node, &self.seen_from_above(views));
    }

    fn remembered(places: &PlaceIndex) -> &[NodeId] {
        places.nodes()
    }

    fn alike(
        &self,
        places: &mut PlaceIndex,
        views: &[View<SpaceSweep>],
        at_most: usize,
        allow: impl Fn(NodeId) -> bool,
    ) -> Vec<(NodeId, Window<Pose3>)> {
        let half_width_m = LIKENESS_RANGES * self.range_m;
        let hits = places.query(&self.seen_from_above(views), at_most, allow);
        // What places look like from above tells where, and not surely enough how the robot was turned there.
        let window = Window {
            target_from_query: Pose3::identity(),
            half_width_m,
            half_height_m: half_width_m,
            half_width_rad: PI,
        };
        hits.iter().map(|hit| (hit.node, window)).collect()
    }
}

/// Share of points that two submaps of one place may have seen through of each other.
fn most_seen_through(query: &SpaceSubmap, target: &SpaceSubmap, resolution_m: f64) -> f64 {
    let own = |submap: &SpaceSubmap| submap.seen_through(&submap.points.points_m, Pose3::identity(), resolution_m);
    SEEN_THROUGH + SEEN_THROUGH_TIMES * own(query).max(own(target))
}

/// Of all points those that are known and fit.
fn share(fit: &Fit) -> f64 {
    fit.known_share * fit.inlier_share
}

impl SpaceSubmap {
    fn seen(&self) -> Seen<'_> {
        let PointColumns { points_m, origins_m, .. } = &self.points;
        Seen { points_m, times_s: &[], origins_m, sigmas_m: &[] }
    }

    /// Share of points, of those in directions in which a view has seen something, that a view has seen through.
    fn seen_through(&self, points_m: &[[f32; 3]], submap_from_points: Pose3, resolution_m: f64) -> f64 {
        let (mut judged, mut through) = (vec![false; points_m.len()], vec![false; points_m.len()]);
        for (view_from_submap, seen) in &self.views {
            let view_from_points = *view_from_submap * submap_from_points;
            let rotation = view_from_points.rotation.to_rotation_matrix();
            for (number, point) in points_m.iter().enumerate() {
                let at = rotation * nalgebra::Vector3::from(point.map(f64::from)) + view_from_points.translation;
                if let Some(is_through) = seen.has_seen_through([at.x as f32, at.y as f32, at.z as f32], resolution_m) {
                    judged[number] = true;
                    through[number] |= is_through;
                }
            }
        }
        let count = |flags: &[bool]| flags.iter().filter(|flag| **flag).count() as f64;
        count(&through) / count(&judged).max(1.0)
    }
}

#[cfg(test)]
mod tests;
