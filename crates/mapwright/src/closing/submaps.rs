//! What was seen along the way, as submaps.

use crate::settings::Settings;
use crate::store::{NodeId, Past};
use mapwright_geom::Pose2;
use mapwright_loops::{SubmapSettings, View};
use mapwright_sensor::{BeamTable, SweepPoints};
use std::sync::Arc;

/// Length of way that makes a submap, to one side, metres.
pub(super) const SUBMAP_M: f64 = 8.0;
/// Views of a submap lie so far apart at least: metres or radians.
const VIEW_M: f64 = 0.4;
const VIEW_RAD: f64 = 0.35;
/// Views of a submap at most, to one side.
const VIEWS_AT_MOST: usize = 40;
/// Points farther off are not compared, cells.
const REACH_CELLS: f64 = 300.0;

/// How submaps are drawn.
pub(super) fn submaps(settings: &Settings) -> SubmapSettings {
    SubmapSettings {
        resolution_m: settings.map.resolution_m,
        passes_per_hit: settings.map.passes_per_hit,
        free_range_m: settings.scan.free_range_m,
        reach_m: REACH_CELLS * settings.map.resolution_m,
        thin_cells: 2,
    }
}

/// End points of views, in their submap's frame.
pub(super) fn end_points(views: &[View]) -> Vec<[f64; 2]> {
    let (mut points, mut table, mut ends) = (SweepPoints::default(), BeamTable::default(), Vec::new());
    for view in views {
        points.fill(&view.sweep, &mut table, 0.0);
        ends.extend(points.hits.iter().map(|&hit| view.submap_from_keyframe.transform(hit)));
    }
    ends
}

/// Keyframes along the way around `at`, as [`views`], by the length of the way.
pub(super) fn views_along(past: Past<'_>, at: NodeId, both_sides: bool, reach_m: f64) -> Vec<View> {
    views(past, at, both_sides, reach_m, |node| past.way_m[node] - past.way_m[node - 1])
}

/// Keyframes along the way around `at`, before it and, if so wished, after it; `step_m` is the way to a keyframe from the
/// one before.
pub(super) fn views(
    past: Past<'_>,
    at: NodeId,
    both_sides: bool,
    reach_m: f64,
    step_m: impl Fn(usize) -> f64,
) -> Vec<View> {
    let at = at as usize;
    let submap_from_local = past.local_from_keyframe[at].inverse();
    let mut views = Vec::new();
    let mut side = |nodes: &mut dyn Iterator<Item = (usize, f64)>| {
        let (mut way_m, mut last, mut taken) = (0.0, None::<Pose2>, 0);
        for (node, step_m) in nodes {
            way_m += step_m;
            if way_m > reach_m || taken >= VIEWS_AT_MOST {
                break;
            }
            let pose = past.local_from_keyframe[node];
            let far = |last: Pose2| last.distance(pose) >= VIEW_M || last.between(pose).theta.abs() >= VIEW_RAD;
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
