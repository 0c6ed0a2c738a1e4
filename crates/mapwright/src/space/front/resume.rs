//! The front end in space as bytes, and one that goes on with an earlier run. After a run that was killed, what inertial readings have told
//! is learnt anew.

use super::SpaceFrontEnd;
use super::dynamic::DynamicObjects;
use super::inertial::{Inertial, LevelWatch};
use super::predict::Predictor;
use super::prepare::Preparation;
use crate::front::{Links, links};
use crate::front_end::{FrontEnd, Resumes};
use crate::pose::RobotPose;
use crate::sensors::{PerSensor, SensorId, Sensors};
use crate::settings::Settings;
use crate::space::local_map::LocalMapping;
use crate::space::scale::Scale;
use crate::watch::Watch;
use mapwright_geom::{Cov6, Pose3, Stored, is_covariance, is_in_place};
use mapwright_record::Past;
use mapwright_sensor::SpaceSweep;

impl Resumes<SpaceSweep> for SpaceFrontEnd {
    const VERSION: u8 = 9;

    fn put(&self, out: &mut Vec<u8>) {
        self.preparation.scale().put(out);
        self.predictor.put(out);
        self.tracker.usual().get(SensorId::default()).copied().flatten().put(out);
        self.tracker.watch.put(out);
        self.inertial.put(out);
        self.pose.put(out);
        (self.middle_from_stamp, self.carried_on).put(out);
        self.local_map.is_some().put(out);
        self.local_map.iter().for_each(|local_map| local_map.put(out));
        self.level.put(out);
        self.moving.put(out);
        if self.sensors.are_several() {
            self.sensors.put(out);
            self.predictor.put_sensors(out);
            self.tracker.usual().put(out);
            self.posed_by.put(out);
            self.inertial.put_back(out);
        }
    }

    fn restore(settings: Settings, past: Past<'_, SpaceSweep>, from: &mut &[u8]) -> Option<Self> {
        let scale: Option<Scale> = Stored::take(from)?;
        let mut predictor = Predictor::restore(from)?;
        let first: Option<f64> = Stored::take(from)?;
        let watch = Watch::take(from).filter(Watch::is_sound)?;
        let mut inertial = Inertial::restore(from)?;
        let pose = RobotPose::restore(past, from)?;
        let (middle_from_stamp, carried_on): (Pose3, Cov6) = Stored::take(from)?;
        (is_in_place(middle_from_stamp) && is_covariance(&carried_on)).then_some(())?;
        let local_map = match bool::take(from)? {
            true => Some(LocalMapping::restore(&settings, scale?, past, from)?),
            false => None,
        };
        let level = LevelWatch::take(from).filter(|level| level.is_of(past.session))?;
        let moving = DynamicObjects::restore(from)?;
        let (mut sensors, mut usual, mut posed_by) = (Sensors::default(), PerSensor::default(), None);
        *usual.of(SensorId::default()) = first;
        if !from.is_empty() {
            sensors = Stored::take(from)?;
            predictor = predictor.take_sensors(from)?;
            (usual, posed_by) = (Stored::take(from)?, Stored::take(from)?);
            inertial = inertial.take_back(from)?;
        }
        usual.iter().all(|usual| usual.is_none_or(f64::is_finite)).then_some(())?;
        let preparation = Preparation::of_scale(scale);
        let new = Self::new(settings, Pose3::identity());
        let tracker = new.tracker.clone().used_to(usual, watch);
        Some(Self {
            preparation,
            moving,
            sensors,
            posed_by,
            predictor,
            tracker,
            inertial,
            pose,
            middle_from_stamp,
            carried_on,
            local_map,
            level,
            ..new
        })
    }

    fn resume(settings: Settings, past: Past<'_, SpaceSweep>) -> Self {
        let links = links(past);
        let last = past.session.trajectory().last().map(|pose| pose.map_from_robot);
        let mut front = Self::new(settings, last.unwrap_or_default());
        let Some(scale) = front.scale_by(past) else { return front };
        front.local_map = Some(LocalMapping::of_links(&front.settings, scale, past, &links));
        let covariances = links.iter().map(Links::fused).collect();
        front.pose = RobotPose::resume(last.unwrap_or_default(), covariances, Cov6::zeros());
        front
    }
}

impl SpaceFrontEnd {
    /// What was derived from the first clouds, or is now from the first keyframe.
    pub(super) fn scale_by(&mut self, past: Past<'_, SpaceSweep>) -> Option<Scale> {
        if self.preparation.scale().is_none() {
            let first = past.session.keyframes().first()?;
            let points: Vec<[f32; 3]> = first.sweep.points_m().collect();
            let scale = Scale::of(&self.settings, &first.sweep.sensor, &points, &[]);
            self.preparation = Preparation::of_scale(Some(scale));
        }
        self.preparation.scale()
    }
}
