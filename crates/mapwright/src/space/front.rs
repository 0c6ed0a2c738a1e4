//! The front end in space: prepare, predict, match, insert, and the local map.

use super::local_map::LocalMapping;
use super::scale::Scale;
use crate::cycles::Follows;
use crate::front::{Motion, RobotPose};
use crate::settings::Settings;
use crate::store::{NewKeyframe, Written};
use mapwright_geom::{Cov6, Pose, Pose3, TangentMatrix};
use mapwright_loops::{KnownPlace, SpaceSubmaps, VerifySettings};
use mapwright_record::{LocalMapReport, NodeId, Past};
use mapwright_sensor::{BeamCounts, Cloud, DownEstimate, ImuReading, ImuTaken, SpaceSweep};
use nalgebra::Vector6;
use std::sync::Arc;

mod inertial;
mod predict;
mod prepare;
mod resume;
mod span;
mod sweep_motion;
mod track;

pub use inertial::ImuReport;
use inertial::Inertial;
pub(crate) use inertial::LevelWatch;
use predict::{Predictor, Step, carried_on_variances};
use prepare::Preparation;
use span::Span;
use sweep_motion::SweepMotion;
pub(crate) use track::Matched;
use track::Tracker;

/// A keyframe is made after so much way, of the sensor's rms range, or so much turning, radians,
const KEYFRAME_SHARE: f64 = 0.06;
const KEYFRAME_RAD: f64 = 0.2;
/// or where less than this share of a cloud lies where something is known.
const KNOWN_SHARE: f64 = 0.8;

/// The front end.
#[derive(Debug, Clone)]
pub(crate) struct FrontEnd {
    settings: Settings,
    preparation: Preparation,
    predictor: Predictor,
    inertial: Inertial,
    /// During the present sweep, and as it may have been instead.
    motion: SweepMotion,
    other_motion: SweepMotion,
    tracker: Tracker,
    /// Of the robot in the middle of its sweep.
    pose: RobotPose<Pose3>,
    /// From there to where it was at the cloud's stamp.
    middle_from_stamp: Pose3,
    /// Covariance of that.
    carried_on: Cov6,
    local_map: Option<LocalMapping>,
}

/// A cloud that is prepared, and where the robot should be.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Prepared {
    step: Step,
    predicted: Pose3,
    pub(crate) beams: BeamCounts,
    pub(crate) refused: Option<&'static str>,
}

impl FrontEnd {
    pub(crate) fn new(settings: Settings, local_from_robot: Pose3) -> Self {
        Self {
            preparation: Preparation::default(),
            predictor: Predictor::default(),
            inertial: Inertial::default(),
            motion: SweepMotion::default(),
            other_motion: SweepMotion::default(),
            tracker: Tracker::new(&settings),
            pose: RobotPose::new(local_from_robot),
            middle_from_stamp: Pose3::identity(),
            carried_on: Cov6::zeros(),
            local_map: None,
            settings,
        }
    }

    pub(crate) fn settings(&self) -> &Settings {
        &self.settings
    }

    pub(crate) fn pose(&self) -> &RobotPose<Pose3> {
        &self.pose
    }

    /// Where the robot was at the cloud's stamp.
    pub(crate) fn local_from_robot(&self) -> Pose3 {
        self.pose.local_from_robot() * self.middle_from_stamp
    }

    /// Covariance of that relative to the anchor.
    pub(crate) fn covariance(&self, past: Past<'_, SpaceSweep>) -> Cov6 {
        let stamp_from_middle = self.middle_from_stamp.inverse();
        self.pose.covariance(past).carried_by(&stamp_from_middle.adjoint()) + self.carried_on
    }

    /// What was derived from the first clouds, once there was one with enough points.
    pub(crate) fn scale(&self) -> Option<Scale> {
        self.preparation.scale()
    }

    /// Remembers a reading of an inertial sensor.
    pub(crate) fn add_imu(&mut self, reading: ImuReading) -> ImuTaken {
        self.inertial.add(reading)
    }

    pub(crate) fn imu_report(&self) -> ImuReport {
        self.inertial.report()
    }

    /// Where down is at a keyframe that was made of the present cloud, where that is known well enough.
    pub(crate) fn take_down(&mut self) -> Option<DownEstimate> {
        self.inertial.take_down()
    }

    /// Steps 1 and 2: points in the robot's frame, undistorted and thinned, what was dropped counted; the pose by odometry or constant
    /// velocity, and by an inertial sensor. The map is levelled before anything is drawn in it.
    pub(crate) fn prepare(&mut self, cloud: &Cloud) -> Prepared {
        let step = self.predictor.step(&self.settings.motion, cloud.stamp, cloud.odom_from_robot);
        let span = Span::of(cloud);
        let step = self.inertial.predict(step, span.stamp_after(cloud.stamp, span.middle_s()));
        if self.local_map.is_none()
            && let Some(levelled) = self.inertial.levelled(self.pose.local_from_robot())
        {
            self.pose.stand(levelled);
        }
        self.inertial.shape(self.predictor.twist_per_s(step), cloud.stamp, span, &mut self.motion);
        let refused = self.preparation.check(cloud).err();
        let beams = self.preparation.prepare(&self.settings, cloud, &self.motion, refused.is_none());
        Prepared { step, predicted: self.pose.local_from_robot() * step.last_from_robot, beams, refused }
    }

    /// Step 3: the cloud against the local map; once more where the robot moved otherwise during the sweep than was thought before.
    pub(crate) fn track(&mut self, cloud: &Cloud, prepared: &Prepared) -> Option<Matched> {
        let Prepared { step, predicted, .. } = *prepared;
        let last = self.pose.local_from_robot();
        let points = self.preparation.match_points();
        let mut matched = self.tracker.track(self.local_map.as_ref()?, points, (last, predicted), &step)?;
        if !matched.is_believed() || prepared.refused.is_some() {
            return Some(matched);
        }
        let twist_per_s = self.predictor.twist_after(&step, last.between(matched.local_from_robot));
        if self.bends(cloud, Some(twist_per_s)) {
            self.straighten(cloud, Some(twist_per_s));
            let points = self.preparation.match_points();
            let again = self.tracker.again(self.local_map.as_ref()?, points, (&matched, predicted), &step);
            if again.fits_as_well_as(&matched) {
                matched = again;
            } else {
                self.straighten(cloud, self.predictor.twist_per_s(step));
            }
        }
        let half_s = 0.5 * Span::of(cloud).length_s();
        if half_s > 0.0 {
            let change_per_s = self.predictor.change_after(&step, last.between(matched.local_from_robot));
            let bent = carried_on_variances(&step, change_per_s, half_s);
            matched.information = softened(&matched.information, &bent);
        }
        Some(matched)
    }

    /// Whether a sweep taken with such a motion lies elsewhere, by more than the sensor's noise, than it was taken to.
    fn bends(&mut self, cloud: &Cloud, twist_per_s: Option<Vector6<f64>>) -> bool {
        let (Some(scale), span) = (self.preparation.scale(), Span::of(cloud)) else { return false };
        self.inertial.shape(twist_per_s, cloud.stamp, span, &mut self.other_motion);
        let is_bent = |time_s: f64| {
            let [was, is] = [&self.motion, &self.other_motion]
                .map(|motion| motion.middle_from_robot(time_s).unwrap_or_else(Pose3::identity));
            was.distance(is) + scale.range_m * Pose::between(was, is).angle() > scale.noise_m
        };
        span.length_s() > 0.0 && (is_bent(span.first_s) || is_bent(span.last_s))
    }

    /// Undistorts the sweep by such a motion.
    fn straighten(&mut self, cloud: &Cloud, twist_per_s: Option<Vector6<f64>>) {
        self.inertial.shape(twist_per_s, cloud.stamp, Span::of(cloud), &mut self.motion);
        self.preparation.prepare(&self.settings, cloud, &self.motion, true);
    }

    /// Takes over the new pose and its covariance.
    pub(crate) fn settle(
        &mut self,
        past: Past<'_, SpaceSweep>,
        cloud: &Cloud,
        prepared: &Prepared,
        matched: Option<&Matched>,
    ) {
        let Prepared { step, predicted, .. } = *prepared;
        let believed = matched.filter(|matched| matched.is_believed());
        let anchor = believed.and_then(|matched| matched.supplier);
        let noise = step.information.try_inverse().unwrap_or_else(Cov6::identity);
        let motion = Motion { last_from_robot: step.last_from_robot, noise, predicted };
        let at = believed.map(|matched| (matched.local_from_robot, matched.information));
        let last_from_robot = self.pose.settle(past, motion, at, anchor);
        let twist_per_s = match believed {
            Some(_) => Some(self.predictor.twist_after(&step, last_from_robot)),
            None => self.predictor.twist_per_s(step),
        };
        self.predictor.settle(cloud.stamp, cloud.odom_from_robot, believed.map(|_| last_from_robot));
        self.inertial.learn(believed.filter(|matched| matched.knows_turn).map(|_| last_from_robot));
        self.inertial.shape(twist_per_s, cloud.stamp, Span::of(cloud), &mut self.motion);
        self.middle_from_stamp = self.motion.middle_from_robot(0.0).unwrap_or_else(Pose3::identity);
        self.carried_on = carried_on_variances(&step, self.predictor.change_per_s(), Span::of(cloud).middle_s());
    }

    /// Step 4: a keyframe, once the robot has moved enough and sees something.
    pub(crate) fn new_keyframe(
        &self,
        past: Past<'_, SpaceSweep>,
        cloud: &Cloud,
        matched: Option<&Matched>,
    ) -> Option<NewKeyframe<SpaceSweep>> {
        let local_from_robot = self.pose.local_from_robot();
        let scale = self.preparation.scale()?;
        let is_far = past.newest().is_none_or(|newest| {
            let step = past.pose(newest).between(local_from_robot);
            step.translation.norm() > KEYFRAME_SHARE * scale.range_m || step.rotation.angle() > KEYFRAME_RAD
        });
        let believed = matched.filter(|matched| matched.is_believed());
        let is_new = believed.is_some_and(|matched| matched.report.known_share < KNOWN_SHARE);
        // What fits nowhere hangs on the prediction alone, and is as uncertain: what was mapped before is not matched against then.
        let may_be_far = believed.is_none()
            && self.pose.odometry_since_keyframe().position_variance_m2().sqrt() > KEYFRAME_SHARE * scale.range_m;
        if !(is_far || is_new || may_be_far) || self.preparation.points().is_empty() {
            return None;
        }
        Some(NewKeyframe {
            stamp: cloud.stamp,
            sweep: Arc::new(self.preparation.sweep(cloud)),
            left_out: None,
            hardly_fits: believed.is_some_and(Matched::hardly_fits),
            local_from_keyframe: local_from_robot,
            covariance: self.pose.covariance(past),
            odometry: self.pose.odometry_since_keyframe(),
            fused: self.pose.fused(),
            matched: believed.and_then(|matched| Some((self.pose.anchor()?, matched.information))),
        })
    }

    /// The keyframe was written: it joins the local map.
    pub(crate) fn wrote(
        &mut self,
        past: Past<'_, SpaceSweep>,
        new: &NewKeyframe<SpaceSweep>,
        written: &Written<Pose3>,
    ) {
        self.pose.made_keyframe(new.covariance);
        let Some(scale) = self.preparation.scale() else { return };
        let local_map = self.local_map.get_or_insert_with(|| LocalMapping::new(&self.settings, scale));
        local_map.insert(past, written.node, &written.links);
    }

    /// Step 5, once a cloud: the local map follows what is certain relative to the robot.
    pub(crate) fn follow(&mut self, past: Past<'_, SpaceSweep>) {
        self.local_map.iter_mut().for_each(|local_map| local_map.follow(past));
    }

    /// How what was seen along the way is drawn to be compared.
    pub(crate) fn submaps(&self, verify: VerifySettings) -> Option<SpaceSubmaps> {
        let scale = self.preparation.scale()?;
        Some(SpaceSubmaps::new(scale.maps(), scale.range_m, verify))
    }

    /// How certain old places are relative to the newest keyframe.
    pub(crate) fn survey(&mut self, past: Past<'_, SpaceSweep>) -> Vec<KnownPlace<Pose3>> {
        self.local_map.as_mut().map_or_else(Vec::new, |local_map| local_map.survey(past))
    }

    pub(crate) fn local_map_voxels(&self) -> usize {
        self.local_map.as_ref().map_or(0, |local_map| local_map.map().voxels())
    }

    /// An old place near to the newest keyframe that is matched against.
    pub(crate) fn old_place_nearby(&self, past: Past<'_, SpaceSweep>) -> Option<NodeId> {
        self.local_map.as_ref()?.old_place_nearby(past)
    }

    pub(crate) fn local_map_report(&self) -> LocalMapReport {
        self.local_map.as_ref().map_or_else(LocalMapReport::default, LocalMapping::report)
    }
}

/// The information of a pose that is uncertain by so much more.
fn softened(information: &Cov6, more: &Cov6) -> Cov6 {
    let covariance = information.try_inverse().map(|covariance| covariance + more);
    covariance.and_then(|covariance| covariance.try_inverse()).unwrap_or(*information)
}

impl Follows<SpaceSweep> for FrontEnd {
    fn close(&mut self, past: Past<'_, SpaceSweep>, from: NodeId, to: NodeId, covariance: &Cov6) {
        self.local_map.iter_mut().for_each(|local_map| local_map.close(past, from, to, covariance));
    }

    fn open(&mut self, from: NodeId, to: NodeId) {
        self.local_map.iter_mut().for_each(|local_map| local_map.open(from, to));
    }

    fn carry(&mut self, past: Past<'_, SpaceSweep>, before: &[Pose3]) {
        self.local_map.iter_mut().for_each(|local_map| local_map.carry(past, before));
    }
}
