//! A look at the place where a robot thinks it is.

use crate::settings::Settings;
use mapwright_geom::Pose2;
use mapwright_grid::{Matcher, MatcherSettings, SearchWindow};
use mapwright_loops::{
    Finding, PlaneSubmap, PlaneVerifier, SUBMAP_M, VerifySettings, View, WINDOW_M, WINDOW_RAD, views, views_along,
};
use mapwright_record::{NodeId, Past};

/// What is looked for where a robot was put down was seen on so much way, metres.
const LATELY_M: f64 = 2.5;

/// What was seen since the newest keyframe, in its frame, beside what was seen on the way there, as for a closure.
pub(super) fn look_back(
    settings: &Settings,
    past: Past<'_>,
    matcher: MatcherSettings,
    mut seen: Vec<View>,
) -> Option<Finding> {
    let newest = past.newest()?;
    let newest_from_last = seen.last()?.submap_from_keyframe;
    for view in &mut seen {
        view.submap_from_keyframe = newest_from_last.between(view.submap_from_keyframe);
    }
    let target = views_along(past, newest, false, SUBMAP_M);
    Some(look(settings, matcher, &target, &seen, newest_from_last))
}

/// What was seen lately by a robot that maps provisionally, beside what was seen around an old keyframe; `at_from_newest` is where
/// its newest keyframe is thought to be.
pub(super) fn look_around(
    settings: &Settings,
    past: Past<'_>,
    matcher: MatcherSettings,
    at: NodeId,
    provisional: Past<'_>,
    at_from_newest: Pose2,
) -> Option<Finding> {
    let newest = provisional.newest()?;
    let seen = views(provisional, newest, false, LATELY_M, |node| provisional.step_m(node));
    Some(look(settings, matcher, &views_along(past, at, true, SUBMAP_M), &seen, at_from_newest))
}

/// How what was seen fits near where it is thought to be, whatever its score.
fn look(
    settings: &Settings,
    matcher: MatcherSettings,
    target: &[View],
    seen: &[View],
    target_from_seen: Pose2,
) -> Finding {
    let submaps = settings.submaps();
    let [target, query] = [target, seen].map(|views| PlaneSubmap::new(views, &submaps));
    let window =
        SearchWindow { world_from_robot: target_from_seen, half_width_m: WINDOW_M, half_width_rad: WINDOW_RAD };
    let settings = VerifySettings { least_score: 0.0, ..VerifySettings::default() };
    PlaneVerifier::new(settings, Matcher { settings: matcher }).look_for(&query, &target, &window)
}
