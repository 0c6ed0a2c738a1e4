//! What the clouds of a run amount to.

use crate::status_runs::StatusRuns;
use mapwright::{BeamCounts, Cloud, MatchReport, Pose3, SpaceSweep, Stamp, Status, Update};

/// How a cloud fits the map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FitOfCloud {
    pub(super) stamp: Stamp,
    pub(super) status: Status,
    pub(super) matched: Option<MatchReport>,
}

impl FitOfCloud {
    fn of(update: &Update<SpaceSweep>) -> Self {
        Self { stamp: update.stamp, status: update.status, matched: update.matched }
    }
}

/// Counts over all clouds.
#[derive(Debug, Clone, Default)]
pub(crate) struct Tally {
    pub(super) clouds: u64,
    /// How each fits the map.
    pub(super) fits: Vec<FitOfCloud>,
    /// The numbers of those that came with the wheels' pose, and that.
    pub(super) wheels: Vec<(u64, Pose3)>,
    by_status: [u64; 3],
    pub(super) points: BeamCounts,
    pub(super) restarted: u64,
    pub(super) evaluations: u64,
    pub(super) refused: std::collections::BTreeMap<String, u64>,
    pub(super) runs: StatusRuns,
}

impl Tally {
    pub(crate) fn add(&mut self, cloud: &Cloud, update: &Update<SpaceSweep>) {
        let odom_from_robot = cloud.odom_from_robot.filter(|pose| pose.is_finite());
        self.wheels.extend(odom_from_robot.map(|pose| (update.scan, pose)));
        self.clouds += 1;
        self.fits.push(FitOfCloud::of(update));
        self.by_status[update.status as usize] += 1;
        self.runs.add(update.status, update.scan, update.stamp);
        self.points.add(&update.beams);
        if let Some(matched) = &update.matched {
            self.restarted += u64::from(matched.restarts > 0);
            self.evaluations += u64::from(matched.evaluations);
        }
        let unwritten = update.unwritten.iter().map(ToString::to_string);
        for reason in update.refused.map(str::to_owned).into_iter().chain(unwritten) {
            *self.refused.entry(reason).or_default() += 1;
        }
    }

    pub(super) fn status(&self, status: Status) -> u64 {
        self.by_status[status as usize]
    }

    /// Of all beams that said something.
    pub(super) fn no_return_share(&self) -> f64 {
        let BeamCounts { returns, no_return, too_near, not_a_number, .. } = self.points;
        let nothing = f64::from(no_return) + f64::from(not_a_number);
        nothing / (nothing + f64::from(returns) + f64::from(too_near)).max(1.0)
    }

    pub(super) fn median_inlier_share(&self) -> Option<f64> {
        median(self.fits.iter().filter_map(|fit| Some(fit.matched?.inlier_share)))
    }
}

/// The upper of the two in the middle, where there are two.
pub(super) fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}
