//! Slips along corridors: what scans say together, and the past put right from where the wheels slipped.
//!
//! Between bare walls a scan says next to nothing about the way along them, and what little there is does not bring a match
//! back from decimetres away: it fits nearly as well where the wheels have it. But it goes on fitting a little less than
//! usual, and each such scan fits better in one and the same place ahead or behind. Their likelihood ratios add up.

use super::Mapper;
use super::guard::{INDEPENDENT_BEAMS, Matched, translation_axes};
use crate::closing::Past;
use crate::live::Frames;
use crate::motion::Step;
use mapwright_geom::{Cov3, Pose2};
use mapwright_grid::Prior;
use mapwright_record::{Edge, EdgeKind, Status};
use nalgebra::Vector3;

/// A fit that falls so far behind the usual one is watched.
const FALL_SHARE: f64 = 0.02;
/// Weight of the newest scan in the usual fit, a slow mean.
const USUAL_WEIGHT: f64 = 0.02;
/// Scans that are looked at lie so far apart, metres.
const LOOK_EVERY_M: f64 = 0.1;
/// Places ahead and behind: so many to either side, so far apart, metres.
const PLACES: usize = 16;
const PLACE_M: f64 = 0.05;
/// A direction is weak where it has less than this share of the other one's information.
const WEAK_SHARE: f64 = 0.3;
/// What one scan may say at most, nats.
const LOOK_AT_MOST: f64 = 5.0;
/// Scans that are needed, how much better they fit there, and than at every other place so far away, nats and metres.
const LOOKS: u32 = 4;
const BETTER: f64 = 8.0;
const BETTER_THAN_OTHERS: f64 = 4.0;
const OTHER_M: f64 = 0.25;
/// Less is not put right, metres.
const LEAST_M: f64 = 0.1;
/// After so much way without a scan that falls behind, and after so much in all, nothing is left to be said, metres.
const LAPSE_M: f64 = 1.5;
const WATCH_M: f64 = 6.0;
/// A slip may have begun so many keyframes before it showed.
const BEFORE: u32 = 8;
/// Standard deviations of the place that was found, metres and radians.
const FOUND_M: f64 = 0.05;
const FOUND_RAD: f64 = 0.01;

/// How scans have fitted of late.
#[derive(Debug, Clone, Default)]
pub(super) struct Slips {
    usual_share: f64,
    watch: Option<Watch>,
    /// Slips that were put right.
    pub(super) mended: Vec<Mended>,
}

/// A slip that was put right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mended {
    /// The scan that settled it.
    pub scan: u64,
    /// The first keyframe that was moved.
    pub from: u32,
    /// By how far, metres.
    pub metres: f64,
}

/// Scans that fall behind.
#[derive(Debug, Clone)]
struct Watch {
    /// The first keyframe that may be misplaced.
    from: u32,
    /// The direction that they say little about, in the front end's frame.
    along: [f64; 2],
    /// Negative log likelihood of each place, less that of where the robot is thought to be.
    sums: [f64; 2 * PLACES + 1],
    looks: u32,
    /// Way since it began, since the last look and since the last scan that fell behind, metres.
    way_m: f64,
    unseen_m: f64,
    fitting_m: f64,
}

impl Watch {
    /// How far along the place lies that explains all, if one does.
    fn verdict_m(&self) -> Option<f64> {
        let best = (0..self.sums.len()).min_by(|&a, &b| self.sums[a].total_cmp(&self.sums[b]))?;
        let away_m = |place: usize| (place as f64 - best as f64).abs() * PLACE_M;
        let by_m = (best as f64 - PLACES as f64) * PLACE_M;
        let others = (0..self.sums.len()).filter(|&place| away_m(place) >= OTHER_M - 1e-9);
        let alone = others.map(|place| self.sums[place] - self.sums[best]).fold(f64::INFINITY, f64::min);
        let found = self.looks >= LOOKS
            && self.sums[best] <= -BETTER
            && alone >= BETTER_THAN_OTHERS
            && by_m.abs() >= LEAST_M
            // The place may lie beyond those that were looked at.
            && best > 0
            && best + 1 < self.sums.len();
        found.then_some(by_m)
    }
}

impl Mapper {
    /// Slips that were put right, in order.
    #[must_use]
    pub fn slips(&self) -> &[Mended] {
        &self.slips.mended
    }

    /// Looks whether the robot has slipped, scan by scan, and puts it right once they say so together.
    pub(super) fn watch_slips(&mut self, matched: Option<&Matched>, step: Step) {
        let Some(matched) = matched.filter(|m| m.status == Status::Tracking && self.suspicion.is_none()) else {
            self.slips.watch = None;
            return;
        };
        let share = matched.agreement.inlier_share();
        let falls = self.slips.usual_share - share > FALL_SHARE;
        let moved_m = step.last_from_robot.x.hypot(step.last_from_robot.y);
        let Some(watch) = &mut self.slips.watch else {
            if falls {
                let from = self.keyframes.len() as u32;
                let sums = [0.0; 2 * PLACES + 1];
                let (along, way_m, unseen_m, fitting_m) = ([0.0; 2], 0.0, LOOK_EVERY_M, 0.0);
                self.slips.watch = Some(Watch { from, along, sums, looks: 0, way_m, unseen_m, fitting_m });
                self.look_along();
            } else if matched.agreement.known_share() > 0.5 {
                self.slips.usual_share += USUAL_WEIGHT * (share - self.slips.usual_share);
            }
            return;
        };
        watch.way_m += moved_m;
        watch.unseen_m += moved_m;
        watch.fitting_m = if falls { 0.0 } else { watch.fitting_m + moved_m };
        if watch.fitting_m > LAPSE_M || watch.way_m > WATCH_M {
            self.slips.usual_share = share;
            self.slips.watch = None;
            return;
        }
        if watch.unseen_m >= LOOK_EVERY_M {
            self.look_along();
            self.mend_slip();
        }
    }

    /// How the scan fits at each place ahead and behind.
    fn look_along(&mut self) {
        let (map, at) = (&self.live.map, self.local_from_robot);
        let points = if self.thinned.is_empty() { &self.points.hits } else { &self.thinned };
        let sigma_m = 1.5 * self.matcher.settings.sigma_m;
        let here = self.matcher.evaluate(map, points, at, sigma_m);
        let ([weak, strong], [[x, y], _]) = translation_axes(&here.hessian);
        let Some(watch) = &mut self.slips.watch else { return };
        watch.unseen_m = 0.0;
        if weak > WEAK_SHARE * strong {
            return;
        }
        let (s, c) = at.theta.sin_cos();
        let mut along = [c * x - s * y, s * x + c * y];
        let cosine = along[0] * watch.along[0] + along[1] * watch.along[1];
        if cosine < 0.0 {
            along = along.map(|v| -v);
        }
        if cosine.abs() < 0.98 {
            // Around a corner it is another corridor.
            (watch.along, watch.sums, watch.looks) = (along, [0.0; 2 * PLACES + 1], 0);
        }
        watch.looks += 1;
        let share = (INDEPENDENT_BEAMS / points.len() as f64).min(1.0);
        for (place, sum) in watch.sums.iter_mut().enumerate() {
            let by_m = (place as f64 - PLACES as f64) * PLACE_M;
            let there = Pose2::new(at.x + by_m * along[0], at.y + by_m * along[1], at.theta);
            let cost = self.matcher.evaluate(map, points, there, sigma_m).cost;
            *sum += ((cost - here.cost) * share).clamp(-LOOK_AT_MOST, LOOK_AT_MOST);
        }
    }

    /// Once all is said, what was mapped since the wheels slipped is moved to where it belongs.
    fn mend_slip(&mut self) {
        let Some((watch, by_m)) = self.slips.watch.as_ref().and_then(|watch| Some((watch, watch.verdict_m()?))) else {
            return;
        };
        // What is under way was asked of the past as it is.
        if self.jobs_out > 0 || !self.jobs.is_empty() {
            return;
        }
        let (from, along) = (watch.from, watch.along);
        self.slips.watch = None;
        let verified = |edge: &Edge| edge.kind == EdgeKind::Closure && edge.to.seq >= from;
        if self.edges.iter().rev().any(verified) {
            return;
        }
        let at = self.local_from_robot;
        let there = Pose2::new(at.x + by_m * along[0], at.y + by_m * along[1], at.theta);
        let variances = [FOUND_M * FOUND_M, FOUND_M * FOUND_M, FOUND_RAD * FOUND_RAD];
        let prior = Prior { world_from_robot: there, variances, tail: self.settings.motion.tail };
        let (found, agreement) = self.refine(&prior, there);
        let found = found.world_from_robot;
        if found.distance(there) > 2.0 * FOUND_M || agreement.inlier_share() < self.slips.usual_share - FALL_SHARE {
            return;
        }
        self.slips.mended.push(Mended { scan: self.scans.len() as u64, from, metres: at.distance(found) });
        self.shift_since(from, found * at.inverse(), found);
    }

    /// Moves the robot and the keyframes from `from` on; edges across say what they say now, the wheels' not much.
    fn shift_since(&mut self, from: u32, new_from_old: Pose2, local_from_robot: Pose2) {
        let before = self.local_from_keyframe.clone();
        for k in from as usize..self.local_from_keyframe.len() {
            self.local_from_keyframe[k] = new_from_old * self.local_from_keyframe[k];
            self.world_from_keyframe[k] = self.world_from_local * self.local_from_keyframe[k];
        }
        let slipped = self.local_from_robot.between(local_from_robot);
        let slip = Vector3::new(slipped.x, slipped.y, slipped.theta);
        let slip = Cov3::from(slip * slip.transpose());
        self.local_from_robot = local_from_robot;
        self.movers.forget();
        let weaken = |information: Cov3| {
            let covariance = information.try_inverse().map(|covariance| covariance + slip);
            covariance.and_then(|covariance| covariance.try_inverse()).unwrap_or(information)
        };
        let past = Past { keyframes: &self.keyframes, local_from_keyframe: &self.local_from_keyframe };
        let is_across = |edge: &Edge| edge.from.seq < from && edge.to.seq >= from && edge.kind != EdgeKind::Closure;
        // Matches of the last keyframes before with old places may have been led astray by it.
        let doubted = from.saturating_sub(BEFORE)..from;
        let is_doubted = |edge: &Edge| {
            let old = self.closing.is_old(edge.from.seq, edge.to.seq);
            edge.kind == EdgeKind::Match && doubted.contains(&edge.to.seq) && old
        };
        self.edges.retain(|edge| !is_doubted(edge));
        for edge in self.edges.iter_mut().filter(|edge| is_across(edge)) {
            let [a, b] = [edge.from, edge.to].map(|id| past.local_from_keyframe[id.seq as usize]);
            edge.from_from_to = a.between(b);
            if edge.from.seq + 1 == edge.to.seq {
                edge.information = weaken(edge.information);
            }
        }
        self.closing.measure_anew(past, from, doubted, weaken);
        if from as usize == self.keyframes.len() {
            self.odometry_since_keyframe += slip;
        } else if let Some(link) = self.links.get_mut(from as usize) {
            *link += slip;
        }
        let frames = Frames { keyframes: &self.keyframes, world_from_robot: &self.local_from_keyframe };
        self.live.carry(&self.settings, &before, frames);
        self.redraw_ground();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn watch(sums: impl Fn(f64) -> f64, looks: u32) -> Watch {
        let mut all = [0.0; 2 * PLACES + 1];
        for (place, sum) in all.iter_mut().enumerate() {
            *sum = sums((place as f64 - PLACES as f64) * PLACE_M);
        }
        Watch { from: 0, along: [1.0, 0.0], sums: all, looks, way_m: 0.0, unseen_m: 0.0, fitting_m: 0.0 }
    }

    #[test]
    fn a_place_that_explains_all_is_found_and_nothing_else_is() {
        let dent = |at_m: f64, deep: f64| move |by_m: f64| -deep * (-((by_m - at_m) / 0.1).powi(2)).exp();
        assert_eq!(watch(dent(0.5, 20.0), 4).verdict_m(), Some(0.5));
        assert_eq!(watch(dent(-0.35, 20.0), 4).verdict_m().map(|m| (m * 100.0).round()), Some(-35.0));
        assert_eq!(watch(dent(0.5, 20.0), 3).verdict_m(), None, "too few scans");
        assert_eq!(watch(dent(0.5, 7.0), 9).verdict_m(), None, "too little");
        assert_eq!(watch(dent(0.05, 20.0), 9).verdict_m(), None, "too near");
        assert_eq!(watch(dent(0.8, 20.0), 9).verdict_m(), None, "at the edge");
        let two = |by_m: f64| dent(0.5, 20.0)(by_m) + dent(-0.5, 17.0)(by_m);
        assert_eq!(watch(two, 9).verdict_m(), None, "two places");
    }
}
