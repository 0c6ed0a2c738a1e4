//! The pipeline: scan in, update out.

use crate::closing::{Budget, Closing};
use crate::jobs::Job;
use crate::live::{Frames, Live, LiveReport};
use crate::motion::{Moved, Predictor, Step};
use crate::probe::{NoProbe, Probe, Stage};
use crate::render::{Doubted, GlobalMap};
use crate::settings::{Settings, SettingsError};
use guard::Matched;
use mapwright_geom::{Cov3, Pose2, Stamp, compose_covariance};
use mapwright_grid::{CorrelativeSearch, CountGrid, LiveMap, Matcher, MatcherSettings};
use mapwright_record::{Candidate, Edge, Keyframe, KeyframeId, Status, Update};
use mapwright_sensor::{BeamCounts, BeamTable, LaserScan, Odometry, Sweep, SweepPoints, TurnRate, TurnRates};
use movers::{Movers, Place};
use nalgebra::{Matrix3, Vector3};
use relocation::{Broken, Lost};
use rustc_hash::FxHashSet;
use slip::Slips;
use std::collections::VecDeque;
use suspicion::Suspicion;
use sweep_motion::RecentOdometry;

mod arrival;
mod correction;
mod guard;
mod insert;
mod movers;
mod relocation;
mod slip;
mod suspicion;
mod sweep_motion;

pub use guard::{DOUBT_SHARE, DOUBT_SIGMAS, KNOWN_SHARE, LOST_SHARE};
pub(crate) use insert::spacing;
pub use slip::Mended;

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
/// Beams a match uses at most.
const MATCH_BEAMS: usize = 4096;
/// Scans over which the share of isolated returns is averaged.
const SCATTER_SCANS: f64 = 200.0;
/// Four buildings with sound lasers have 0.6 to 4.8 %; 10 % of random readings make 13 %.
const SCATTER_SHARE: f64 = 0.08;
/// Error of the map between the anchor and here that no single match shows: at the anchor and per metre away from it,
/// for positions (m) and headings (rad); calibrated with the scale above.
const MAP_FLOOR: [[f64; 2]; 2] = [[0.0005, 0.0007], [0.0007, 0.0006]];

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
    /// How often it was asked where the robot is, and what that may cost.
    questions: u64,
    budget: Budget,
    /// The way is broken before the next keyframe: it hangs on an old one instead.
    broken: Option<Broken>,
    /// Whether the robot is where it thinks it is.
    suspicion: Suspicion,
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
    recent_odometry: RecentOdometry,
    turn_rates: TurnRates,
    movers: Movers,
    sweep: Option<Sweep>,
    table: BeamTable,
    points: SweepPoints,
    searcher: CorrelativeSearch,
    /// End points for matching where there are more than [`MATCH_BEAMS`], else empty.
    thinned: Vec<[f64; 2]>,
    /// Keyframes that were taken out for good.
    dropped: FxHashSet<u32>,
    /// Keyframes whose scan hardly fitted.
    doubted: Vec<Doubted>,
    scatter: Scatter,
    lost_scans: u32,
    /// Running mean of the share of fitting beams.
    usual_share: f64,
    slips: Slips,
    /// The first keyframe made in doubt, until a match confirms where the robot is.
    doubted_from: Option<u32>,
    /// Keyframes in a row with somebody in the way.
    intruded: u32,
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
            closing: Closing::new(&settings),
            jobs: VecDeque::new(),
            jobs_out: 0,
            lost: None,
            questions: 0,
            budget: Budget::default(),
            broken: None,
            suspicion: Suspicion::default(),
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
            recent_odometry: RecentOdometry::default(),
            turn_rates: TurnRates::default(),
            movers: Movers::default(),
            sweep: None,
            table: BeamTable::default(),
            points: SweepPoints::default(),
            searcher: CorrelativeSearch::default(),
            thinned: Vec::new(),
            dropped: FxHashSet::default(),
            doubted: Vec::new(),
            scatter: Scatter::default(),
            lost_scans: 0,
            usual_share: 0.0,
            slips: Slips::default(),
            doubted_from: None,
            intruded: 0,
        }
    }

    /// Remembers a reading of the wheels: for scans within 2 s of it that carry none of their own, and for the robot's motion
    /// during a sweep.
    ///
    /// Hand in what was read during a sweep before its scan, as it arrives from a robot.
    pub fn add_odometry(&mut self, odometry: &Odometry) {
        if odometry.odom_from_robot.is_finite() {
            self.recent_odometry.add(*odometry);
            if let Some(lost) = self.lost_or_arrived() {
                lost.add_odometry(odometry);
            }
        }
    }

    /// Remembers a reading of a gyroscope, for the robot's motion during a sweep: hand in what was read during it before its
    /// scan. False where it is no rate that a robot can have; it is left out then.
    pub fn add_turn_rate(&mut self, rate: &TurnRate) -> bool {
        if let Some(lost) = self.lost_or_arrived() {
            lost.add_turn_rate(rate);
        }
        self.turn_rates.add(*rate)
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
        // 3. Match against the live map, with a guard; what is not certain enough for that leaves before.
        let frames = Frames { keyframes: &self.keyframes, world_from_robot: &self.local_from_keyframe };
        let hits = if self.thinned.is_empty() { &self.points.hits } else { &self.thinned };
        self.live.meet(&self.settings, frames, hits, predicted);
        let matched = self.match_scan(predicted, step);
        probe.end(Stage::Match);
        matched.iter().for_each(|m| self.budget.earn_match(m.report.evaluations, m.report.beams));
        let matched = self.suspicion(scan, matched, step);
        self.settle(scan, odom_from_robot, step, predicted, matched.as_ref());
        self.watch_slips(matched.as_ref(), step);
        // 4. and 5. Insert when the robot has moved enough; the live map follows what is certain.
        let keyframe = self.insert_if_moved(scan, matched.as_ref());
        probe.end(Stage::Insert);
        // 6. and 7. Detect and correct: jobs, done at once or handed out.
        self.detect(keyframe);
        probe.end(Stage::Close);
        // 8. Report.
        self.update(scan, beams, matched.as_ref(), keyframe, refused)
    }

    fn odometry_of(&self, scan: &LaserScan) -> Option<Pose2> {
        let own = scan.odom_from_robot.filter(|pose| pose.is_finite());
        own.or_else(|| self.recent_odometry.fresh_at(scan.stamp))
    }

    fn prepare(&mut self, scan: &LaserScan, step: Step, refused: Option<&'static str>) -> BeamCounts {
        if refused.is_some() {
            self.points.clear();
            let refused = u32::try_from(scan.ranges_m.len()).unwrap_or(u32::MAX);
            return BeamCounts { refused, ..BeamCounts::default() };
        }
        let twist = self.sweep_twist(scan, step);
        let limits = (self.settings.scan.min_range_m, self.settings.scan.max_range_m);
        let sweep = self.sweep.get_or_insert_with(|| Sweep::empty(&scan.laser));
        let mut beams = sweep.fill(scan, twist, limits);
        self.scatter.observe(sweep.isolated_share());
        if self.scatter.is_noisy() {
            beams.isolated = sweep.drop_isolated();
            beams.returns -= beams.isolated;
        }
        self.points.fill(sweep, &mut self.table, self.settings.scan.free_range_m);
        if self.settings.scan.drop_moving && step.from_odometry && !self.predictor.doubts_odometry() {
            let place = Place {
                local_from_robot: self.local_from_robot * step.last_from_robot,
                odom_from_robot: self.odom_from_robot * step.last_from_robot,
            };
            beams.moving = self.movers.drop_from(sweep, &self.points, scan.stamp, place);
            if beams.moving > 0 {
                beams.returns -= beams.moving;
                self.points.fill(sweep, &mut self.table, self.settings.scan.free_range_m);
            }
        }
        self.thinned.clear();
        let every = self.points.hits.len().div_ceil(MATCH_BEAMS);
        if every > 1 {
            self.thinned.extend(self.points.hits.iter().step_by(every));
        }
        beams
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
            let supplier = matched.agreement.supplier;
            self.anchor_at(supplier.filter(|&node| self.live.is_live(node)));
        }
        if !acceptable(self.local_from_robot) {
            self.local_from_robot = before;
        }
        self.lost_scans = if matched.is_some() && !tracking { (self.lost_scans + 1).min(1000) } else { 0 };
        let last_from_robot = before.between(self.local_from_robot);
        let moved = match matched {
            _ if !tracking => Moved::Unknown,
            _ if step.from_odometry => Moved::By(last_from_robot),
            Some(matched) if matched.slip_corrected => Moved::AsBefore,
            _ => Moved::Matched(last_from_robot),
        };
        self.predictor.settle(scan.stamp, odom, moved);
        self.odom_from_robot = self.odom_from_robot * step.last_from_robot;
        if self.lost_scans > 0 {
            self.movers.forget();
        } else {
            let place = Place { local_from_robot: self.local_from_robot, odom_from_robot: self.odom_from_robot };
            self.movers.remember(&scan.laser, scan.stamp, place);
        }
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

    /// The keyframes whose scan hardly fitted when they were made: see [`GlobalMap::export_believed`].
    #[must_use]
    pub fn doubted(&self) -> &[Doubted] {
        &self.doubted
    }

    /// Counts of every keyframe at its present pose, drawn from scratch on two threads, without those that hardly fitted
    /// ([`Mapper::doubted`]) and contradict the others: the map to export.
    #[must_use]
    pub fn render(&self) -> CountGrid {
        self.render_with(2)
    }

    /// As [`Mapper::render`], on so many threads; the map is the same.
    #[must_use]
    pub fn render_with(&self, threads: usize) -> CountGrid {
        let mut map = GlobalMap::new(&self.settings);
        map.export_believed(&self.keyframes, &self.render_poses(), &self.doubted, threads);
        map.into_counts()
    }
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

/// Posterior covariance of a prior covariance and a measurement's information.
fn fuse(covariance: &Cov3, information: &Cov3) -> Cov3 {
    covariance.try_inverse().and_then(|prior| (prior + information).try_inverse()).unwrap_or(*covariance)
}

fn acceptable(pose: Pose2) -> bool {
    pose.is_finite() && pose.x.abs() <= FARTHEST_M && pose.y.abs() <= FARTHEST_M
}
