//! The matcher's gradient is the derivative of its objective, both optimisers climb to the same top, and maps forget
//! without a trace what is taken out of them.

mod common;

use common::{View, map_of, views};
use mapwright_geom::{Pose2, wrap_angle};
use mapwright_grid::{Change, DistanceField, LocalMap, LocalMapSettings, Matcher, MatcherSettings, Prior, Surfel};
use mapwright_sim::{Rng, worlds};
use proptest::prelude::*;
use std::collections::BTreeSet;
use std::sync::{Arc, OnceLock};

/// A map of 40 scans of a suite of rooms and 10 scans from another drive through them.
fn rooms(seed: u64) -> (LocalMap, Vec<View>) {
    let site = Arc::new(worlds::rooms(seed));
    let queries = views(&site, seed + 1_000, 20, 12);
    (map_of(&views(&site, seed, 6, 40)), queries.into_iter().skip(2).collect())
}

fn near(world_from_robot: Pose2, rng: &mut Rng, sigma_m: f64, sigma_rad: f64) -> Pose2 {
    world_from_robot * Pose2::new(rng.normal(sigma_m), rng.normal(sigma_m), rng.normal(sigma_rad))
}

/// The obstacle each point is assigned to at a pose.
fn assignment(map: &LocalMap, points: &[[f64; 2]], world_from_robot: Pose2) -> Vec<Option<Surfel>> {
    let from = [world_from_robot.x, world_from_robot.y];
    points.iter().map(|&point| map.obstacle_seen(from, world_from_robot.transform(point)).copied()).collect()
}

#[test]
fn the_gradient_is_the_derivative_of_the_cost_where_assignments_stay() {
    // Costs are summed in single precision: steps (metres, radians) are as long as their rounding asks for.
    const H: [f64; 3] = [2e-4, 2e-4, 1e-4];
    let matcher = Matcher::default();
    let mut rng = Rng::new(5);
    let (mut compared, mut beams, mut skipped) = (0, 0, 0);
    for seed in 0..4 {
        let (map, queries) = rooms(seed);
        for view in &queries {
            let at = near(view.world_from_robot, &mut rng, 0.05, 0.03);
            let moved = |axis: usize, by: f64| {
                let mut twist = [0.0; 3];
                twist[axis] = by;
                at * Pose2::exp(twist)
            };
            // Beams whose obstacle changes within twice the difference are left out.
            let corners: Vec<_> =
                (0..6).map(|k| moved(k / 2, if k % 2 == 0 { -2.0 } else { 2.0 } * H[k / 2])).collect();
            let here = assignment(&map, &view.points.hits, at);
            let there: Vec<_> = corners.iter().map(|&p| assignment(&map, &view.points.hits, p)).collect();
            let kept = |k: &usize| there.iter().all(|assigned| assigned[*k] == here[*k]);
            let points: Vec<_> = (0..here.len()).filter(kept).map(|k| view.points.hits[k]).collect();
            (beams, skipped) = (beams + points.len(), skipped + here.len() - points.len());
            for sigma_m in [0.03, 0.15] {
                let evaluation = matcher.evaluate(&map, &points, at, sigma_m);
                let cost = |pose| matcher.evaluate(&map, &points, pose, sigma_m).cost;
                for axis in 0..3 {
                    // Central difference of fourth order.
                    let apart = |steps: f64| cost(moved(axis, steps * H[axis])) - cost(moved(axis, -steps * H[axis]));
                    let difference = (8.0 * apart(1.0) - apart(2.0)) / (12.0 * H[axis]);
                    let error = (evaluation.gradient[axis] - difference).abs();
                    let scale = evaluation.gradient.norm();
                    assert!(error < 1e-4 * scale + 1e-3, "axis {axis}: {} {difference}", evaluation.gradient[axis]);
                    compared += 1;
                }
            }
        }
    }
    println!("{compared} derivatives over {beams} beams compared, {skipped} beams left out");
    assert!(compared == 240 && beams > 5_000 && skipped * 20 < beams);
}

#[test]
fn both_optimisers_climb_to_the_same_top() {
    let patient = MatcherSettings { max_evaluations: 500, step_m: 1e-5, ..MatcherSettings::default() };
    let matcher = Matcher { settings: patient };
    let mut rng = Rng::new(6);
    let (mut same, mut all) = (0, 0);
    for seed in 0..6 {
        let (map, queries) = rooms(seed);
        for view in &queries {
            let start = near(view.world_from_robot, &mut rng, 0.03, 0.02);
            let prior = Prior { world_from_robot: start, variances: [0.01, 0.01, 0.01], tail: 1e8 };
            let newton = matcher.gauss_newton(&map, &view.points.hits, &prior, start);
            let ascent = matcher.gradient_ascent(&map, &view.points.hits, &prior, start);
            let apart = newton.world_from_robot.between(ascent.world_from_robot);
            // The objective has dents of millimetres where a beam's obstacle changes; either may stop in one.
            let agree = apart.x.hypot(apart.y) < 5e-3 && apart.theta.abs() < 3e-3;
            same += i32::from(agree);
            all += 1;
            let error = newton.world_from_robot.between(view.world_from_robot);
            assert!(error.x.hypot(error.y) < 0.05 && error.theta.abs() < 0.02, "{error:?}");
            if !agree {
                println!("apart {apart:?}, costs {} and {}", newton.scan_cost, ascent.scan_cost);
            }
        }
    }
    println!("the same top in {same} of {all}");
    assert!(same * 100 >= all * 95, "{same} of {all}");
}

fn all_views() -> &'static [View] {
    static VIEWS: OnceLock<Vec<View>> = OnceLock::new();
    VIEWS.get_or_init(|| views(&Arc::new(worlds::rooms(2)), 2, 15, 24))
}

fn lines(map: &LocalMap) -> Vec<(i32, i32, Surfel)> {
    let obstacles: BTreeSet<_> = map.field().obstacles().collect();
    obstacles.into_iter().map(|(x, y)| (x, y, map.surfels()[map.field().nearest(x, y) as usize])).collect()
}

/// Obstacles and every cell's nearest one and distance, without the handles, which are an accident of history.
fn same_field(a: &DistanceField, b: &DistanceField) -> bool {
    let cells = |field: &DistanceField| field.obstacles().collect::<BTreeSet<_>>();
    let (mine, theirs) = (cells(a), cells(b));
    let knows = |field: &DistanceField, x, y| field.nearest_cell(x, y);
    let bounds = mine
        .iter()
        .chain(&theirs)
        .fold((i32::MAX, i32::MIN, i32::MAX, i32::MIN), |b, &(x, y)| (b.0.min(x), b.1.max(x), b.2.min(y), b.3.max(y)));
    let reach = a.radius_cells() as i32 + 1;
    mine == theirs
        && (mine.is_empty()
            || (bounds.2 - reach..=bounds.3 + reach)
                .all(|y| (bounds.0 - reach..=bounds.1 + reach).all(|x| knows(a, x, y) == knows(b, x, y))))
}

/// A keyframe: a view's number and the error of its pose.
fn keyframe() -> impl Strategy<Value = (usize, f64, f64, f64)> {
    (0..24_usize, -0.3..0.3, -0.3..0.3, -0.2..0.2)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn what_is_taken_out_leaves_no_trace(
        keyframes in prop::collection::vec(keyframe(), 1..10),
        order in prop::collection::vec(any::<(u16, bool)>(), 10),
    ) {
        let placed = |&(number, x, y, theta): &(usize, f64, f64, f64)| {
            let view = &all_views()[number];
            (&view.points, Pose2::new(view.world_from_robot.x + x, view.world_from_robot.y + y,
                wrap_angle(view.world_from_robot.theta + theta)))
        };
        let mut lived = LocalMap::new(LocalMapSettings::default());
        for (k, keyframe) in keyframes.iter().enumerate() {
            let (points, pose) = placed(keyframe);
            lived.change(points, pose, Change::Add, k as u32);
        }
        // Some go, in an order of their own; of these some come back and go once more.
        let mut leaving: Vec<usize> = (0..keyframes.len()).filter(|&k| order[k].0 % 3 != 0).collect();
        leaving.sort_by_key(|&k| order[k].0);
        for &k in &leaving {
            let (points, pose) = placed(&keyframes[k]);
            lived.change(points, pose, Change::Remove, k as u32);
            if order[k].1 {
                lived.change(points, pose, Change::Add, k as u32);
                lived.change(points, pose, Change::Remove, k as u32);
            }
        }
        let mut scratch = LocalMap::new(LocalMapSettings::default());
        for k in (0..keyframes.len()).rev().filter(|k| !leaving.contains(k)) {
            let (points, pose) = placed(&keyframes[k]);
            scratch.change(points, pose, Change::Add, k as u32);
        }
        prop_assert_eq!(lived.counts().to_bytes(), scratch.counts().to_bytes());
        prop_assert!(same_field(lived.field(), scratch.field()));
        prop_assert_eq!(lines(&lived), lines(&scratch));
        if leaving.len() == keyframes.len() {
            prop_assert!(lived.counts().to_bytes().is_empty());
        }
    }
}
