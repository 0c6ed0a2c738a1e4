//! Which gyroscope says how the robot turns during a sweep, and why.

use crate::channel::TopicKind;
use crate::choice::Choice;
use crate::frames::Place;
use crate::survey::{Survey, TopicSurvey, same_name};
use crate::words::grouped;
use mapwright_geom::Pose3;
use nalgebra::Vector3;

/// Where turn rates come from.
#[derive(Debug, Clone, PartialEq)]
pub struct TurningSource {
    /// The topic.
    pub name: String,
    /// The robot's upward axis in the sensor's frame.
    pub up_in_sensor: [f64; 3],
}

/// What was decided for scans whose beams are taken one after the other, and why; none where there is nothing to say.
pub(crate) fn find(
    survey: &Survey,
    scans: &TopicSurvey,
    place: &Place,
    choice: &Choice,
) -> (Option<TurningSource>, Option<String>) {
    let is_asked = |topic: &TopicSurvey| choice.topics.iter().any(|name| same_name(name, &topic.name));
    let imus = survey.topics.iter().filter(|topic| topic.kind == TopicKind::Imu && topic.usable() > 0);
    let Some(topic) = imus.max_by_key(|topic| (is_asked(topic), topic.usable())) else { return (None, None) };
    if !scans.has_times {
        return (None, Some(format!("{} is not used: all beams count as taken at once", topic.name)));
    }
    let (robot, frame) = (&place.robot_frame, topic.frame());
    let robot_from_sensor = match (choice.imu_mount, survey.links.constant(robot, frame)) {
        (Some(rotation), _) => Pose3 { rotation, ..Pose3::identity() },
        (None, Ok(pose)) => pose,
        (None, Err(_)) if frame == robot => Pose3::identity(),
        (None, Err(_)) => {
            let why = format!("{} is not used: nothing says how '{frame}' sits on '{robot}'", topic.name);
            return (None, Some(why));
        }
    };
    let up_in_sensor = robot_from_sensor.rotation.inverse() * Vector3::z();
    let count = grouped(topic.usable());
    let reason = format!("{} ({count} messages) says how the robot turned during a sweep", topic.name);
    (Some(TurningSource { name: topic.name.clone(), up_in_sensor: up_in_sensor.into() }), Some(reason))
}
