//! Whether a robot is still where it was: after a time without a look at the world, and where it has come home.

use super::Mapper;
use super::guard::Matched;
use super::relocation::Lost;
use crate::closing::Past;
use crate::motion::Step;
use mapwright_geom::{Pose2, Stamp};
use mapwright_loops::View;
use mapwright_record::{Objection, Status};

/// After a time without a look at the world, so much way has to fit before the robot is believed where it was, metres.
const SUSPECT_WAY_M: f64 = 1.5;
/// The same where the robot has arrived, by its own account.
const ARRIVAL_WAY_M: f64 = 4.0;
/// From so many usual periods without returns on, and so many seconds.
const BLIND_PERIODS: f64 = 20.0;
const BLIND_S: f64 = 4.0;
/// Such a share of the known beams has to fit then.
const SUSPECT_SHARE: f64 = 0.8;
/// After so many scans in a row that fit nowhere the robot is lost, and so much travel.
const LOST_SCANS: u32 = 10;
/// So many misfits are no accident.
const MISFITS: u32 = 5;
/// A robot that has moved less than this, metres and radians, sees the same again, to this share of known and fitting beams.
const SAME_M: f64 = 0.2;
const SAME_RAD: f64 = 0.1;
const SAME_SHARE: f64 = 0.9;
/// What it sees must not differ from odometry by more standard deviations than this.
const SUSPECT_SIGMAS: f64 = 6.0;
/// So many views are kept for a look, however long it turns on the spot.
const SEEN_AT_MOST: usize = 40;

/// A robot that may not be where it thinks it is. It writes nothing until then.
#[derive(Debug, Clone, Default)]
pub(super) struct Suspicion {
    /// Length of way until it is believed, metres.
    left_m: f64,
    /// How far it has turned meanwhile, radians.
    turned_rad: f64,
    /// Scans that did not fit on it.
    misfits: u32,
    /// The keyframe of an arrival that is not yet believed.
    arrived: Option<u32>,
    /// What it has seen meanwhile, in the frame of the newest keyframe; nothing after an arrival.
    seen: Vec<View>,
    /// Whether that was looked at halfway.
    looked: bool,
}

impl Suspicion {
    pub(super) fn is_none(&self) -> bool {
        self.left_m <= 0.0
    }

    pub(super) fn of_arrival(arrived: Option<u32>) -> Self {
        Self { left_m: ARRIVAL_WAY_M, arrived, ..Self::default() }
    }

    fn of_blindness() -> Self {
        Self { left_m: SUSPECT_WAY_M, ..Self::default() }
    }

    /// Takes a scan in; whether it speaks against the place.
    fn is_against(&mut self, matched: &Matched, step: Step) -> bool {
        self.turned_rad += step.last_from_robot.theta;
        // Without a look at the world and without motion, it is the same that is seen again.
        let moved = SUSPECT_WAY_M - self.left_m >= SAME_M || self.turned_rad.abs() >= SAME_RAD;
        let again = self.arrived.is_none() && !moved;
        self.left_m -= step.last_from_robot.x.hypot(step.last_from_robot.y);
        self.arrived = self.arrived.filter(|_| self.left_m > 0.0);
        let [known, fitting] = [matched.agreement.known_share(), matched.agreement.inlier_share()];
        let same = known >= SAME_SHARE && fitting >= SAME_SHARE;
        let fits = (same || !again)
            && fitting >= SUSPECT_SHARE
            && matched.report.odometry_sigmas <= SUSPECT_SIGMAS
            && matched.status != Status::Lost;
        self.misfits += u32::from(!fits);
        !fits
    }
}

impl Mapper {
    /// After a time without a look at the world the robot may be anywhere: unless what it sees fits very well, it is lost.
    pub(super) fn suspicion(&mut self, stamp: Stamp, matched: Option<Matched>, step: Step) -> Option<Matched> {
        let mut matched = matched?;
        let blind_s = self.seen.map_or(0.0, |seen| stamp.secs_since(seen));
        self.seen = Some(stamp);
        let usual_s = self.predictor.period_s();
        if self.settings.loops.relocate && usual_s > 0.0 && blind_s > BLIND_S.max(BLIND_PERIODS * usual_s) {
            self.suspicion = Suspicion { arrived: self.suspicion.arrived, ..Suspicion::of_blindness() };
        }
        if !self.suspicion.is_none() {
            if self.suspicion.is_against(&matched, step) {
                matched.status = Status::Degraded;
            }
            if self.suspicion.misfits >= MISFITS || self.is_elsewhere(matched.world_from_robot) {
                matched.status = Status::Lost;
                self.get_lost();
            }
        } else if matched.status == Status::Lost && self.lost_scans >= LOST_SCANS {
            self.get_lost();
        }
        Some(matched)
    }

    /// Whether all that was seen since the robot was blind speaks against its place, halfway and once it has gone far enough.
    /// Every scan of it may fit, as in a corridor that looks like the one before; as one submap it is asked what a closure is
    /// asked, and what should be there and is not counts as well.
    fn is_elsewhere(&mut self, local_from_robot: Pose2) -> bool {
        let Some(newest) = self.keyframes.len().checked_sub(1).filter(|_| self.suspicion.arrived.is_none()) else {
            return false;
        };
        let newest_from_robot = self.local_from_keyframe[newest].between(local_from_robot);
        let last = self.suspicion.seen.last().map(|view| view.submap_from_keyframe);
        let is_far = last.is_none_or(|last| self.settings.keyframes.is_far(last.between(newest_from_robot)));
        if is_far && self.suspicion.seen.len() < SEEN_AT_MOST {
            let view = |sweep| View { sweep, submap_from_keyframe: newest_from_robot };
            self.suspicion.seen.extend(self.sweep.clone().map(view));
        }
        let halfway = !self.suspicion.looked && self.suspicion.left_m <= 0.5 * SUSPECT_WAY_M;
        let believed = self.suspicion.is_none();
        if !halfway && !believed {
            return false;
        }
        self.suspicion.looked = true;
        let seen = &mut self.suspicion.seen;
        let seen = if believed { std::mem::take(seen) } else { seen.clone() };
        if seen.len() < 2 {
            // It has driven on without a look; one scan says too little.
            return false;
        }
        let past = Past { keyframes: &self.keyframes, local_from_keyframe: &self.local_from_keyframe };
        let finding = self.closing.look_back(&self.settings, past, self.matcher.settings, seen);
        finding.is_some_and(|finding| finding.objection == Some(Objection::Contradiction))
    }

    pub(super) fn get_lost(&mut self) {
        if self.settings.loops.relocate && !self.keyframes.is_empty() {
            let suspicion = std::mem::take(&mut self.suspicion);
            if let Some(node) = suspicion.arrived {
                self.leave_again(node);
            }
            self.lost = Some(Box::new(Lost::new(self)));
        }
    }

    /// The robot did not arrive where it thought: the keyframe of its arrival is none.
    fn leave_again(&mut self, node: u32) {
        let _ = self.drop_keyframe(self.id(node));
        let arrival = self.id(node);
        self.edges.retain(|edge| edge.to != arrival);
        self.closing.disown(node);
    }
}
