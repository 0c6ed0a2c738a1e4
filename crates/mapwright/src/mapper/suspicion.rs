//! Whether a robot is still where it was: after a time without a look at the world, and where it has come home.

use super::Mapper;
use super::arrival::Arrival;
use super::guard::Matched;
use super::relocation::Lost;
use crate::closing::Past;
use crate::motion::Step;
use mapwright_geom::Pose2;
use mapwright_loops::View;
use mapwright_record::{Objection, Status};
use mapwright_sensor::LaserScan;

/// After a time without a look at the world, so much way has to fit before the robot is believed where it was, metres.
const SUSPECT_WAY_M: f64 = 1.5;
/// The same where the robot has arrived, by its own account.
const ARRIVAL_WAY_M: f64 = 8.0;
/// or, where it leaves what is known, on less than this share of a scan, so much.
const FRONTIER_SHARE: f64 = 0.5;
const FRONTIER_WAY_M: f64 = 1.5;
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
    /// An arrival that is not yet believed.
    arrival: Option<Arrival>,
    /// What it has seen meanwhile, in the frame of the newest keyframe; nothing after an arrival.
    seen: Vec<View>,
    /// Whether that was looked at halfway.
    looked: bool,
}

impl Suspicion {
    pub(super) fn is_none(&self) -> bool {
        self.left_m <= 0.0 && self.arrival.is_none()
    }

    pub(super) fn of_arrival(arrival: Arrival) -> Self {
        Self { left_m: ARRIVAL_WAY_M, arrival: Some(arrival), ..Self::default() }
    }

    /// What a robot that has arrived would be otherwise.
    pub(super) fn lost(&mut self) -> Option<&mut Lost> {
        self.arrival.as_mut().map(Arrival::lost)
    }

    fn of_blindness() -> Self {
        Self { left_m: SUSPECT_WAY_M, ..Self::default() }
    }

    /// Keeps an arrival for as long as it is not believed.
    fn keep(&mut self, arrival: Arrival, known_share: f64) {
        let is_at_frontier = known_share < FRONTIER_SHARE && ARRIVAL_WAY_M - self.left_m >= FRONTIER_WAY_M;
        if is_at_frontier && !arrival.is_doubted() {
            self.left_m = 0.0;
        }
        self.arrival = Some(arrival).filter(|arrival| self.left_m > 0.0 || arrival.is_doubted());
    }

    /// Takes a scan in; whether it speaks against the place.
    fn is_against(&mut self, matched: &Matched, step: Step) -> bool {
        self.turned_rad += step.last_from_robot.theta;
        // Without a look at the world and without motion, it is the same that is seen again.
        let moved = SUSPECT_WAY_M - self.left_m >= SAME_M || self.turned_rad.abs() >= SAME_RAD;
        let again = self.arrival.is_none() && !moved;
        self.left_m -= step.last_from_robot.x.hypot(step.last_from_robot.y);
        let [known, fitting] = [matched.agreement.known_share(), matched.agreement.inlier_share()];
        let same = known >= SAME_SHARE && fitting >= SAME_SHARE;
        let fits = (same || !again)
            && fitting >= SUSPECT_SHARE
            // Who has arrived is held against all that it sees, whatever its wheels do.
            && (self.arrival.is_some() || matched.report.odometry_sigmas <= SUSPECT_SIGMAS)
            && matched.status != Status::Lost;
        self.misfits += u32::from(!fits);
        !fits
    }
}

impl Mapper {
    /// After a time without a look at the world the robot may be anywhere: unless what it sees fits very well, it is lost.
    pub(super) fn suspicion(&mut self, scan: &LaserScan, matched: Option<Matched>, step: Step) -> Option<Matched> {
        let mut matched = matched?;
        let stamp = scan.stamp;
        let blind_s = self.seen.map_or(0.0, |seen| stamp.secs_since(seen));
        self.seen = Some(stamp);
        let usual_s = self.predictor.period_s();
        if self.settings.loops.relocate && usual_s > 0.0 && blind_s > BLIND_S.max(BLIND_PERIODS * usual_s) {
            self.suspicion = match self.suspicion.arrival.take() {
                Some(arrival) => Suspicion::of_arrival(arrival.anew(self)),
                None => Suspicion::of_blindness(),
            };
        }
        if !self.suspicion.is_none() {
            if self.suspicion.is_against(&matched, step) {
                matched.status = Status::Degraded;
            }
            let elsewhere = if let Some(mut arrival) = self.suspicion.arrival.take() {
                let refuted = arrival.is_refuted(self, scan, &matched);
                if arrival.is_doubted() {
                    matched.status = Status::Degraded;
                }
                self.suspicion.keep(arrival, matched.agreement.known_share());
                refuted
            } else {
                self.is_elsewhere(matched.world_from_robot)
            };
            if self.suspicion.misfits >= MISFITS || elsewhere {
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
        let Some(newest) = self.keyframes.len().checked_sub(1) else { return false };
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
            self.lost = Some(match suspicion.arrival {
                Some(arrival) => self.leave_again(arrival),
                None => Box::new(Lost::new(self)),
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;

    fn arrived(way_m: f64, against: u32) -> (Suspicion, Arrival) {
        let mapper = Mapper::with(Settings::default(), Pose2::IDENTITY);
        let arrival = Arrival::new(9, 3, Box::new(Lost::new(&mapper))).with_against(against);
        let mut suspicion = Suspicion::of_arrival(arrival);
        suspicion.left_m -= way_m;
        let arrival = suspicion.arrival.take().expect("it is");
        (suspicion, arrival)
    }

    #[test]
    fn an_arrival_is_believed_in_the_end_or_where_known_ground_ends() {
        let is_believed = |way_m: f64, known_share: f64, against: u32| {
            let (mut suspicion, arrival) = arrived(way_m, against);
            suspicion.keep(arrival, known_share);
            suspicion.is_none()
        };
        assert!(!is_believed(7.9, 0.9, 0) && is_believed(8.0, 0.9, 0), "all of the way");
        assert!(!is_believed(1.4, 0.4, 0) && is_believed(1.6, 0.4, 0) && !is_believed(1.6, 0.6, 0), "the frontier");
        assert!(!is_believed(1.6, 0.4, 1) && !is_believed(8.0, 0.9, 1), "nobody is believed in doubt");
    }
}
