//! Step 3: the match, and the guard that starts it again where it is in doubt.

use super::predict::{Predictor, Step};
use super::prepare::Preparation;
use crate::front_end::Found;
use crate::local_map::LocalMapping;
use crate::pose::RobotPose;
use crate::sensors::{PerSensor, SensorId};
use crate::settings::{Optimizer, Settings};
use crate::watch::Watch;
use mapwright_geom::{Cov3, Pose2, Stamp, Stored};
use mapwright_grid::{
    Agreement, CorrelativeSearch, LocalMap, MatchResult, Matcher, MatcherSettings, Prior, SearchWindow,
};
use mapwright_record::{MatchReport, NodeId, Past, Status};
use nalgebra::Matrix3;

/// Below this share of fitting beams, among those in known territory, a match is doubtful.
pub const DOUBT_SHARE: f64 = 0.6;
/// Below this share the match is not believed; below [`DOUBT_SHARE`] neither where it contradicts odometry after a scan that was
/// not believed.
pub const LOST_SHARE: f64 = 0.35;
/// Disagreement with odometry that raises doubt, standard deviations.
pub const DOUBT_SIGMAS: f64 = 4.0;
/// Where a smaller share of a scan's beams ends in known territory, the map says little about the pose.
pub const KNOWN_SHARE: f64 = 0.3;
/// A scan can only be said not to fit where more than this share of its end points lies where something is known.
pub(crate) const MISFIT_KNOWN_SHARE: f64 = 0.5;
/// After so many keyframes without confirmation it is a new part of the map that is tracked.
const UNCONFIRMED_AT_MOST: usize = 50;
/// Where beams count with no more than this share (`matching.beam_share`), as those of scans that stand for a dozen echoes of sonars, a scan says
/// too little to doubt its prediction.
const LITTLE_SHARE: f64 = 0.1;
/// Headings tried on doubt beside the predicted one, radians.
const RESTART_HEADINGS_RAD: [f64; 8] = [-0.15, 0.15, -0.35, 0.35, -0.7, 0.7, -1.3, 1.3];
/// Headings tried where scans are far apart, radians.
const NEARBY_HEADINGS_RAD: [f64; 4] = [-0.018, -0.009, 0.009, 0.018];
/// The search's window: so many of the prior's standard deviations, within bounds.
const SEARCH_SIGMAS: f64 = 4.0;
const SEARCH_LEAST_M: f64 = 0.5;
const SEARCH_MOST_M: f64 = 5.0;
const SEARCH_LEAST_RAD: f64 = 1.5;
/// Neighbouring beams are right or wrong together: where matches are compared, a scan says as much as so many that are
/// independent of each other.
pub(super) const INDEPENDENT_BEAMS: f64 = 30.0;
/// The most that disagreement with odometry may count there. As above, calibrated in docs/decisions/0010.
const PRIOR_COST_AT_MOST: f64 = 40.0;
/// What it costs there that the wheels fail: `-ln p`, one step in eight thousand.
const FAILURE_COST: f64 = 9.0;
/// This share of the strongest direction's information is noise of the normals and is taken off the weaker one's.
const WEAK_SHARE: f64 = 0.01;
/// The same without odometry: nothing holds a match then that sticks along a corridor to what was just drawn, and what it says
/// of that direction is wrong by metres before a scan tells.
const WEAK_SHARE_ALONE: f64 = 0.03;
/// A match that fits so much less than usual may have been led astray, or have slipped.
const FALL_SHARE: f64 = 0.05;
/// Starts that are tried then, ahead and behind, metres.
const SLIPS_M: [f64; 6] = [-0.45, -0.3, -0.15, 0.15, 0.3, 0.45];
/// Standard deviation of a slip, metres; with odometry that is as good as its model none is longer.
const SLIPPED_M: f64 = 0.3;
/// With odometry that is worse none is longer than this, metres.
const SLIPPED_AT_MOST_M: f64 = 0.5;
/// From such shares of known and of fitting beams on a match judges odometry.
const SURE_SHARE: f64 = 0.8;
/// A robot that was blind is where its wheels say where the scan says so too, to a cell and so many radians.
const THERE_RAD: f64 = 0.01;
/// Weight of the newest scan in the usual share of fitting beams.
const USUAL_WEIGHT: f64 = 0.05;
/// What does not fit is not in the model, and what fits is as little to be trusted: the information falls with the square
/// of the fit, to this share where the match is doubtful.
const LEAST_TRUST: f64 = 0.05;
/// From the curvature of the objective to information. Beams are correlated (less), the last stage's sigma is wider
/// than a beam's noise (more); calibrated by the NEES of simulated rooms and corridors (`tests/consistency.rs`).
const INFORMATION_SCALE: f64 = 1.7;

/// What the match stage hands on.
#[derive(Debug, Clone)]
pub struct Matched {
    pub(crate) local_from_robot: Pose2,
    pub(crate) information: Cov3,
    pub(crate) agreement: Agreement,
    pub(crate) status: Status,
    pub(crate) report: MatchReport,
    /// An older slip was put right: the pose's step is not the robot's motion.
    pub(super) slip_corrected: bool,
    /// Where the scan knows the pose by itself: what it corrects odometry by, and to what variances.
    pub(super) on_odometry: Option<([f64; 3], [f64; 3])>,
    /// And there the wheels told a way back as one ahead.
    pub(super) reversed: bool,
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
    /// The keyframe that supplied most of what it was matched against.
    pub(crate) fn supplier(&self) -> Option<NodeId> {
        self.agreement.supplier.map(NodeId::new)
    }

    /// Whether the scan fits badly where much is known.
    pub(super) fn hardly_fits(&self) -> bool {
        self.agreement.inlier_share() < DOUBT_SHARE && self.agreement.known_share() > MISFIT_KNOWN_SHARE
    }
}

/// What a scan is matched with, and what is known beside it.
#[derive(Clone, Copy)]
pub(super) struct Scene<'a> {
    pub(super) settings: &'a Settings,
    pub(super) map: &'a LocalMap,
    /// End points in the robot's frame.
    pub(super) points: &'a [[f64; 2]],
    pub(super) predictor: &'a Predictor,
    /// Where the robot was at the scan before, and its motion since.
    pub(super) local_from_last: Pose2,
    pub(super) step: Step,
    /// The laser that took the scan.
    pub(super) laser: SensorId,
    /// The keyframe that comes next.
    pub(super) next: NodeId,
}

impl<'a> Scene<'a> {
    /// The last scan and all that is known of it, with the pose before it.
    pub(super) fn new(
        settings: &'a Settings,
        local_map: &'a LocalMapping,
        preparation: &'a Preparation,
        predictor: &'a Predictor,
        (past, pose): (Past<'_>, &RobotPose),
        step: Step,
    ) -> Self {
        Self {
            settings,
            map: &local_map.map,
            points: preparation.match_points(),
            predictor,
            local_from_last: pose.local_from_robot(),
            step,
            laser: preparation.laser(),
            next: NodeId::at(past.local_from_keyframe.len()),
        }
    }

    fn refine_with(&self, matcher: &Matcher, prior: &Prior, start: Pose2) -> (MatchResult, Agreement) {
        let (map, hits) = (self.map, self.points);
        let result = match self.settings.matching.optimizer {
            Optimizer::GaussNewton => matcher.gauss_newton(map, hits, prior, start),
            Optimizer::GradientAscent => matcher.gradient_ascent(map, hits, prior, start),
            Optimizer::UnscaledGradientAscent => matcher.unscaled_gradient_ascent(map, hits, prior, start),
        };
        (result, map.agreement(hits, result.world_from_robot))
    }

    /// Where the robot is if the wheels fail.
    fn failures(&self, prior: &Prior) -> Vec<Prior> {
        self.predictor.failures(self.step).map(|moved| self.after(moved, prior)).collect()
    }

    /// Where it is after another motion.
    fn after(&self, last_from_robot: Pose2, prior: &Prior) -> Prior {
        Prior { world_from_robot: self.local_from_last * last_from_robot, ..*prior }
    }
}

/// Matches scans, and remembers how they have fitted.
#[derive(Debug, Clone)]
pub(crate) struct Tracker {
    pub(super) matcher: Matcher,
    searcher: CorrelativeSearch,
    /// By laser, running mean of the share of fitting beams.
    usual_share: PerSensor<f64>,
    /// Since when nothing was seen, and how many scans in a row were not believed.
    pub(super) watch: Watch,
    /// The first keyframe made in doubt, until a match confirms where the robot is.
    doubted_from: Option<NodeId>,
}

impl Tracker {
    pub(super) fn new(settings: &Settings) -> Self {
        Self {
            matcher: Matcher { settings: settings.matcher() },
            searcher: CorrelativeSearch::default(),
            usual_share: PerSensor::default(),
            watch: Watch::default(),
            doubted_from: None,
        }
    }

    pub(super) fn put(&self, out: &mut Vec<u8>) {
        self.usual_share.put(out);
        let Watch { misfits, seen, blank, heard, silence } = self.watch;
        (misfits, self.doubted_from, seen).put(out);
        (blank, heard, silence).put(out);
    }

    /// Goes on as it was, after so many keyframes.
    pub(super) fn restore(settings: &Settings, from: &mut &[u8], keyframes: usize) -> Option<Self> {
        let usual_share = PerSensor::<f64>::take(from)?;
        let (misfits, doubted_from, seen): (u32, Option<NodeId>, _) = Stored::take(from)?;
        let (blank, heard, silence): (u32, _, _) = Stored::take(from)?;
        let watch = Watch { misfits, seen, blank, heard, silence };
        let is_sound = usual_share.iter().all(|share| (0.0..=1.0).contains(share))
            && watch.is_sound()
            && doubted_from.is_none_or(|from| from.index() <= keyframes);
        is_sound.then(|| Self { usual_share, watch, doubted_from, ..Self::new(settings) })
    }

    /// Something new is mapped from this scan on.
    pub(super) fn begin_anew(&mut self, stamp: Stamp) {
        self.doubted_from = None;
        self.watch.begin_anew(stamp);
    }

    /// The scan against the local map, from the prediction and, where that is doubtful, from elsewhere. None without a map or
    /// without a hit.
    pub(super) fn track(&mut self, scene: &Scene<'_>, stamp: Stamp, predicted: Pose2) -> Option<Matched> {
        if scene.points.is_empty() {
            self.watch.see_nothing(stamp);
            return None;
        }
        self.watch.see(stamp);
        if scene.next.index() == 0 {
            return None;
        }
        let Scene { step, .. } = *scene;
        let widen = 1.0 + f64::from(self.watch.misfits);
        let prior = Prior {
            world_from_robot: predicted,
            variances: step.variances.map(|v| v * widen),
            tail: scene.settings.motion.tail,
        };
        let first = self.refine(scene, &prior, predicted);
        let first_fits = first.1.inlier_share() >= DOUBT_SHARE;
        let evaluations = first.0.evaluations;
        let mut tried = Tried {
            best: first,
            evaluations,
            restarts: 0,
            searched: false,
            first_fits,
            prior,
            failures: scene.failures(&prior),
            from_odometry: step.from_odometry,
        };
        // Scans that say little are no reason to look elsewhere: they fit anywhere, and odometry decides.
        let says_enough = scene.settings.matching.beam_share > LITTLE_SHARE;
        let doubtful = says_enough && tried.doubtful();
        if doubtful || says_enough && scene.predictor.may_be_reversed(step) {
            self.restart_failures(scene, &mut tried);
        }
        if doubtful {
            self.restart_headings(scene, &prior, &mut tried);
        }
        if says_enough && tried.best.1.inlier_share() < DOUBT_SHARE {
            self.search(scene, &prior, &mut tried);
        }
        let mut slip_corrected = false;
        if says_enough {
            self.restart_finely(scene, &prior, &mut tried);
            self.restart_nearby(scene, &prior, &mut tried);
            slip_corrected = self.restart_slipped(scene, &mut tried);
        }
        self.observe_share(scene.laser, &tried.best.1);
        let on_odometry = self.on_odometry(&tried, step);
        let reversed = on_odometry.is_some() && tried.is_likelier(&scene.after(step.reversed(), &tried.prior));
        let Tried { best: (result, agreement), evaluations, restarts, searched, .. } = tried;
        let odometry_sigmas = sigmas(&prior, result.world_from_robot);
        let unconfirmed = self.unconfirmed(scene.next, &agreement);
        let status = match judge(&agreement, odometry_sigmas, step.from_odometry && self.watch.misfits > 0) {
            Status::Tracking if unconfirmed => Status::Degraded,
            Status::Lost if !says_enough => Status::Degraded,
            status => status,
        };
        let report = MatchReport {
            beams: scene.points.len() as u32,
            inlier_share: agreement.inlier_share(),
            off_m: None,
            known_share: agreement.known_share(),
            odometry_sigmas,
            evaluations,
            restarts,
            searched,
            unconfirmed,
        };
        let fits = 1.0 - (1.0 - agreement.inlier_share()) / (1.0 - DOUBT_SHARE);
        let trust = if status == Status::Degraded { LEAST_TRUST } else { (fits * fits).max(LEAST_TRUST) };
        Some(Matched {
            local_from_robot: if status == Status::Lost { predicted } else { result.world_from_robot },
            information: constrained(&result.hessian, step.from_odometry) * (INFORMATION_SCALE * trust),
            agreement,
            status,
            report,
            slip_corrected,
            on_odometry,
            reversed,
        })
    }

    /// Whether the scan fits as scans usually do, knows the pose by itself and finds it in the very place where the wheels say: a match from
    /// elsewhere comes to rest nearby too, but not just there.
    pub(super) fn is_where_wheels_say(&self, scene: &Scene<'_>, predicted: Pose2) -> bool {
        if !scene.step.from_odometry || scene.predictor.doubts_odometry() {
            return false;
        }
        let tail = scene.settings.motion.tail;
        let prior = Prior { world_from_robot: predicted, variances: scene.step.variances, tail };
        let (result, agreement) = self.refine(scene, &prior, predicted);
        let fits = agreement.inlier_share() >= SURE_SHARE.max(self.usual_share(scene.laser) - FALL_SHARE);
        let is_sure = fits && agreement.known_share() >= SURE_SHARE;
        let is_known = || constrained(&result.hessian, true).try_inverse().is_some();
        let error = predicted.between(result.world_from_robot);
        let is_there = error.x.hypot(error.y) <= scene.settings.map.resolution_m && error.theta.abs() <= THERE_RAD;
        is_there && is_sure && is_known()
    }

    /// Where a scan is by a match from the prediction alone, if it fits there.
    pub(super) fn glance(&self, scene: &Scene<'_>, predicted: Pose2) -> Option<Pose2> {
        if scene.points.is_empty() || scene.next.index() == 0 {
            return None;
        }
        let tail = scene.settings.motion.tail;
        let prior = Prior { world_from_robot: predicted, variances: scene.step.variances, tail };
        let (result, agreement) = self.refine(scene, &prior, predicted);
        (agreement.inlier_share() >= DOUBT_SHARE).then_some(result.world_from_robot)
    }

    /// After a scan that did not fit, whatever is mapped may be in the wrong place and fit itself: doubt remains until a
    /// match is supplied by what was mapped before, or the robot has gone far.
    fn unconfirmed(&mut self, next: NodeId, agreement: &Agreement) -> bool {
        if agreement.inlier_share() < DOUBT_SHARE {
            self.doubted_from.get_or_insert(next);
        } else if self.doubted_from.is_some_and(|from| {
            agreement.supplier.is_some_and(|supplier| NodeId::new(supplier) < from)
                || next.index() - from.index() > UNCONFIRMED_AT_MOST
        }) {
            self.doubted_from = None;
        }
        self.doubted_from.is_some()
    }

    /// A match from one start, and how the scan agrees with the map there.
    pub(super) fn refine(&self, scene: &Scene<'_>, prior: &Prior, start: Pose2) -> (MatchResult, Agreement) {
        scene.refine_with(&self.matcher, prior, start)
    }

    /// On doubt the match is started again from where the robot is if the wheels fail.
    fn restart_failures(&self, scene: &Scene<'_>, tried: &mut Tried) {
        for failure in tried.failures.clone() {
            tried.restarts += 1;
            tried.offer(self.refine(scene, &failure, failure.world_from_robot));
        }
    }

    /// A match begins coarsely, to find its way from afar; what comes into view all at once may lead it astray then. Where it
    /// fits less than usual it is started again without, for with sound odometry it is near.
    fn restart_finely(&self, scene: &Scene<'_>, prior: &Prior, tried: &mut Tried) {
        let sound = tried.from_odometry && !scene.predictor.doubts_odometry();
        if sound && self.usual_share(scene.laser) - tried.best.1.inlier_share() > FALL_SHARE {
            let settings = MatcherSettings { capture_sigma_m: self.matcher.settings.sigma_m, ..self.matcher.settings };
            tried.restarts += 1;
            tried.offer(scene.refine_with(&Matcher { settings }, prior, prior.world_from_robot));
        }
    }

    /// Where scans are so far apart that each becomes a keyframe, it is matched from other headings nearby too: its beams lie
    /// far from those before, several headings fit, the nearest is not always the best, and what is drawn stays.
    fn restart_nearby(&self, scene: &Scene<'_>, prior: &Prior, tried: &mut Tried) {
        let at = tried.best.0.world_from_robot;
        if scene.settings.keyframes.is_far(scene.step.last_from_robot) {
            for turn in NEARBY_HEADINGS_RAD {
                tried.offer(self.refine(scene, prior, at * Pose2::new(0.0, 0.0, turn)));
            }
        }
    }

    /// A match may stick to what the scans before it have drawn, and slip along a corridor while every scan seems to fit.
    /// It shows as a fit that falls behind the usual one. Then the places ahead and behind, in the direction that the scan
    /// says least about, are tried, and one that fits nearly as usual is right: the slip is older than this scan, so the
    /// prediction does not speak against it. Odometry that is as good as its model would have shown a long one. Tells
    /// whether one was taken.
    fn restart_slipped(&self, scene: &Scene<'_>, tried: &mut Tried) -> bool {
        let share = tried.best.1.inlier_share();
        let drop = self.usual_share(scene.laser) - share;
        if drop <= FALL_SHARE || share < DOUBT_SHARE {
            return false;
        }
        let [variance_x, variance_y, variance_theta] = tried.prior.variances;
        let slipped_m2 = SLIPPED_M * SLIPPED_M;
        let variances = [variance_x + slipped_m2, variance_y + slipped_m2, variance_theta];
        let prior = Prior { variances, ..tried.prior };
        let at = tried.best.0.world_from_robot;
        let (_, [[x, y], _]) = translation_axes(&tried.best.0.hessian);
        let mut least = share + 0.5 * drop;
        let farthest_m = match (tried.from_odometry, scene.predictor.doubts_odometry()) {
            (true, true) => SLIPPED_AT_MOST_M,
            (true, false) => SLIPPED_M,
            (false, _) => f64::INFINITY,
        };
        let mut corrected = false;
        for by_m in SLIPS_M {
            tried.restarts += 1;
            let other = self.refine(scene, &prior, at * Pose2::new(by_m * x, by_m * y, 0.0));
            tried.evaluations += other.0.evaluations;
            let near = at.distance(other.0.world_from_robot) <= farthest_m;
            if near && other.1.inlier_share() > least {
                least = other.1.inlier_share();
                tried.best = other;
                corrected = true;
            }
        }
        corrected
    }

    /// Where the scan fits and knows the pose by itself, odometry is judged by it: its correction, and to what variances.
    fn on_odometry(&self, tried: &Tried, step: Step) -> Option<([f64; 3], [f64; 3])> {
        let (result, agreement) = &tried.best;
        let sure = agreement.inlier_share() >= SURE_SHARE && agreement.known_share() >= SURE_SHARE;
        let covariance = (constrained(&result.hessian, step.from_odometry) * INFORMATION_SCALE).try_inverse();
        let covariance = covariance.filter(|_| sure && self.watch.misfits == 0)?;
        let correction = tried.prior.world_from_robot.between(result.world_from_robot).log();
        Some((correction, covariance.diagonal().into()))
    }

    /// The share of fitting beams that is usual here and now.
    fn observe_share(&mut self, laser: SensorId, agreement: &Agreement) {
        if agreement.known_share() > 0.5 {
            let usual = self.usual_share.of(laser);
            *usual += USUAL_WEIGHT * (agreement.inlier_share() - *usual);
        }
    }

    fn usual_share(&self, laser: SensorId) -> f64 {
        self.usual_share.get(laser).copied().unwrap_or_default()
    }

    /// On doubt the match is started again from other headings; a wrong heading is how matches fail.
    fn restart_headings(&self, scene: &Scene<'_>, prior: &Prior, tried: &mut Tried) {
        let predicted = prior.world_from_robot;
        for turn in RESTART_HEADINGS_RAD {
            tried.restarts += 1;
            tried.offer(self.refine(scene, prior, Pose2::new(predicted.x, predicted.y, predicted.theta + turn)));
        }
    }

    /// Where restarts do not help, every pose of the prior's window is looked at, and the best one refined.
    fn search(&mut self, scene: &Scene<'_>, prior: &Prior, tried: &mut Tried) {
        let [vx, vy, vtheta] = prior.variances;
        // Wheels may slip in a turn, but nothing turns a robot round behind their back.
        let turned_rad = if tried.from_odometry { SEARCH_SIGMAS * vtheta.sqrt() } else { std::f64::consts::PI };
        let window = SearchWindow {
            world_from_robot: prior.world_from_robot,
            half_width_m: (SEARCH_SIGMAS * vx.max(vy).sqrt()).clamp(SEARCH_LEAST_M, SEARCH_MOST_M),
            half_width_rad: turned_rad.clamp(SEARCH_LEAST_RAD, std::f64::consts::PI),
        };
        tried.searched = true;
        let found = self.searcher.search(scene.map, scene.points, &window, None);
        if let Some(found) = found {
            tried.offer(self.refine(scene, prior, found.best.world_from_robot));
        }
    }
}

/// Distance of a pose from the prior's in standard deviations, the worst of the three.
fn sigmas(prior: &Prior, world_from_robot: Pose2) -> f64 {
    let error = prior.world_from_robot.between(world_from_robot).log();
    error.iter().zip(prior.variances).map(|(e, v)| e.abs() / v.sqrt()).fold(0.0, f64::max)
}

/// Matches from several starts, and the best of them.
struct Tried {
    best: (MatchResult, Agreement),
    evaluations: u32,
    restarts: u32,
    searched: bool,
    /// The match from the prediction explains the scan.
    first_fits: bool,
    prior: Prior,
    /// Where the robot is if the wheels fail.
    failures: Vec<Prior>,
    from_odometry: bool,
}

impl Tried {
    fn doubtful(&self) -> bool {
        doubtful(&self.best.1, sigmas(&self.prior, self.best.0.world_from_robot))
    }

    /// Smaller is better: the objective, and beams that end where other beams have passed. What odometry says counts in
    /// full while the first match explains the scan, and only so much where it may have missed a motion altogether.
    fn score(&self, (result, agreement): &(MatchResult, Agreement)) -> f64 {
        let most = if self.first_fits { f64::INFINITY } else { PRIOR_COST_AT_MOST };
        let beams = f64::from(agreement.fitting + agreement.contradicting + agreement.unknown);
        let scan = result.scan_cost + f64::from(agreement.contradicting);
        scan * (INDEPENDENT_BEAMS / beams).min(1.0) + self.motion_cost(result.world_from_robot).min(most)
    }

    /// Negative log density of the motion: as odometry says, or by one of its failures.
    fn motion_cost(&self, world_from_robot: Pose2) -> f64 {
        let failed = self.failures.iter().map(|failure| failure.cost(world_from_robot) + FAILURE_COST);
        failed.fold(self.prior.cost(world_from_robot), f64::min)
    }

    /// Whether the robot moved so rather than as odometry says.
    fn is_likelier(&self, failure: &Prior) -> bool {
        let at = self.best.0.world_from_robot;
        self.from_odometry && failure.cost(at) + FAILURE_COST < self.prior.cost(at)
    }

    fn offer(&mut self, other: (MatchResult, Agreement)) {
        self.evaluations += other.0.evaluations;
        if self.score(&other) < self.score(&self.best) {
            self.best = other;
        }
    }
}

fn doubtful(agreement: &Agreement, odometry_sigmas: f64) -> bool {
    agreement.inlier_share() < DOUBT_SHARE || odometry_sigmas > DOUBT_SIGMAS
}

/// `after_lost`: the scan before was not believed, and there is odometry to go by.
fn judge(agreement: &Agreement, odometry_sigmas: f64, after_lost: bool) -> Status {
    // A match that sees nothing it knows strays to where a part of it fits.
    let strays = after_lost && odometry_sigmas > DOUBT_SIGMAS && agreement.inlier_share() < DOUBT_SHARE;
    if agreement.known_share() > 0.5 && (agreement.inlier_share() < LOST_SHARE || strays) {
        Status::Lost
    } else if doubtful(agreement, odometry_sigmas) || agreement.known_share() < KNOWN_SHARE {
        Status::Degraded
    } else {
        Status::Tracking
    }
}

/// The information on translation along its weaker and its stronger direction, and the directions, in the robot's frame.
pub(super) fn translation_axes(information: &Cov3) -> ([f64; 2], [[f64; 2]; 2]) {
    let eigen = information.fixed_view::<2, 2>(0, 0).into_owned().symmetric_eigen();
    let order = if eigen.eigenvalues[0] < eigen.eigenvalues[1] { [0, 1] } else { [1, 0] };
    let direction = |axis: usize| [eigen.eigenvectors[(0, axis)], eigen.eigenvectors[(1, axis)]];
    (order.map(|axis| eigen.eigenvalues[axis]), order.map(direction))
}

/// The part of a scan's information that its surfaces really carry.
///
/// Along a bare wall the noise of the normals looks like a little information; a direction of translation with less
/// than a share of the strongest one's ([`WEAK_SHARE`], [`WEAK_SHARE_ALONE`]) is left to the prediction, and the share is taken
/// off a better one.
fn constrained(information: &Cov3, from_odometry: bool) -> Cov3 {
    let ([weak, strong], [_, [x, y]]) = translation_axes(information);
    let share = if from_odometry { WEAK_SHARE } else { WEAK_SHARE_ALONE };
    let known = (weak - share * strong).max(0.0);
    let keep = if known > 0.0 { (known / weak).sqrt() } else { 0.0 };
    let (xx, xy, yy) = (x * x + keep * y * y, x * y * (1.0 - keep), y * y + keep * x * x);
    let shrink = Matrix3::new(xx, xy, 0.0, xy, yy, 0.0, 0.0, 0.0, 1.0);
    shrink * information * shrink
}
