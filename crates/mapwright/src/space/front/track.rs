//! Step 3: the match, and the guard that starts it again where it is in doubt.
//!
//! Near to the prediction first, at the finer resolutions. Where what is known bears that out less than it did the clouds before, from the
//! coarse ones too, where the robot stood, and from other headings: on hard data the basin decides, not the precision. The most probable
//! of what is found is taken, by points and prediction.

use super::predict::Step;
use crate::front_end::Found;
use crate::sensors::{PerSensor, SensorId};
use crate::settings::{Optimizer, Settings};
use crate::space::local_map::LocalMapping;
use crate::watch::Watch;
use mapwright_geom::{Cov6, Pose3};
use mapwright_record::{MatchReport, NodeId, Status};
use mapwright_voxel::{
    Ascent, BentFit, Descent, Fit, HELD_SHARE, Matcher, MatcherSettings, Prior, Seen, Start, TwistPrior,
};
use nalgebra::Vector6;

/// A match is in doubt where a point of which something is known is less likely, where it lies and by what was predicted, than those of the
/// clouds before by so much, in logarithms,
const DOUBT_NATS: f64 = 0.25;
/// or where less than this share of it is known: in a wrong place little is.
const DOUBT_KNOWN: f64 = 0.75;
/// How much the newest cloud counts in what is usual.
const USUAL_GAIN: f64 = 0.2;
/// Below this share a match is doubtful, and below the next it is not believed.
const DEGRADED_SHARE: f64 = 0.55;
const LOST_SHARE: f64 = 0.35;
/// Where a smaller share of a cloud lies where something is known, the map says nothing of the pose.
const LEAST_KNOWN: f64 = 0.15;
/// Headings tried on doubt, beside the predicted one: so many steps to either side, radians.
const HEADINGS: i32 = 11;
const HEADING_RAD: f64 = 0.262;
/// The most promising of them are followed to the finest resolution.
const FOLLOWED: usize = 3;
/// A cloud that was matched in doubt says less, to this share of its information.
const DOUBTED_TRUST: f64 = 0.25;

/// What the match stage hands on.
#[derive(Debug, Clone, Copy)]
pub struct Matched {
    pub(crate) local_from_robot: Pose3,
    pub(crate) information: Cov6,
    pub(crate) status: Status,
    pub(crate) report: MatchReport,
    /// Whether it knows how the robot turned: it fits, and surfaces hold its rotation.
    pub(super) knows_turn: bool,
    /// The mean log likelihood ratio of a point of which something is known.
    pub(super) each_known: Option<f64>,
    /// What is known bears it out less than it did the clouds before.
    pub(super) in_doubt: bool,
    /// Log evidence of what was predicted, nats.
    pub(super) evidence: f64,
    /// So little of it is known that the map says nothing of the pose.
    pub(super) is_nowhere: bool,
    /// What is known makes it less likely there than anywhere.
    pub(super) is_contradicted: bool,
    /// Who supplied most of what it was matched against.
    pub(super) supplier: Option<NodeId>,
}

impl Found for Matched {
    fn status(&self) -> Status {
        self.status
    }

    fn report(&self) -> MatchReport {
        self.report
    }
}

impl Matched {
    /// Whether so little of it is known that it is in doubt.
    pub(super) fn hardly_knows(&self) -> bool {
        self.report.known_share < DOUBT_KNOWN
    }

    pub(super) fn hardly_fits(&self) -> bool {
        self.report.inlier_share < DEGRADED_SHARE
    }
}

/// Matches, and remembers how likely clouds were.
#[derive(Debug, Clone, Default)]
pub(super) struct Tracker {
    matcher: Matcher,
    suppliers: Vec<NodeId>,
    /// The mean log likelihood ratio of a point of which something is known, of matches that were believed: of each sensor.
    usual: PerSensor<Option<f64>>,
    /// That of the present cloud.
    sensor: SensorId,
    /// Since when nothing was seen, and how many clouds in a row were not believed.
    pub(super) watch: Watch,
}

impl Tracker {
    pub(super) fn new(settings: &Settings) -> Self {
        let ascent = match settings.matching.optimizer {
            Optimizer::GaussNewton => Ascent::GaussNewton,
            Optimizer::GradientAscent => Ascent::Gradient,
            Optimizer::UnscaledGradientAscent => Ascent::UnscaledGradient,
        };
        let matcher = Matcher::new(MatcherSettings { ascent, ..MatcherSettings::default() });
        Self { matcher, ..Self::default() }
    }

    /// How likely clouds of each sensor were.
    pub(super) fn usual(&self) -> &PerSensor<Option<f64>> {
        &self.usual
    }

    /// One that goes on with that.
    pub(super) fn used_to(self, usual: PerSensor<Option<f64>>, watch: Watch) -> Self {
        Self { usual, watch, ..self }
    }

    /// The next cloud is of this sensor.
    pub(super) fn turn_to(&mut self, sensor: SensorId) {
        self.sensor = sensor;
    }

    fn usual_now(&self) -> Option<f64> {
        self.usual.get(self.sensor).copied().flatten()
    }

    /// The cloud against the local map; `last` is where the robot was, and `undistorted` the twist by which its points were undistorted.
    pub(super) fn track(
        &mut self,
        local_map: &LocalMapping,
        seen: Seen<'_>,
        (last, predicted): (Pose3, Pose3),
        (step, undistorted_per_s): (&Step, Vector6<f64>),
    ) -> Option<Matched> {
        if seen.points_m.is_empty() {
            return None;
        }
        let map = local_map.map();
        let prior = Prior { map_from_cloud: predicted, information: step.information };
        // Constant velocity as the only start is worse than standing still.
        let standing = if step.from_imu { Pose3 { rotation: predicted.rotation, ..last } } else { last };
        let read = step.read.map(|rotation| Pose3 { rotation: last.rotation * rotation, ..predicted });
        let mut best = self.matcher.climb_near(map, seen, &prior, predicted);
        let mut restarts = 0;
        if self.is_doubtful(&best, &prior) {
            best = likelier(best, self.matcher.climb_near(map, seen, &prior, standing), &prior);
            let starts = [predicted, standing].into_iter().chain(read);
            for start in self.matcher.rough(map, seen, &prior, starts, Descent::Whole, 1) {
                best = likelier(best, self.matcher.climb(map, seen, &prior, start), &prior);
            }
        }
        if self.is_doubtful(&best, &prior) {
            // Who has turned so far since has turned during the sweep as well.
            let about = |k: i32| {
                let turned = Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, HEADING_RAD * f64::from(k));
                let turning = turned / step.own_elapsed_s - undistorted_per_s;
                let twist_per_s = if step.from_imu { Vector6::zeros() } else { turning };
                Start { map_from_cloud: last * Pose3::exp(turned), twist_per_s }
            };
            let headings = (-HEADINGS..=HEADINGS + 1).map(about);
            for start in self.matcher.rough(map, seen, &prior, headings, Descent::WholeAndFine, FOLLOWED) {
                best = likelier(best, self.matcher.climb(map, seen, &prior, start), &prior);
                restarts += 1;
            }
        }
        Some(self.judge(local_map, seen.points_m, &prior, &best, restarts))
    }

    /// Remembers how likely a match made its cloud, if it is believed.
    pub(super) fn get_used_to(&mut self, matched: &Matched) {
        if let Some(found) = matched.each_known.filter(|_| matched.is_believed()) {
            let usual = self.usual.of(self.sensor);
            *usual = Some(usual.map_or(found, |usual| usual + USUAL_GAIN * (found - usual)));
        }
    }

    fn is_doubtful(&self, fit: &Fit, prior: &Prior) -> bool {
        let is_unlikely = |usual: f64| each_known(fit.posterior(prior), fit) < usual - DOUBT_NATS;
        fit.known_share < DOUBT_KNOWN || self.usual_now().is_none_or(is_unlikely)
    }

    /// A sweep, and the motion while it was taken, from where it was found.
    pub(super) fn bent(
        &mut self,
        local_map: &LocalMapping,
        seen: Seen<'_>,
        (found, prior): (&Matched, &Prior),
        motion: &TwistPrior,
    ) -> BentFit {
        self.matcher.climb_bent(local_map.map(), seen, (prior, found.local_from_robot), motion)
    }

    /// The cloud once more from where it was found before, undistorted as its points say.
    pub(super) fn again(
        &mut self,
        local_map: &LocalMapping,
        seen: Seen<'_>,
        (before, bent, prior): (&Matched, &BentFit, &Prior),
    ) -> Matched {
        let seen = Seen { times_s: &[], ..seen };
        let mut fit = self.matcher.climb_near(local_map.map(), seen, prior, bent.fit.map_from_cloud);
        fit.evaluations += bent.fit.evaluations + before.report.evaluations;
        fit.information = bent.fit.information;
        self.judge(local_map, seen.points_m, prior, &fit, before.report.restarts)
    }

    fn judge(
        &mut self,
        local_map: &LocalMapping,
        points: &[[f32; 3]],
        prior: &Prior,
        fit: &Fit,
        restarts: u32,
    ) -> Matched {
        let Fit { known_share, inlier_share, off_m, .. } = *fit;
        let is_nowhere = known_share + fit.lines_share < LEAST_KNOWN;
        let fits = if is_nowhere || known_share > 0.0 && inlier_share < LOST_SHARE {
            Status::Lost
        } else if inlier_share < DEGRADED_SHARE {
            Status::Degraded
        } else {
            Status::Tracking
        };
        let error = Pose3::between(prior.map_from_cloud, fit.map_from_cloud).log();
        let trust = if fits == Status::Tracking { 1.0 } else { DOUBTED_TRUST };
        let [translation, rotation] = fit.held_shares;
        let is_turn_held = rotation >= HELD_SHARE;
        let is_held = is_turn_held && translation >= HELD_SHARE;
        let status = if fits == Status::Tracking && !is_held { Status::Degraded } else { fits };
        let report = MatchReport {
            beams: fit.points,
            inlier_share,
            off_m: Some(off_m),
            known_share,
            odometry_sigmas: error.dot(&(prior.information * error)).sqrt(),
            evaluations: fit.evaluations,
            restarts,
            searched: false,
            unconfirmed: false,
        };
        Matched {
            local_from_robot: fit.map_from_cloud,
            information: fit.information * trust,
            status,
            each_known: (known_share > 0.0).then(|| each_known(fit.log_likelihood, fit)),
            in_doubt: self.is_doubtful(fit, prior),
            evidence: fit.evidence(prior),
            is_nowhere,
            is_contradicted: fit.log_likelihood < 0.0,
            knows_turn: fits == Status::Tracking && is_turn_held,
            report,
            supplier: self.supplier(local_map, points, fit.map_from_cloud),
        }
    }

    /// The keyframe that supplied most of what the points lie on, the newest of equals.
    fn supplier(&mut self, local_map: &LocalMapping, points: &[[f32; 3]], pose: Pose3) -> Option<NodeId> {
        self.suppliers.clear();
        local_map.map().each_supplier(points, pose, |owner| self.suppliers.push(NodeId::new(owner)));
        self.suppliers.sort_unstable();
        let runs = self.suppliers.chunk_by(|a, b| a == b).filter(|run| local_map.is_drawn(run[0]));
        runs.max_by_key(|run| (run.len(), run[0])).map(|run| run[0])
    }
}

/// The likelier of two fits, by points and prior.
fn likelier(a: Fit, b: Fit, prior: &Prior) -> Fit {
    let evaluations = a.evaluations + b.evaluations;
    let best = if b.posterior(prior) > a.posterior(prior) { b } else { a };
    Fit { evaluations, ..best }
}

/// The mean of such a point of which something is known.
fn each_known(log_likelihood: f64, fit: &Fit) -> f64 {
    if fit.known_share > 0.0 { log_likelihood / fit.known_share } else { 0.0 }
}
