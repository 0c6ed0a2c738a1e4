//! A robot that was found: it writes nothing and goes on mapping provisionally until what it sees has borne that out for metres.

use super::check::{CHECKED_SHARE, MISFITS};
use super::look::look_around;
use super::lost::Lost;
use crate::front::{FrontEnd, Matched};
use mapwright_geom::Pose2;
use mapwright_record::{NodeId, Past, Status};
use mapwright_sensor::LaserScan;

/// So much way has to fit before the robot is believed, metres,
const TRIAL_WAY_M: f64 = 8.0;
/// or, where it leaves what is known, on less than this share of a scan, so much.
const FRONTIER_SHARE: f64 = 0.5;
const FRONTIER_WAY_M: f64 = 1.5;
/// What was seen lately speaks against the place where less than this share of what is known fits, or more than this share of
/// all is contradicted: a right place keeps 0.83 and 0.11 (docs/decisions/0012).
const TRIAL_LEAST_SHARE: f64 = 0.78;
const TRIAL_MOST_CONTRADICTION: f64 = 0.15;
/// So many looks in a row are no accident.
const LOOKS_AGAINST: u32 = 2;

/// Where a robot was found, and what it would be otherwise.
#[derive(Debug, Clone)]
pub(crate) struct Trial {
    /// The keyframe that was made where it was found.
    node: NodeId,
    /// An old keyframe that it is near.
    near: NodeId,
    lost: Box<Lost>,
    /// Looks in a row that spoke against the place.
    against: u32,
    /// Length of way until it is believed, metres.
    left_m: f64,
    /// Scans that did not fit on it.
    misfits: u32,
}

/// How a trial goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outcome {
    GoesOn,
    /// The robot is believed.
    Passed,
    /// It is not there.
    Failed,
    /// It was believed, but too many scans did not fit: it is lost, and was not elsewhere.
    LostAgain,
}

impl Trial {
    pub(crate) fn new(node: NodeId, near: NodeId, lost: Box<Lost>) -> Self {
        Self { node, near, lost, against: 0, left_m: TRIAL_WAY_M, misfits: 0 }
    }

    /// What the robot would be otherwise.
    pub(super) fn lost(&mut self) -> &mut Lost {
        &mut self.lost
    }

    /// The robot is not there: the keyframe that was made, and what it is instead.
    pub(super) fn fail(self) -> (NodeId, Box<Lost>) {
        let Self { node, mut lost, .. } = self;
        lost.give_up();
        (node, lost)
    }

    /// The robot was blind: what it has seen says nothing of where it is now.
    pub(super) fn anew(mut self, front: &FrontEnd) -> Self {
        self.lost.begin_again(front);
        Self::new(self.node, self.near, self.lost)
    }

    /// Takes a scan and the motion since the one before in.
    pub(super) fn judge(
        &mut self,
        front: &FrontEnd,
        past: Past<'_>,
        scan: &LaserScan,
        step: Pose2,
        matched: &mut Matched,
    ) -> Outcome {
        self.left_m -= step.x.hypot(step.y);
        // Who was found is held against all that it sees, whatever its wheels do.
        let fits = matched.agreement.inlier_share() >= CHECKED_SHARE && matched.status != Status::Lost;
        self.misfits += u32::from(!fits);
        if !fits {
            matched.status = Status::Degraded;
        }
        let refuted = self.is_refuted(front, past, scan, matched);
        if self.is_doubted() {
            matched.status = Status::Degraded;
        }
        let passed = self.is_passed(matched.agreement.known_share());
        match (refuted || self.misfits >= MISFITS, passed) {
            (true, true) => Outcome::LostAgain,
            (true, false) => Outcome::Failed,
            (false, true) => Outcome::Passed,
            (false, false) => Outcome::GoesOn,
        }
    }

    /// Whether the robot is believed: after all of the way, or where known ground ends.
    fn is_passed(&mut self, known_share: f64) -> bool {
        let is_at_frontier = known_share < FRONTIER_SHARE && TRIAL_WAY_M - self.left_m >= FRONTIER_WAY_M;
        if is_at_frontier && !self.is_doubted() {
            self.left_m = 0.0;
        }
        self.left_m <= 0.0 && !self.is_doubted()
    }

    /// Whether what was seen lately speaks against the place.
    fn is_refuted(&mut self, front: &FrontEnd, past: Past<'_>, scan: &LaserScan, matched: &Matched) -> bool {
        let supplier = matched.supplier().filter(|&node| node < self.node && front.is_in_local_map(node));
        self.near = supplier.unwrap_or(self.near);
        if self.lost.see(front, scan).is_keyframe {
            let is_against = self.is_against(front, past, matched.local_from_robot);
            self.against = if is_against { self.against + 1 } else { 0 };
        }
        self.against >= LOOKS_AGAINST
    }

    fn is_against(&self, front: &FrontEnd, past: Past<'_>, local_from_robot: Pose2) -> bool {
        let provisional = self.lost.past();
        let newest = provisional.newest();
        let keyframe_from_robot = newest.map_or(Pose2::IDENTITY, |k| self.lost.provisional().keyframe_from_robot(k));
        let near_from_newest = past.pose(self.near).between(local_from_robot * keyframe_from_robot.inverse());
        let finding = look_around(front.settings(), past, front.matcher(), self.near, provisional, near_from_newest);
        finding.is_some_and(|finding| {
            finding.evidence.inlier_share.is_some_and(|share| share < TRIAL_LEAST_SHARE)
                || finding.evidence.contradiction.is_some_and(|share| share > TRIAL_MOST_CONTRADICTION)
        })
    }

    /// Whether the last look spoke against the place.
    fn is_doubted(&self) -> bool {
        self.against > 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;

    #[test]
    fn who_was_found_is_believed_in_the_end_or_where_known_ground_ends() {
        let is_believed = |way_m: f64, known_share: f64, against: u32| {
            let lost = Box::new(Lost::new(&FrontEnd::new(Settings::default(), Pose2::IDENTITY)));
            let mut trial = Trial { against, ..Trial::new(NodeId::new(9), NodeId::new(3), lost) };
            trial.left_m -= way_m;
            trial.is_passed(known_share)
        };
        assert!(!is_believed(7.9, 0.9, 0) && is_believed(8.0, 0.9, 0), "all of the way");
        assert!(!is_believed(1.4, 0.4, 0) && is_believed(1.6, 0.4, 0) && !is_believed(1.6, 0.6, 0), "the frontier");
        assert!(!is_believed(1.6, 0.4, 1) && !is_believed(8.0, 0.9, 1), "nobody is believed in doubt");
    }
}
