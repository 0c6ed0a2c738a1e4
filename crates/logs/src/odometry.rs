//! Which odometry to use, and why.

use crate::channel::TopicKind;
use crate::choice::Choice;
use crate::frames::{Place, SWING_MOST_RAD};
use crate::links::{Link, Links, is_map, is_world};
use crate::survey::{Survey, TopicSurvey, same_name};
use crate::words::grouped;
use mapwright_geom::Pose3;

/// Where the robot's own idea of its motion comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum OdometrySource {
    /// There is none.
    None,
    /// A topic of `nav_msgs/Odometry`.
    Topic {
        /// Its name.
        name: String,
        /// The robot's frame in the frame that it moves.
        child_from_robot: Pose3,
    },
    /// The transforms from one frame to another.
    Transforms {
        /// The frame that odometry started in.
        parent: String,
        /// The frame that moves in it.
        child: String,
        /// The robot's frame in the frame that moves.
        child_from_robot: Pose3,
    },
}

/// What was decided.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Found {
    pub(crate) source: OdometrySource,
    pub(crate) reason: String,
    pub(crate) assumed: Option<String>,
}

/// Topics of odometry that can be used, the one to prefer first: not another mapper's result, then most messages.
pub(crate) fn topics<'a>(survey: &'a Survey, choice: &Choice) -> Vec<&'a TopicSurvey> {
    let all = survey.topics.iter().filter(|topic| topic.kind == TopicKind::Odometry && topic.usable() > 0);
    let mut all: Vec<_> = all.filter(|topic| !is_map(topic.frame()) || is_chosen(topic, choice)).collect();
    all.sort_by_key(|topic| (!is_chosen(topic, choice), u64::MAX - topic.usable(), topic.name.len()));
    if choice.topics.iter().any(|name| survey.topic(name).is_some_and(|topic| topic.kind == TopicKind::Transforms)) {
        return Vec::new();
    }
    all
}

fn is_chosen(topic: &TopicSurvey, choice: &Choice) -> bool {
    choice.topics.iter().any(|name| same_name(name, &topic.name))
}

/// Odometry of the robot that a place is on.
pub(crate) fn find(survey: &Survey, place: &Place, choice: &Choice) -> Found {
    find_within(survey, place, choice, SWING_MOST_RAD)
}

/// The same of a robot that may swing as it likes.
pub(crate) fn find_in_space(survey: &Survey, place: &Place, choice: &Choice) -> Found {
    find_within(survey, place, choice, f64::INFINITY)
}

fn find_within(survey: &Survey, place: &Place, choice: &Choice, swing_most_rad: f64) -> Found {
    let by_link = moving_link(&survey.links, &place.robot_frame, swing_most_rad);
    let is_fake = |moves: bool| !moves && survey.scans_change();
    let (candidates, still): (Vec<_>, Vec<_>) =
        topics(survey, choice).into_iter().partition(|topic| !is_fake(topic.movement.has_moved));
    if let Some(topic) = candidates.first() {
        return by_topic(survey, topic, &candidates[1..], by_link, place, choice);
    }
    match by_link.filter(|link| !is_fake(!link.stands_still())) {
        None if !still.is_empty() || by_link.is_some_and(|link| !is_map(&link.parent)) => {
            let links = by_link.filter(|link| !is_map(&link.parent));
            let links = links.map(|link| format!("'{}' -> '{}'", link.parent, link.child));
            let never: Vec<_> = still.iter().map(|topic| topic.name.clone()).chain(links).collect();
            let never = if let [one] = &never[..] {
                format!("{one} never moves")
            } else {
                format!("{} never move", never.join(" and "))
            };
            Found {
                reason: format!("none: {never}, though what is seen does: poses are predicted by constant velocity"),
                source: OdometrySource::None,
                assumed: None,
            }
        }
        Some(link) if !is_map(&link.parent) => Found {
            reason: format!(
                "the transforms '{}' -> '{}' ({}), for there is no topic of odometry that fits",
                link.parent,
                link.child,
                grouped(link.transforms)
            ),
            source: OdometrySource::Transforms {
                parent: link.parent.clone(),
                child: link.child.clone(),
                child_from_robot: survey.links.constant(&link.child, &place.robot_frame).unwrap_or(Pose3::identity()),
            },
            assumed: None,
        },
        Some(link) => Found {
            reason: format!(
                "none: '{}' -> '{}' is where another mapper believed to be, which is no odometry; poses are predicted by \
                 constant velocity",
                link.parent, link.child
            ),
            source: OdometrySource::None,
            assumed: None,
        },
        None => Found {
            reason: "none in the log: poses are predicted by constant velocity".to_owned(),
            source: OdometrySource::None,
            assumed: None,
        },
    }
}

/// The link by which a robot moves: the first above its frame that is not constant, or whose parent is `odom`; none that
/// swings farther out of the plane within the robot.
fn moving_link<'a>(links: &'a Links, robot_frame: &str, swing_most_rad: f64) -> Option<&'a Link> {
    let moving = links.above(robot_frame).into_iter().find(|link| is_world(&link.parent) || !link.is_constant());
    moving.filter(|link| is_world(&link.parent) || link.swung_rad <= swing_most_rad)
}

fn by_topic(
    survey: &Survey,
    topic: &TopicSurvey,
    others: &[&TopicSurvey],
    by_link: Option<&Link>,
    place: &Place,
    choice: &Choice,
) -> Found {
    let child = topic.child_frame();
    let (child_from_robot, assumed) = match survey.links.constant(child, &place.robot_frame) {
        Ok(child_from_robot) => (child_from_robot, None),
        Err(_) if child.is_empty() => (Pose3::identity(), None),
        Err(_) => (
            Pose3::identity(),
            Some(format!(
                "{} moves '{child}', which nothing links to '{}': taken for the same frame",
                topic.name, place.robot_frame
            )),
        ),
    };
    let mut reason = format!("{} ({}, {} messages)", topic.name, topic.type_name, grouped(topic.usable()));
    if is_chosen(topic, choice) {
        reason += ", as asked for";
    } else if let Some(other) = others.first() {
        reason += &format!(", with more messages than {} ({})", other.name, grouped(other.usable()));
    }
    if let Some(link) = by_link {
        let (parent, child) = (&link.parent, &link.child);
        reason +=
            &format!("; preferred to the transforms '{parent}' -> '{child}', for messages are the readings themselves");
    }
    Found { source: OdometrySource::Topic { name: topic.name.clone(), child_from_robot }, reason, assumed }
}
