//! Recordings in which a match must fail: the pose is right, or the mapper says that it may not be.
#![allow(clippy::expect_used, clippy::print_stdout, reason = "a test may fail loudly and show what it measured")]

use crate::support;

use mapwright::{Pose2, Status, Update};
use mapwright_eval::Nees;
use mapwright_sim::{FailedMatchCase, failed_match_cases};
use support::{in_parallel, mapper};

/// 99 % of an honest covariance's samples lie below (chi-square, three degrees of freedom).
const NEES_LIMIT: f64 = 11.3;
/// Scans after the event in which a wrong pose counts.
const WATCHED: usize = 20;

/// Whether no pose after the event is both wrong and reported as certain.
fn right_or_noticed(case: &FailedMatchCase) -> bool {
    let mut mapper = mapper();
    let mut start = None;
    let mut error_before_m = 0.0;
    for (number, recorded) in case.drive().scans().take(case.event_scan + WATCHED).enumerate() {
        let update = mapper.add_scan(&recorded.scan);
        let truth = start.get_or_insert(recorded.world_from_robot).between(recorded.world_from_robot);
        let error = truth.between(update.map_from_robot);
        if number + 1 == case.event_scan {
            error_before_m = error.x.hypot(error.y);
        }
        let wrong = error.x.hypot(error.y) > error_before_m + 0.15 || error.theta.abs() > 0.06;
        if number >= case.event_scan && wrong && !noticed(&update, truth) {
            return false;
        }
    }
    true
}

fn noticed(update: &Update, truth: Pose2) -> bool {
    let mut nees = Nees::default();
    let counted = nees.add(truth, update.map_from_robot, &update.covariance);
    update.status != Status::Tracking || !counted || nees.mean().is_some_and(|sample| sample < NEES_LIMIT)
}

#[test]
fn a_match_that_fails_is_repaired_or_noticed() {
    let cases = failed_match_cases(1);
    let fine = in_parallel(cases.len(), |k| right_or_noticed(&cases[k]));
    let failed: Vec<_> =
        cases.iter().zip(&fine).filter(|(_, fine)| !**fine).map(|(case, _)| (case.kind, case.event_stamp)).collect();
    println!("right or noticed in {} of {}", cases.len() - failed.len(), cases.len());
    assert!(failed.len() * 20 <= cases.len(), "unnoticed in {} of {}: {failed:?}", failed.len(), cases.len());
}
