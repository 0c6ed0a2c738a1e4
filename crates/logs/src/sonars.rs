//! Sonars of a recording: single cones, of several topics or frames, that make up one ring.

use crate::channel::{Messages, TopicKind};
use crate::choice::Choice;
use crate::frames::{Place, place};
use crate::links::{bare, stamp_or};
use crate::odometry;
use crate::problem::Problem;
use crate::survey::{SonarHead, Survey, TopicSurvey, same_name};
use mapwright_bags::RawMessage;
use mapwright_ros::messages::Range;
use mapwright_ros::planar;
use mapwright_sensor::{Sonar, SonarReading, SonarRing};
use nalgebra::Vector3;
use std::sync::Arc;

/// A greatest range from here on is in millimetres: 200 m are beyond any sonar, 0.2 m are not.
const MILLIMETRES_FROM: f32 = 200.0;

/// One sonar of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct SonarSource {
    /// The topic of its readings.
    pub topic: String,
    /// Its frame.
    pub frame: String,
    /// Where it sits and how it looks, by the first of its messages.
    pub sonar: Sonar,
    /// What a number of its messages is, metres.
    pub(crate) unit_m: f64,
}

/// What is found, and why others are not used.
#[derive(Debug, Default)]
pub(crate) struct Found {
    pub(crate) sonars: Vec<SonarSource>,
    /// Of the first.
    pub(crate) place: Option<Place>,
    pub(crate) refused: Vec<String>,
}

/// The sonars that sit on one robot, `on` that one where it is known.
pub(crate) fn find(survey: &Survey, choice: &Choice, on: Option<&str>) -> Found {
    let topics = odometry::topics(survey, choice);
    let moved: Vec<_> = topics.first().map(|topic| topic.child_frame()).into_iter().filter(|f| !f.is_empty()).collect();
    let mut found = Found::default();
    let mut robot = on.map(str::to_owned);
    let is_asked = |topic: &TopicSurvey| choice.topics.iter().any(|name| same_name(name, &topic.name));
    let mut all: Vec<_> =
        survey.topics.iter().filter(|topic| topic.kind == TopicKind::Range && topic.usable() > 0).collect();
    if all.iter().any(|topic| is_asked(topic)) {
        all.retain(|topic| is_asked(topic));
    }
    for topic in all {
        for (frame, said) in &topic.sonars {
            match placed(survey, choice, frame, &moved, robot.as_deref())
                .and_then(|at| Ok((source(topic, frame, *said, &at)?, at)))
            {
                Ok((source, at)) => {
                    robot.get_or_insert_with(|| at.robot_frame.clone());
                    found.place.get_or_insert(at);
                    found.sonars.push(source);
                }
                Err(reason) => found.refused.push(format!("{} ('{frame}'): {reason}", topic.name)),
            }
        }
    }
    found
}

fn placed(survey: &Survey, choice: &Choice, frame: &str, moved: &[&str], on: Option<&str>) -> Result<Place, String> {
    let at = place(&survey.links, frame, moved, choice)?;
    if at.assumed.is_some() {
        return Err("expected transforms that say where the sonar sits on the robot, found none".to_owned());
    }
    match on {
        Some(robot) if robot != at.robot_frame => Err(format!("it sits on '{}', not on '{robot}'", at.robot_frame)),
        _ => Ok(at),
    }
}

fn source(topic: &TopicSurvey, frame: &str, said: SonarHead, at: &Place) -> Result<SonarSource, String> {
    let unit_m = if said[2].is_finite() && said[2] >= MILLIMETRES_FROM { 1e-3 } else { 1.0 };
    let forward = at.robot_from_sensor.rotation * Vector3::x();
    let sonar = sonar(said, unit_m, planar(&at.robot_from_sensor));
    sonar.check()?;
    let up_rad = forward.z.clamp(-1.0, 1.0).asin();
    if up_rad.abs() > 0.5 * sonar.opening_rad {
        return Err(format!(
            "its axis leaves the plane by {:.0} deg: expected at most half of its cone, {:.0} deg",
            up_rad.to_degrees(),
            0.5 * sonar.opening_rad.to_degrees()
        ));
    }
    Ok(SonarSource { topic: topic.name.clone(), frame: frame.to_owned(), sonar, unit_m })
}

fn sonar([opening_rad, min, max]: SonarHead, unit_m: f64, robot_from_sonar: mapwright_geom::Pose2) -> Sonar {
    let [opening_rad, min, max] = [opening_rad, min, max].map(f64::from);
    Sonar { robot_from_sonar, opening_rad, range_min_m: min.max(0.0) * unit_m, range_max_m: max * unit_m }
}

/// Makes readings of messages.
#[derive(Debug)]
pub(crate) struct SonarMaker {
    sources: Vec<SonarSource>,
    ring: Arc<SonarRing>,
}

impl SonarMaker {
    pub(crate) fn new(sources: &[SonarSource]) -> Self {
        let sonars = sources.iter().map(|source| source.sonar.clone()).collect();
        Self { sources: sources.to_vec(), ring: Arc::new(SonarRing { name: "sonars".to_owned(), sonars }) }
    }

    /// The reading of a message, NaN for all other sonars; whether it had a stamp of its own.
    pub(crate) fn reading(
        &mut self,
        messages: &mut Messages,
        message: &RawMessage<'_>,
    ) -> Result<(SonarReading, bool), Problem> {
        let decoder = match messages {
            Messages::Range(decoder) => decoder,
            Messages::None(Some(reason)) => return Err(Problem::Undecodable(reason.clone())),
            _ => return Err(Problem::Undecodable("expected sensor_msgs/Range".to_owned())),
        };
        let range: Range<'_> = decoder.decode(message.data).map_err(|error| Problem::Undecodable(error.to_string()))?;
        let frame = bare(&range.header.frame_id);
        let is_of = |source: &SonarSource| source.frame == frame && same_name(&source.topic, &message.connection.topic);
        let number = self.sources.iter().position(is_of);
        let number = number.ok_or_else(|| Problem::Unusable(format!("'{frame}' is no sonar that can be placed")))?;
        let SonarSource { sonar: known, unit_m, .. } = &self.sources[number];
        let said = [range.field_of_view, range.min_range, range.max_range];
        let now = sonar(said, *unit_m, known.robot_from_sonar);
        if now != self.ring.sonars[number] {
            now.check().map_err(Problem::Unusable)?;
            Arc::make_mut(&mut self.ring).sonars[number] = now;
        }
        let mut ranges_m = vec![f32::NAN; self.sources.len()];
        ranges_m[number] = (f64::from(range.range) * unit_m) as f32;
        let (stamp, is_unstamped) = stamp_or(range.header.stamp, message.log_stamp);
        Ok((SonarReading { stamp, ring: Arc::clone(&self.ring), ranges_m, odom_from_robot: None }, !is_unstamped))
    }
}
