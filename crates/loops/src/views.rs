//! What was seen along the way: keyframes' measurements at their places.

use mapwright_geom::Pose;
use mapwright_record::{Measurement, NodeId, Past};
use mapwright_sensor::Sweep;
use std::sync::Arc;

/// Views of a submap by one sensor lie so far apart at least: metres or radians.
const VIEW_M: f64 = 0.4;
const VIEW_RAD: f64 = 0.35;
/// Views of a submap by one sensor at most, to one side.
const VIEWS_AT_MOST: usize = 40;

/// What a submap is made of: a keyframe's measurement at its place.
#[derive(Debug, Clone)]
pub struct View<M: Measurement = Sweep> {
    /// What the sensor saw.
    pub sweep: Arc<M>,
    /// Where from.
    pub submap_from_keyframe: M::Pose,
}

/// What was taken of one sensor: how many views, and where the last one was.
struct Taken<'a, M: Measurement> {
    last: &'a M,
    at: M::Pose,
    views: usize,
}

/// Keyframes along the way around `at`, as [`views`], by the length of the way.
#[must_use]
pub fn views_along<M: Measurement>(past: Past<'_, M>, at: NodeId, both_sides: bool, reach_m: f64) -> Vec<View<M>> {
    views(past, at, both_sides, reach_m, |from, to| past.way_m[to] - past.way_m[from])
}

/// Keyframes along the way up to `at`, as [`views_along`], where `pose_of` has them.
pub(crate) fn views_up_to<M: Measurement>(
    past: Past<'_, M>,
    at: NodeId,
    reach_m: f64,
    pose_of: impl Fn(usize) -> M::Pose,
) -> Vec<View<M>> {
    views_at(past, at, false, reach_m, |from, to| past.way_m[to] - past.way_m[from], pose_of)
}

/// Keyframes up to so many metres along the way around `at`, in its frame, before it and, if so wished, after it; `step_m` is the
/// way from a keyframe to the next.
#[must_use]
pub fn views<M: Measurement>(
    past: Past<'_, M>,
    at: NodeId,
    both_sides: bool,
    reach_m: f64,
    step_m: impl Fn(usize, usize) -> f64,
) -> Vec<View<M>> {
    views_at(past, at, both_sides, reach_m, step_m, |node| past.local_from_keyframe[node])
}

fn views_at<M: Measurement>(
    past: Past<'_, M>,
    at: NodeId,
    both_sides: bool,
    reach_m: f64,
    step_m: impl Fn(usize, usize) -> f64,
    pose_of: impl Fn(usize) -> M::Pose,
) -> Vec<View<M>> {
    let submap_from_local = pose_of(at.index()).inverse();
    let mut views = Vec::new();
    let mut side = |nodes: &mut dyn Iterator<Item = (usize, f64)>| {
        let (mut way_m, mut sensors) = (0.0, Vec::<Taken<'_, M>>::new());
        for (node, step_m) in nodes {
            way_m += step_m;
            let is_full = !sensors.is_empty() && sensors.iter().all(|sensor| sensor.views >= VIEWS_AT_MOST);
            if way_m > reach_m || is_full {
                break;
            }
            let Some(sweep) = past.drawn[node].as_ref() else { continue };
            let pose = pose_of(node);
            let far = |last: M::Pose| last.distance(pose) >= VIEW_M || last.between(pose).angle() >= VIEW_RAD;
            match sensors.iter_mut().find(|sensor| sensor.last.is_of_one_sensor_with(sweep)) {
                Some(sensor) if sensor.views >= VIEWS_AT_MOST || !far(sensor.at) => continue,
                Some(sensor) => (sensor.at, sensor.views) = (pose, sensor.views + 1),
                None => sensors.push(Taken { last: sweep, at: pose, views: 1 }),
            }
            views.push(View { sweep: Arc::clone(sweep), submap_from_keyframe: submap_from_local * pose });
        }
    };
    let back = std::iter::successors(Some((at, 0.0)), |&(node, _)| {
        past.before(node).map(|before| (before, step_m(before.index(), node.index())))
    });
    side(&mut back.map(|(node, step_m)| (node.index(), step_m)));
    if both_sides {
        let next = |node: NodeId| past.after(node).map(|next| (next, step_m(node.index(), next.index())));
        let ahead = std::iter::successors(next(at), |&(node, _)| next(node));
        side(&mut ahead.map(|(node, step_m)| (node.index(), step_m)));
    }
    views
}
