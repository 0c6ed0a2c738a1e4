//! What to map of a recording of space, and why.

use super::camera;
use super::further::Lidars;
use super::imu::{self, ImuSource};
use super::packets::PacketPlan;
use super::stereo::{self, Pair};
use super::tilting::{Joint, is_tilting};
use super::topic::{Candidate, TopicPlan};
use crate::channel::TopicKind;
use crate::choice::Choice;
use crate::frames::{Place, place_in_space};
use crate::links::{bare, is_world};
use crate::odometry::{self, OdometrySource};
use crate::plan::{contents, nothing_of};
use crate::survey::{Survey, TopicSurvey, same_name};
use crate::words::with_damage;
use mapwright_clouds::{CameraOptions, DEPTH_SCALE_KEY};
use mapwright_geom::Pose3;
use mapwright_sensor::{OdometryCalibration, SpaceSensor};
use std::cmp::Reverse;

/// What is mapped in space.
#[derive(Debug, Clone, PartialEq)]
pub struct SpacePlan {
    /// The topic of the clouds or images of depth, of the first sensor.
    pub topic: String,
    /// What kind of messages.
    pub kind: TopicKind,
    /// Topics of other sensors of the same robot that are mapped with it.
    pub further: Vec<String>,
    /// How many messages of all of these.
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
    /// What is known to be wrong with odometry.
    pub(super) calibration: Option<OdometryCalibration>,
    /// How each topic's messages become clouds, the first one's first.
    pub(super) sources: Vec<TopicPlan>,
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
                topic.kind.is_planar(),
                candidate.place.assumed.is_some(),
                candidate.is_camera,
                candidate.is_camera && !is_of_depth,
                topic.kind.is_packets(),
                Reverse(points),
            )
        });
        let mut candidates = candidates.into_iter();
        match candidates.next() {
            Some(chosen) if chosen.camera.is_some() && choice.range_unit_m.is_some() => Err(format!(
                "--range-unit is for clouds and scans, {} has images of depth: `{DEPTH_SCALE_KEY}` says which number stands for a metre",
                chosen.topic.name
            )),
            Some(chosen) => {
                let lidars = Lidars::of(chosen, candidates, choice)?;
                Ok(decide(survey, (choice, options), lidars, &refused))
            }
            None => Err(refused.join("; ")),
        }
    }

    /// Whether this is what a recording is mapped as where nobody asks for it: it has something to map in space, and no scans of
    /// a planar laser, or what is asked for by name is none of these.
    #[must_use]
    pub fn is_default(survey: &Survey, choice: &Choice) -> bool {
        let is_asked = |topic: &&TopicSurvey| choice.asks_for(&topic.name);
        let is_planar =
            |topic: &TopicSurvey| topic.kind.is_planar() && topic.usable() > 0 && !is_tilting(survey, topic);
        let spatial = || survey.topics.iter().filter(|topic| is_spatial(survey, topic));
        let any_planar = survey.topics.iter().any(is_planar);
        let pairs = stereo::pairs(survey, choice);
        let is_pair_asked = pairs.iter().any(|pair| choice.asks_for(&pair.left.name));
        let is_pair = spatial().next().is_none() && !pairs.is_empty() && !any_planar;
        choice.slice.is_none()
            && (is_pair_asked
                || is_pair
                || spatial().any(|topic| is_asked(&topic))
                || (spatial().next().is_some() && !any_planar))
    }
}

/// Whether a topic's messages are clouds or images of depth, or scans of a laser that tilts.
fn is_spatial(survey: &Survey, topic: &TopicSurvey) -> bool {
    let is_seen = topic.messages > 0 && !topic.packets.is_inertial;
    is_seen && (topic.kind.is_clouds() || topic.is_depth || is_tilting(survey, topic))
}

fn decide(
    survey: &Survey,
    (choice, options): (&Choice, &CameraOptions),
    lidars: Lidars<'_>,
    refused: &[String],
) -> SpacePlan {
    let why = lidars.why_chosen(choice);
    let Lidars { chosen, further, .. } = lidars;
    let is_optical = chosen.topic.is_depth || chosen.stereo.is_some();
    let (place, assumed_mount) = looking_ahead(chosen.place, chosen.topic, (chosen.is_camera, is_optical));
    let calibrated = choice.space.and_then(|space| space.robot_from_sensor);
    let (place, assumed_mount) = match calibrated {
        Some(found) => (Place { robot_from_sensor: place.robot_from_sensor.moved_in_plane(found), ..place }, None),
        None => (place, assumed_mount),
    };
    let odometry = odometry::find_in_space(survey, &place, choice);
    let has_odometry = odometry.source != OdometrySource::None;
    let joint = chosen.joint.map(|joint| joint.with_odometry(has_odometry));
    let chosen = Candidate { place, joint, ..chosen };
    let Candidate { topic, place, .. } = &chosen;
    let imu = imu::find(survey, topic, place, choice);
    let mut reasons = vec![chosen.words(&why)];
    reasons.extend(chosen.device_words());
    reasons.push(("robot", format!("'{}', {}", place.robot_frame, place.reason)));
    reasons.push(("mounting", mounting_words(topic.frame(), place, calibrated.is_some())));
    reasons.push(("odometry", odometry.reason.clone()));
    let without_imu = (choice.imu_mount.is_some() && imu.source.is_none())
        .then(|| "--imu-mount says how the inertial sensor sits: there is none that can be used".to_owned());
    reasons.extend(imu.reason.map(|reason| ("imu", reason)));
    let motion = chosen.motion_words();
    reasons.extend(motion.clone().map(|words| ("motion", words)));
    for (other, why) in &further {
        reasons.push(other.words(&format!("mapped too, {why}")));
        reasons.extend(other.device_words());
        reasons.push(("mounting", mounting_words(other.topic.frame(), &other.place, false)));
        let of_this = other.motion_words().filter(|words| Some(words) != motion.as_ref());
        reasons.extend(of_this.map(|words| ("motion", format!("{}: {words}", other.topic.name))));
    }
    reasons.extend(refused.iter().map(|reason| ("refused", reason.clone())));
    let robot_frame = place.robot_frame.clone();
    let (own, mut said) = TopicPlan::of(survey, (choice, options), chosen);
    let mut sources = vec![own.clone()];
    for (other, _) in further {
        let (plan, more) = TopicPlan::of(survey, (choice, options), other);
        said = said.and(more, &plan.topic);
        sources.push(plan);
    }
    SpacePlan {
        topic: own.topic,
        kind: own.kind,
        further: sources.iter().skip(1).map(|source| source.topic.clone()).collect(),
        messages: sources.iter().map(|source| source.messages).sum(),
        sensor: own.sensor,
        robot_frame,
        odometry: odometry.source,
        imu: imu.source,
        reasons,
        assumed: [assumed_mount, odometry.assumed, imu.assumed].into_iter().flatten().chain(said.assumed).collect(),
        odd: said.odd.into_iter().chain(without_imu).collect(),
        doubts: said.doubts,
        calibration: choice.odometry,
        sources,
    }
}

/// Where nothing says where a camera sits, its optical axis (z, with x to the right) is taken for the robot's way ahead.
fn looking_ahead(place: Place, topic: &TopicSurvey, (is_camera, is_image): (bool, bool)) -> (Place, Option<String>) {
    let Some(assumed) = place.assumed.clone() else { return (place, None) };
    let is_optical = is_image || (is_camera && topic.frame().contains("optical"));
    let ahead = Pose3::from_quaternion([0.0; 3], [-0.5, 0.5, -0.5, 0.5]).filter(|_| is_optical);
    (Place { robot_from_sensor: ahead.unwrap_or(place.robot_from_sensor), ..place }, Some(assumed))
}

fn mounting_words(sensor: &str, place: &Place, is_calibrated: bool) -> String {
    if place.assumed.is_some() && !is_calibrated {
        return format!("'{sensor}' in the robot's origin, assumed");
    }
    let (at, angles) = (place.robot_from_sensor.translation, imu::angles_words(&place.robot_from_sensor.rotation));
    let by = if is_calibrated { ": x, y and yaw as calibrated" } else { "" };
    format!("'{sensor}' at x {:.3} m, y {:.3} m, z {:.3} m, {angles}{by}", at.x, at.y, at.z)
}

/// Topics that can be mapped, and why others cannot.
fn candidates<'a>(
    survey: &'a Survey,
    choice: &Choice,
    options: &CameraOptions,
) -> Result<(Vec<Candidate<'a>>, Vec<String>), String> {
    let pairs = stereo::pairs(survey, choice);
    let is_of_pair =
        |topic: &TopicSurvey| pairs.iter().any(|pair| [pair.left, pair.right].iter().any(|one| one.name == topic.name));
    for name in &choice.topics {
        let Some(first) = survey.topic(name) else {
            return Err(format!("there is no topic {name}; there are {}", contents(survey)));
        };
        let mut named = survey.topics.iter().filter(|topic| same_name(&topic.name, name));
        if !named.any(|topic| {
            is_spatial(survey, topic) || is_of_pair(topic) || topic.kind.is_clouds() || topic.kind.is_motion()
        }) {
            let what = if first.shape.is_empty() { String::new() } else { format!(" ({})", first.shape) };
            return Err(format!("{name} is {}{what}, expected clouds, images of depth or odometry", first.type_name));
        }
    }
    let is_asked = |topic: &&TopicSurvey| choice.asks_for(&topic.name);
    let mut all: Vec<_> = survey.topics.iter().filter(|topic| is_spatial(survey, topic)).collect();
    let by_name = all.iter().any(is_asked);
    if by_name {
        all.retain(is_asked);
    }
    let moved = odometry::topics(survey, choice).first().map(|topic| topic.child_frame()).filter(|f| !f.is_empty());
    let moved: Vec<_> = moved.into_iter().collect();
    let is_pair_asked = pairs.iter().any(|pair| choice.asks_for(&pair.left.name) || choice.asks_for(&pair.right.name));
    if !pairs.is_empty() && (all.is_empty() || (is_pair_asked && !by_name)) {
        return of_pairs(survey, (choice, options), &pairs, &moved);
    }
    if all.is_empty() {
        let expected = "clouds, images of depth or scans of a laser that tilts, found no topic of PointCloud2, \
             of Image or CompressedImage with depth, or of LaserScan on a joint that swings";
        return Err(nothing_of(expected, survey));
    }
    let (mut found, mut refused) = (Vec::new(), Vec::new());
    for topic in all {
        match candidate(survey, choice, options, topic, &moved, by_name) {
            Ok(candidate) => found.push(candidate),
            Err(reason) => refused.push(format!("{}: {reason}", topic.name)),
        }
    }
    let is_missing =
        |name: &&String| !found.iter().any(|candidate: &Candidate<'_>| same_name(name, &candidate.topic.name));
    let missing = choice.topics.iter().filter(is_missing).find_map(|name| {
        let name = name.trim_start_matches('/');
        refused.iter().find(|reason| reason.trim_start_matches('/').starts_with(&format!("{name}: ")))
    });
    match missing {
        Some(reason) => Err(reason.clone()),
        None => Ok((found, refused)),
    }
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
    let (joint, place) = if topic.kind.is_planar() {
        let (joint, place) = Joint::of(survey, topic, moved, choice)?;
        (Some(joint), place)
    } else {
        (None, place_in_space(&survey.links, topic.frame(), moved, choice)?)
    };
    Ok(Candidate { topic, place, is_camera: is_camera(topic), camera, packets, joint, stereo: None })
}

/// The first pair of cameras of which it is known what they are, and why others are not.
fn of_pairs<'a>(
    survey: &Survey,
    (choice, options): (&Choice, &CameraOptions),
    pairs: &[Pair<'a>],
    moved: &[&str],
) -> Result<(Vec<Candidate<'a>>, Vec<String>), String> {
    let mut refused = Vec::new();
    for pair in pairs {
        let found = stereo::find(survey, *pair, options)
            .and_then(|stereo| Ok((stereo, place_in_space(&survey.links, pair.left.frame(), moved, choice)?)));
        match found {
            Ok((found, place)) => {
                let stereo = Some(found);
                let candidate = Candidate {
                    topic: pair.left,
                    place,
                    is_camera: true,
                    camera: None,
                    packets: None,
                    joint: None,
                    stereo,
                };
                return Ok((vec![candidate], refused));
            }
            Err(reason) => refused.push(reason),
        }
    }
    Err(refused.join("; "))
}

/// Whether a depth camera took a topic's messages: images, or clouds in an optical frame or in rows and named so.
fn is_camera(topic: &TopicSurvey) -> bool {
    let is_in_rows = topic.points[1] > 1 && topic.name.contains("depth");
    topic.is_depth || topic.frame().ends_with("optical_frame") || is_in_rows
}
