//! A look at the place where a robot thinks it still is.

use super::{Closing, Past, SUBMAP_M, WINDOW_M, WINDOW_RAD, submaps};
use crate::settings::Settings;
use mapwright_grid::{Matcher, MatcherSettings, SearchWindow};
use mapwright_loops::{Finding, Submap, Verifier, VerifySettings, View};

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
        let submaps = submaps(settings);
        let target = Submap::new(&self.views(past, newest, false, SUBMAP_M), &submaps);
        let query = Submap::new(&seen, &submaps);
        let window =
            SearchWindow { world_from_robot: newest_from_last, half_width_m: WINDOW_M, half_width_rad: WINDOW_RAD };
        let settings = VerifySettings { least_score: 0.0, ..VerifySettings::default() };
        Some(Verifier::new(settings, Matcher { settings: matcher }).look_for(&query, &target, &window))
    }
}
