//! Slips along corridors: what scans say together, and the past put right from where the wheels slipped.
//!
//! Between bare walls a scan says next to nothing about the way along them, and what little there is does not bring a match
//! back from decimetres away: it fits nearly as well where the wheels have it. But it goes on fitting a little less than
//! usual, and each such scan fits better in one and the same place ahead or behind. Their likelihood ratios add up.

use super::Mapper;
use super::guard::{DOUBT_SIGMAS, INDEPENDENT_BEAMS, Matched, translation_axes};
use crate::closing::{Past, spread, weakened};
use crate::live::Frames;
use crate::motion::Step;
use mapwright_geom::Pose2;
use mapwright_grid::{Change, LiveMap, Matcher, Prior};
use mapwright_record::{EdgeKind, Status};
use mapwright_sensor::SweepPoints;

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
/// The last two speak for the same place up to here, metres.
const STEADY_M: f64 = 0.1;
/// What was seen on the way alone has to say so much for it, nats.
const LEAST_GAIN: f64 = 3.0;
/// Less is not put right, metres.
const LEAST_M: f64 = 0.1;
/// After so much way without a scan that falls behind, and after so much in all, nothing is left to be said, metres.
const LAPSE_M: f64 = 1.5;
const WATCH_M: f64 = 6.0;
/// A slip may have begun so many keyframes before it showed.
const BEFORE: u32 = 12;
/// So many keyframes after it tell where a slip began.
const LOOK_ON: usize = 10;
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
    /// The same of the last look alone.
    last: [f64; 2 * PLACES + 1],
    looks: u32,
    /// Way since it began, since the last look and since the last scan that fell behind, metres.
    way_m: f64,
    unseen_m: f64,
    fitting_m: f64,
}

impl Watch {
    fn new(from: u32) -> Self {
        let none = [0.0; 2 * PLACES + 1];
        Self {
            from,
            along: [0.0; 2],
            sums: none,
            last: none,
            looks: 0,
            way_m: 0.0,
            unseen_m: LOOK_EVERY_M,
            fitting_m: 0.0,
        }
    }

    /// The same, with nothing said yet.
    fn anew(&self) -> Self {
        let Self { from, way_m, unseen_m, fitting_m, .. } = *self;
        Self { way_m, unseen_m, fitting_m, ..Self::new(from) }
    }

    /// Another look. Where the last two speak for another place than all together the wheels are slipping still, and what
    /// was said before says nothing.
    fn add(&mut self, look: [f64; 2 * PLACES + 1]) {
        let both = std::array::from_fn(|place| self.last[place] + look[place]);
        self.sums = std::array::from_fn(|place| self.sums[place] + look[place]);
        self.looks += 1;
        if self.looks > 2 && place_m(best(&self.sums).abs_diff(best(&both)) + PLACES) > STEADY_M {
            (self.sums, self.looks) = (both, 2);
        }
        self.last = look;
    }

    /// How far along the place lies that explains all, if one does.
    fn verdict_m(&self) -> Option<f64> {
        let best = best(&self.sums);
        let away_m = |place: usize| (place as f64 - best as f64).abs() * PLACE_M;
        let by_m = place_m(best);
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
    pub(super) fn watch_slips(&mut self, matched: Option<&Matched>, step: Step, predicted: Pose2) {
        let matched = matched.filter(|m| m.status != Status::Lost && self.suspicion.is_none());
        if matched.is_some_and(|m| m.slip_corrected || m.report.odometry_sigmas > DOUBT_SIGMAS) {
            self.follow_jump(predicted);
        }
        let Some(matched) = matched.filter(|m| m.status == Status::Tracking && !m.slip_corrected) else {
            self.slips.watch = None;
            return;
        };
        let share = matched.agreement.inlier_share();
        let falls = self.slips.usual_share - share > FALL_SHARE;
        let moved_m = step.last_from_robot.x.hypot(step.last_from_robot.y);
        let Some(watch) = &mut self.slips.watch else {
            if falls {
                self.slips.watch = Some(Watch::new(self.keyframes.len() as u32));
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
            *watch = Watch { along, ..watch.anew() };
        }
        let at_place = |place: usize| {
            let by_m = place_m(place);
            Pose2::new(at.x + by_m * along[0], at.y + by_m * along[1], at.theta)
        };
        let here = misfit(&self.matcher, map, points, at);
        watch.add(std::array::from_fn(|place| gain(misfit(&self.matcher, map, points, at_place(place)), here)));
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
        let (noticed, along) = (watch.from, watch.along);
        self.slips.watch = None;
        let at = self.local_from_robot;
        let there = Pose2::new(at.x + by_m * along[0], at.y + by_m * along[1], at.theta);
        let variances = [FOUND_M * FOUND_M, FOUND_M * FOUND_M, FOUND_RAD * FOUND_RAD];
        let prior = Prior { world_from_robot: there, variances, tail: self.settings.motion.tail };
        let (found, agreement) = self.refine(&prior, there);
        let found = found.world_from_robot;
        if found.distance(there) > 2.0 * FOUND_M || agreement.inlier_share() < self.slips.usual_share - FALL_SHARE {
            return;
        }
        let Some(from) = self.began(noticed, found * at.inverse()) else { return };
        if self.is_verified_since(from) {
            return;
        }
        self.slips.mended.push(Mended { scan: self.scans.len() as u64, from, metres: at.distance(found) });
        self.shift_since(from, at, found);
    }

    /// The match itself has put a slip right: what was mapped meanwhile follows.
    fn follow_jump(&mut self, predicted: Pose2) {
        let found = self.local_from_robot;
        let jump_m = predicted.distance(found);
        if jump_m < LEAST_M || self.jobs_out > 0 || !self.jobs.is_empty() {
            return;
        }
        let newest = self.keyframes.len() as u32;
        let began = self.began(newest, found * predicted.inverse());
        let Some(from) = began.filter(|&from| from < newest && !self.is_verified_since(from)) else { return };
        self.slips.mended.push(Mended { scan: self.scans.len() as u64, from, metres: jump_m });
        self.shift_since(from, predicted, found);
    }

    /// Whether a keyframe from there on was found at an old place.
    fn is_verified_since(&self, from: u32) -> bool {
        self.edges.iter().rev().any(|edge| edge.kind == EdgeKind::Closure && edge.to.seq >= from)
    }

    /// The first keyframe that is misplaced: from there on what was seen fits better beside what was seen before if it is
    /// moved, and before it does not.
    fn began(&mut self, noticed: u32, new_from_old: Pose2) -> Option<u32> {
        let first = noticed.saturating_sub(BEFORE).max(1);
        let past = Past { keyframes: &self.keyframes, local_from_keyframe: &self.local_from_keyframe };
        let origin = *self.local_from_keyframe.get(first as usize - 1)?;
        let mut map = self.closing.ground_before(&self.settings, past, first - 1).map;
        let mut points = SweepPoints::default();
        let mut best = (LEAST_GAIN, None);
        for began in first..=self.keyframes.len() as u32 {
            let mut sum = 0.0;
            let mut look = |hits: &[[f64; 2]], pose: Pose2| {
                let misfit = |pose: Pose2| misfit(&self.matcher, &map, hits, origin.between(pose));
                sum += gain(misfit(pose), misfit(new_from_old * pose));
            };
            for node in (began as usize..self.keyframes.len()).take(LOOK_ON) {
                points.fill(&self.keyframes[node].sweep, &mut self.table, self.settings.scan.free_range_m);
                look(&points.hits, self.local_from_keyframe[node]);
            }
            if began as usize + LOOK_ON > self.keyframes.len() {
                look(if self.thinned.is_empty() { &self.points.hits } else { &self.thinned }, self.local_from_robot);
            }
            if sum > best.0 {
                best = (sum, Some(began));
            }
            if let (Some(keyframe), Some(&pose)) =
                (self.keyframes.get(began as usize), self.local_from_keyframe.get(began as usize))
            {
                points.fill(&keyframe.sweep, &mut self.table, self.settings.scan.free_range_m);
                points.fill_normals();
                map.change(&points, origin.between(pose), Change::Add, 0);
            }
        }
        best.1
    }

    /// Moves the robot from where it was thought to be, and with it the keyframes from `from` on. Edges across say what they say
    /// now, the wheels' not much.
    fn shift_since(&mut self, from: u32, thought: Pose2, found: Pose2) {
        let before = self.local_from_keyframe.clone();
        let new_from_old = found * thought.inverse();
        for k in from as usize..before.len() {
            self.local_from_keyframe[k] = new_from_old * before[k];
            self.world_from_keyframe[k] = self.world_from_local * self.local_from_keyframe[k];
        }
        self.movers.forget();
        let now = &self.local_from_keyframe;
        let change = |a: usize, b: usize| before[a].between(before[b]).between(now[a].between(now[b]));
        for edge in self.edges.iter_mut().filter(|edge| edge.kind != EdgeKind::Closure && edge.to.seq >= from) {
            let change = change(edge.from.seq as usize, edge.to.seq as usize);
            edge.from_from_to = edge.from_from_to * change;
            if edge.from.seq + 1 == edge.to.seq {
                edge.information = weakened(edge.information, change);
            }
        }
        self.closing.measure_anew(from, change);
        for k in from as usize..now.len() {
            self.links[k] += spread(change(k - 1, k));
        }
        if let (Some(&old), Some(new)) = (before.last(), now.last()) {
            self.odometry_since_keyframe += spread(old.between(thought).between(new.between(found)));
        }
        self.local_from_robot = found;
        let frames = Frames { keyframes: &self.keyframes, world_from_robot: &self.local_from_keyframe };
        self.live.carry(&self.settings, &before, frames);
        self.redraw_ground();
    }
}

/// The place that fits best.
fn best(sums: &[f64; 2 * PLACES + 1]) -> usize {
    (0..sums.len()).min_by(|&a, &b| sums[a].total_cmp(&sums[b])).unwrap_or(PLACES)
}

/// Negative log likelihood of a scan at a pose.
fn misfit(matcher: &Matcher, map: &LiveMap, hits: &[[f64; 2]], pose: Pose2) -> f64 {
    let share = (INDEPENDENT_BEAMS / hits.len() as f64).min(1.0);
    matcher.evaluate(map, hits, pose, 1.5 * matcher.settings.sigma_m).cost * share
}

/// How much more one place costs than another, as one scan may say.
fn gain(one: f64, other: f64) -> f64 {
    (one - other).clamp(-LOOK_AT_MOST, LOOK_AT_MOST)
}

/// How far ahead a place lies, metres.
fn place_m(place: usize) -> f64 {
    (place as f64 - PLACES as f64) * PLACE_M
}

#[cfg(test)]
mod tests {
    use super::*;

    fn watch(sums: impl Fn(f64) -> f64, looks: u32) -> Watch {
        let mut all = [0.0; 2 * PLACES + 1];
        for (place, sum) in all.iter_mut().enumerate() {
            *sum = sums(place_m(place));
        }
        Watch { sums: all, looks, ..Watch::new(0) }
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
