//! Slips along corridors: what scans say together, and the past put right from where the wheels slipped.
//!
//! Between bare walls a scan says next to nothing about the way along them, and what little there is does not bring a match
//! back from decimetres away: it fits nearly as well where the wheels have it. But it goes on fitting a little less than
//! usual, and each such scan fits better in one and the same place ahead or behind. Their likelihood ratios add up.

use super::track::{INDEPENDENT_BEAMS, Matched, Scene, Tracker, translation_axes};
use crate::sensors::PerSensor;
use crate::store::Slipped;
use mapwright_geom::{Cov3, Pose2, Stored, stored};
use mapwright_grid::Prior;
use mapwright_record::{NodeId, Status};
use nalgebra::Vector3;

/// A fit that falls so far behind the usual one is watched.
const BEHIND_SHARE: f64 = 0.02;
/// Weight of the newest scan in the usual fit, a slow mean.
const USUAL_FIT_WEIGHT: f64 = 0.02;
/// Scans that are looked at lie so far apart, metres.
const LOOK_EVERY_M: f64 = 0.1;
/// Places ahead and behind: so many to either side, so far apart, metres.
const PLACES_A_SIDE: usize = 16;
const PLACE_STEP_M: f64 = 0.05;
/// A direction is weak where it has less than this share of the other one's information.
const OPEN_SHARE: f64 = 0.3;
/// What one scan may say at most, nats.
const LOOK_AT_MOST: f64 = 5.0;
/// Scans that are needed, how much better they fit there, and than at every other place so far away, nats and metres.
const LOOKS_NEEDED: u32 = 4;
const BETTER: f64 = 8.0;
const BETTER_THAN_OTHERS: f64 = 4.0;
const OTHER_M: f64 = 0.25;
/// Less is not put right, metres.
const CORRECTED_FROM_M: f64 = 0.1;
/// After so much way without a scan that falls behind, and after so much in all, nothing is left to be said, metres.
const LAPSE_M: f64 = 1.5;
const WATCH_M: f64 = 6.0;
/// A slip may have begun so many keyframes before it showed.
pub(crate) const BEFORE: usize = 8;
/// Standard deviations of the place that was found, metres and radians.
const FOUND_M: f64 = 0.05;
const FOUND_RAD: f64 = 0.01;

/// Watches how scans fit, for slips that single scans do not show.
#[derive(Debug, Clone, Default)]
pub(super) struct SlipWatch {
    usual_share: PerSensor<f64>,
    watch: Option<Watch>,
}

/// Scans that fall behind.
#[derive(Debug, Clone)]
struct Watch {
    /// The first keyframe that may be misplaced.
    from: NodeId,
    /// The direction that they say little about, in the front end's frame.
    along: [f64; 2],
    /// Negative log likelihood of each place, less that of where the robot is thought to be.
    sums: [f64; 2 * PLACES_A_SIDE + 1],
    looks: u32,
    /// Way since it began, since the last look and since the last scan that fell behind, metres.
    way_m: f64,
    unseen_m: f64,
    fitting_m: f64,
}

stored!(SlipWatch { usual_share, watch });
stored!(Watch { from, along, sums, looks, way_m, unseen_m, fitting_m });

impl Watch {
    /// How far along the place lies that explains all, if one does.
    fn verdict_m(&self) -> Option<f64> {
        let best = (0..self.sums.len()).min_by(|&a, &b| self.sums[a].total_cmp(&self.sums[b]))?;
        let away_m = |place: usize| (place as f64 - best as f64).abs() * PLACE_STEP_M;
        let by_m = (best as f64 - PLACES_A_SIDE as f64) * PLACE_STEP_M;
        let others = (0..self.sums.len()).filter(|&place| away_m(place) >= OTHER_M - 1e-9);
        let alone = others.map(|place| self.sums[place] - self.sums[best]).fold(f64::INFINITY, f64::min);
        let found = self.looks >= LOOKS_NEEDED
            && self.sums[best] <= -BETTER
            && alone >= BETTER_THAN_OTHERS
            && by_m.abs() >= CORRECTED_FROM_M
            // The place may lie beyond those that were looked at.
            && best > 0
            && best + 1 < self.sums.len();
        found.then_some(by_m)
    }
}

impl SlipWatch {
    /// Goes on as it was, after so many keyframes.
    pub(super) fn restore(from: &mut &[u8], keyframes: usize) -> Option<Self> {
        let is_sound = |watch: &Watch| {
            let all = watch.sums.iter().chain([&watch.way_m, &watch.unseen_m, &watch.fitting_m]);
            watch.from.index() <= keyframes
                && watch.along[0].hypot(watch.along[1]) < 1.001
                && all.copied().all(f64::is_finite)
        };
        Self::take(from).filter(|slips| slips.watch.as_ref().is_none_or(is_sound))
    }

    /// Nothing is watched for while the robot may be elsewhere.
    pub(super) fn stop(&mut self) {
        self.watch = None;
    }

    /// Looks whether the robot has slipped, scan by scan, and says so once they tell it together. `local_from_robot` is where the
    /// match has put it; while `busy` what is under way was asked of the past as it is, and `is_closed_since` a keyframe says
    /// whether a closure vouches for what was mapped from there on.
    pub(super) fn watch(
        &mut self,
        scene: &Scene<'_>,
        tracker: &Tracker,
        matched: &Matched,
        local_from_robot: Pose2,
        busy: bool,
        is_closed_since: impl Fn(NodeId) -> bool,
    ) -> Option<Slipped> {
        let share = matched.agreement.inlier_share();
        let usual_share = self.usual_share.of(scene.laser);
        let falls = *usual_share - share > BEHIND_SHARE;
        let moved_m = scene.step.last_from_robot.x.hypot(scene.step.last_from_robot.y);
        let Some(watch) = &mut self.watch else {
            if falls {
                let sums = [0.0; 2 * PLACES_A_SIDE + 1];
                let (along, way_m, unseen_m, fitting_m) = ([0.0; 2], 0.0, LOOK_EVERY_M, 0.0);
                let mut watch = Watch { from: scene.next, along, sums, looks: 0, way_m, unseen_m, fitting_m };
                watch.look_along(scene, tracker, local_from_robot);
                self.watch = Some(watch);
            } else if matched.agreement.known_share() > 0.5 {
                *usual_share += USUAL_FIT_WEIGHT * (share - *usual_share);
            }
            return None;
        };
        watch.way_m += moved_m;
        watch.unseen_m += moved_m;
        watch.fitting_m = if falls { 0.0 } else { watch.fitting_m + moved_m };
        if watch.fitting_m > LAPSE_M || watch.way_m > WATCH_M {
            *usual_share = share;
            self.watch = None;
            return None;
        }
        if watch.unseen_m < LOOK_EVERY_M {
            return None;
        }
        watch.look_along(scene, tracker, local_from_robot);
        let by_m = watch.verdict_m().filter(|_| !busy)?;
        let (from, along) = (watch.from, watch.along);
        self.watch = None;
        let by = [by_m * along[0], by_m * along[1]];
        if is_closed_since(from) { None } else { self.slipped(scene, tracker, local_from_robot, from, by) }
    }

    /// A slip by so much, x and y, unless a match there says otherwise.
    fn slipped(
        &self,
        scene: &Scene<'_>,
        tracker: &Tracker,
        at: Pose2,
        from: NodeId,
        [by_x, by_y]: [f64; 2],
    ) -> Option<Slipped> {
        let there = Pose2::new(at.x + by_x, at.y + by_y, at.theta);
        let variances = [FOUND_M * FOUND_M, FOUND_M * FOUND_M, FOUND_RAD * FOUND_RAD];
        let prior = Prior { world_from_robot: there, variances, tail: scene.settings.motion.tail };
        let (found, agreement) = tracker.refine(scene, &prior, there);
        let found = found.world_from_robot;
        let usual_share = self.usual_share.get(scene.laser).copied().unwrap_or_default();
        if found.distance(there) > 2.0 * FOUND_M || agreement.inlier_share() < usual_share - BEHIND_SHARE {
            return None;
        }
        let slip = at.between(found);
        let slip = Vector3::new(slip.x, slip.y, slip.theta);
        Some(Slipped {
            from,
            metres: at.distance(found),
            new_from_old: found * at.inverse(),
            local_from_robot: found,
            slip: Cov3::from(slip * slip.transpose()),
        })
    }
}

/// Whether slips may be told at all.
pub(super) fn is_clear(matched: Option<&Matched>) -> Option<&Matched> {
    matched.filter(|matched| matched.status == Status::Tracking)
}

impl Watch {
    /// How the scan fits at each place ahead and behind.
    fn look_along(&mut self, scene: &Scene<'_>, tracker: &Tracker, at: Pose2) {
        let Scene { map, points, .. } = *scene;
        let sigma_m = 1.5 * tracker.matcher.settings.sigma_m;
        let here = tracker.matcher.evaluate(map, points, at, sigma_m);
        let ([weak, strong], [[x, y], _]) = translation_axes(&here.hessian);
        self.unseen_m = 0.0;
        if weak > OPEN_SHARE * strong {
            return;
        }
        let (s, c) = at.theta.sin_cos();
        let mut along = [c * x - s * y, s * x + c * y];
        let cosine = along[0] * self.along[0] + along[1] * self.along[1];
        if cosine < 0.0 {
            along = along.map(|v| -v);
        }
        if cosine.abs() < 0.98 {
            // Around a corner it is another corridor.
            (self.along, self.sums, self.looks) = (along, [0.0; 2 * PLACES_A_SIDE + 1], 0);
        }
        self.looks += 1;
        let share = (INDEPENDENT_BEAMS / points.len() as f64).min(1.0);
        for (place, sum) in self.sums.iter_mut().enumerate() {
            let by_m = (place as f64 - PLACES_A_SIDE as f64) * PLACE_STEP_M;
            let there = Pose2::new(at.x + by_m * along[0], at.y + by_m * along[1], at.theta);
            let cost = tracker.matcher.evaluate(map, points, there, sigma_m).cost;
            *sum += ((cost - here.cost) * share).clamp(-LOOK_AT_MOST, LOOK_AT_MOST);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn watch(sums: impl Fn(f64) -> f64, looks: u32) -> Watch {
        let mut all = [0.0; 2 * PLACES_A_SIDE + 1];
        for (place, sum) in all.iter_mut().enumerate() {
            *sum = sums((place as f64 - PLACES_A_SIDE as f64) * PLACE_STEP_M);
        }
        Watch { from: NodeId::new(0), along: [1.0, 0.0], sums: all, looks, way_m: 0.0, unseen_m: 0.0, fitting_m: 0.0 }
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
