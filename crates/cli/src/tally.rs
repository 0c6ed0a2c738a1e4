//! What became of the scans: status over time, how well they fit, what was refused.

use crate::doubt::Doubts;
use crate::status_runs::StatusRuns;
use crate::terminal::grouped;
use mapwright::{BeamCounts, DOUBT_SIGMAS, MatchReport, Stamp, Status, Update};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Bins of the inlier shares.
const BINS: usize = 1000;

/// Counts over all updates; memory grows with the times that a lost robot was found, and with nothing else.
#[derive(Debug, Clone)]
pub(crate) struct Tally {
    pub(crate) scans: u64,
    pub(crate) refused: BTreeMap<&'static str, u64>,
    pub(crate) doubts: Doubts,
    by_status: [u64; 3],
    runs: StatusRuns,
    inlier_shares: Vec<u64>,
    matched: u64,
    restarted: u64,
    by_odometry: u64,
    /// Matches that contradict the motion before, where no wheels say how the robot moves, and by how many deviations at most.
    against: u64,
    against_sigmas: f64,
    searched: u64,
    evaluations: u64,
    beams: BeamCounts,
    span: Option<(Stamp, Stamp)>,
    /// The first of the scans in a row up to now whose poses are guesses, and the longest time that such a row took, seconds.
    guessed_from: Option<Stamp>,
    guessed_s: f64,
    /// Whether the scan before was lost.
    was_lost: bool,
    found: Vec<u64>,
}

/// Of scans that led to poses or measurements beyond what a session can hold.
const UNWRITTEN: &str = "it led to a pose or an edge that no session can hold";

impl Default for Tally {
    fn default() -> Self {
        Self {
            scans: 0,
            refused: BTreeMap::new(),
            doubts: Doubts::default(),
            by_status: [0; 3],
            runs: StatusRuns::default(),
            inlier_shares: vec![0; BINS + 1],
            matched: 0,
            restarted: 0,
            by_odometry: 0,
            against: 0,
            against_sigmas: 0.0,
            searched: 0,
            evaluations: 0,
            beams: BeamCounts::default(),
            span: None,
            guessed_from: None,
            guessed_s: 0.0,
            was_lost: false,
            found: Vec::new(),
        }
    }
}

impl Tally {
    /// Takes note of a scan; `by_odometry` says what predicted its pose.
    pub(crate) fn add(&mut self, update: &Update, by_odometry: bool) {
        self.scans += 1;
        self.by_status[update.status as usize] += 1;
        self.by_odometry += u64::from(by_odometry);
        self.beams.add(&update.beams);
        let (first, last) = self.span.unwrap_or((update.stamp, update.stamp));
        self.span = Some((first.min(update.stamp), last.max(update.stamp)));
        if let Some(reason) = update.refused {
            *self.refused.entry(reason).or_default() += 1;
        }
        if !update.unwritten.is_empty() {
            *self.refused.entry(UNWRITTEN).or_default() += update.unwritten.len() as u64;
        }
        if let Some(report) = &update.matched {
            self.matched += 1;
            self.restarted += u64::from(report.restarts > 0);
            self.searched += u64::from(report.searched);
            self.evaluations += u64::from(report.evaluations);
            if !by_odometry && report.odometry_sigmas > DOUBT_SIGMAS {
                self.against += 1;
                self.against_sigmas = self.against_sigmas.max(report.odometry_sigmas);
            }
            self.inlier_shares[(report.inlier_share.clamp(0.0, 1.0) * BINS as f64) as usize] += 1;
        }
        self.see_guess(update, by_odometry);
        self.see_finding(update);
        self.doubts.add(update, by_odometry);
        self.runs.add(update.status, update.scan, update.stamp);
    }

    /// The pose of a scan that nothing was matched with, and that no wheels predicted, is a guess.
    fn see_guess(&mut self, update: &Update, by_odometry: bool) {
        let is_guess = update.matched.is_none() && !by_odometry;
        self.guessed_from = self.guessed_from.or(Some(update.stamp)).filter(|_| is_guess);
        let row_s = self.guessed_from.map_or(0.0, |from| update.stamp.secs_since(from));
        self.guessed_s = self.guessed_s.max(row_s);
    }

    /// A robot that was lost is found elsewhere than was predicted, or where nothing that was mapped before confirms it.
    fn see_finding(&mut self, update: &Update) {
        let is_lost = update.status == Status::Lost;
        let was_lost = std::mem::replace(&mut self.was_lost, is_lost);
        let is_unsure = |report: &MatchReport| report.odometry_sigmas > DOUBT_SIGMAS || report.unconfirmed;
        if was_lost && !is_lost && update.matched.as_ref().is_some_and(is_unsure) {
            self.found.push(update.scan);
        }
    }

    /// The numbers of the scans in which that was.
    pub(crate) fn found(&self) -> &[u64] {
        &self.found
    }

    /// The longest time over which scans came, but neither laser nor wheels said how the robot moves, seconds.
    pub(crate) fn guessed_s(&self) -> f64 {
        self.guessed_s
    }

    /// Share of the scans whose poses odometry predicted.
    pub(crate) fn share_by_odometry(&self) -> f64 {
        self.by_odometry as f64 / self.scans.max(1) as f64
    }

    /// Matches that contradict the motion before, where no wheels say how the robot moves, as a share of the scans, and by how many
    /// deviations at most.
    pub(crate) fn against_velocity(&self) -> (f64, f64) {
        (self.against as f64 / self.scans.max(1) as f64, self.against_sigmas)
    }

    /// Share of the returns that met what travels with the robot.
    pub(crate) fn share_on_robot(&self) -> f64 {
        let BeamCounts { returns, on_robot, .. } = self.beams;
        f64::from(on_robot) / (f64::from(returns) + f64::from(on_robot)).max(1.0)
    }

    /// Time between the earliest and the latest stamp, seconds.
    pub(crate) fn log_s(&self) -> f64 {
        self.span.map_or(0.0, |(first, last)| last.secs_since(first))
    }

    /// Scans with a status.
    pub(crate) fn count(&self, status: Status) -> u64 {
        self.by_status[status as usize]
    }

    /// Share of the scans with a status.
    pub(crate) fn share(&self, status: Status) -> f64 {
        self.count(status) as f64 / self.scans.max(1) as f64
    }

    /// Share of the scans that could not be used: those that were refused, and so many that were left out before.
    pub(crate) fn share_unused(&self, left_out: u64) -> f64 {
        let refused: u64 = self.refused.values().sum();
        (left_out + refused) as f64 / (left_out + self.scans).max(1) as f64
    }

    /// Median over the matched scans of the share of beams that fit the map.
    pub(crate) fn median_inlier_share(&self) -> Option<f64> {
        let half = self.matched.div_ceil(2);
        let mut below = 0;
        let bin = self.inlier_shares.iter().position(|&n| {
            below += n;
            below >= half
        })?;
        (self.matched > 0).then_some(bin as f64 / BINS as f64)
    }

    pub(crate) fn status_report(&self) -> Value {
        let (run_count, runs) = self.runs.report();
        json!({
            "tracking": self.count(Status::Tracking),
            "degraded": self.count(Status::Degraded),
            "lost": self.count(Status::Lost),
            "run_count": run_count,
            "runs": runs,
            "doubt": self.doubts.report(),
        })
    }

    pub(crate) fn match_report(&self) -> Value {
        json!({
            "matched": self.matched,
            "median_inlier_share": self.median_inlier_share(),
            "restarted": self.restarted,
            "searched": self.searched,
            "evaluations": self.evaluations,
        })
    }

    /// What became of the beams, in words.
    pub(crate) fn beam_words(&self) -> String {
        let beams = &self.beams;
        let kinds = [
            (beams.returns, "met something"),
            (beams.no_return, "met nothing within the laser's reach"),
            (beams.too_near, "are 0, negative or nearer than the laser's least range"),
            (beams.not_a_number, "are no numbers"),
            (beams.isolated, "stand alone"),
            (beams.moving, "met what moves"),
            (beams.on_robot, "met what travels with the robot"),
            (beams.refused, "are of scans that were refused"),
        ];
        let there = kinds.iter().filter(|(number, _)| *number > 0);
        let words: Vec<_> = there.map(|(number, what)| format!("{} {what}", grouped(u64::from(*number)))).collect();
        if words.is_empty() { "there are none".to_owned() } else { words.join(", ") }
    }

    pub(crate) fn beam_report(&self) -> Value {
        json!({
            "returns": self.beams.returns,
            "no_return": self.beams.no_return,
            "too_near": self.beams.too_near,
            "not_a_number": self.beams.not_a_number,
            "isolated": self.beams.isolated,
            "moving": self.beams.moving,
            "on_robot": self.beams.on_robot,
            "refused": self.beams.refused,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright::{LaserModel, LaserScan, Mapper, Settings};
    use std::sync::Arc;

    /// What is noted of scans taken at these times, with such ranges of each beam.
    fn tally(times_s: &[f64], range_m: impl Fn(f64, usize) -> f32, by_odometry: bool) -> Tally {
        let laser = Arc::new(LaserModel::half_circle("front", 181));
        let (mut mapper, mut tally) = (Mapper::new(Settings::default()).unwrap(), Tally::default());
        for &at_s in times_s {
            let scan = LaserScan {
                stamp: Stamp::from_secs_f64(at_s),
                laser: Arc::clone(&laser),
                ranges_m: (0..181).map(|beam| range_m(at_s, beam)).collect(),
                odom_from_robot: None,
            };
            tally.add(&mapper.add_scan(&scan), by_odometry);
        }
        tally
    }

    /// A wall that is not smooth.
    fn wall_m(beam: usize) -> f32 {
        3.0 + 0.01 * (beam % 60) as f32
    }

    fn guessed_s(times_s: &[f64], blank: impl Fn(f64) -> bool, by_odometry: bool) -> f64 {
        let range_m = |at_s: f64, beam: usize| if blank(at_s) { f32::INFINITY } else { wall_m(beam) };
        tally(times_s, range_m, by_odometry).guessed_s()
    }

    #[test]
    fn a_lost_robot_that_is_found_unconfirmed_is_noted() {
        let every_fifth: Vec<f64> = (0..100).map(|k| 0.2 * f64::from(k)).collect();
        // So many of five beams see the wall at a time.
        let found = |of_five: fn(f64) -> usize| {
            let range_m = |at_s: f64, beam: usize| if beam % 5 >= of_five(at_s) { 1.0 } else { wall_m(beam) };
            tally(&every_fifth, range_m, false).found().to_vec()
        };
        assert!(found(|_| 5).is_empty());
        let lost = |at_s: f64| if (5.0..5.5).contains(&at_s) { 1 } else { 5 };
        assert!(found(lost).is_empty());
        let then_doubted = |at_s: f64| {
            if (5.0..5.5).contains(&at_s) {
                1
            } else if (5.5..5.9).contains(&at_s) {
                2
            } else {
                5
            }
        };
        assert_eq!(found(then_doubted), [28], "5.6 s");
    }

    #[test]
    fn scans_that_are_refused_or_left_out_before_are_not_used() {
        let every_fifth: Vec<f64> = (0..10).map(|k| 0.2 * f64::from(k)).collect();
        let mut tally = tally(&every_fifth, |_, beam| wall_m(beam), false);
        assert!(tally.share_unused(0).abs() < 1e-9 && (tally.share_unused(30) - 0.75).abs() < 1e-9);
        tally.refused.insert("a reason", 5);
        assert!((tally.share_unused(0) - 0.5).abs() < 1e-9 && (tally.share_unused(10) - 0.75).abs() < 1e-9);
        assert!(Tally::default().share_unused(0).abs() < 1e-9);
    }

    #[test]
    fn poses_are_guesses_where_scans_see_nothing_and_no_wheels_turn() {
        let every_fifth: Vec<f64> = (0..100).map(|k| 0.2 * f64::from(k)).collect();
        let blank = |at_s: f64| (5.0..15.1).contains(&at_s);
        assert!((guessed_s(&every_fifth, blank, false) - 10.0).abs() < 0.3);
        assert!(guessed_s(&every_fifth, blank, true) < 1e-9);
        assert!(guessed_s(&every_fifth, |_| false, false) < 1e-9);
        let with_gap: Vec<f64> = every_fifth.iter().copied().filter(|&at_s| !blank(at_s)).collect();
        assert!(guessed_s(&with_gap, |_| false, false) < 1e-9, "no pose is told of a time without scans");
    }
}
