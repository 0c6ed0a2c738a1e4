//! How the messages of one topic become clouds, and what is said of that.

use super::camera::{self, CameraPlan};
use super::packets::PacketPlan;
use super::stereo::{self, StereoTopics};
use super::tilting::Joint;
use crate::channel::TopicKind;
use crate::choice::Choice;
use crate::frames::{Place, place_in_space};
use crate::survey::{Survey, TopicSurvey};
use crate::words::grouped;
use mapwright_clouds::{CameraOptions, UnitOf, Units};
use mapwright_geom::Pose3;
use mapwright_sensor::{SpaceSensor, SweepTimes};
use std::collections::BTreeMap;

/// A topic that can be mapped.
pub(super) struct Candidate<'a> {
    pub(super) topic: &'a TopicSurvey,
    pub(super) place: Place,
    pub(super) is_camera: bool,
    pub(super) camera: Option<camera::Found>,
    pub(super) packets: Option<PacketPlan>,
    pub(super) joint: Option<Joint>,
    pub(super) stereo: Option<stereo::Found>,
}

impl Candidate<'_> {
    /// In words, and why it is mapped.
    pub(super) fn words(&self, why: &str) -> (&'static str, String) {
        let TopicSurvey { name, type_name, shape, .. } = self.topic;
        let what = match self.topic.kind {
            _ if self.stereo.is_some() => "stereo",
            kind if kind.is_planar() => "scans",
            kind if kind.is_clouds() => "clouds",
            _ => "depth",
        };
        (what, format!("{name} ({type_name}, {} messages, {shape}): {why}", grouped(self.topic.usable())))
    }

    /// What sends its packets, or which camera it has, in words.
    pub(super) fn device_words(&self) -> impl Iterator<Item = (&'static str, String)> {
        let packets = self.packets.as_ref().map(|packets| ("lidar", packets.words()));
        let stereo = self.stereo.as_ref().map(|stereo| ("camera", stereo.reason.clone()));
        packets.into_iter().chain(self.camera.as_ref().map(|camera| ("camera", camera.reason.clone()))).chain(stereo)
    }

    /// Whether the motion during a sweep is undone, in words; none of images.
    pub(super) fn motion_words(&self) -> Option<String> {
        let Self { topic, is_camera, .. } = *self;
        if let Some(joint) = &self.joint {
            return Some(joint.words());
        }
        topic.kind.is_clouds().then(|| match (topic.has_times, is_camera) {
            (true, _) if topic.sweeps.times().unit_s().is_none() => format!(
                "not undone: times of points span {:.2} s, and clouds come so often that they are of no sweep",
                topic.sweeps.span_s
            ),
            (true, _) => "undone: the points have times".to_owned(),
            (false, true) => "a depth camera's clouds: all points of one are taken at once".to_owned(),
            (false, false) => "points have no times: all of a cloud count as taken at once".to_owned(),
        })
    }
}

/// How the messages of a topic become clouds.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TopicPlan {
    pub(super) topic: String,
    pub(super) kind: TopicKind,
    pub(super) messages: u64,
    /// What took most of them.
    pub(super) sensor: SpaceSensor,
    /// What one stands for in the coordinates of clouds, metres.
    pub(super) unit_m: f64,
    /// What the times of points are.
    pub(super) times: SweepTimes,
    /// Sensors by the messages' frames.
    pub(super) sensors: BTreeMap<String, SpaceSensor>,
    /// Of a lidar's packets.
    pub(super) packets: Option<PacketPlan>,
    /// Of images of depth.
    pub(super) camera: Option<CameraPlan>,
    /// Of scans of a laser that tilts.
    pub(super) joint: Option<Joint>,
    /// Of pairs of images.
    pub(super) stereo: Option<StereoTopics>,
}

/// What is said of a topic, in words: what had to be assumed, what is odd and what casts doubt on a map of it.
#[derive(Debug, Default)]
pub(super) struct Said {
    pub(super) assumed: Vec<String>,
    pub(super) odd: Vec<String>,
    pub(super) doubts: Vec<String>,
}

impl Said {
    /// This, and what is said of another topic.
    pub(super) fn and(mut self, other: Self, name: &str) -> Self {
        let named = |words: Vec<String>| words.into_iter().map(|words| format!("{name}: {words}")).collect::<Vec<_>>();
        self.assumed.extend(named(other.assumed));
        self.odd.extend(named(other.odd));
        self.doubts.extend(named(other.doubts));
        self
    }
}

impl TopicPlan {
    pub(super) fn of(
        survey: &Survey,
        (choice, options): (&Choice, &CameraOptions),
        candidate: Candidate<'_>,
    ) -> (Self, Said) {
        let Candidate { topic, place, is_camera, mut camera, packets, joint, stereo } = candidate;
        let made = |robot_from_sensor| match &stereo {
            Some(found) => SpaceSensor { robot_from_sensor, ..found.topics.sensor.clone() },
            None => sensor_of(topic, is_camera, robot_from_sensor),
        };
        let as_made = made(place.robot_from_sensor);
        let units = units_of(topic, &as_made, camera.as_mut(), (choice, options));
        let near = |sensor: SpaceSensor| SpaceSensor {
            range_min_m: units.range_min_m.unwrap_or(sensor.range_min_m),
            ..sensor
        };
        let sensor = near(as_made);
        let mut sensors = BTreeMap::from([(topic.frame().to_owned(), sensor.clone())]);
        for frame in topic.frames.keys().filter(|frame| *frame != topic.frame()) {
            let robot = Choice { frame: Some(place.robot_frame.clone()), ..choice.clone() };
            if let Ok(other) = place_in_space(&survey.links, frame, &[], &robot)
                && other.assumed.is_none()
            {
                sensors.insert(frame.clone(), near(made(other.robot_from_sensor)));
            }
        }
        let times = topic.sweeps.times();
        let of_camera = camera.as_ref().map_or_else(Vec::new, |camera| camera.assumed.clone());
        let of_joint = joint.as_ref().and_then(Joint::assumed);
        let assumed = shares_words(topic, times).into_iter().chain(units.assumed).chain(of_camera).chain(of_joint);
        let said = Said {
            assumed: assumed.collect(),
            odd: units.odd.into_iter().collect(),
            doubts: camera.as_ref().and_then(|camera| camera.doubt.clone()).into_iter().collect(),
        };
        let plan = Self {
            topic: topic.name.clone(),
            kind: topic.kind,
            messages: packets.as_ref().map_or(topic.usable(), |packets| packets.clouds(topic)),
            sensor,
            unit_m: units.unit_m.unwrap_or(1.0),
            times,
            sensors,
            packets,
            camera: camera.map(|camera| camera.plan),
            joint,
            stereo: stereo.map(|found| found.topics),
        };
        (plan, said)
    }
}

/// The unit of a topic's clouds as it is asked for, or as its first messages have it. Of images of depth it is the camera's number that
/// stands for a metre.
fn units_of(
    topic: &TopicSurvey,
    sensor: &SpaceSensor,
    camera: Option<&mut camera::Found>,
    (choice, options): (&Choice, &CameraOptions),
) -> Units {
    let Some(camera) = camera else {
        let asked = choice.range_unit_m;
        let found = topic.distances.scaled(asked.unwrap_or(1.0)).judge(sensor, UnitOf::Clouds(asked));
        return Units { unit_m: asked.or(found.unit_m), ..found };
    };
    let per_m = camera.plan.depth_per_m.unwrap_or(topic.depth_per_m);
    let of = UnitOf::Images { per_m, is_asked: options.depth_scale.is_some() };
    let found = topic.distances.scaled(topic.depth_per_m / per_m).judge(sensor, of);
    if let Some(unit_m) = found.unit_m {
        camera.plan.depth_per_m = Some(per_m / unit_m);
    }
    Units { unit_m: None, ..found }
}

fn sensor_of(topic: &TopicSurvey, is_camera: bool, robot_from_sensor: Pose3) -> SpaceSensor {
    let made = if is_camera { SpaceSensor::depth_camera(&topic.name) } else { SpaceSensor::lidar(&topic.name) };
    SpaceSensor { robot_from_sensor, ..made }
}

/// Times that are none of seconds, taken for what they can only be.
fn shares_words(topic: &TopicSurvey, times: SweepTimes) -> Option<String> {
    let SweepTimes::Shares { sweep_s } = times else { return None };
    let span_s = topic.sweeps.span_s;
    Some(format!(
        "times of points span {span_s:.2} s, clouds come every {sweep_s:.2} s: taken for shares of a sweep that lasts from one cloud to the next"
    ))
}
