//! The search finds what an exhaustive search finds, and the robot.
#![allow(clippy::expect_used, reason = "helpers of tests may, as tests may")]

mod common;

use common::{View, map_of, map_of_obstacles, views};
use mapwright_geom::{Pose2, sin_cos, wrap_angle};
use mapwright_grid::{
    CorrelativeSearch, LocalMap, LocalMapSettings, Peak, SearchResult, SearchSettings, SearchWindow, Separation,
    floor_cell,
};
use mapwright_sim::{Rng, worlds};
use proptest::prelude::*;
use std::cmp::Reverse;
use std::f64::consts::PI;
use std::sync::Arc;

/// Every pose of the lattice in the documented order, best first: score, steps from the middle along x, y, heading.
struct Exhaustive {
    poses: Vec<(Reverse<u32>, i32, i32, i32, i32)>,
    middle: Pose2,
    step_m: f64,
    step_rad: f64,
}

impl Exhaustive {
    /// The lattice is worked out here again from the documentation, but for the number of headings.
    fn new(map: &LocalMap, points: &[[f64; 2]], window: &SearchWindow, sigma_m: f64, found: &SearchResult) -> Self {
        let middle = window.world_from_robot;
        let (step_m, step_rad) = (found.step_m, found.step_rad);
        let half = (window.half_width_m / step_m - 1e-9).ceil() as i32;
        let half_turn = if step_rad == 0.0 { 0 } else { (window.half_width_rad.min(PI) / step_rad).round() as i32 };
        let lowest_turn = if window.half_width_rad >= PI { 1 - half_turn } else { -half_turn };
        let cell = map.settings.resolution_m;
        let mut poses = Vec::new();
        for k in lowest_turn..=half_turn {
            let (s, c) = sin_cos(middle.theta + f64::from(k) * step_rad);
            for j in -half..=half {
                for i in -half..=half {
                    let score_of = |p: &[f64; 2]| {
                        // Rounded down to a millionth of a cell, as documented: a plain floor differs in one of some 10^4 runs.
                        let x = floor_cell((middle.x + (c * p[0] - s * p[1])) * (1.0 / cell)) + i;
                        let y = floor_cell((middle.y + (s * p[0] + c * p[1])) * (1.0 / cell)) + j;
                        map.field().nearest_cell(x, y).map_or(0, |(d2, _)| {
                            let d2_sigmas = f64::from(d2) * (cell / sigma_m) * (cell / sigma_m);
                            (255.0 * (-0.5 * d2_sigmas).exp()).round() as u32
                        })
                    };
                    let score = points.iter().map(score_of).sum();
                    poses.push((Reverse(score), i * i + j * j + k * k, k, j, i));
                }
            }
        }
        poses.sort_unstable();
        Self { poses, middle, step_m, step_rad }
    }

    /// The best pose, and the best of those that are separated from it.
    fn check(&self, found: &SearchResult, full_turn: bool, separation: Separation) {
        type Step = (Reverse<u32>, i32, i32, i32, i32);
        let separated = |a: &Step, b: &Step| {
            let turned = f64::from(a.2 - b.2) * self.step_rad;
            let turned = if full_turn { wrap_angle(turned) } else { turned };
            let distance_steps = separation.distance_m / self.step_m + 1e-6;
            f64::from((a.4 - b.4).pow(2) + (a.3 - b.3).pow(2)) > distance_steps.powi(2)
                || turned.abs() > separation.angle_rad + 1e-9
        };
        let expected = |&(Reverse(score), _, k, j, i): &Step| {
            let x = self.middle.x + f64::from(i) * self.step_m;
            let y = self.middle.y + f64::from(j) * self.step_m;
            (score, Pose2::new(x, y, self.middle.theta + f64::from(k) * self.step_rad))
        };
        let best = &self.poses[0];
        let rival = self.poses.iter().find(|pose| separated(pose, best));
        let as_found = |peak: &Peak| (peak.score, peak.world_from_robot);
        assert_eq!(as_found(&found.best), expected(best));
        assert_eq!(found.rival.as_ref().map(as_found), rival.map(expected));
    }
}

fn check_against_exhaustive(
    map: &LocalMap,
    points: &[[f64; 2]],
    window: &SearchWindow,
    searcher: &mut CorrelativeSearch,
) {
    let separation = Separation { distance_m: 0.3, angle_rad: 0.2 };
    let found = searcher.search(map, points, window, Some(separation)).expect("there are points");
    let all = Exhaustive::new(map, points, window, searcher.settings.sigma_m, &found);
    all.check(&found, window.half_width_rad >= PI, separation);
    let alone = searcher.search(map, points, window, None).expect("there are points");
    assert_eq!((alone.best, alone.rival), (found.best, None));
    let mut asked = None;
    let not_worth = searcher.search_worth_rival(map, points, window, Some(separation), |best| {
        asked = Some(*best);
        false
    });
    assert_eq!((not_worth.expect("as before"), asked), (alone, Some(found.best)));
}

fn points_in(range_m: f64, count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<[f64; 2]>> {
    prop::collection::vec((-range_m..range_m, -range_m..range_m).prop_map(|(x, y)| [x, y]), count)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn the_best_pose_and_its_rival_are_those_of_an_exhaustive_search(
        obstacles in points_in(2.0, 0..40),
        points in points_in(1.0, 1..12),
        middle in (-1.0..1.0, -1.0..1.0, -3.0..3.0),
        half_width_m in prop_oneof![Just(0.0), 0.0..0.8],
        half_width_rad in prop_oneof![Just(0.0), 0.0..0.6, Just(PI)],
        sigma_m in 0.03..0.3,
    ) {
        let map = map_of_obstacles(obstacles, LocalMapSettings { resolution_m: 0.1, ..LocalMapSettings::default() });
        let world_from_robot = Pose2::new(middle.0, middle.1, middle.2);
        let window = SearchWindow { world_from_robot, half_width_m, half_width_rad };
        let mut searcher = CorrelativeSearch::new(SearchSettings { sigma_m, ..SearchSettings::default() });
        check_against_exhaustive(&map, &points, &window, &mut searcher);
    }
}

#[test]
fn rooms_are_searched_exactly_with_warm_buffers() {
    let mut searcher = CorrelativeSearch::default();
    for seed in 0..6 {
        let views = views(&Arc::new(worlds::rooms(seed)), seed, 10, 21);
        let map = map_of(&views[..20]);
        let truth = views[20].world_from_robot;
        let world_from_robot = truth * Pose2::new(0.2, -0.13, 0.06);
        let window = SearchWindow { world_from_robot, half_width_m: 0.3 + 0.1 * seed as f64, half_width_rad: 0.1 };
        check_against_exhaustive(&map, &views[20].points.hits, &window, &mut searcher);
    }
}

#[test]
fn an_empty_map_says_stay_where_you_are() {
    let map = LocalMap::new(LocalMapSettings::default());
    let window = SearchWindow { world_from_robot: Pose2::new(3.0, 4.0, 1.0), half_width_m: 2.0, half_width_rad: PI };
    let found = CorrelativeSearch::default().search(&map, &[[5.0, 1.0]], &window, Some(Separation::default())).unwrap();
    assert_eq!((found.best.world_from_robot, found.best.score), (window.world_from_robot, 0));
    assert_eq!((found.share(), found.ambiguity()), (0.0, 1.0));
    let mut demanding = CorrelativeSearch::new(SearchSettings { least_share: 0.1, ..SearchSettings::default() });
    assert_eq!(demanding.search(&map, &[[5.0, 1.0]], &window, None), None);
}

#[test]
fn odd_input_is_survived() {
    let map = map_of_obstacles(vec![[1.0, 1.0]], LocalMapSettings::default());
    let mut searcher = CorrelativeSearch::default();
    let window = SearchWindow { world_from_robot: Pose2::IDENTITY, half_width_m: 0.5, half_width_rad: 0.1 };
    assert_eq!(searcher.search(&map, &[], &window, None), None);
    assert_eq!(searcher.search(&map, &[[f64::NAN, 1.0], [0.0, f64::INFINITY], [1e300, 0.0]], &window, None), None);
    let mixed = [[f64::NAN, 0.0], [1.0, 1.0], [99.0, 0.0]];
    assert_eq!(searcher.search(&map, &mixed, &window, None).unwrap().points_used, 1);
    assert_eq!(searcher.search(&map, &[[0.0, 0.0]], &window, None).unwrap().best.score, 0);
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1.0, 1e300] {
        for window in [
            SearchWindow { half_width_m: bad, ..window },
            SearchWindow { world_from_robot: Pose2 { x: bad * 1e7, y: 0.0, theta: 0.0 }, ..window },
        ] {
            assert_eq!(searcher.search(&map, &mixed, &window, None), None, "{window:?}");
        }
        let _ = searcher.search(&map, &mixed, &SearchWindow { half_width_rad: bad, ..window }, None);
        for settings in [
            SearchSettings { sigma_m: bad, ..SearchSettings::default() },
            SearchSettings { reach_m: bad, ..SearchSettings::default() },
            SearchSettings { least_share: bad, ..SearchSettings::default() },
        ] {
            let _ = CorrelativeSearch::new(settings).search(&map, &mixed, &window, Some(Separation::default()));
        }
    }
    let far = SearchWindow { world_from_robot: Pose2::new(-1e6, 1e6, 0.0), ..window };
    assert_eq!(searcher.search(&map, &mixed, &far, None).unwrap().best.score, 0);
}

#[test]
fn huge_windows_are_searched_in_wider_steps_or_refused() {
    let views = views(&Arc::new(worlds::rooms(3)), 3, 10, 40);
    let map = map_of(&views);
    let (points, truth) = (&views[20].points.hits, views[20].world_from_robot);
    let mut searcher = CorrelativeSearch::default();
    let window = |half_width_m| SearchWindow {
        world_from_robot: Pose2::new(truth.x + 20.0, truth.y - 30.0, 0.0),
        half_width_m,
        half_width_rad: PI,
    };
    let found = searcher.search(&map, points, &window(100.0), None).unwrap();
    let off = found.best.world_from_robot.between(truth);
    assert!(found.step_m > 0.05 && off.x.hypot(off.y) < 2.0 * found.step_m, "{found:?} {off:?}");
    assert_eq!(searcher.search(&map, points, &window(2_000.0), None), None);
}

struct Case {
    map: LocalMap,
    view: View,
    off: Pose2,
}

/// A map of the first hundred scans of a drive (every fifth), and a scan taken later in the part that it shows.
fn office_case(seed: u64) -> Case {
    let mut rng = Rng::new(seed);
    let site = Arc::new(worlds::office_floor(seed));
    let views = views(&site, seed, 5, 100);
    let other = common::views(&site, seed ^ 0x5eed, 5, 100);
    let view = other[20 + rng.below(70)].clone();
    let (bearing, distance_m) = (rng.uniform(-PI, PI), rng.uniform(0.0, 1.0));
    let turn = rng.uniform(-1.0, 1.0) * 60_f64.to_radians();
    let off = Pose2::new(distance_m * bearing.cos(), distance_m * bearing.sin(), turn);
    Case { map: map_of(&views), view, off }
}

#[test]
fn a_robot_is_found_in_an_office_from_a_metre_and_sixty_degrees_away() {
    let mut searcher = CorrelativeSearch::default();
    let (mut in_place, mut within_one, mut within_two) = (0, 0, 0);
    for seed in 0..100 {
        let Case { map, view, off } = office_case(seed);
        let truth = view.world_from_robot;
        let world_from_robot = Pose2::new(truth.x + off.x, truth.y + off.y, truth.theta + off.theta);
        let window = SearchWindow { world_from_robot, half_width_m: 1.0, half_width_rad: 60_f64.to_radians() };
        let found = searcher.search(&map, &view.points.hits, &window, None).unwrap();
        let best = found.best.world_from_robot;
        let close = (best.x - truth.x).abs() <= found.step_m && (best.y - truth.y).abs() <= found.step_m;
        let turned_steps = wrap_angle(best.theta - truth.theta).abs() / found.step_rad;
        in_place += i32::from(close);
        within_one += i32::from(close && turned_steps <= 1.0);
        within_two += i32::from(close && turned_steps <= 2.0);
    }
    println!("of 100: {in_place} within a cell; {within_one} also within a step in heading, {within_two} within two");
    // A step in heading (0.1 to 0.6 deg) is a cell for the farthest point alone: the others tell it less sharply.
    assert!(in_place >= 98 && within_one >= 80 && within_two >= 97, "{in_place} {within_one} {within_two}");
}
