//! What was seen along the way: keyframes' measurements at their places.

use mapwright_geom::Pose;
use mapwright_record::{Measurement, NodeId, Past};
use mapwright_sensor::Sweep;
use std::sync::Arc;

/// Views of a submap lie so far apart at least: metres or radians.
const VIEW_M: f64 = 0.4;
const VIEW_RAD: f64 = 0.35;
/// Views of a submap at most, to one side.
const VIEWS_AT_MOST: usize = 40;

/// What a submap is made of: a keyframe's measurement at its place.
#[derive(Debug, Clone)]
pub struct View<M: Measurement = Sweep> {
    /// What the sensor saw.
    pub sweep: Arc<M>,
    /// Where from.
    pub submap_from_keyframe: M::Pose,
}

/// Keyframes along the way around `at`, as [`views`], by the length of the way.
#[must_use]
pub fn views_along<M: Measurement>(past: Past<'_, M>, at: NodeId, both_sides: bool, reach_m: f64) -> Vec<View<M>> {
    views(past, at, both_sides, reach_m, |node| past.way_m[node] - past.way_m[node - 1])
}

/// Keyframes up to so many metres along the way around `at`, in its frame, before it and, if so wished, after it; `step_m` is the
/// way to a keyframe from the one before.
#[must_use]
pub fn views<M: Measurement>(
    past: Past<'_, M>,
    at: NodeId,
    both_sides: bool,
    reach_m: f64,
    step_m: impl Fn(usize) -> f64,
) -> Vec<View<M>> {
    let at = at.index();
    let submap_from_local = past.local_from_keyframe[at].inverse();
    let mut views = Vec::new();
    let mut side = |nodes: &mut dyn Iterator<Item = (usize, f64)>| {
        let (mut way_m, mut last, mut taken) = (0.0, None::<M::Pose>, 0);
        for (node, step_m) in nodes {
            way_m += step_m;
            if way_m > reach_m || taken >= VIEWS_AT_MOST {
                break;
            }
            let pose = past.local_from_keyframe[node];
            let far = |last: M::Pose| last.distance(pose) >= VIEW_M || last.between(pose).angle() >= VIEW_RAD;
            if let Some(sweep) = past.drawn[node].as_ref().filter(|_| last.is_none_or(far)) {
                (last, taken) = (Some(pose), taken + 1);
                views.push(View { sweep: Arc::clone(sweep), submap_from_keyframe: submap_from_local * pose });
            }
        }
    };
    side(&mut (0..=at).rev().map(|node| (node, if node == at { 0.0 } else { step_m(node + 1) })));
    if both_sides {
        side(&mut (at + 1..past.local_from_keyframe.len()).map(|node| (node, step_m(node))));
    }
    views
}
