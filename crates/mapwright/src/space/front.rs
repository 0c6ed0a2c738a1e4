//! The front end in space: prepare, predict, match, insert, and the local map.

use super::local_map::LocalMapping;
use super::scale::Scale;
use crate::cycles::Follows;
use crate::front::{Links, links};
use crate::front_end::{Found, FrontEnd};
use crate::pose::{Motion, RobotPose};
use crate::sensors::{SensorId, Sensors, newest_of};
use crate::settings::Settings;
use crate::store::{NewKeyframe, Written};
use crate::watch::Watch;
use mapwright_geom::{Cov6, Pose3, Stamp, TangentMatrix, compose_covariance};
use mapwright_loops::{KnownPlace, SUBMAP_M, SpaceSubmaps, Submaps, VerifySettings, View, Window, views_along};
use mapwright_record::{FragmentStart, LocalMapReport, NodeId, Past, Session};
use mapwright_sensor::{Cloud, DownEstimate, ImuReading, ImuTaken, SpaceSensor, SpaceSweep};
use mapwright_voxel::{Prior, TwistPrior};
use nalgebra::Vector6;
use std::f64::consts::PI;
use std::sync::Arc;

mod dynamic;
mod inertial;
mod mount;
mod predict;
mod prepare;
mod resume;
mod span;
mod speed;
mod sweep_motion;
mod track;
mod wheels;

use dynamic::DynamicObjects;
pub use inertial::ImuReport;
use inertial::Inertial;
use inertial::LevelWatch;
pub use mount::ImuMount;
use predict::{Predictor, Settled, Step, Taken, carried_on_variances};
use prepare::Preparation;
use span::Span;
use sweep_motion::SweepMotion;
use track::Matched;
use track::Tracker;

/// A keyframe is made after so much way, of the sensor's rms range, or so much turning, radians,
const KEYFRAME_SHARE: f64 = 0.06;
const KEYFRAME_RAD: f64 = 0.2;
/// or where less than this share of a cloud lies where something is known.
const KNOWN_SHARE: f64 = 0.8;
/// Where the robot is found farther than this from where it should be, of the rms range, or after a gap, a match in doubt is not enough:
/// it is looked for, within so many times the way that it usually goes in the time since the cloud before.
const STRAYED_SHARE: f64 = 0.25;
const WINDOW_SIGMAS: f64 = 3.0;
/// A cloud in doubt is not where it was found if more of its points than this share lie where the sensor has seen through of late: of clouds
/// that are, 0.5 % are and with 16 rings up to 3.6 %, of carried ones 4.6 to 14 % (docs/decisions/0044-two-sides-in-space.md).
const SEEN_THROUGH_SHARE: f64 = 0.04;
/// Share of the clouds up to which wheels say what is not so.
const WHEELS_FAIL: f64 = 1e-3;
/// A sweep's twist is uncertain by so many times what its prior, which is kept tight (`predict::LEFT_OFF`), leaves of it.
const BENT_SIGMAS: f64 = 2.0;

/// The front end.
#[derive(Debug, Clone)]
pub struct SpaceFrontEnd {
    settings: Settings,
    preparation: Preparation,
    /// What moves.
    moving: DynamicObjects,
    /// Points of the present cloud, where it is a keyframe, that lie on it.
    left_out: usize,
    sensors: Sensors<SpaceSensor>,
    /// The sensor of the present cloud; and of the last cloud that said where the robot is, with its stamp and how surely it did.
    sensor: SensorId,
    posed_by: Option<((SensorId, Stamp), Cov6)>,
    /// Another sensor has just said where the robot is, and the present cloud shows what none has shown: where that is certain enough to be
    /// matched against, its information.
    sees_elsewhere: Option<Option<Cov6>>,
    predictor: Predictor,
    inertial: Inertial,
    /// During the present sweep, whether its turning was read, and how sure its points make it.
    motion: SweepMotion,
    turn_is_read: bool,
    twist_covariance: Option<Cov6>,
    tracker: Tracker,
    /// Of the robot in the middle of its sweep.
    pose: RobotPose<Pose3>,
    /// From there to where it was at the cloud's stamp.
    middle_from_stamp: Pose3,
    /// Covariance of that.
    carried_on: Cov6,
    local_map: Option<LocalMapping>,
    level: LevelWatch,
}

/// A cloud that was prepared.
type Prepared = crate::front_end::Prepared<Pose3, Step>;

impl SpaceFrontEnd {
    /// What was derived from the first clouds, once there was one with enough points.
    pub(crate) fn scale(&self) -> Option<Scale> {
        self.preparation.scale()
    }

    /// Remembers a reading of an inertial sensor.
    pub(crate) fn add_imu(&mut self, reading: ImuReading) -> ImuTaken {
        self.inertial.add(reading)
    }

    pub(crate) fn hear_odometry(&mut self, stamp: Stamp) {
        self.tracker.watch.hear(stamp);
    }

    pub(crate) fn imu_report(&self) -> ImuReport {
        self.inertial.report()
    }

    /// The cloud against the local map.
    fn matched(&mut self, prepared: &Prepared) -> Option<Matched> {
        let Prepared { step, predicted, .. } = prepared;
        let ways = (self.pose.local_from_robot(), *predicted);
        let undistorted = self.predictor.twist_per_s(*step).unwrap_or_else(Vector6::zeros);
        self.tracker.track(self.local_map.as_ref()?, self.preparation.seen(), ways, (step, undistorted))
    }

    /// The same where the wheels say what is not so: they slip, spin or stand still while the robot goes on as before. So it is if that is the
    /// likelier, for all that wheels seldom fail.
    fn matched_without_wheels(&mut self, prepared: &mut Prepared, by_wheels: &Matched) -> Option<Matched> {
        let step = self.predictor.without_wheels(&prepared.step);
        let predicted = self.pose.local_from_robot() * step.last_from_robot;
        let failed = Prepared { step, predicted, ..*prepared };
        let is_likelier = |matched: &Matched| matched.evidence + WHEELS_FAIL.ln() > by_wheels.evidence;
        let matched = self.matched(&failed).filter(|matched| matched.is_believed() && is_likelier(matched))?;
        let correction = prepared.predicted.between(matched.local_from_robot);
        self.predictor.observe(&self.settings.motion, &prepared.step, correction, &matched.information);
        *prepared = failed;
        Some(matched)
    }

    /// When the middle of the last cloud's sweep was, and the robot's pose then in a frame that corrections do not move.
    pub(crate) fn middle_of(&self, cloud: &Cloud) -> (Stamp, Pose3) {
        let span = Span::of(cloud);
        (span.stamp_after(cloud.stamp, span.middle_s()), self.pose.local_from_robot())
    }

    /// A sweep that takes time, and how the robot moved during it, by its points: undistorted and matched anew.
    fn bend(&mut self, cloud: &Cloud, prepared: &Prepared, matched: Matched) -> Option<Matched> {
        let (span, step) = (Span::of(cloud), &prepared.step);
        let seen = Some(self.preparation.seen()).filter(|_| span.length_s() > 0.0)?;
        let moved = self.pose.local_from_robot().between(matched.local_from_robot);
        let prior = Prior { map_from_cloud: prepared.predicted, information: step.information };
        let motion = self.motion_prior(step, moved, span);
        let bent = self.tracker.bent(self.local_map.as_ref()?, seen, (&matched, &prior), &motion);
        self.motion.bend(bent.twist_per_s, span);
        self.twist_covariance = Some(bent.covariance);
        if self.bends(bent.twist_per_s, span) {
            self.preparation.prepare(&self.settings, cloud, &self.motion, true);
        }
        let seen = self.preparation.seen();
        let again = self.tracker.again(self.local_map.as_ref()?, seen, (&matched, &bent, &prior));
        // A motion that is taken for even is as wrong as it is uncertain: over the sweep, root mean square.
        let still_bent = bent.covariance * (BENT_SIGMAS.powi(2) * span.length_s().powi(2) / 12.0);
        Some(Matched { information: softened(&again.information, &still_bent), ..again })
    }

    /// A sweep that was bent to fit a place where it is not.
    fn unbend(&mut self, cloud: &Cloud) {
        if self.twist_covariance.take().is_some() {
            self.motion.straighten();
            self.preparation.prepare(&self.settings, cloud, &self.motion, true);
        }
    }

    /// What is known of the motion during a sweep, beside that by which it was undistorted, once it is known how the robot has moved.
    fn motion_prior(&self, step: &Step, moved: Pose3, span: Span) -> TwistPrior {
        let (after, mut variances) = self.predictor.twist_after(step, moved);
        let mut twist_per_s = after - self.predictor.twist_per_s(*step).unwrap_or_else(Vector6::zeros);
        if self.turn_is_read {
            twist_per_s.fixed_rows_mut::<3>(3).fill(0.0);
            variances.fixed_rows_mut::<3>(3).fill(self.inertial.turn_sigma_rad_per_s(span.length_s()).powi(2));
            if let Some(velocity) = self.inertial.velocity_now() {
                twist_per_s.fixed_rows_mut::<3>(0).fill(0.0);
                variances.fixed_rows_mut::<3>(0).fill(velocity.variance);
            }
        }
        TwistPrior { twist_per_s, information: Cov6::from_diagonal(&variances.map(|variance| 1.0 / variance)) }
    }

    /// Whether such a motion on top moves a point by more than the sensor's noise.
    fn bends(&self, twist_per_s: Vector6<f64>, span: Span) -> bool {
        let Some(scale) = self.preparation.scale() else { return false };
        let [way, turn] = [0, 3].map(|first| twist_per_s.fixed_rows::<3>(first).norm());
        0.5 * span.length_s() * (way + scale.range_m * turn) > scale.noise_m
    }

    /// Whether the sensor has seen through what it would see now: the robot was carried to where a floor and a wall fit as well.
    fn is_seen_through(&self, matched: &Matched) -> bool {
        let Some(scale) = self.scale() else { return false };
        let points_m = self.preparation.match_points();
        self.moving.share_seen_through(matched.local_from_robot, points_m, scale.resolution_m) > SEEN_THROUGH_SHARE
    }

    /// Remembers what was seen, where it is known from where.
    fn remember_what_was_seen(&mut self, cloud: &Cloud, is_known: bool) {
        if is_known {
            let sensor_m = cloud.sensor.robot_from_sensor.translation;
            let points_m = self.preparation.points();
            self.moving.remember(cloud.stamp, self.pose.local_from_robot(), points_m, sensor_m);
        } else {
            self.moving.forget();
        }
    }

    /// Takes what moves out of what is drawn.
    fn leave_out_what_moves(&mut self, cloud: &Cloud) {
        let Some(scale) = self.scale() else { return };
        let (local_from_robot, points_m) = (self.pose.local_from_robot(), self.preparation.points());
        self.left_out = self.moving.find(cloud.stamp, local_from_robot, points_m, scale.resolution_m);
        if self.left_out > 0 {
            let moving = &self.moving;
            self.preparation.leave_out(|point| moving.moves(point, scale.resolution_m));
        }
    }

    /// The present cloud is of its sensor: what is learnt of one says nothing of another.
    fn turn_to(&mut self, cloud: &Cloud) {
        self.sensor = self.sensors.of(&cloud.sensor);
        self.predictor.turn_to(self.sensor);
        self.tracker.turn_to(self.sensor);
    }

    /// Whether a cloud of another sensor has just said where the robot is.
    fn is_posed_by_another(&self, stamp: Stamp) -> bool {
        let is_at_once = |then: Stamp| self.predictor.is_at_once(then, stamp);
        self.posed_by.is_some_and(|((sensor, then), _)| sensor != self.sensor && is_at_once(then))
    }

    /// The information of where the robot is predicted, since another sensor has said it, where what is seen from there is certain enough to
    /// be matched against; none at all where nothing was matched then.
    fn carried_information(&self, step: &Step) -> Option<Cov6> {
        let scale = self.scale()?;
        let since = self.predictor.variances(step);
        let [way, turn] = [0, 3].map(|first| since.diagonal().fixed_rows::<3>(first).max());
        let is_sure = way + scale.range_m * scale.range_m * turn <= scale.gate_m() * scale.gate_m();
        let covariance = self.posed_by?.1.try_inverse().map(|then| then + since);
        let information = covariance.map_or(Some(Cov6::zeros()), |covariance| covariance.try_inverse());
        information.filter(|_| is_sure)
    }

    pub(crate) fn local_map_voxels(&self) -> usize {
        self.local_map.as_ref().map_or(0, |local_map| local_map.map().voxels())
    }

    /// A robot that has moved no farther has not moved, metres.
    fn still_m(&self) -> f64 {
        self.scale().map_or(0.0, |scale| KEYFRAME_SHARE * scale.range_m)
    }

    /// Where the cloud is found in what was seen along the way of late, by all that speaks against a closure: the robot may be as far from
    /// its prediction as it usually goes since the cloud before, and have turned as far as it can have in that time: anyhow, after a second.
    fn look_around(&self, past: Past<'_, SpaceSweep>, cloud: &Cloud, prepared: &Prepared) -> Option<Pose3> {
        let (newest, mut submaps) = (past.newest()?, self.submaps()?);
        let range_m = self.scale()?.range_m;
        // From farther away nothing is seen of what was seen on that way.
        let step = &prepared.step;
        let usual_m = self.predictor.usual_way_m(cloud.stamp);
        let sigma_m = if step.from_odometry { (1.0 / step.information[(0, 0)]).sqrt().min(usual_m) } else { usual_m };
        let reach_m = (WINDOW_SIGMAS * sigma_m).min(SUBMAP_M + range_m);
        let turn_sigma_rad = 1.0 / self.predictor.without_wheels(step).information[(5, 5)].sqrt();
        let target = submaps.draw(&views_along(past, newest, false, SUBMAP_M));
        let sweep = Arc::new(self.preparation.sweep(cloud));
        let query = submaps.draw(&[View { sweep, submap_from_keyframe: Pose3::identity() }]);
        let window = Window {
            target_from_query: past.pose(newest).between(prepared.predicted),
            half_width_m: reach_m + STRAYED_SHARE * range_m,
            half_height_m: STRAYED_SHARE * range_m,
            half_width_rad: (WINDOW_SIGMAS * turn_sigma_rad).min(PI),
        };
        let found = submaps.look_for(&query, &target, &window);
        let newest_from_robot = found.target_from_query.filter(|_| found.objection.is_none())?;
        Some(past.pose(newest) * newest_from_robot)
    }

    fn keyframe_here(
        &self,
        past: Past<'_, SpaceSweep>,
        cloud: &Cloud,
        believed: Option<&Matched>,
    ) -> NewKeyframe<SpaceSweep> {
        NewKeyframe {
            stamp: cloud.stamp,
            sweep: Arc::new(self.preparation.sweep(cloud)),
            left_out: None,
            hardly_fits: believed.is_some_and(Matched::hardly_fits),
            local_from_keyframe: self.pose.local_from_robot(),
            covariance: self.pose.covariance(past),
            odometry: self.pose.odometry_since_keyframe(),
            fused: self.pose.fused(),
            matched: believed
                .map(|matched| matched.information)
                .or(self.sees_elsewhere.flatten().filter(|information| *information != Cov6::zeros()))
                .and_then(|information| Some((self.pose.anchor()?, information))),
        }
    }
}

impl FrontEnd<SpaceSweep> for SpaceFrontEnd {
    type Step = Step;
    type Matched = Matched;

    fn new(settings: Settings, local_from_robot: Pose3) -> Self {
        Self {
            preparation: Preparation::default(),
            moving: DynamicObjects::default(),
            left_out: 0,
            sensors: Sensors::default(),
            sensor: SensorId::default(),
            posed_by: None,
            sees_elsewhere: None,
            predictor: Predictor::default(),
            inertial: Inertial::default(),
            motion: SweepMotion::default(),
            turn_is_read: false,
            twist_covariance: None,
            tracker: Tracker::new(&settings),
            pose: RobotPose::new(local_from_robot),
            middle_from_stamp: Pose3::identity(),
            carried_on: Cov6::zeros(),
            local_map: None,
            level: LevelWatch::default(),
            settings,
        }
    }

    fn settings(&self) -> &Settings {
        &self.settings
    }

    fn pose(&self) -> &RobotPose<Pose3> {
        &self.pose
    }

    fn local_from_robot(&self) -> Pose3 {
        self.pose.local_from_robot() * self.middle_from_stamp
    }

    fn covariance(&self, past: Past<'_, SpaceSweep>) -> Cov6 {
        let stamp_from_middle = self.middle_from_stamp.inverse();
        self.pose.covariance(past).carried_by(&stamp_from_middle.adjoint()) + self.carried_on
    }

    fn moving(&self) -> u32 {
        self.left_out as u32
    }

    fn take_down(&mut self) -> Option<DownEstimate> {
        self.inertial.take_down()
    }

    fn prepare(&mut self, cloud: &Cloud) -> Prepared {
        let refused = self.preparation.check(cloud).err();
        if refused.is_none() {
            self.turn_to(cloud);
        }
        let span = Span::of(cloud);
        let taken = Taken { stamp: cloud.stamp, middle_s: span.middle_s() };
        let step = self.predictor.step(&self.settings.motion, taken, cloud.odom_from_robot);
        let step = self.inertial.predict(step, span.stamp_after(cloud.stamp, span.middle_s()));
        let twist_per_s = self.predictor.twist_per_s(step);
        self.turn_is_read = self.inertial.shape(twist_per_s, cloud.stamp, span, &mut self.motion);
        self.twist_covariance = None;
        self.sees_elsewhere = None;
        self.left_out = 0;
        let beams = self.preparation.prepare(&self.settings, cloud, &self.motion, refused.is_none());
        let predicted = self.pose.local_from_robot() * step.last_from_robot;
        Prepared { step, predicted, odom_from_robot: cloud.odom_from_robot, beams, refused }
    }

    fn track(&mut self, past: Past<'_, SpaceSweep>, cloud: &Cloud, prepared: &mut Prepared) -> Option<Matched> {
        if self.sees() {
            self.tracker.watch.see(cloud.stamp);
        } else {
            self.tracker.watch.see_nothing(cloud.stamp);
        }
        let mut matched = self.matched(prepared)?;
        let has_shown = || newest_of(past, cloud.sensor.as_ref()).is_some();
        let is_new = matched.is_nowhere || matched.hardly_knows() && !has_shown();
        if is_new && self.is_posed_by_another(cloud.stamp) {
            self.sees_elsewhere = Some(self.carried_information(&prepared.step));
            return None;
        }
        if matched.in_doubt && prepared.step.from_odometry {
            matched = self.matched_without_wheels(prepared, &matched).unwrap_or(matched);
        }
        self.tracker.get_used_to(&matched);
        if !matched.is_believed() || prepared.refused.is_some() {
            return Some(matched);
        }
        self.bend(cloud, prepared, matched).or(Some(matched))
    }

    fn settle(&mut self, past: Past<'_, SpaceSweep>, cloud: &Cloud, prepared: &Prepared, matched: Option<&Matched>) {
        let Prepared { step, predicted, .. } = *prepared;
        self.tracker.watch.note(matched.is_some_and(|matched| !matched.is_believed()));
        let believed = matched.filter(|matched| matched.is_believed());
        let anchor = believed.and_then(|matched| matched.supplier);
        let noise = step.information.try_inverse().unwrap_or_else(Cov6::identity);
        let motion = Motion { last_from_robot: step.last_from_robot, noise, predicted };
        let carried = self.sees_elsewhere.flatten().map(|information| (predicted, information));
        let at = believed.map(|matched| (matched.local_from_robot, matched.information)).or(carried);
        let last_from_robot = self.pose.settle(past, motion, at, anchor);
        let moved = believed.filter(|_| !step.is_looked_for);
        if let Some(Matched { local_from_robot, information, .. }) = moved {
            self.predictor.observe(&self.settings.motion, &step, predicted.between(*local_from_robot), information);
        }
        let middle_s = Span::of(cloud).middle_s();
        let taken = Taken { stamp: cloud.stamp, middle_s };
        let (is_matched, is_looked_for) = (believed.is_some(), step.is_looked_for);
        let sees_elsewhere = self.sees_elsewhere.is_some();
        let settled = Settled { last_from_robot, is_matched, is_looked_for, sees_elsewhere };
        self.predictor.settle(taken, cloud.odom_from_robot, settled);
        if let Some(matched) = believed {
            self.posed_by = Some(((self.sensor, cloud.stamp), matched.information));
        }
        self.inertial.learn(moved.filter(|matched| matched.knows_turn).map(|_| last_from_robot));
        self.middle_from_stamp = self.motion.middle_from_robot(0.0).unwrap_or_else(Pose3::identity);
        let by_points = self.twist_covariance.map(|covariance| covariance * (middle_s * middle_s));
        let carried_on = || carried_on_variances(&step, self.predictor.change_per_s(), middle_s);
        self.carried_on = by_points.unwrap_or_else(carried_on);
        self.remember_what_was_seen(cloud, believed.is_some());
    }

    fn new_keyframe(
        &mut self,
        past: Past<'_, SpaceSweep>,
        cloud: &Cloud,
        matched: Option<&Matched>,
    ) -> Option<NewKeyframe<SpaceSweep>> {
        let local_from_robot = self.pose.local_from_robot();
        let scale = self.preparation.scale()?;
        let newest = newest_of(past, cloud.sensor.as_ref());
        let is_far = newest.is_none_or(|newest| {
            let step = past.pose(newest).between(local_from_robot);
            step.translation.norm() > KEYFRAME_SHARE * scale.range_m || step.rotation.angle() > KEYFRAME_RAD
        });
        let believed = matched.filter(|matched| matched.is_believed());
        let is_new = believed.is_some_and(|matched| matched.report.known_share < KNOWN_SHARE);
        let is_first = past.newest().is_none() || self.sees_elsewhere.flatten().is_some();
        if !(is_far || is_new || is_first) || !(is_first || believed.is_some()) || self.preparation.points().is_empty()
        {
            return None;
        }
        self.leave_out_what_moves(cloud);
        Some(self.keyframe_here(past, cloud, believed))
    }

    fn wrote(&mut self, past: Past<'_, SpaceSweep>, new: &NewKeyframe<SpaceSweep>, written: &Written<Pose3>) {
        self.pose.made_keyframe(new.covariance);
        if self.sees_elsewhere.is_none() && new.matched.is_none() {
            self.posed_by = Some(((self.sensor, new.stamp), Cov6::zeros()));
        }
        let Some(scale) = self.preparation.scale() else { return };
        let local_map = self.local_map.get_or_insert_with(|| LocalMapping::new(&self.settings, scale));
        local_map.insert(past, written.node, &written.links);
    }

    fn follow(&mut self, past: Past<'_, SpaceSweep>, _inserted: bool) {
        self.local_map.iter_mut().for_each(|local_map| local_map.follow(past));
    }

    fn submaps(&self) -> Option<SpaceSubmaps> {
        let scale = self.preparation.scale()?;
        Some(SpaceSubmaps::new(scale.maps(), scale.range_m, VerifySettings::in_space()))
    }

    fn survey(&mut self, past: Past<'_, SpaceSweep>) -> Vec<KnownPlace<Pose3>> {
        self.local_map.as_mut().map_or_else(Vec::new, |local_map| local_map.survey(past))
    }

    fn local_map_report(&self) -> LocalMapReport {
        self.local_map.as_ref().map_or_else(LocalMapReport::default, LocalMapping::report)
    }

    fn sees(&self) -> bool {
        !self.preparation.match_points().is_empty()
    }

    fn watch(&self) -> &Watch {
        &self.tracker.watch
    }

    fn usual_period_s(&self) -> f64 {
        self.predictor.period_s()
    }

    fn has_stood(&self, prepared: &Prepared) -> bool {
        prepared.step.last_from_robot.translation.norm() <= self.still_m()
    }

    fn is_after_gap(&self, prepared: &Prepared) -> bool {
        prepared.step.after_gap
    }

    /// Where clouds fit nowhere the prediction alone goes on. Wheels lead over gaps to where a match finds the rest of the way.
    fn has_strayed(&self, prepared: &Prepared) -> bool {
        let since_keyframe = self.pose.odometry_since_keyframe();
        let Some(scale) = self.scale().filter(|_| prepared.step.from_odometry) else {
            return since_keyframe.position_variance_m2().sqrt() > self.still_m();
        };
        let noise = prepared.step.information.try_inverse().unwrap_or_else(Cov6::identity);
        let covariance = compose_covariance(&since_keyframe, prepared.step.last_from_robot, &noise);
        covariance.position_variance_m2().sqrt() > STRAYED_SHARE * scale.range_m
    }

    fn is_known_to_be(
        &mut self,
        past: Past<'_, SpaceSweep>,
        cloud: &Cloud,
        prepared: &mut Prepared,
        _why: FragmentStart,
    ) -> bool {
        self.unbend(cloud);
        let found = self.look_around(past, cloud, prepared);
        prepared.predicted = found.unwrap_or(prepared.predicted);
        prepared.step.is_looked_for = found.is_some();
        found.is_some()
    }

    fn is_found_nowhere(&self, prepared: &Prepared, matched: &Matched) -> bool {
        let away_m = prepared.predicted.distance(matched.local_from_robot);
        let is_far = self.scale().is_some_and(|scale| away_m > STRAYED_SHARE * scale.range_m);
        let is_unlikely = matched.in_doubt && (is_far || prepared.step.after_gap || self.is_seen_through(matched));
        matched.is_believed() && (is_unlikely || matched.is_contradicted)
    }

    fn leave(&mut self) {
        self.local_map.iter_mut().for_each(LocalMapping::leave_all);
    }

    fn keyframe_unmatched(&self, past: Past<'_, SpaceSweep>, cloud: &Cloud) -> Option<NewKeyframe<SpaceSweep>> {
        (!self.preparation.points().is_empty()).then(|| self.keyframe_here(past, cloud, None))
    }

    fn began_fragment(
        &mut self,
        past: Past<'_, SpaceSweep>,
        stamp: Stamp,
        new: &NewKeyframe<SpaceSweep>,
        written: &Written<Pose3>,
    ) {
        self.wrote(past, new, written);
        self.pose.begin_fragment(written.node);
        self.tracker.watch.begin_anew(stamp);
    }

    fn is_leaning(&mut self, session: &Session<SpaceSweep>) -> bool {
        self.level.is_leaning(session)
    }

    fn support(&self, past: Past<'_, SpaceSweep>) -> Option<NodeId> {
        self.local_map.as_ref()?.old_place_nearby(past)
    }

    fn switch_on(&mut self) {
        self.predictor = Predictor::default();
        self.inertial = Inertial::default();
        self.tracker = Tracker::new(&self.settings);
        self.pose.switch_on();
        (self.middle_from_stamp, self.carried_on) = (Pose3::identity(), Cov6::zeros());
        (self.posed_by, self.sees_elsewhere) = (None, None);
        self.moving.forget();
        self.leave();
    }

    fn take_in(&mut self, past: Past<'_, SpaceSweep>, first_edge: usize, is_first: bool) {
        let Some(node) = past.newest() else { return };
        let mut links = Links::default();
        past.session.recorded_edges().iter().skip(first_edge).for_each(|known| links.add(known));
        if is_first {
            self.leave();
        }
        self.pose.take_in(node, past.pose(node), links.fused());
        if self.local_map.is_none() {
            self.local_map = self.scale_by(past).map(|scale| LocalMapping::new(&self.settings, scale));
        }
        if let Some(local_map) = &mut self.local_map {
            local_map.take_in(past, node, &links.all(past, node), &links.closures);
        }
    }

    fn drop_keyframe(&mut self, past: Past<'_, SpaceSweep>, node: NodeId) {
        self.local_map.iter_mut().for_each(|local_map| local_map.drop(past, node));
    }
}

/// The information of a pose that is uncertain by so much more.
fn softened(information: &Cov6, more: &Cov6) -> Cov6 {
    let covariance = information.try_inverse().map(|covariance| covariance + more);
    covariance.and_then(|covariance| covariance.try_inverse()).unwrap_or(*information)
}

impl Follows<SpaceSweep> for SpaceFrontEnd {
    fn close(&mut self, past: Past<'_, SpaceSweep>, from: NodeId, to: NodeId, covariance: &Cov6) {
        self.local_map.iter_mut().for_each(|local_map| local_map.close(past, from, to, covariance));
    }

    fn open(&mut self, from: NodeId, to: NodeId) {
        self.local_map.iter_mut().for_each(|local_map| local_map.open(from, to));
    }

    fn begin_anew(&mut self, past: Past<'_, SpaceSweep>) {
        if let Some(scale) = self.preparation.scale() {
            self.local_map = Some(LocalMapping::of_links(&self.settings, scale, past, &links(past)));
        }
    }

    fn carry(&mut self, past: Past<'_, SpaceSweep>, before: &[Pose3]) {
        self.local_map.iter_mut().for_each(|local_map| local_map.carry(past, before));
    }
}
