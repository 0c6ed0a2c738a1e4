//! The front end: where the robot is from scan to scan, and the keyframes it makes. It owns the local map and the robot's pose, in a
//! frame of its own in which the newest keyframe never jumps, and can be run without a mapper: what it finds it returns.

use crate::cycles::Follows;
use crate::front_end::{Found, FrontEnd};
use crate::local_map::{Frames, LocalMapping};
use crate::pose::{Motion, RobotPose};
use crate::sensors::newest_of;
use crate::settings::Settings;
use crate::store::{NewKeyframe, Slipped, Written};
use crate::watch::Watch;
use insert::Intruders;
use mapwright_geom::{Cov3, Pose2, Stamp, TangentMatrix, compose_covariance};
use mapwright_grid::LocalMap;
use mapwright_loops::{KnownPlace, PlaneSubmaps, VerifySettings};
use mapwright_record::{Beams, FragmentStart, LeftOutReason, LocalMapReport, NodeId, Past};
use mapwright_sensor::{LaserScan, Odometry, Sweep, SweepPoints, TurnRate};
use predict::{Moved, Predictor, Step};
use prepare::Preparation;
use seen::Place;
use slip::SlipWatch;
use std::sync::Arc;
use track::{Scene, Tracker, translation_axes};

mod checkpoint;
mod dynamic;
mod insert;
mod on_robot;
mod predict;
mod prepare;
mod resume;
mod seen;
mod slip;
mod sweep_motion;
mod sweep_twist;
mod track;

pub(crate) use resume::{Links, links};
pub(crate) use slip::BEFORE;
pub use track::{DOUBT_SHARE, DOUBT_SIGMAS, KNOWN_SHARE, LOST_SHARE};
pub(crate) use track::{MISFIT_KNOWN_SHARE, Matched};

/// Nothing is matched against from such a standard deviation of the position on, metres: places that look alike lie as near as
/// three of them. Gaps in logs of two buildings ask for 0.3 to 1.1 (docs/decisions/0024-fragments.md).
const BREAK_SIGMA_M: f64 = 1.0;

/// Builds a local map and tracks the robot in it, one scan at a time.
#[derive(Debug, Clone)]
pub struct PlaneFrontEnd {
    settings: Settings,
    preparation: Preparation,
    predictor: Predictor,
    tracker: Tracker,
    pose: RobotPose,
    local_map: LocalMapping,
    intruders: Intruders,
    slips: SlipWatch,
}

/// A scan that was prepared.
type Prepared = crate::front_end::Prepared<Pose2, Step>;

impl PlaneFrontEnd {
    /// The newest scan's points, in the robot's frame.
    pub(crate) fn points(&self) -> &SweepPoints {
        self.preparation.points()
    }

    /// How submaps are drawn and looked for.
    pub(crate) fn plane_submaps(&self) -> PlaneSubmaps {
        let settings = &self.settings;
        PlaneSubmaps::new(settings.submaps(), VerifySettings::default(), self.tracker.matcher.settings)
    }

    pub(crate) fn add_odometry(&mut self, odometry: &Odometry) {
        if odometry.odom_from_robot.is_finite() {
            self.preparation.add_odometry(*odometry);
            self.tracker.watch.hear(odometry.stamp);
        }
    }

    pub(crate) fn add_turn_rate(&mut self, rate: &TurnRate) -> bool {
        self.preparation.add_turn_rate(rate)
    }

    /// A first match tells the motion during a sweep whose beams were not taken at once, and the motion is undone anew.
    fn undo_motion_by_match(&mut self, past: Past<'_>, scan: &LaserScan, prepared: &Prepared) {
        let Prepared { step, predicted, .. } = *prepared;
        let Some(elapsed_s) = self.predictor.moving_s(scan.stamp).filter(|_| self.preparation.can_be_told()) else {
            return;
        };
        let scene =
            Scene::new(&self.settings, &self.local_map, &self.preparation, &self.predictor, (past, &self.pose), step);
        let Some(found) = self.tracker.glance(&scene, predicted) else { return };
        let last_from_now = self.pose.local_from_robot().between(found);
        let by_wheels = step.from_odometry.then_some(step.last_from_robot);
        self.preparation.undo_motion(&self.settings.scan, scan.stamp, elapsed_s, last_from_now, by_wheels);
    }

    fn has_sound_wheels(&self, step: Step) -> bool {
        step.from_odometry && !self.predictor.doubts_odometry()
    }

    fn keyframe_here(
        &self,
        past: Past<'_>,
        scan: &LaserScan,
        matched: Option<&Matched>,
        left_out: Option<(Beams, LeftOutReason)>,
    ) -> Option<NewKeyframe> {
        let sweep = Arc::new(self.preparation.sweep()?.clone());
        Some(NewKeyframe {
            stamp: scan.stamp,
            sweep,
            left_out,
            hardly_fits: matched.is_some_and(Matched::hardly_fits),
            local_from_keyframe: self.pose.local_from_robot(),
            covariance: self.pose.covariance(past),
            odometry: self.pose.odometry_since_keyframe(),
            fused: self.pose.fused(),
            matched: matched.and_then(|matched| Some((self.pose.anchor()?, matched.information))),
        })
    }

    pub(crate) fn local_map(&self) -> &LocalMap {
        &self.local_map.map
    }
}

impl FrontEnd<Sweep> for PlaneFrontEnd {
    type Step = Step;
    type Matched = Matched;

    fn new(settings: Settings, local_from_robot: Pose2) -> Self {
        Self {
            preparation: Preparation::default(),
            predictor: Predictor::default(),
            tracker: Tracker::new(&settings),
            pose: RobotPose::new(local_from_robot),
            local_map: LocalMapping::new(&settings),
            intruders: Intruders::default(),
            slips: SlipWatch::default(),
            settings,
        }
    }

    fn settings(&self) -> &Settings {
        &self.settings
    }

    fn pose(&self) -> &RobotPose {
        &self.pose
    }

    fn submaps(&self) -> Option<PlaneSubmaps> {
        Some(self.plane_submaps())
    }

    fn prepare(&mut self, scan: &LaserScan) -> Prepared {
        let refused = scan.laser.check(scan.ranges_m.len()).err();
        let odom_from_robot = self.preparation.odometry_of(scan);
        self.predictor.turn_to(self.preparation.turn_to(&scan.laser));
        let step = self.predictor.step(&self.settings.motion, scan.stamp, odom_from_robot);
        let predicted = self.pose.local_from_robot() * step.last_from_robot;
        let place =
            Place { local_from_robot: predicted, odom_from_robot: self.pose.odom_from_robot() * step.last_from_robot };
        let sound = self.settings.scan.drop_moving && self.has_sound_wheels(step);
        let beams = if refused.is_some() {
            self.preparation.refuse(scan)
        } else {
            let twist = self.predictor.twist(scan.stamp, step);
            let (settings, place) = (&self.settings.scan, sound.then_some(place));
            let believes = |elapsed_s, motion| self.predictor.believes(elapsed_s, motion);
            self.preparation.prepare(settings, scan, step, twist, place, believes)
        };
        Prepared { step, predicted, odom_from_robot, beams, refused }
    }

    fn track(&mut self, past: Past<'_>, scan: &LaserScan, prepared: &mut Prepared) -> Option<Matched> {
        let Prepared { step, predicted, .. } = *prepared;
        self.local_map.meet(&self.settings, Frames::of(past), self.preparation.match_points(), predicted);
        self.undo_motion_by_match(past, scan, prepared);
        let scene =
            Scene::new(&self.settings, &self.local_map, &self.preparation, &self.predictor, (past, &self.pose), step);
        let matched = self.tracker.track(&scene, scan.stamp, predicted)?;
        if let Some((correction, variances)) = matched.on_odometry {
            self.predictor.observe(step, correction, variances);
        }
        if matched.reversed {
            self.predictor.catch_reversed();
        }
        Some(matched)
    }

    fn settle(&mut self, past: Past<'_>, scan: &LaserScan, prepared: &Prepared, matched: Option<&Matched>) {
        let Prepared { step, predicted, odom_from_robot, .. } = *prepared;
        let believed = matched.filter(|matched| matched.is_believed());
        let supplier = believed.and_then(Matched::supplier);
        let anchor = supplier.filter(|&node| self.local_map.is_live(node));
        let weakest = believed.map_or(0.0, |matched| translation_axes(&matched.information).0[0]);
        let noise = Cov3::from_diagonal(&self.predictor.noise(step, weakest).into());
        let motion = Motion { last_from_robot: step.last_from_robot, noise, predicted };
        let at = believed.map(|matched| (matched.local_from_robot, matched.information));
        let last_from_robot = self.pose.settle(past, motion, at, anchor);
        self.tracker.watch.note(matched.is_some_and(|matched| !matched.is_believed()));
        let moved = match believed {
            None => Moved::Unknown,
            _ if step.from_odometry => Moved::By(last_from_robot),
            Some(matched) if matched.slip_corrected => Moved::AsBefore,
            _ => Moved::Matched(last_from_robot),
        };
        self.predictor.settle(scan.stamp, odom_from_robot, moved);
        if self.tracker.watch.misfits > 0 {
            self.preparation.forget_scans();
        } else {
            let place =
                Place { local_from_robot: self.pose.local_from_robot(), odom_from_robot: self.pose.odom_from_robot() };
            let motion = match self.has_sound_wheels(step) {
                true => on_robot::Motion::ByWheels,
                false if weakest * step.variances[0] > 1.0 => on_robot::Motion::ByScans,
                false => on_robot::Motion::Guessed,
            };
            self.preparation.remember(scan.stamp, place, motion, self.settings.scan.drop_moving);
        }
    }

    fn watch_slips(
        &mut self,
        past: Past<'_>,
        step: Step,
        matched: Option<&Matched>,
        busy: bool,
        is_closed_since: impl Fn(NodeId) -> bool,
    ) -> Option<Slipped> {
        let Some(matched) = slip::is_clear(matched) else {
            self.slips.stop();
            return None;
        };
        let scene =
            Scene::new(&self.settings, &self.local_map, &self.preparation, &self.predictor, (past, &self.pose), step);
        self.slips.watch(&scene, &self.tracker, matched, self.pose.local_from_robot(), busy, is_closed_since)
    }

    fn new_keyframe(&mut self, past: Past<'_>, scan: &LaserScan, matched: Option<&Matched>) -> Option<NewKeyframe> {
        let local_from_robot = self.pose.local_from_robot();
        let newest = newest_of(past, &scan.laser);
        let moved = newest.is_none_or(|node| self.settings.keyframes.is_far(past.pose(node).between(local_from_robot)));
        let lost = matched.is_some_and(|matched| !matched.is_believed());
        if !moved || lost || self.preparation.points().hits.is_empty() {
            return None;
        }
        let beams = self.intruders.find(&self.local_map.map, &self.preparation, local_from_robot);
        let left_out = beams.map(|beams| (beams, LeftOutReason::InTheWay));
        self.keyframe_here(past, scan, matched, left_out)
    }

    fn wrote(&mut self, past: Past<'_>, new: &NewKeyframe, written: &Written) {
        for (from, covariance) in &written.links {
            self.local_map.connect(*from, covariance, written.spacing);
        }
        self.pose.made_keyframe(new.covariance);
        let (lever_m, _) = self.preparation.points().lever_and_reach_m();
        self.local_map.insert(&self.settings, Frames::of(past), written.node, lever_m);
    }

    fn follow(&mut self, past: Past<'_>, inserted: bool) {
        self.local_map.follow(&self.settings, Frames::of(past), inserted);
    }

    fn slip(&mut self, past: Past<'_>, before: &[Pose2], slipped: &Slipped) {
        self.pose.slip(slipped.from, slipped.local_from_robot, &slipped.slip);
        self.preparation.forget_scans();
        self.carry(past, before);
    }

    fn drop_keyframe(&mut self, past: Past<'_>, node: NodeId) {
        self.local_map.drop(&self.settings, Frames::of(past), node);
    }

    fn survey(&mut self, _past: Past<'_>) -> Vec<KnownPlace> {
        self.local_map.survey()
    }

    fn local_map_report(&self) -> LocalMapReport {
        self.local_map.report()
    }

    fn sees(&self) -> bool {
        !self.preparation.match_points().is_empty()
    }

    fn watch(&self) -> &Watch {
        &self.tracker.watch
    }

    fn usual_period_s(&self) -> f64 {
        self.predictor.usual_period_s()
    }

    fn has_stood(&self, prepared: &Prepared) -> bool {
        !self.settings.keyframes.is_far(prepared.step.last_from_robot)
    }

    fn is_after_gap(&self, prepared: &Prepared) -> bool {
        prepared.step.after_gap
    }

    fn has_strayed(&self, prepared: &Prepared) -> bool {
        let step = prepared.step;
        let noise = Cov3::from_diagonal(&step.variances.into());
        let covariance = compose_covariance(&self.pose.fused(), step.last_from_robot, &noise);
        covariance.position_variance_m2().sqrt() > BREAK_SIGMA_M
    }

    /// A robot that was blind may be where its wheels say: had it been carried, the scan would not fit just there.
    fn is_known_to_be(
        &mut self,
        past: Past<'_>,
        _scan: &LaserScan,
        prepared: &mut Prepared,
        why: FragmentStart,
    ) -> bool {
        if why != FragmentStart::Blind {
            return false;
        }
        let Prepared { step, predicted, .. } = *prepared;
        self.local_map.meet(&self.settings, Frames::of(past), self.preparation.match_points(), predicted);
        let scene =
            Scene::new(&self.settings, &self.local_map, &self.preparation, &self.predictor, (past, &self.pose), step);
        self.tracker.is_where_wheels_say(&scene, predicted)
    }

    fn leave(&mut self) {
        self.local_map.leave_all();
    }

    fn keyframe_unmatched(&self, past: Past<'_>, scan: &LaserScan) -> Option<NewKeyframe> {
        self.keyframe_here(past, scan, None, None)
    }

    fn began_fragment(&mut self, past: Past<'_>, stamp: Stamp, new: &NewKeyframe, written: &Written) {
        self.wrote(past, new, written);
        self.pose.begin_fragment(written.node);
        self.tracker.begin_anew(stamp);
    }

    fn support(&self, _past: Past<'_>) -> Option<NodeId> {
        self.pose.anchor()
    }

    fn switch_on(&mut self) {
        self.preparation = Preparation::default();
        self.predictor = Predictor::default();
        self.tracker = Tracker::new(&self.settings);
        self.intruders = Intruders::default();
        self.slips = SlipWatch::default();
        self.pose.switch_on();
        self.local_map.leave_all();
    }

    fn take_in(&mut self, past: Past<'_>, first_edge: usize, is_first: bool) {
        self.take_in_newest(past, first_edge, is_first);
    }
}

impl Follows<Sweep> for PlaneFrontEnd {
    fn close(&mut self, past: Past<'_>, from: NodeId, to: NodeId, covariance: &Cov3) {
        self.local_map.close(Frames::of(past), from, to, covariance);
    }

    fn open(&mut self, from: NodeId, to: NodeId) {
        self.local_map.open(from, to);
    }

    fn begin_anew(&mut self, past: Past<'_>) {
        self.local_map = LocalMapping::new(&self.settings);
        self.take_in_keyframes(past, &links(past));
    }

    fn carry(&mut self, past: Past<'_>, before: &[Pose2]) {
        self.local_map.carry(&self.settings, before, Frames::of(past));
    }
}
