//! The pipeline: scan in, update out.

use crate::closing::Closing;
use crate::jobs::Job;
use crate::live::{Frames, Live, LiveReport};
use crate::motion::{Predictor, Step};
use crate::probe::{NoProbe, Probe, Stage};
use crate::render::GlobalMap;
use crate::settings::{Optimizer, Settings, SettingsError};
use mapwright_geom::{Cov3, Pose2, Stamp, compose_covariance};
use mapwright_grid::{
    Agreement, CorrelativeSearch, CountGrid, LiveMap, MatchResult, Matcher, MatcherSettings, Prior, SearchWindow,
};
use mapwright_record::{Candidate, Edge, EdgeKind, Keyframe, KeyframeId, MatchReport, Status, Update};
use mapwright_sensor::{BEAM_DROPPED, BeamCounts, BeamTable, LaserScan, Odometry, Sweep, SweepPoints};
use nalgebra::{Matrix3, Vector3};
use relocation::{Broken, Lost};
use rustc_hash::FxHashSet;
use std::collections::VecDeque;

mod correction;
mod relocation;

/// A pose of the final trajectory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrajectoryPose {
    /// The scan's stamp.
    pub stamp: Stamp,
    /// Pose of the robot in the map, with every correction.
    pub map_from_robot: Pose2,
}

/// Poses beyond this are refused, metres.
const FARTHEST_M: f64 = 1e6;
/// Keyframes back from the newest over which the chain of covariances is kept in mind.
const CHAIN: usize = 64;
/// Below this share of fitting beams, among those in known territory, a match is doubtful.
pub const DOUBT_SHARE: f64 = 0.6;
/// Below this share the match is not believed.
pub const LOST_SHARE: f64 = 0.35;
/// Disagreement with odometry that raises doubt, standard deviations.
pub const DOUBT_SIGMAS: f64 = 4.0;
/// Where a smaller share of a scan's beams ends in known territory, the map says little about the pose.
pub const KNOWN_SHARE: f64 = 0.3;
/// After so many keyframes without confirmation it is a new part of the map that is tracked.
const UNCONFIRMED_AT_MOST: u32 = 50;
/// Headings tried on doubt beside the predicted one, radians.
const RESTART_HEADINGS_RAD: [f64; 8] = [-0.15, 0.15, -0.35, 0.35, -0.7, 0.7, -1.3, 1.3];
/// The search's window: so many of the prior's standard deviations, within bounds.
const SEARCH_SIGMAS: f64 = 4.0;
const SEARCH_LEAST_M: f64 = 0.5;
const SEARCH_MOST_M: f64 = 5.0;
/// Neighbouring beams are right or wrong together: where matches are compared, a scan says as much as so many that are
/// independent of each other.
const INDEPENDENT_BEAMS: f64 = 30.0;
/// The most that disagreement with odometry may count there. As above, calibrated in docs/decisions/0010.
const PRIOR_COST_AT_MOST: f64 = 40.0;
/// What it costs there that the wheels fail: `-ln p`, one step in eight thousand.
const FAILURE_COST: f64 = 9.0;
/// From this share of end points in space that beams have passed on, they are taken for somebody in the way and left
/// out of the keyframe.
const INTRUDER_SHARE: f64 = 0.15;
/// After so many keyframes in a row it is the world that has changed.
const INTRUDED_AT_MOST: u32 = 16;
/// More motion than this within one sweep is not believed, metres and radians.
const SWEEP_MOTION_M: f64 = 5.0;
const SWEEP_TURN_RAD: f64 = 3.0;
/// Beams a match uses at most.
const MATCH_BEAMS: usize = 4096;
/// Scans over which the share of isolated returns is averaged.
const SCATTER_SCANS: f64 = 200.0;
/// Four buildings with sound lasers have 0.6 to 4.8 %; 10 % of random readings make 13 %.
const SCATTER_SHARE: f64 = 0.08;
/// This share of the strongest direction's information is noise of the normals and is taken off the weaker one's.
const WEAK_SHARE: f64 = 0.1;
/// From the curvature of the objective to information. Beams are correlated (less), the last stage's sigma is wider
/// than a beam's noise (more); calibrated by the NEES of simulated rooms and corridors (`tests/consistency.rs`).
const INFORMATION_SCALE: f64 = 1.5;
/// Error of the map between the anchor and here that no single match shows: at the anchor and per metre away from it,
/// for positions (m) and headings (rad); calibrated with the scale above.
const MAP_FLOOR: [[f64; 2]; 2] = [[0.0005, 0.0007], [0.0003, 0.0006]];

/// Builds a map one scan at a time.
#[derive(Debug, Clone)]
pub struct Mapper {
    settings: Settings,
    matcher: Matcher,
    predictor: Predictor,
    live: Live,
    keyframes: Vec<Keyframe>,
    edges: Vec<Edge>,
    closing: Closing,
    jobs: VecDeque<Job>,
    /// Jobs that were handed out and have not come back.
    jobs_out: usize,
    /// The map that is made while the robot does not know where it is.
    lost: Option<Box<Lost>>,
    /// The way is broken before the next keyframe: it hangs on an old one instead.
    broken: Option<Broken>,
    /// Length of way until a robot that was not seen for a while is believed to be where it was, metres.
    suspect_m: f64,
    /// Scans that did not fit on it.
    misfits: u32,
    /// The keyframe of an arrival that is not yet believed.
    arrived: Option<u32>,
    /// The last scan that saw something.
    seen: Option<Stamp>,
    /// Current poses of the keyframes, in the front end's frame and in the map's.
    local_from_keyframe: Vec<Pose2>,
    world_from_keyframe: Vec<Pose2>,
    /// Every scan: the keyframe it hangs on and its pose seen from there.
    scans: Vec<(Stamp, Option<u32>, Pose2)>,
    local_from_robot: Pose2,
    /// Moves when the past is corrected, for the robot and what is matched against stay where they are.
    world_from_local: Pose2,
    odom_from_robot: Pose2,
    /// Information of the last match, zero where there was none.
    information: Cov3,
    /// Motion-model covariance alone, relative to the newest keyframe.
    odometry_since_keyframe: Cov3,
    /// Fused covariance of each keyframe relative to the one before.
    links: Vec<Cov3>,
    anchor: Option<u32>,
    /// Covariance of the newest keyframe relative to the anchor.
    keyframe_from_anchor: Cov3,
    last_odometry: Option<Odometry>,
    sweep: Option<Sweep>,
    table: BeamTable,
    points: SweepPoints,
    searcher: CorrelativeSearch,
    /// End points for matching where there are more than [`MATCH_BEAMS`], else empty.
    thinned: Vec<[f64; 2]>,
    /// Keyframes that were taken out for good.
    dropped: FxHashSet<u32>,
    scatter: Scatter,
    lost_scans: u32,
    /// The first keyframe made in doubt, until a match confirms where the robot is.
    doubted_from: Option<u32>,
    /// Keyframes in a row with somebody in the way.
    intruded: u32,
}

/// What the match stage hands on.
struct Matched {
    world_from_robot: Pose2,
    information: Cov3,
    agreement: Agreement,
    status: Status,
    report: MatchReport,
}

impl Mapper {
    /// A mapper that starts at the map's origin.
    ///
    /// # Errors
    /// A setting outside its range.
    pub fn new(settings: Settings) -> Result<Self, SettingsError> {
        Self::starting_at(settings, Pose2::IDENTITY)
    }

    /// A mapper whose robot starts at `world_from_robot`.
    ///
    /// # Errors
    /// A setting outside its range.
    pub fn starting_at(settings: Settings, world_from_robot: Pose2) -> Result<Self, SettingsError> {
        settings.validate()?;
        Ok(Self::with(settings, world_from_robot))
    }

    fn with(settings: Settings, world_from_robot: Pose2) -> Self {
        let matcher = Matcher {
            settings: MatcherSettings {
                sigma_m: settings.matching.sigma_m,
                capture_sigma_m: settings.matching.capture_sigma_m,
                random_ratio: settings.matching.random_ratio,
                beam_share: settings.matching.beam_share,
                max_evaluations: settings.matching.max_evaluations,
                ..MatcherSettings::default()
            },
        };
        Self {
            live: Live::new(&settings),
            settings,
            matcher,
            predictor: Predictor::default(),
            keyframes: Vec::new(),
            edges: Vec::new(),
            closing: Closing::new(),
            jobs: VecDeque::new(),
            jobs_out: 0,
            lost: None,
            broken: None,
            suspect_m: 0.0,
            misfits: 0,
            arrived: None,
            seen: None,
            local_from_keyframe: Vec::new(),
            world_from_keyframe: Vec::new(),
            scans: Vec::new(),
            local_from_robot: world_from_robot,
            world_from_local: Pose2::IDENTITY,
            odom_from_robot: Pose2::IDENTITY,
            information: Cov3::zeros(),
            odometry_since_keyframe: Cov3::zeros(),
            links: Vec::new(),
            anchor: None,
            keyframe_from_anchor: Cov3::zeros(),
            last_odometry: None,
            sweep: None,
            table: BeamTable::default(),
            points: SweepPoints::default(),
            searcher: CorrelativeSearch::default(),
            thinned: Vec::new(),
            dropped: FxHashSet::default(),
            scatter: Scatter::default(),
            lost_scans: 0,
            doubted_from: None,
            intruded: 0,
        }
    }

    /// Remembers a reading of the wheels for scans that carry none of their own.
    pub fn add_odometry(&mut self, odometry: &Odometry) {
        if odometry.odom_from_robot.is_finite() {
            self.last_odometry = Some(*odometry);
        }
    }

    /// One scan through the pipeline.
    pub fn add_scan(&mut self, scan: &LaserScan) -> Update {
        self.add_scan_probed(scan, &mut NoProbe)
    }

    /// As [`Mapper::add_scan`], telling `probe` when each stage ends.
    pub fn add_scan_probed(&mut self, scan: &LaserScan, probe: &mut impl Probe) -> Update {
        probe.begin();
        let refused = scan.laser.check(scan.ranges_m.len()).err();
        // 1. Prepare: returns and free space as points, what was dropped counted.
        let odom_from_robot = self.odometry_of(scan);
        let step = self.predictor.step(&self.settings.motion, scan.stamp, odom_from_robot);
        let beams = self.prepare(scan, step, refused);
        probe.end(Stage::Prepare);
        // 2. Predict: the pose by odometry or constant velocity, its covariance the match's prior.
        let predicted = self.local_from_robot * step.last_from_robot;
        probe.end(Stage::Predict);
        if self.lost.is_some() {
            return self.add_scan_while_lost(scan, beams, step, predicted, odom_from_robot, refused);
        }
        // 3. Match against the live map, with a guard.
        let matched = self.match_scan(predicted, step);
        probe.end(Stage::Match);
        let matched = self.suspicion(scan.stamp, matched, step);
        self.settle(scan, odom_from_robot, step, predicted, matched.as_ref());
        // 4. and 5. Insert when the robot has moved enough; the live map follows what is certain.
        let keyframe = self.insert_if_moved(scan, matched.as_ref());
        probe.end(Stage::Insert);
        // 6. and 7. Detect and correct: jobs, done at once or handed out.
        self.detect(keyframe);
        // 8. Report.
        self.update(scan, beams, matched.as_ref(), keyframe, refused)
    }

    fn odometry_of(&self, scan: &LaserScan) -> Option<Pose2> {
        let own = scan.odom_from_robot.filter(|pose| pose.is_finite());
        own.or(self.last_odometry.map(|odometry| odometry.odom_from_robot))
    }

    fn prepare(&mut self, scan: &LaserScan, step: Step, refused: Option<&'static str>) -> BeamCounts {
        if refused.is_some() {
            self.points.clear();
            let refused = u32::try_from(scan.ranges_m.len()).unwrap_or(u32::MAX);
            return BeamCounts { refused, ..BeamCounts::default() };
        }
        // The sweep's own motion: the step's twist, carried on at the same rate.
        let twist = if scan.laser.beam_period_s > 0.0 { self.predictor.twist(scan.stamp, step) } else { [0.0; 3] };
        let sweep_s = scan.laser.beam_period_s.abs() * scan.ranges_m.len() as f64;
        let credible =
            twist[0].hypot(twist[1]) * sweep_s <= SWEEP_MOTION_M && twist[2].abs() * sweep_s <= SWEEP_TURN_RAD;
        let twist = if credible { twist } else { [0.0; 3] };
        let limits = (self.settings.scan.min_range_m, self.settings.scan.max_range_m);
        let sweep = self.sweep.get_or_insert_with(|| Sweep::empty(&scan.laser));
        let mut beams = sweep.fill(scan, twist, limits);
        self.scatter.observe(sweep.isolated_share());
        if self.scatter.is_noisy() {
            beams.isolated = sweep.drop_isolated();
            beams.returns -= beams.isolated;
        }
        self.points.fill(sweep, &mut self.table, self.settings.scan.free_range_m);
        self.thinned.clear();
        let every = self.points.hits.len().div_ceil(MATCH_BEAMS);
        if every > 1 {
            self.thinned.extend(self.points.hits.iter().step_by(every));
        }
        beams
    }

    fn match_scan(&mut self, predicted: Pose2, step: Step) -> Option<Matched> {
        if self.keyframes.is_empty() || self.points.hits.is_empty() {
            return None;
        }
        let widen = 1.0 + f64::from(self.lost_scans);
        let prior = Prior {
            world_from_robot: predicted,
            variances: step.variances.map(|v| v * widen),
            tail: self.settings.motion.tail,
        };
        let first = self.refine(&prior, predicted);
        let first_fits = first.1.inlier_share() >= DOUBT_SHARE;
        let evaluations = first.0.evaluations;
        let mut tried = Tried {
            best: first,
            evaluations,
            restarts: 0,
            searched: false,
            first_fits,
            prior,
            failures: self.failures(&prior, step),
        };
        if tried.doubtful() {
            self.restart_failures(&mut tried);
            self.restart_headings(&prior, &mut tried);
        }
        if tried.best.1.inlier_share() < DOUBT_SHARE {
            self.search(&prior, &mut tried);
        }
        let Tried { best: (result, agreement), evaluations, restarts, searched, .. } = tried;
        let odometry_sigmas = sigmas(&prior, result.world_from_robot);
        let unconfirmed = self.unconfirmed(&agreement);
        let status = match judge(&agreement, odometry_sigmas) {
            Status::Tracking if unconfirmed => Status::Degraded,
            status => status,
        };
        let report = MatchReport {
            beams: self.match_points().len() as u32,
            inlier_share: agreement.inlier_share(),
            known_share: agreement.known_share(),
            odometry_sigmas,
            evaluations,
            restarts,
            searched,
            unconfirmed,
        };
        let trust = if status == Status::Degraded { 0.05 } else { 1.0 };
        Some(Matched {
            world_from_robot: if status == Status::Lost { predicted } else { result.world_from_robot },
            information: constrained(&result.hessian) * (INFORMATION_SCALE * trust),
            agreement,
            status,
            report,
        })
    }

    /// After a scan that did not fit, whatever is mapped may be in the wrong place and fit itself: doubt remains until a
    /// match is supplied by what was mapped before, or the robot has gone far.
    fn unconfirmed(&mut self, agreement: &Agreement) -> bool {
        let next = self.keyframes.len() as u32;
        if agreement.inlier_share() < DOUBT_SHARE {
            self.doubted_from.get_or_insert(next);
        } else if self.doubted_from.is_some_and(|from| {
            agreement.supplier.is_some_and(|supplier| supplier < from) || next - from > UNCONFIRMED_AT_MOST
        }) {
            self.doubted_from = None;
        }
        self.doubted_from.is_some()
    }

    /// The end points a match uses: all, or evenly chosen ones where they are very many.
    fn match_points(&self) -> &[[f64; 2]] {
        if self.thinned.is_empty() { &self.points.hits } else { &self.thinned }
    }

    /// A match from one start, and how the scan agrees with the map there.
    fn refine(&self, prior: &Prior, start: Pose2) -> (MatchResult, Agreement) {
        let (map, hits) = (&self.live.map, self.match_points());
        let result = match self.settings.matching.optimizer {
            Optimizer::GaussNewton => self.matcher.gauss_newton(map, hits, prior, start),
            Optimizer::GradientAscent => self.matcher.gradient_ascent(map, hits, prior, start),
            Optimizer::UnscaledGradientAscent => self.matcher.unscaled_gradient_ascent(map, hits, prior, start),
        };
        (result, map.agreement(hits, result.world_from_robot))
    }

    /// Where the robot is if the wheels fail.
    fn failures(&self, prior: &Prior, step: Step) -> Vec<Prior> {
        let at = |last_from_robot: Pose2| Prior { world_from_robot: self.local_from_robot * last_from_robot, ..*prior };
        self.predictor.failures(step).map(at).collect()
    }

    /// On doubt the match is started again from where the robot is if the wheels fail.
    fn restart_failures(&self, tried: &mut Tried) {
        for failure in tried.failures.clone() {
            tried.restarts += 1;
            tried.offer(self.refine(&failure, failure.world_from_robot));
        }
    }

    /// On doubt the match is started again from other headings; a wrong heading is how matches fail.
    fn restart_headings(&self, prior: &Prior, tried: &mut Tried) {
        let predicted = prior.world_from_robot;
        for turn in RESTART_HEADINGS_RAD {
            tried.restarts += 1;
            tried.offer(self.refine(prior, Pose2::new(predicted.x, predicted.y, predicted.theta + turn)));
        }
    }

    /// Where restarts do not help, every pose of the prior's window is looked at, and the best one refined.
    fn search(&mut self, prior: &Prior, tried: &mut Tried) {
        let [vx, vy, _] = prior.variances;
        let window = SearchWindow {
            world_from_robot: prior.world_from_robot,
            half_width_m: (SEARCH_SIGMAS * vx.max(vy).sqrt()).clamp(SEARCH_LEAST_M, SEARCH_MOST_M),
            half_width_rad: std::f64::consts::PI,
        };
        tried.searched = true;
        let hits = if self.thinned.is_empty() { &self.points.hits } else { &self.thinned };
        let found = self.searcher.search(&self.live.map, hits, &window, None);
        if let Some(found) = found {
            tried.offer(self.refine(prior, found.best.world_from_robot));
        }
    }

    /// Takes over the new pose and its covariance.
    fn settle(
        &mut self,
        scan: &LaserScan,
        odom: Option<Pose2>,
        step: Step,
        predicted: Pose2,
        matched: Option<&Matched>,
    ) {
        let before = self.local_from_robot;
        let noise = Matrix3::from_diagonal(&Vector3::from(step.variances));
        self.information = Cov3::zeros();
        self.odometry_since_keyframe = compose_covariance(&self.odometry_since_keyframe, step.last_from_robot, &noise);
        let tracking = matched.is_some_and(|m| m.status != Status::Lost);
        self.local_from_robot = predicted;
        if let Some(matched) = matched.filter(|_| tracking) {
            self.local_from_robot = matched.world_from_robot;
            self.information = matched.information;
            self.anchor_at(matched.agreement.supplier);
        }
        if !acceptable(self.local_from_robot) {
            self.local_from_robot = before;
        }
        self.lost_scans = if matched.is_some() && !tracking { (self.lost_scans + 1).min(1000) } else { 0 };
        let moved = before.between(self.local_from_robot);
        self.predictor.settle(scan.stamp, odom, moved, tracking);
        self.odom_from_robot = self.odom_from_robot * step.last_from_robot;
    }

    /// Makes `anchor` the keyframe that covariances are relative to.
    fn anchor_at(&mut self, anchor: Option<u32>) {
        let Some(anchor) = anchor.filter(|_| anchor != self.anchor) else { return };
        let newest = self.keyframes.len().saturating_sub(1);
        self.anchor = Some(anchor);
        if newest - (anchor as usize).min(newest) <= CHAIN {
            self.keyframe_from_anchor = (anchor as usize + 1..=newest).fold(Cov3::zeros(), |sum, k| {
                let step = self.local_from_keyframe[k - 1].between(self.local_from_keyframe[k]);
                compose_covariance(&sum, step, &self.links[k])
            });
        }
    }

    fn insert_if_moved(&mut self, scan: &LaserScan, matched: Option<&Matched>) -> Option<u32> {
        let lost = matched.is_some_and(|m| m.status == Status::Lost);
        let empty = self.points.hits.is_empty();
        let moved = self.local_from_keyframe.last().is_none_or(|&newest| {
            let step = newest.between(self.local_from_robot);
            step.x.hypot(step.y) > self.settings.keyframes.distance_m
                || step.theta.abs() > self.settings.keyframes.angle_rad
        });
        let inserted =
            (moved && !lost && !empty && self.suspect_m <= 0.0).then(|| self.insert(scan, matched)).flatten();
        let frames = Frames { keyframes: &self.keyframes, world_from_robot: &self.local_from_keyframe };
        self.live.follow(&self.settings, frames, inserted.is_some());
        let newest = self.keyframes.len().checked_sub(1).map(|k| k as u32);
        let keyframe_from_robot = newest
            .map_or(self.local_from_robot, |k| self.local_from_keyframe[k as usize].between(self.local_from_robot));
        self.scans.push((scan.stamp, newest, keyframe_from_robot));
        inserted
    }

    fn insert(&mut self, scan: &LaserScan, matched: Option<&Matched>) -> Option<u32> {
        let node = self.keyframes.len() as u32;
        let id = self.id(node);
        let sweep = self.believed_sweep()?;
        let covariance = self.covariance();
        self.keyframes.push(Keyframe { id, stamp: scan.stamp, scan: self.scans.len() as u64, sweep });
        self.local_from_keyframe.push(self.local_from_robot);
        self.world_from_keyframe.push(self.world_from_local * self.local_from_robot);
        if node > 0 {
            self.connect(node, matched, &covariance);
        } else {
            self.closing.add(self.world_from_keyframe[0], 0.0, &[]);
        }
        self.links.push(fuse(&self.odometry_since_keyframe, &self.information));
        self.keyframe_from_anchor = covariance;
        self.odometry_since_keyframe = Cov3::zeros();
        let frames = Frames { keyframes: &self.keyframes, world_from_robot: &self.local_from_keyframe };
        let (lever_m, _) = self.points.lever_and_reach_m();
        self.live.insert(&self.settings, frames, node, lever_m);
        Some(node)
    }

    /// The sweep, without the beams that end in space known to be free where they are many: people in the way, or a
    /// match that is wrong. Few of them are news, a door or a chair, and stay.
    fn believed_sweep(&mut self) -> Option<Sweep> {
        let mut sweep = self.sweep.clone()?;
        let mut intruders = Vec::new();
        let map = &self.live.map;
        let _ = map.agreement_of_each(&self.points.hits, self.local_from_robot, |hit| intruders.push(hit));
        let many = intruders.len() as f64 >= INTRUDER_SHARE * self.points.hits.len() as f64;
        self.intruded = if many { self.intruded + 1 } else { 0 };
        if !many || self.intruded > INTRUDED_AT_MOST {
            return Some(sweep);
        }
        let returns: Vec<usize> = (0..sweep.codes.len()).filter(|&beam| sweep.range_m(beam).is_some()).collect();
        for hit in intruders {
            sweep.codes[returns[hit]] = BEAM_DROPPED;
        }
        Some(sweep)
    }

    /// Odometry edge with the motion model's information, match edge with the scan's; never both in one.
    fn connect(&mut self, node: u32, matched: Option<&Matched>, covariance: &Cov3) {
        let last = node - 1;
        let between =
            |from: u32| self.local_from_keyframe[from as usize].between(self.local_from_keyframe[node as usize]);
        let mut edges = Vec::new();
        let mut links = Vec::new();
        let mut step_m = between(last).x.hypot(between(last).y);
        if let Some(broken) = self.broken.take() {
            let information = broken.covariance.try_inverse().unwrap_or_else(Cov3::zeros);
            edges.push((broken.from, EdgeKind::Closure, information));
            links.push((broken.from, broken.covariance));
            step_m = relocation::BROKEN_WAY_M;
        } else {
            let information = self.odometry_since_keyframe.try_inverse().unwrap_or_else(Cov3::zeros);
            edges.push((last, EdgeKind::Odometry, information));
            links.push((last, fuse(&self.odometry_since_keyframe, &self.information)));
        }
        if let (Some(matched), Some(anchor)) = (matched, self.anchor.filter(|&a| a < node)) {
            edges.push((anchor, EdgeKind::Match, matched.information));
            if links.iter().all(|&(from, _)| from != anchor) {
                links.push((anchor, *covariance));
            }
        }
        let edge = |&(from, kind, information): &(u32, EdgeKind, Cov3)| Edge {
            from: self.id(from),
            to: self.id(node),
            kind,
            from_from_to: between(from),
            information,
        };
        let edges: Vec<Edge> = edges.iter().map(edge).collect();
        self.closing.add(self.world_from_keyframe[node as usize], step_m, &edges);
        self.edges.extend(edges);
        for (from, covariance) in links {
            self.live.connect(from, &covariance);
        }
    }

    /// Covariance of the robot relative to the anchor.
    fn covariance(&self) -> Cov3 {
        let predicted = match self.local_from_keyframe.last() {
            Some(newest) => {
                let step = newest.between(self.local_from_robot);
                compose_covariance(&self.keyframe_from_anchor, step, &self.odometry_since_keyframe)
            }
            None => self.odometry_since_keyframe,
        };
        let away_m = self.anchor.map_or(0.0, |a| self.local_from_keyframe[a as usize].distance(self.local_from_robot));
        let [floor_m, floor_rad] = MAP_FLOOR.map(|[at_anchor, per_metre]| at_anchor + per_metre * away_m);
        let floor = Vector3::new(floor_m * floor_m, floor_m * floor_m, floor_rad * floor_rad);
        fuse(&predicted, &self.information) + Matrix3::from_diagonal(&floor)
    }

    fn update(
        &self,
        scan: &LaserScan,
        beams: BeamCounts,
        matched: Option<&Matched>,
        keyframe: Option<u32>,
        refused: Option<&'static str>,
    ) -> Update {
        Update {
            scan: self.scans.len() as u64 - 1,
            stamp: scan.stamp,
            map_from_robot: self.world_from_local * self.local_from_robot,
            covariance: self.covariance(),
            anchor: self.anchor.map(|node| self.id(node)),
            status: matched
                .map_or(if self.scans.len() == 1 { Status::Tracking } else { Status::Degraded }, |m| m.status),
            map_from_odom: self.world_from_local * self.local_from_robot * self.odom_from_robot.inverse(),
            odom_from_robot: self.odom_from_robot,
            keyframe: keyframe.map(|node| self.id(node)),
            beams,
            matched: matched.map(|m| m.report),
            refused,
        }
    }

    fn id(&self, node: u32) -> KeyframeId {
        KeyframeId { robot: 0, session: 0, seq: node }
    }

    /// The settings in force.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Keyframes in the order they were made.
    #[must_use]
    pub fn keyframes(&self) -> &[Keyframe] {
        &self.keyframes
    }

    /// Edges in the order they were made.
    #[must_use]
    pub fn edges(&self) -> &[Edge] {
        &self.edges
    }

    /// Every place the robot may have come back to, in the order they were looked at, taken or not.
    #[must_use]
    pub fn candidates(&self) -> &[Candidate] {
        &self.closing.candidates
    }

    /// Present pose of each keyframe in the map.
    #[must_use]
    pub fn keyframe_poses(&self) -> &[Pose2] {
        &self.world_from_keyframe
    }

    /// The map that scans are matched against.
    #[must_use]
    pub fn live_map(&self) -> &LiveMap {
        &self.live.map
    }

    /// What the live map consists of.
    #[must_use]
    pub fn live_report(&self) -> LiveReport {
        self.live.report()
    }

    /// The whole trajectory, every scan in arrival order, with every correction made since.
    pub fn trajectory(&self) -> impl ExactSizeIterator<Item = TrajectoryPose> + '_ {
        self.scans.iter().map(|&(stamp, keyframe, keyframe_from_robot)| {
            let map_from_robot = match keyframe {
                Some(node) => self.world_from_keyframe[node as usize] * keyframe_from_robot,
                None => keyframe_from_robot,
            };
            TrajectoryPose { stamp, map_from_robot }
        })
    }

    /// Takes a keyframe out of the map for good: its beams, and what scans are matched against.
    ///
    /// Returns whether there was such a keyframe in the live map's bookkeeping.
    pub fn drop_keyframe(&mut self, id: KeyframeId) -> bool {
        let known = id.robot == 0 && id.session == 0 && (id.seq as usize) < self.keyframes.len();
        if known {
            let frames = Frames { keyframes: &self.keyframes, world_from_robot: &self.local_from_keyframe };
            self.live.drop(&self.settings, frames, id.seq);
            self.dropped.insert(id.seq);
        }
        known
    }

    /// Present pose of each keyframe in the map, none for those that were dropped: what a [`GlobalMap`] follows.
    #[must_use]
    pub fn render_poses(&self) -> Vec<Option<Pose2>> {
        let stays = |keyframe: &Keyframe| !self.dropped.contains(&keyframe.id.seq);
        self.keyframes.iter().zip(&self.world_from_keyframe).map(|(k, &pose)| stays(k).then_some(pose)).collect()
    }

    /// Counts of every keyframe at its present pose, drawn from scratch on two threads: the map to export.
    #[must_use]
    pub fn render(&self) -> CountGrid {
        self.render_with(2)
    }

    /// As [`Mapper::render`], on so many threads; the map is the same.
    #[must_use]
    pub fn render_with(&self, threads: usize) -> CountGrid {
        let mut map = GlobalMap::new(&self.settings);
        map.export(&self.keyframes, &self.render_poses(), threads);
        map.into_counts()
    }
}

/// Distance of a pose from the prior's in standard deviations, the worst of the three.
fn sigmas(prior: &Prior, world_from_robot: Pose2) -> f64 {
    let error = prior.world_from_robot.between(world_from_robot).log();
    error.iter().zip(prior.variances).map(|(e, v)| e.abs() / v.sqrt()).fold(0.0, f64::max)
}

/// Running mean of the share of isolated returns: a laser that scatters is told from a room with thin things in it.
#[derive(Debug, Clone, Default)]
struct Scatter {
    mean: f64,
    scans: f64,
}

impl Scatter {
    fn observe(&mut self, share: f64) {
        self.scans = (self.scans + 1.0).min(SCATTER_SCANS);
        self.mean += (share - self.mean) / self.scans;
    }

    fn is_noisy(&self) -> bool {
        self.mean > SCATTER_SHARE
    }
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
}

impl Tried {
    /// Misfit and disagreement with odometry add up: a share of each may be as doubtful as one alone.
    fn doubtful(&self) -> bool {
        let misfit = (1.0 - self.best.1.inlier_share()) / (1.0 - DOUBT_SHARE);
        let disagreement = sigmas(&self.prior, self.best.0.world_from_robot) / DOUBT_SIGMAS;
        misfit.hypot(disagreement) > 1.0
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

fn judge(agreement: &Agreement, odometry_sigmas: f64) -> Status {
    if agreement.inlier_share() < LOST_SHARE && agreement.known_share() > 0.5 {
        Status::Lost
    } else if doubtful(agreement, odometry_sigmas) || agreement.known_share() < KNOWN_SHARE {
        Status::Degraded
    } else {
        Status::Tracking
    }
}

/// The part of a scan's information that its surfaces really carry.
///
/// Along a bare wall the noise of the normals looks like a little information; a direction of translation with less
/// than [`WEAK_SHARE`] of the strongest one's is left to odometry, and the share is taken off a better one.
fn constrained(information: &Cov3) -> Cov3 {
    let eigen = information.fixed_view::<2, 2>(0, 0).into_owned().symmetric_eigen();
    let (weak, strong) = if eigen.eigenvalues[0] < eigen.eigenvalues[1] { (0, 1) } else { (1, 0) };
    let known = (eigen.eigenvalues[weak] - WEAK_SHARE * eigen.eigenvalues[strong]).max(0.0);
    let keep = if known > 0.0 { (known / eigen.eigenvalues[weak]).sqrt() } else { 0.0 };
    let [x, y] = [eigen.eigenvectors[(0, strong)], eigen.eigenvectors[(1, strong)]];
    let (xx, xy, yy) = (x * x + keep * y * y, x * y * (1.0 - keep), y * y + keep * x * x);
    let shrink = Matrix3::new(xx, xy, 0.0, xy, yy, 0.0, 0.0, 0.0, 1.0);
    shrink * information * shrink
}
/// Posterior covariance of a prior covariance and a measurement's information.
fn fuse(covariance: &Cov3, information: &Cov3) -> Cov3 {
    covariance.try_inverse().and_then(|prior| (prior + information).try_inverse()).unwrap_or(*covariance)
}

fn acceptable(pose: Pose2) -> bool {
    pose.is_finite() && pose.x.abs() <= FARTHEST_M && pose.y.abs() <= FARTHEST_M
}
