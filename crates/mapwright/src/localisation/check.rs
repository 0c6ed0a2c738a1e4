//! Whether a robot is still where it was, after a time without a look at the world.

use super::look::look_back;
use crate::front::{FrontEnd, Matched};
use mapwright_geom::Pose2;
use mapwright_loops::View;
use mapwright_record::{Objection, Past, Status};
use std::sync::Arc;

/// So much way has to fit before the robot is believed where it was, metres.
const CHECKED_WAY_M: f64 = 1.5;
/// Such a share of the known beams has to fit then.
pub(super) const CHECKED_SHARE: f64 = 0.8;
/// So many misfits are no accident.
pub(super) const MISFITS: u32 = 5;
/// A robot that has moved less than this, metres and radians, sees the same again, to this share of known and fitting beams.
const STOOD_M: f64 = 0.2;
const STOOD_RAD: f64 = 0.1;
const STOOD_SHARE: f64 = 0.9;
/// What it sees must not differ from odometry by more standard deviations than this.
const CHECKED_SIGMAS: f64 = 6.0;
/// So many views are kept for a look, however long it turns on the spot.
const SEEN_AT_MOST: usize = 40;

/// A robot that may not be where it thinks it is. It writes nothing until then.
#[derive(Debug, Clone)]
pub(crate) struct Check {
    /// Length of way until it is believed, metres.
    left_m: f64,
    /// How far it has turned meanwhile, radians.
    turned_rad: f64,
    /// Scans that did not fit on it.
    misfits: u32,
    /// What it has seen meanwhile, in the frame of the newest keyframe.
    seen: Vec<View>,
    /// Whether that was looked at halfway.
    looked: bool,
}

impl Default for Check {
    fn default() -> Self {
        Self { left_m: CHECKED_WAY_M, turned_rad: 0.0, misfits: 0, seen: Vec::new(), looked: false }
    }
}

impl Check {
    /// Takes a scan and the motion since the one before in; whether too much speaks against the place.
    pub(super) fn fails(&mut self, front: &FrontEnd, past: Past<'_>, step: Pose2, matched: &mut Matched) -> bool {
        if self.is_against(step, matched) {
            matched.status = Status::Degraded;
        }
        let elsewhere = self.is_elsewhere(front, past, matched.local_from_robot);
        self.misfits >= MISFITS || elsewhere
    }

    /// Whether the robot is believed.
    pub(super) fn is_over(&self) -> bool {
        self.left_m <= 0.0
    }

    fn is_against(&mut self, step: Pose2, matched: &Matched) -> bool {
        self.turned_rad += step.theta;
        // Without motion it is the same that is seen again.
        let again = CHECKED_WAY_M - self.left_m < STOOD_M && self.turned_rad.abs() < STOOD_RAD;
        self.left_m -= step.x.hypot(step.y);
        let [known, fitting] = [matched.agreement.known_share(), matched.agreement.inlier_share()];
        let same = known >= STOOD_SHARE && fitting >= STOOD_SHARE;
        let fits = (same || !again)
            && fitting >= CHECKED_SHARE
            && matched.report.odometry_sigmas <= CHECKED_SIGMAS
            && matched.status != Status::Lost;
        self.misfits += u32::from(!fits);
        !fits
    }

    /// Whether all that was seen since the robot was blind speaks against its place, halfway and once it has gone far enough.
    /// Every scan of it may fit, as in a corridor that looks like the one before; as one submap it is asked what a closure is
    /// asked, and what should be there and is not counts as well.
    fn is_elsewhere(&mut self, front: &FrontEnd, past: Past<'_>, local_from_robot: Pose2) -> bool {
        let Some(newest) = past.newest() else { return false };
        let newest_from_robot = past.pose(newest).between(local_from_robot);
        let last = self.seen.last().map(|view| view.submap_from_keyframe);
        let is_far = last.is_none_or(|last| front.settings().keyframes.is_far(last.between(newest_from_robot)));
        if is_far && self.seen.len() < SEEN_AT_MOST {
            let view = |sweep| View { sweep: Arc::new(sweep), submap_from_keyframe: newest_from_robot };
            self.seen.extend(front.scan().sweep().cloned().map(view));
        }
        let halfway = !self.looked && self.left_m <= 0.5 * CHECKED_WAY_M;
        if !halfway && !self.is_over() {
            return false;
        }
        self.looked = true;
        if self.seen.len() < 2 {
            // It has driven on without a look; one scan says too little.
            return false;
        }
        let finding = look_back(front.settings(), past, front.matcher(), self.seen.clone());
        finding.is_some_and(|finding| finding.objection == Some(Objection::Contradiction))
    }
}
