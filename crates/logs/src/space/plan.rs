//! What to map of a recording of space, and why.

use super::camera::{self, CameraPlan};
use super::imu::{self, ImuSource};
use super::packets::PacketPlan;
use crate::channel::TopicKind;
use crate::choice::{Choice, OdometryCalibration};
use crate::frames::{Place, list, place_in_space};
use crate::links::{bare, is_world};
use crate::odometry::{self, OdometrySource};
use crate::plan::{contents, nothing_of};
use crate::survey::{Survey, TopicSurvey, same_name};
use crate::words::{grouped, with_damage};
use mapwright_clouds::{CameraOptions, DEPTH_SCALE_KEY, UnitOf, Units};
use mapwright_geom::{Pose2, Pose3};
use mapwright_sensor::{SpaceSensor, SweepTimes};
use nalgebra::{UnitQuaternion, Vector3};
use std::cmp::Reverse;
use std::collections::BTreeMap;

/// What is mapped in space.
#[derive(Debug, Clone, PartialEq)]
pub struct SpacePlan {
    /// The topic of the clouds or images of depth.
    pub topic: String,
    /// What kind of messages.
    pub kind: TopicKind,
    /// How many of them.
    pub messages: u64,
    /// What took most of them.
    pub sensor: SpaceSensor,
    /// The robot's frame.
    pub robot_frame: String,
    /// Where odometry comes from.
    pub odometry: OdometrySource,
    /// Where inertial readings come from, if there are any.
    pub imu: Option<ImuSource>,
    /// Each decision and why: the name of what was decided, and the words.
    pub reasons: Vec<(&'static str, String)>,
    /// What had to be assumed, in words.
    pub assumed: Vec<String>,
    /// What is odd, in words, with what to type where it is wrong.
    pub odd: Vec<String>,
    /// What casts doubt on a map of it, in words.
    pub doubts: Vec<String>,
    /// What one stands for in the coordinates of clouds, metres.
    pub(super) unit_m: f64,
    /// What is known to be wrong with odometry.
    pub(super) calibration: Option<OdometryCalibration>,
    /// What the times of points are.
    pub(super) times: SweepTimes,
    /// Sensors by the messages' frames.
    pub(super) sensors: BTreeMap<String, SpaceSensor>,
    /// Of a lidar's packets.
    pub(super) packets: Option<PacketPlan>,
    /// Of images of depth.
    pub(super) camera: Option<CameraPlan>,
}

/// A topic that can be mapped.
struct Candidate<'a> {
    topic: &'a TopicSurvey,
    place: Place,
    is_camera: bool,
    camera: Option<camera::Found>,
    packets: Option<PacketPlan>,
}

impl SpacePlan {
    /// Decides what to map.
    ///
    /// # Errors
    /// Why nothing can be mapped in space, what is there instead and what to type, in words.
    pub fn of(survey: &Survey, choice: &Choice, options: &CameraOptions) -> Result<Self, String> {
        Self::of_sound(survey, choice, options).map_err(|reason| with_damage(&reason, survey))
    }

    fn of_sound(survey: &Survey, choice: &Choice, options: &CameraOptions) -> Result<Self, String> {
        let (mut candidates, refused) = candidates(survey, choice, options)?;
        candidates.sort_by_key(|candidate| {
            let topic = candidate.topic;
            let is_of_depth = topic.name.contains("depth");
            let points = topic.points[0].max(1).saturating_mul(topic.usable());
            (
                candidate.place.assumed.is_some(),
                candidate.is_camera,
                candidate.is_camera && !is_of_depth,
                topic.kind.is_packets(),
                Reverse(points),
            )
        });
        let others: Vec<_> = candidates.iter().skip(1).map(|candidate| candidate.topic.name.clone()).collect();
        match candidates.into_iter().next() {
            Some(chosen) if chosen.camera.is_some() && choice.range_unit_m.is_some() => Err(format!(
                "--range-unit is for clouds and scans, {} has images of depth: `{DEPTH_SCALE_KEY}` says which number stands for a metre",
                chosen.topic.name
            )),
            Some(chosen) => Ok(decide(survey, (choice, options), chosen, &others, &refused)),
            None => Err(refused.join("; ")),
        }
    }

    /// Whether this is what a recording is mapped as where nobody asks for it: it has something to map in space, and no scans of
    /// a planar laser, or what is asked for by name is none of these.
    #[must_use]
    pub fn is_default(survey: &Survey, choice: &Choice) -> bool {
        let is_asked = |topic: &&TopicSurvey| choice.topics.iter().any(|name| same_name(name, &topic.name));
        let is_planar = |topic: &TopicSurvey| topic.kind.is_planar() && topic.usable() > 0;
        let spatial = || survey.topics.iter().filter(|topic| is_spatial(topic));
        let any_planar = survey.topics.iter().any(is_planar);
        choice.slice.is_none()
            && (spatial().any(|topic| is_asked(&topic)) || (spatial().next().is_some() && !any_planar))
    }
}

/// Whether a topic's messages are clouds or images of depth.
fn is_spatial(topic: &TopicSurvey) -> bool {
    topic.messages > 0 && !topic.packets.is_inertial && (topic.kind.is_clouds() || topic.is_depth)
}

fn decide(
    survey: &Survey,
    (choice, options): (&Choice, &CameraOptions),
    chosen: Candidate<'_>,
    others: &[String],
    refused: &[String],
) -> SpacePlan {
    let Candidate { topic, place, is_camera, mut camera, packets } = chosen;
    let (place, assumed_mount) = looking_ahead(place, topic, is_camera);
    let (place, assumed_mount) = match choice.space.and_then(|space| space.robot_from_sensor) {
        Some(found) => (Place { robot_from_sensor: moved_to(place.robot_from_sensor, found), ..place }, None),
        None => (place, assumed_mount),
    };
    let odometry = odometry::find_in_space(survey, &place, choice);
    let imu = imu::find(survey, topic, &place, choice);
    let is_asked = choice.topics.iter().any(|name| same_name(name, &topic.name));
    let why = match (is_asked, others) {
        (true, _) => "as asked for".to_owned(),
        (_, []) => "the only topic that can be mapped in space".to_owned(),
        (_, others) => format!("not used: {}", list(others.iter().map(String::as_str))),
    };
    let what = if topic.kind.is_clouds() { "clouds" } else { "depth" };
    let count = grouped(topic.usable());
    let mut reasons =
        vec![(what, format!("{} ({}, {count} messages, {}): {why}", topic.name, topic.type_name, topic.shape))];
    reasons.extend(packets.as_ref().map(|packets| ("lidar", packets.words())));
    reasons.extend(camera.as_ref().map(|camera| ("camera", camera.reason.clone())));
    reasons.push(("robot", format!("'{}', {}", place.robot_frame, place.reason)));
    let is_calibrated = choice.space.is_some_and(|space| space.robot_from_sensor.is_some());
    reasons.push(("mounting", mounting_words(topic.frame(), &place, is_calibrated)));
    reasons.push(("odometry", odometry.reason.clone()));
    let without_imu = (choice.imu_mount.is_some() && imu.source.is_none())
        .then(|| "--imu-mount says how the inertial sensor sits: there is none that can be used".to_owned());
    reasons.extend(imu.reason.map(|reason| ("imu", reason)));
    let times = topic.sweeps.times();
    if topic.kind.is_clouds() {
        reasons.push(("motion", motion_words(topic, is_camera, times)));
    }
    reasons.extend(refused.iter().map(|reason| ("refused", reason.clone())));
    let as_made = sensor_of(topic, is_camera, place.robot_from_sensor);
    let units = units_of(topic, &as_made, camera.as_mut(), (choice, options));
    let near =
        |sensor: SpaceSensor| SpaceSensor { range_min_m: units.range_min_m.unwrap_or(sensor.range_min_m), ..sensor };
    let sensor = near(as_made);
    let mut sensors = BTreeMap::from([(topic.frame().to_owned(), sensor.clone())]);
    for frame in topic.frames.keys().filter(|frame| *frame != topic.frame()) {
        let robot = Choice { frame: Some(place.robot_frame.clone()), ..choice.clone() };
        if let Ok(other) = place_in_space(&survey.links, frame, &[], &robot)
            && other.assumed.is_none()
        {
            sensors.insert(frame.clone(), near(sensor_of(topic, is_camera, other.robot_from_sensor)));
        }
    }
    let of_camera = camera.as_ref().map_or_else(Vec::new, |camera| camera.assumed.clone());
    let of_times = shares_words(topic, times);
    SpacePlan {
        topic: topic.name.clone(),
        kind: topic.kind,
        messages: packets.as_ref().map_or(topic.usable(), |packets| packets.clouds(topic)),
        sensor,
        robot_frame: place.robot_frame,
        odometry: odometry.source,
        imu: imu.source,
        reasons,
        assumed: [assumed_mount, odometry.assumed, imu.assumed, of_times, units.assumed]
            .into_iter()
            .flatten()
            .chain(of_camera)
            .collect(),
        odd: units.odd.into_iter().chain(without_imu).collect(),
        doubts: camera.as_ref().and_then(|camera| camera.doubt.clone()).into_iter().collect(),
        unit_m: units.unit_m.unwrap_or(1.0),
        calibration: choice.odometry,
        times,
        sensors,
        packets,
        camera: camera.map(|camera| camera.plan),
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

/// Where nothing says where a camera sits, its optical axis (z, with x to the right) is taken for the robot's way ahead.
fn looking_ahead(place: Place, topic: &TopicSurvey, is_camera: bool) -> (Place, Option<String>) {
    let Some(assumed) = place.assumed.clone() else { return (place, None) };
    let is_optical = topic.is_depth || (is_camera && topic.frame().contains("optical"));
    let ahead = Pose3::from_quaternion([0.0; 3], [-0.5, 0.5, -0.5, 0.5]).filter(|_| is_optical);
    (Place { robot_from_sensor: ahead.unwrap_or(place.robot_from_sensor), ..place }, Some(assumed))
}

/// A place of which the position in the robot's plane and the yaw were found to be others.
fn moved_to(robot_from_sensor: Pose3, found: Pose2) -> Pose3 {
    let (roll, pitch, _) = robot_from_sensor.rotation.euler_angles();
    Pose3 {
        rotation: UnitQuaternion::from_euler_angles(roll, pitch, found.theta),
        translation: Vector3::new(found.x, found.y, robot_from_sensor.translation.z),
    }
}

fn mounting_words(sensor: &str, place: &Place, is_calibrated: bool) -> String {
    if place.assumed.is_some() && !is_calibrated {
        return format!("'{sensor}' in the robot's origin, assumed");
    }
    let (at, angles) = (place.robot_from_sensor.translation, imu::angles_words(&place.robot_from_sensor.rotation));
    let by = if is_calibrated { ": x, y and yaw as calibrated" } else { "" };
    format!("'{sensor}' at x {:.3} m, y {:.3} m, z {:.3} m, {angles}{by}", at.x, at.y, at.z)
}

/// Times that are none of seconds, taken for what they can only be.
fn shares_words(topic: &TopicSurvey, times: SweepTimes) -> Option<String> {
    let SweepTimes::Shares { sweep_s } = times else { return None };
    let span_s = topic.sweeps.span_s;
    Some(format!(
        "times of points span {span_s:.2} s, clouds come every {sweep_s:.2} s: taken for shares of a sweep that lasts from one cloud to the next"
    ))
}

fn motion_words(topic: &TopicSurvey, is_camera: bool, times: SweepTimes) -> String {
    match (topic.has_times, is_camera) {
        (true, _) if times.unit_s().is_none() => format!(
            "not undone: times of points span {:.2} s, and clouds come so often that they are of no sweep",
            topic.sweeps.span_s
        ),
        (true, _) => "undone: the points have times".to_owned(),
        (false, true) => "a depth camera's clouds: all points of one are taken at once".to_owned(),
        (false, false) => "points have no times: all of a cloud count as taken at once".to_owned(),
    }
}

/// Topics that can be mapped, and why others cannot.
fn candidates<'a>(
    survey: &'a Survey,
    choice: &Choice,
    options: &CameraOptions,
) -> Result<(Vec<Candidate<'a>>, Vec<String>), String> {
    for name in &choice.topics {
        let Some(first) = survey.topic(name) else {
            return Err(format!("there is no topic {name}; there are {}", contents(survey)));
        };
        let mut named = survey.topics.iter().filter(|topic| same_name(&topic.name, name));
        if !named.any(|topic| is_spatial(topic) || topic.kind.is_clouds() || topic.kind.is_motion()) {
            let what = if first.shape.is_empty() { String::new() } else { format!(" ({})", first.shape) };
            return Err(format!("{name} is {}{what}, expected clouds, images of depth or odometry", first.type_name));
        }
    }
    let is_asked = |topic: &&TopicSurvey| choice.topics.iter().any(|name| same_name(name, &topic.name));
    let mut all: Vec<_> = survey.topics.iter().filter(|topic| is_spatial(topic)).collect();
    let by_name = all.iter().any(is_asked);
    if by_name {
        all.retain(is_asked);
    }
    if all.is_empty() {
        let expected =
            "clouds or images of depth, found no topic of PointCloud2, or of Image or CompressedImage with depth";
        return Err(nothing_of(expected, survey));
    }
    let moved = odometry::topics(survey, choice).first().map(|topic| topic.child_frame()).filter(|f| !f.is_empty());
    let moved: Vec<_> = moved.into_iter().collect();
    let (mut found, mut refused) = (Vec::new(), Vec::new());
    for topic in all {
        match candidate(survey, choice, options, topic, &moved, by_name) {
            Ok(candidate) => found.push(candidate),
            Err(reason) => refused.push(format!("{}: {reason}", topic.name)),
        }
    }
    Ok((found, refused))
}

fn candidate<'a>(
    survey: &Survey,
    choice: &Choice,
    options: &CameraOptions,
    topic: &'a TopicSurvey,
    moved: &[&str],
    is_asked: bool,
) -> Result<Candidate<'a>, String> {
    if topic.usable() == 0 {
        let why = topic.first_error.as_ref().map_or_else(|| "no messages".to_owned(), |e| format!("unreadable: {e}"));
        return Err(why);
    }
    if is_world(bare(topic.frame())) && !is_asked {
        return Err(format!("in '{}', so that somebody has put these points together: no sensor's", topic.frame()));
    }
    let camera = if topic.is_depth { Some(camera::find(survey, topic, options)?) } else { None };
    let packets = topic.kind.is_packets().then(|| PacketPlan::of(survey, topic)).transpose()?;
    let place = place_in_space(&survey.links, topic.frame(), moved, choice)?;
    Ok(Candidate { topic, place, is_camera: is_camera(topic), camera, packets })
}

/// Whether a depth camera took a topic's messages: images, or clouds in an optical frame or in rows and named so.
fn is_camera(topic: &TopicSurvey) -> bool {
    let is_in_rows = topic.points[1] > 1 && topic.name.contains("depth");
    topic.is_depth || topic.frame().ends_with("optical_frame") || is_in_rows
}
