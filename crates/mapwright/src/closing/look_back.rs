//! A look at the place where a robot thinks it is.

use super::{Closing, Past, SUBMAP_M, WINDOW_M, WINDOW_RAD, submaps, views};
use crate::settings::Settings;
use mapwright_geom::Pose2;
use mapwright_grid::{Matcher, MatcherSettings, SearchWindow};
use mapwright_loops::{Finding, Submap, Verifier, VerifySettings, View};

/// What is looked for where a robot has arrived was seen on so much way, metres.
const LATELY_M: f64 = 2.5;

impl Closing {
    /// What was seen since the newest keyframe, in its frame, beside what was seen on the way there, as for a closure.
    pub(crate) fn look_back(
        &self,
        settings: &Settings,
        past: Past<'_>,
        matcher: MatcherSettings,
        mut seen: Vec<View>,
    ) -> Option<Finding> {
        let newest = past.keyframes.len().checked_sub(1)? as u32;
        let newest_from_last = seen.last()?.submap_from_keyframe;
        for view in &mut seen {
            view.submap_from_keyframe = newest_from_last.between(view.submap_from_keyframe);
        }
        let target = self.views(past, newest, false, SUBMAP_M);
        Some(look(settings, matcher, &target, &seen, newest_from_last))
    }

    /// What was seen lately by a robot that maps aside, beside what was seen around an old keyframe; `at_from_newest` is where
    /// its newest keyframe is thought to be.
    pub(crate) fn look_around(
        &self,
        settings: &Settings,
        past: Past<'_>,
        matcher: MatcherSettings,
        at: u32,
        aside: Past<'_>,
        at_from_newest: Pose2,
    ) -> Option<Finding> {
        let newest = aside.keyframes.len().checked_sub(1)? as u32;
        let step_m = |node: usize| aside.local_from_keyframe[node - 1].distance(aside.local_from_keyframe[node]);
        let seen = views(aside, newest, false, LATELY_M, step_m);
        Some(look(settings, matcher, &self.views(past, at, true, SUBMAP_M), &seen, at_from_newest))
    }
}

/// How what was seen fits near where it is thought to be, whatever its score.
fn look(
    settings: &Settings,
    matcher: MatcherSettings,
    target: &[View],
    seen: &[View],
    target_from_seen: Pose2,
) -> Finding {
    let submaps = submaps(settings);
    let [target, query] = [target, seen].map(|views| Submap::new(views, &submaps));
    let window =
        SearchWindow { world_from_robot: target_from_seen, half_width_m: WINDOW_M, half_width_rad: WINDOW_RAD };
    let settings = VerifySettings { least_score: 0.0, ..VerifySettings::default() };
    Verifier::new(settings, Matcher { settings: matcher }).look_for(&query, &target, &window)
}
