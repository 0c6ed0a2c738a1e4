//! All that is known as one coarse map, and what was seen lately looked for in the whole of it.
//!
//! The search is exact (branch and bound over every position within the map's bounds and every heading), so a place that
//! explains what was seen nearly as well as the best one does not go unnoticed: it is the rival.

use crate::plane_submap::{PlaneSubmap, PlaneSubmapSettings, draw};
use crate::views::View;
use mapwright_geom::Pose2;
use mapwright_grid::{
    Agreement, CorrelativeSearch, LocalMap, Matcher, Peak, Prior, SearchSettings, SearchWindow, Separation,
};
use mapwright_sensor::{BeamTable, SweepPoints};
use std::cell::Cell;
use std::f64::consts::PI;
use std::sync::Arc;

/// The atlas' cells are so many times those of a submap: the search is for the place, the exact pose comes later.
const COARSER: f64 = 2.0;
/// Who sees known ground stands so near to where it was seen from, metres.
const MARGIN_M: f64 = 3.0;
/// Points that are looked for at most, and how far they may lie, metres.
const POINTS: usize = 100;
const SEARCHED_M: f64 = 10.0;
/// What the search gives for a point on an obstacle.
const FULL_SCORE: u32 = 255;
/// No place fits worse than this share of the full score: who is on known ground knows most of what it sees.
const LEAST_SCORE: f64 = 0.75;
/// Half a turn counts as so many metres where the nearest view is looked for: what matters is to have looked the same way.
const HALF_TURN_M: f64 = 1.5;
/// Two obstacles are one within such a squared distance, cells.
const ON_OBSTACLE_CELLS2: u32 = 9;
/// Views on either side of one at most.
const VIEWS_AT_MOST: usize = 40;

/// A pose of the submap that was looked for in the map, and its share of the full score.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Pose of the submap in the map.
    pub map_from_query: Pose2,
    /// 0 to 1.
    pub score: f64,
}

/// How much may still be searched for: poses and blocks of poses scored ([`CorrelativeSearch::scored`]).
#[derive(Debug, Clone)]
pub struct Effort(Cell<u64>);

impl Effort {
    /// So much.
    #[must_use]
    pub fn new(scored: u64) -> Self {
        Self(Cell::new(scored))
    }

    /// What is left of it.
    #[must_use]
    pub fn left(&self) -> u64 {
        self.0.get()
    }

    /// Whether nothing is left: what was looked for last was cut short.
    #[must_use]
    pub fn is_spent(&self) -> bool {
        self.left() == 0
    }

    fn spend(&self, scored: u64) {
        self.0.set(self.left().saturating_sub(scored));
    }
}

/// All that is known: a coarse map of it, and the views it is made of.
#[derive(Debug, Clone)]
pub struct Atlas {
    /// In the order of the way.
    views: Vec<View>,
    map: LocalMap,
    middle: Pose2,
    half_width_m: f64,
}

impl Atlas {
    /// Draws views, given along the way, whose `submap_from_keyframe` are poses in the map.
    #[must_use]
    pub fn new(views: Vec<View>, submaps: &PlaneSubmapSettings) -> Self {
        let coarser = PlaneSubmapSettings { resolution_m: COARSER * submaps.resolution_m, ..*submaps };
        let (map, _) = draw(&views, &coarser);
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for Pose2 { x, y, .. } in views.iter().map(|view| view.submap_from_keyframe) {
            low = [low[0].min(x), low[1].min(y)];
            high = [high[0].max(x), high[1].max(y)];
        }
        let middle = Pose2::new(0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), 0.0);
        let half_width_m = 0.5 * (high[0] - low[0]).max(high[1] - low[1]) + MARGIN_M;
        Self { views, map, middle, half_width_m }
    }

    /// Where in all that is known a submap fits best; `None` where nothing fits, or where the effort is spent before that is known.
    #[must_use]
    pub fn find(&self, query: &PlaneSubmap, effort: &Effort) -> Option<Sighting> {
        self.search(query, effort, (LEAST_SCORE, 1.0), None, |_| false)
    }

    /// Calls with the places other than the `best` one that score at least such a share of it, best first, until told to
    /// stop or the effort is spent.
    pub fn rivals(
        &self,
        query: &PlaneSubmap,
        effort: &Effort,
        best: &Sighting,
        least_share: f64,
        mut go_on: impl FnMut(&Sighting) -> bool,
    ) {
        // A hair less, so that the best is found once more.
        let least_score = best.score * (1.0 - 1e-9);
        let shares = (least_score, least_share);
        let _ = self.search(query, effort, shares, Some(Separation::default()), |rival| go_on(&rival));
    }

    /// Places that score at least `least_score` of the full score and `least_share` of what the best does, at least a metre or
    /// 20 degrees apart, best first.
    #[must_use]
    pub fn sightings(
        &self,
        query: &PlaneSubmap,
        effort: &Effort,
        (least_score, least_share): (f64, f64),
        at_most: usize,
    ) -> Vec<Sighting> {
        let mut sightings = Vec::new();
        let separation = Separation { distance_m: 1.0, ..Separation::default() };
        let best = self.search(query, effort, (least_score, least_share), Some(separation), |rival| {
            sightings.push(rival);
            sightings.len() + 1 < at_most
        });
        best.into_iter().chain(sightings).take(at_most).collect()
    }

    /// The pose of a submap near one where it was sighted that fits best by all its points, and how it fits there.
    #[must_use]
    pub fn refine(&self, query: &PlaneSubmap, map_from_query: Pose2, matcher: &mut Matcher) -> (Pose2, Agreement) {
        let prior = Prior { world_from_robot: map_from_query, variances: [1.0, 1.0, 0.1], tail: 1e8 };
        let refined = matcher.gauss_newton(&self.map, &query.hits, &prior, map_from_query).world_from_robot;
        (refined, self.map.agreement(&query.hits, refined))
    }

    /// Share of views of which at least such a share of the end points lies on known ground, where their map lies in this one
    /// as stated.
    #[must_use]
    pub fn share_on_known_ground<'a>(
        &self,
        views: impl IntoIterator<Item = &'a View>,
        map_from_views: Pose2,
        least_share: f64,
    ) -> f64 {
        let (mut points, mut table) = (SweepPoints::default(), BeamTable::default());
        let (mut all, mut known) = (0_u32, 0_u32);
        for view in views {
            points.fill(&view.sweep, &mut table, 0.0);
            let agreement = self.map.agreement(&points.hits, map_from_views * view.submap_from_keyframe);
            all += 1;
            known += u32::from(agreement.known_share() >= least_share);
        }
        if all == 0 { 0.0 } else { f64::from(known) / f64::from(all) }
    }

    fn search(
        &self,
        query: &PlaneSubmap,
        effort: &Effort,
        (least_share, least_rival_share): (f64, f64),
        separation: Option<Separation>,
        mut go_on: impl FnMut(Sighting) -> bool,
    ) -> Option<Sighting> {
        if effort.is_spent() {
            return None;
        }
        let within = |p: &&[f64; 2]| p[0] * p[0] + p[1] * p[1] <= SEARCHED_M * SEARCHED_M;
        let every = query.hits.iter().filter(within).count().div_ceil(POINTS).max(1);
        let points: Vec<[f64; 2]> = query.hits.iter().filter(within).step_by(every).copied().collect();
        let sigma_m = SearchSettings::default().sigma_m.max(self.map.settings.resolution_m);
        let settings =
            SearchSettings { sigma_m, reach_m: SEARCHED_M, least_share, least_rival_share, most_scored: effort.left() };
        let Self { middle: world_from_robot, half_width_m, .. } = *self;
        let window = SearchWindow { world_from_robot, half_width_m, half_width_rad: PI };
        let full = f64::from(FULL_SCORE) * points.len() as f64;
        let sighting =
            |peak: Peak| Sighting { map_from_query: peak.world_from_robot, score: f64::from(peak.score) / full };
        let mut searcher = CorrelativeSearch::new(settings);
        let found = searcher.search_rivals(&self.map, &points, &window, separation, |rival| go_on(sighting(rival)));
        effort.spend(searcher.scored());
        Some(sighting(found?.best))
    }

    /// The view, by its place among those the atlas was made of, from nearest a pose.
    #[must_use]
    pub fn nearest(&self, map_from_robot: Pose2) -> Option<usize> {
        let away_m = |view: &View| {
            let turn_rad = view.submap_from_keyframe.between(map_from_robot).theta.abs();
            view.submap_from_keyframe.distance(map_from_robot) + HALF_TURN_M / PI * turn_rad
        };
        let away_m: Vec<f64> = self.views.iter().map(away_m).collect();
        (0..away_m.len()).min_by(|&a, &b| away_m[a].total_cmp(&away_m[b]))
    }

    /// Share of another map's obstacles that stand on obstacles of this one, where the other lies in it as stated.
    #[must_use]
    pub fn share_of(&self, other: &Self, map_from_other: Pose2) -> f64 {
        let side_m = self.map.settings.resolution_m;
        let (mut all, mut known) = (0_u32, 0_u32);
        for cell in other.map.field().obstacles() {
            let [x, y] = <[i32; 2]>::from(cell).map(|at| (f64::from(at) + 0.5) * other.map.settings.resolution_m);
            let [x, y] = map_from_other.transform([x, y]).map(|m| (m / side_m).floor() as i32);
            all += 1;
            known += u32::from(self.map.field().nearest_cell(x, y).is_some_and(|(d2, _)| d2 <= ON_OBSTACLE_CELLS2));
        }
        if all == 0 { 0.0 } else { f64::from(known) / f64::from(all) }
    }

    /// Pose of a view in the map.
    #[must_use]
    pub fn map_from_view(&self, view: usize) -> Pose2 {
        self.views[view].submap_from_keyframe
    }

    /// The views along the way around one, up to so many metres before and after it, in its frame.
    #[must_use]
    pub fn around(&self, view: usize, reach_m: f64) -> Vec<View> {
        let view_from_map = self.map_from_view(view).inverse();
        let mut around = Vec::new();
        let mut side = |nodes: &mut dyn Iterator<Item = usize>| {
            let (mut way_m, mut last) = (0.0, self.map_from_view(view));
            for at in nodes.take(VIEWS_AT_MOST) {
                let View { sweep, submap_from_keyframe } = &self.views[at];
                way_m += last.distance(*submap_from_keyframe);
                if way_m > reach_m {
                    break;
                }
                last = *submap_from_keyframe;
                around.push(View { sweep: Arc::clone(sweep), submap_from_keyframe: view_from_map * last });
            }
        };
        side(&mut (0..=view).rev());
        side(&mut (view + 1..self.views.len()));
        around
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_sensor::Sweep;
    use mapwright_sim::{Drive, DriveSettings, worlds};

    const SUBMAPS: PlaneSubmapSettings =
        PlaneSubmapSettings { resolution_m: 0.05, passes_per_hit: 5, free_range_m: 8.0, reach_m: 15.0, thin_cells: 2 };

    fn all() -> Effort {
        Effort::new(u64::MAX)
    }

    #[test]
    fn a_search_that_is_cut_short_finds_nothing_and_says_so() {
        let views = drive();
        let (atlas, seen) = (Atlas::new(views.clone(), &SUBMAPS), query(&views, 40));
        let enough = Effort::new(1 << 40);
        assert!(atlas.find(&seen, &enough).is_some() && !enough.is_spent());
        let needed = (1 << 40) - enough.left();
        let little = Effort::new(needed - 1);
        assert!(atlas.find(&seen, &little).is_none() && little.is_spent());
        assert!(atlas.find(&seen, &little).is_none(), "nothing is left");
        assert!(atlas.sightings(&seen, &Effort::new(needed / 2), (0.4, 0.5), 6).is_empty());
    }

    /// What a drive through rooms has seen every second.
    fn drive() -> Vec<View> {
        let settings = DriveSettings { scan_rate_hz: 1.0, seed: 3, ..DriveSettings::default() };
        let scans = Drive::new(worlds::rooms(3).into(), settings).scans().take(120);
        let view = |scan: mapwright_sim::TrueScan| {
            let mut sweep = Sweep::empty(&scan.scan.laser);
            let _ = sweep.fill(&scan.scan, [0.0; 3], (0.1, 30.0));
            View { sweep: Arc::new(sweep), submap_from_keyframe: scan.world_from_robot }
        };
        scans.map(view).collect()
    }

    /// The last few views before one, in its frame.
    fn query(views: &[View], at: usize) -> PlaneSubmap {
        let here = views[at].submap_from_keyframe;
        let seen = views[at - 4..=at].iter().map(|view| View {
            sweep: Arc::clone(&view.sweep),
            submap_from_keyframe: here.between(view.submap_from_keyframe),
        });
        PlaneSubmap::new(&seen.collect::<Vec<_>>(), &SUBMAPS)
    }

    #[test]
    fn a_place_is_found_among_all() {
        let views = drive();
        let atlas = Atlas::new(views.clone(), &SUBMAPS);
        for at in (20..100).step_by(20) {
            let found = atlas.find(&query(&views, at), &all()).expect("it was there");
            let error = views[at].submap_from_keyframe.between(found.map_from_query);
            assert!(error.x.hypot(error.y) < 0.15 && error.theta.abs() < 0.03, "{error:?} at {at}");
            assert!(found.score > 0.9);
            let near = atlas.nearest(found.map_from_query).expect("there are views");
            assert!(atlas.map_from_view(near).distance(found.map_from_query) < 0.6);
            let around = atlas.around(near, 3.0);
            assert!(around.len() > 3 && around.len() < views.len());
            assert!(around[0].submap_from_keyframe.distance(Pose2::IDENTITY) < 1e-9);
        }
    }

    #[test]
    fn a_copy_of_a_place_is_its_rival() {
        let views = drive();
        let mut twice = views.clone();
        let away = Pose2::new(60.0, 10.0, 1.0);
        twice.extend(views.iter().map(|view| View {
            sweep: Arc::clone(&view.sweep),
            submap_from_keyframe: away * view.submap_from_keyframe,
        }));
        let [once, twice] = [views.clone(), twice].map(|views| Atlas::new(views, &SUBMAPS));
        let seen = query(&views, 60);
        let rivals = |atlas: &Atlas, least: f64| {
            let best = atlas.find(&seen, &all()).expect("it was there");
            let mut rivals = Vec::new();
            atlas.rivals(&seen, &all(), &best, least, |rival| {
                rivals.push(*rival);
                rivals.len() < 3
            });
            (best, rivals)
        };
        let alone = rivals(&once, 0.85).1;
        let (best, found) = rivals(&twice, 0.85);
        assert!(found.len() == alone.len() + 1 && found[0].score <= best.score, "{alone:?} {best:?} {found:?}");
        let here = views[60].submap_from_keyframe;
        let mut errors_m = [best, found[0]].map(|s| (away * here).distance(s.map_from_query));
        errors_m.sort_by(f64::total_cmp);
        assert!(errors_m[0] < 0.15 && (errors_m[1] - (away * here).distance(here)).abs() < 0.3, "{errors_m:?}");
    }

    #[test]
    fn the_share_that_is_known_is_that_of_the_way_shared() {
        let views = drive();
        let moved = Pose2::new(3.0, -2.0, 0.7);
        let part = |range: std::ops::Range<usize>| {
            let view = |view: &View| View {
                sweep: Arc::clone(&view.sweep),
                submap_from_keyframe: moved.inverse() * view.submap_from_keyframe,
            };
            Atlas::new(views[range].iter().map(view).collect(), &SUBMAPS)
        };
        let known = Atlas::new(views[..60].to_vec(), &SUBMAPS);
        let [inside, partly, outside] = [20..40, 40..90, 60..120].map(|range| known.share_of(&part(range), moved));
        assert!(inside > 0.95 && partly < inside && outside < partly, "{inside} {partly} {outside}");
        let away = Pose2::new(500.0, 0.0, 0.0) * moved;
        assert!(known.share_of(&part(20..40), away) == 0.0);
        assert!(known.share_of(&Atlas::new(Vec::new(), &SUBMAPS), moved) == 0.0);
    }

    #[test]
    fn sightings_are_told_best_first_and_refined_to_the_centimetre() {
        let views = drive();
        let atlas = Atlas::new(views.clone(), &SUBMAPS);
        let (seen, here) = (query(&views, 60), views[60].submap_from_keyframe);
        let sightings = atlas.sightings(&seen, &all(), (0.4, 0.5), 3);
        assert!(sightings.len() == 3 && sightings.is_sorted_by(|a, b| a.score >= b.score), "{sightings:?}");
        assert_eq!(Some(sightings[0]), atlas.find(&seen, &all()));
        for (k, a) in sightings.iter().enumerate() {
            let apart = |b: &Sighting| {
                let between = a.map_from_query.between(b.map_from_query);
                between.x.hypot(between.y) > 0.99 || between.theta.abs() > 0.34
            };
            assert!(sightings[k + 1..].iter().all(apart) && a.score >= 0.5 * sightings[0].score);
        }
        let (refined, agreement) = atlas.refine(&seen, sightings[0].map_from_query, &mut Matcher::default());
        let error = here.between(refined);
        assert!(error.x.hypot(error.y) < 0.02 && error.theta.abs() < 0.005, "{error:?}");
        assert!(agreement.inlier_share() > 0.95 && agreement.known_share() > 0.95, "{agreement:?}");
        assert!(atlas.sightings(&PlaneSubmap::new(&[], &SUBMAPS), &all(), (0.4, 0.5), 6).is_empty());
        assert!(atlas.sightings(&seen, &all(), (0.4, 0.5), 0).is_empty());
    }

    #[test]
    fn views_of_known_ground_are_told_from_those_of_other_ground() {
        let views = drive();
        let known = Atlas::new(views[..60].to_vec(), &SUBMAPS);
        let share =
            |range: std::ops::Range<usize>, moved: Pose2| known.share_on_known_ground(&views[range], moved, 0.9);
        let [inside, outside] = [20..40, 80..120].map(|range| share(range, Pose2::IDENTITY));
        assert!(inside == 1.0 && outside < 0.5, "{inside} {outside}");
        assert!(share(20..40, Pose2::new(500.0, 0.0, 0.0)) == 0.0 && share(0..0, Pose2::IDENTITY) == 0.0);
    }

    #[test]
    fn nothing_is_found_in_or_by_nothing() {
        let views = drive();
        let empty = Atlas::new(Vec::new(), &SUBMAPS);
        assert!(empty.find(&query(&views, 20), &all()).is_none() && empty.nearest(Pose2::IDENTITY).is_none());
        let atlas = Atlas::new(views, &SUBMAPS);
        assert!(atlas.find(&PlaneSubmap::new(&[], &SUBMAPS), &all()).is_none());
    }
}
