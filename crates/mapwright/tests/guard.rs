//! Recordings in which a match must fail: the pose is right, or the mapper says that it may not be.
#![allow(clippy::expect_used, clippy::print_stdout, reason = "a test may fail loudly and show what it measured")]

mod support;

use mapwright::{Pose2, Status, Update};
use mapwright_eval::Nees;
use mapwright_sim::{Drive, DriveSettings, FailedMatchCase, failed_match_cases, worlds};
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

/// Every other beam sees things nearer than they are, five scans long.
#[test]
fn what_hardly_fits_is_not_drawn_unless_it_goes_on() {
    const BAD: std::ops::Range<usize> = 40..45;
    let mut mapper = mapper();
    let site = worlds::office_floor(3);
    let drive = Drive::new(site.into(), DriveSettings { seed: 3, ..DriveSettings::default() });
    let mut made = Vec::new();
    for (number, mut recorded) in drive.scans().step_by(10).take(BAD.end + 5).enumerate() {
        if BAD.contains(&number) {
            recorded.scan.ranges_m.iter_mut().step_by(2).for_each(|range_m| *range_m *= 0.7);
        }
        let update = mapper.add_scan(&recorded.scan);
        let fitting = update.matched.map_or(1.0, |report| report.inlier_share);
        made.extend(update.keyframe.map(|id| (number, id.seq as usize, fitting)));
    }
    let bad: Vec<_> = made.iter().filter(|(number, ..)| BAD.contains(number)).collect();
    let is_blank = |seq: usize| mapper.keyframes()[seq].sweep.is_blank();
    println!("{bad:?}");
    assert!(bad.len() >= 4 && bad.iter().all(|(_, _, fitting)| *fitting < 0.6), "{bad:?}");
    let blank: Vec<usize> = (0..mapper.keyframes().len()).filter(|&seq| is_blank(seq)).collect();
    assert_eq!(blank, bad[..3].iter().map(|(_, seq, _)| *seq).collect::<Vec<_>>(), "the first three, and no other");
    assert!(made.len() > 30 && made.last().is_some_and(|(number, ..)| *number > BAD.end), "it goes on");
}
