//! The backwards correction on loops with a known truth.

use mapwright_geom::{Pose2, wrap_angle};
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
}
