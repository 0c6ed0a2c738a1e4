//! The backwards correction on loops with a known truth.

use mapwright_geom::{Pose, Pose2, Pose3, wrap_angle};
use mapwright_graph::spread::{Share, SpreadError, shares_by_motion, spread};
use proptest::prelude::*;
use std::f64::consts::TAU;

/// Steps around a rectangle with a little weave, back to the start, and some steps after.
fn true_steps() -> Vec<Pose2> {
    let mut steps = Vec::new();
    for side in 0..4 {
        for k in 0..if side % 2 == 0 { 60 } else { 35 } {
            steps.push(Pose2::exp([0.5, 0.0, 0.04 * (f64::from(k) * 0.3).sin()]));
        }
        (0..9).for_each(|_| steps.push(Pose2::exp([0.2, 0.0, TAU / 36.0])));
    }
    steps.extend((0..20).map(|_| Pose2::exp([0.5, 0.0, 0.03])));
    steps
}

fn integrated(steps: impl IntoIterator<Item = Pose2>) -> Vec<Pose2> {
    let mut chain = vec![Pose2::new(3.0, -2.0, 0.7)];
    for step in steps {
        chain.push(chain[chain.len() - 1] * step);
    }
    chain
}

fn largest_error(a: &[Pose2], b: &[Pose2]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.distance(*b) + wrap_angle(a.theta - b.theta).abs()).fold(0.0, f64::max)
}

const FIRST: usize = 12;
const LAST: usize = 220;

#[test]
fn a_constant_heading_bias_is_recovered_exactly() {
    let truth = integrated(true_steps());
    let half = Pose2::new(0.0, 0.0, 0.5 * 0.004);
    let mut chain = integrated(
        true_steps().iter().enumerate().map(
            |(at, step)| {
                if (FIRST..LAST).contains(&at) { half * *step * half } else { *step }
            },
        ),
    );
    assert!(largest_error(&chain, &truth) > 5.0);
    let shares = vec![Share { rotation: 1.0, translation: 1.0 }; LAST - FIRST];
    spread(&mut chain, FIRST, LAST, truth[FIRST].between(truth[LAST]), &shares).unwrap();
    assert!(largest_error(&chain, &truth) < 1e-9, "{}", largest_error(&chain, &truth));
}

#[test]
fn a_bias_in_proportion_to_the_distance_is_recovered_by_shares_of_the_distance() {
    let truth = integrated(true_steps());
    let biased = |step: &Pose2| {
        let half = Pose2::new(0.0, 0.0, 0.5 * 0.005 * step.x.hypot(step.y));
        half * *step * half
    };
    let mut chain = integrated(true_steps().iter().map(biased));
    let (first, last) = (0, truth.len() - 1);
    let shares: Vec<Share> =
        true_steps().iter().map(|s| s.x.hypot(s.y)).map(|d| Share { rotation: d, translation: d }).collect();
    spread(&mut chain, first, last, truth[first].between(truth[last]), &shares).unwrap();
    assert!(largest_error(&chain, &truth) < 1e-9);
}

/// The chapter's loop: out of the error of a scale only what lies along the closure can be seen; on a straight way that
/// is all of it.
#[test]
fn a_constant_scale_bias_is_recovered_exactly() {
    let steps: Vec<Pose2> = (0..80).map(|k| Pose2::new(0.3 + 0.1 * (f64::from(k) * 0.7).sin(), 0.0, 0.0)).collect();
    let truth = integrated(steps.clone());
    let mut chain = integrated(steps.iter().map(|step| Pose2::new(1.07 * step.x, step.y, step.theta)));
    let shares = shares_by_motion(&chain);
    spread(&mut chain, 0, 80, truth[0].between(truth[80]), &shares).unwrap();
    assert!(largest_error(&chain, &truth) < 1e-9, "{}", largest_error(&chain, &truth));
}

#[test]
fn what_makes_no_sense_is_refused() {
    let mut chain = integrated(true_steps());
    let before = chain.clone();
    let poses = chain.len();
    let found = spread(&mut chain, 5, 5, Pose2::IDENTITY, &[]);
    assert_eq!(found, Err(SpreadError::Loop { first: 5, last: 5, poses }));
    assert_eq!(spread(&mut chain, 0, 2, Pose2::IDENTITY, &[]), Err(SpreadError::Shares { expected: 2, found: 0 }));
    let bad = [Share { rotation: -1.0, translation: f64::NAN }];
    assert_eq!(spread(&mut chain, 0, 1, Pose2::IDENTITY, &bad), Err(SpreadError::Value));
    assert_eq!(chain, before);
}

/// Round and up a helix of which each step is a screw about its axis, tilted against the map's axes; some steps before and
/// after.
fn helix() -> Vec<Pose3> {
    let world_from_axis = Pose3::exp([2.0, -1.0, 4.0, 0.7, -0.5, 0.3].into());
    let along = |k: f64| Pose3::exp([0.0, 0.0, 0.04 * k, 0.0, 0.0, 0.05 * k].into());
    // pitched and rolled, so that no axis of the robot is that of the helix
    let robot = Pose3::exp([6.0, 0.0, 0.0, 0.3, -0.4, 1.2].into());
    (0..260).map(|k| world_from_axis * along(f64::from(k)) * robot).collect()
}

fn turned_about<P: Pose>(axis: [f64; 3], rad: f64, pose: P) -> P {
    pose.turned(axis.map(|a| a * rad))
}

/// The chain with every step of a loop turned too far about an axis of the world, half before and half after it.
fn biased_about(axis: [f64; 3], bias_rad: impl Fn(usize) -> f64, truth: &[Pose3]) -> Vec<Pose3> {
    let mut chain = vec![truth[0]];
    for (at, pair) in truth.windows(2).enumerate() {
        let half = if (FIRST..LAST).contains(&at) { 0.5 * bias_rad(at) } else { 0.0 };
        let before = turned_about(axis, half, chain[at]);
        chain.push(turned_about(axis, half, before * pair[0].between(pair[1])));
    }
    chain
}

fn largest_error_3(a: &[Pose3], b: &[Pose3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.distance(*b) + a.between(*b).angle()).fold(0.0, f64::max)
}

#[test]
fn a_constant_bias_about_any_axis_of_the_world_is_recovered_exactly_in_space() {
    let truth = helix();
    for axis in [[0.0, 0.0, 1.0], [0.6, -0.48, 0.64]] {
        let mut chain = biased_about(axis, |_| 0.005, &truth);
        assert!(largest_error_3(&chain, &truth) > 2.0);
        let shares = vec![Share { rotation: 1.0, translation: 1.0 }; LAST - FIRST];
        spread(&mut chain, FIRST, LAST, truth[FIRST].between(truth[LAST]), &shares).unwrap();
        assert!(largest_error_3(&chain, &truth) < 1e-9, "{}", largest_error_3(&chain, &truth));
    }
}

/// The loop of the plane lies on a slope, the robot's own axis is that of the bias.
#[test]
fn a_heading_bias_on_a_slope_is_recovered_exactly_in_proportion_to_its_shares() {
    let slope = Pose3::exp([0.0, 0.0, 0.0, 0.4, -0.6, 0.2].into());
    let truth: Vec<Pose3> = integrated(true_steps()).into_iter().map(|pose| slope * pose.in_space()).collect();
    let up = slope.transform([0.0, 0.0, 1.0].into()).into();
    let bias = |at: usize| 0.002 * (1.0 + (at as f64 * 0.37).sin());
    let mut chain = biased_about(up, bias, &truth);
    assert!(largest_error_3(&chain, &truth) > 2.0);
    let shares: Vec<Share> = (FIRST..LAST).map(|at| Share { rotation: bias(at), translation: 1.0 }).collect();
    spread(&mut chain, FIRST, LAST, truth[FIRST].between(truth[LAST]), &shares).unwrap();
    assert!(largest_error_3(&chain, &truth) < 1e-9, "{}", largest_error_3(&chain, &truth));
}

/// Steps that err about any axis and along any: the way comes nearer to the truth, and to it at its end.
#[test]
fn random_errors_in_space_shrink() {
    let truth = helix();
    let last = truth.len() - 1;
    let mean_error = |chain: &[Pose3]| chain.iter().zip(&truth).map(|(a, b)| a.distance(*b)).sum::<f64>() / last as f64;
    let (mut before, mut after) = (0.0, 0.0);
    for seed in 0..20 {
        let mut chain = vec![truth[0]];
        for (at, pair) in truth.windows(2).enumerate() {
            let error = nalgebra::Vector6::from_fn(|k, _| 0.004 * (7.3 * (6 * at + k + 1800 * seed) as f64).sin());
            chain.push(chain[at] * pair[0].between(pair[1]).retract(&error));
        }
        before += mean_error(&chain);
        let shares = shares_by_motion(&chain);
        spread(&mut chain, 0, last, truth[0].between(truth[last]), &shares).unwrap();
        after += mean_error(&chain);
        assert!(chain[last].distance(truth[last]) < 1e-9);
    }
    assert!(after < 0.6 * before, "{before} {after}");
}

#[test]
fn half_a_turn_and_more_is_shared_the_shorter_way() {
    let steps = [Pose3::exp([1.0, 0.0, 0.0, 0.0, 0.0, 0.0].into()); 4];
    for turn in [3.0, std::f64::consts::PI, 3.3] {
        let mut chain = vec![Pose3::identity()];
        steps.iter().for_each(|step| chain.push(chain[chain.len() - 1] * *step));
        let closure = Pose3::exp([0.0, 0.0, 0.0, 0.0, turn, 0.0].into());
        let shares = shares_by_motion(&chain);
        spread(&mut chain, 0, 4, closure, &shares).unwrap();
        assert_eq!(chain[4], chain[0] * closure);
        let quarter = chain[0].between(chain[1]).angle();
        assert!((quarter - 0.25 * turn.min(TAU - turn)).abs() < 1e-9, "{turn} {quarter}");
    }
}

proptest! {
    #[test]
    fn the_closure_holds_before_stays_after_is_rigid(
        first in 0..100_usize,
        length in 1..100_usize,
        closure in (-9.0..9.0f64, -9.0..9.0f64, -3.0..3.0f64),
        weights in prop::collection::vec((0.0..2.0f64, 0.0..2.0f64), 100),
        still in any::<bool>(),
    ) {
        let before = integrated(true_steps());
        let mut after = before.clone();
        let last = first + length;
        let first_from_last = Pose2::new(closure.0, closure.1, closure.2);
        let scale = if still { 0.0 } else { 1.0 };
        let shares: Vec<Share> = weights[..length].iter()
            .map(|w| Share { rotation: scale * w.0, translation: scale * w.1 }).collect();
        spread(&mut after, first, last, first_from_last, &shares).unwrap();
        prop_assert_eq!(after[last], after[first] * first_from_last);
        prop_assert_eq!(&after[..=first], &before[..=first]);
        for k in last..before.len() - 1 {
            let (was, is) = (before[k].between(before[k + 1]), after[k].between(after[k + 1]));
            prop_assert!(was.between(is).to_vector().norm() < 1e-9);
        }
    }

    #[test]
    fn the_closure_holds_before_stays_after_is_rigid_in_space(
        first in 0..100_usize,
        length in 1..100_usize,
        closure in prop::array::uniform6(-3.0..3.0f64),
        weights in prop::collection::vec((0.0..2.0f64, 0.0..2.0f64), 100),
        still in any::<bool>(),
    ) {
        let before = helix();
        let mut after = before.clone();
        let last = first + length;
        let first_from_last = Pose3::exp(closure.into());
        let scale = if still { 0.0 } else { 1.0 };
        let shares: Vec<Share> = weights[..length].iter()
            .map(|w| Share { rotation: scale * w.0, translation: scale * w.1 }).collect();
        spread(&mut after, first, last, first_from_last, &shares).unwrap();
        prop_assert_eq!(after[last], after[first] * first_from_last);
        prop_assert_eq!(&after[..=first], &before[..=first]);
        for k in last..before.len() - 1 {
            let (was, is) = (before[k].between(before[k + 1]), after[k].between(after[k + 1]));
            prop_assert!(was.distance(is) + was.between(is).angle() < 1e-7);
        }
        // every step turns by its share of one rotation about one axis of the world
        let missing = before[last].turn_to(after[last]);
        let sum: f64 = shares.iter().map(|share| share.rotation).sum();
        let mut so_far = 0.0;
        for (at, share) in (first..last).zip(&shares) {
            so_far += if sum > 0.0 { share.rotation / sum } else { 1.0 / length as f64 };
            let expected = before[at + 1].turned(missing.map(|m| so_far * m));
            prop_assert!(expected.between(after[at + 1]).angle() < 1e-6);
        }
    }

    #[test]
    fn in_the_plane_space_does_as_the_plane_does(
        first in 0..100_usize,
        length in 1..100_usize,
        closure in (-9.0..9.0f64, -9.0..9.0f64, -3.0..3.0f64),
    ) {
        let mut plane = integrated(true_steps());
        let mut space: Vec<Pose3> = plane.iter().map(|pose| pose.in_space()).collect();
        let (last, closure) = (first + length, Pose2::new(closure.0, closure.1, closure.2));
        let shares = shares_by_motion(&plane[first..=last]);
        for (of_plane, of_space) in shares.iter().zip(shares_by_motion(&space[first..=last])) {
            prop_assert!((of_plane.rotation - of_space.rotation).abs() < 1e-9);
            prop_assert!((of_plane.translation - of_space.translation).abs() < 1e-9);
        }
        spread(&mut plane, first, last, closure, &shares).unwrap();
        spread(&mut space, first, last, closure.in_space(), &shares).unwrap();
        for (plane, space) in plane.iter().zip(&space) {
            let error = plane.in_space().between(*space);
            prop_assert!(error.length() + error.angle() < 1e-6, "{:?} {:?}", plane, space);
        }
    }
}
