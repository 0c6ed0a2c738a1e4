//! Which inertial sensor is read, how it sits on the robot, and its messages as readings.

use crate::channel::{Messages, TopicKind};
use crate::choice::Choice;
use crate::frames::{Place, list};
use crate::links::{bare, stamp_or};
use crate::survey::{NO_TURN_RATE, Survey, TopicSurvey, has_turn_rate};
use crate::words::grouped;
use mapwright_geom::{Pose3, Stamp};
use mapwright_ros::messages::Imu;
use mapwright_sensor::ImuReading;
use nalgebra::{UnitQuaternion, Vector3};

/// Where inertial readings come from.
#[derive(Debug, Clone, PartialEq)]
pub struct ImuSource {
    /// The topic.
    pub name: String,
    /// How many messages.
    pub messages: u64,
    /// Its messages' frame.
    pub frame: String,
    /// Turns what it reads into the robot's frame.
    pub robot_from_imu: UnitQuaternion<f64>,
    /// By how much its stamps are late, seconds: a reading with the stamp `t` was taken at `t - lag_s`.
    pub lag_s: f64,
}

/// What was decided, and why; what had to be assumed.
#[derive(Debug, Default)]
pub(super) struct Found {
    pub(super) source: Option<ImuSource>,
    pub(super) reason: Option<String>,
    pub(super) assumed: Option<String>,
}

/// The topic that was asked for, else that which shares most of its name's beginning with the mapped one's, of those the one with most
/// messages.
pub(super) fn find(survey: &Survey, mapped: &TopicSurvey, place: &Place, choice: &Choice) -> Found {
    let is_asked = |topic: &TopicSurvey| choice.asks_for(&topic.name);
    let mut imus: Vec<_> =
        survey.topics.iter().filter(|topic| is_inertial(topic, mapped) && topic.messages > 0).collect();
    imus.sort_by_key(|topic| {
        let shared = shared_names(&topic.name, &mapped.name);
        std::cmp::Reverse((topic.usable() > 0, is_asked(topic), shared, topic.usable()))
    });
    let Some((topic, others)) = imus.split_first() else { return Found::default() };
    if topic.usable() == 0 {
        let why = topic.first_error.as_deref().unwrap_or("no messages");
        return Found { reason: Some(format!("{} is not used: {why}", topic.name)), ..Found::default() };
    }
    let (robot, frame) = (place.robot_frame.as_str(), bare(topic.frame()));
    let is_in_lidar = topic.kind == TopicKind::OusterPackets;
    let in_lidar = || Ok(Some(place.robot_from_sensor));
    let asked = choice.imu_mount.map(|rotation| Pose3 { rotation, ..Pose3::identity() });
    let mounted = match asked {
        Some(pose) => Ok(Some(pose)),
        None if is_in_lidar => in_lidar(),
        None => mount(survey, mapped, place, frame),
    };
    let (robot_from_imu, how, assumed) = match mounted {
        Ok(Some(pose)) if asked.is_some() => (pose, "mounted as asked for", None),
        Ok(Some(pose)) if is_in_lidar => (pose, "in the lidar as its metadata say", None),
        Ok(Some(pose)) => (pose, "mounted as transforms say", None),
        Ok(None) => {
            let assumed = format!("nothing says how '{frame}' sits on '{robot}': its axes are taken for the robot's");
            (Pose3::identity(), "mounting assumed", Some(assumed))
        }
        Err(moving) => {
            return Found { reason: Some(format!("{} is not used: {moving}", topic.name)), ..Found::default() };
        }
    };
    let rate = topic.rate_hz().map_or_else(String::new, |rate_hz| format!(", {rate_hz:.1} a second"));
    let lag_s = choice.space.map_or(0.0, |space| space.imu_lag_s);
    let late = if lag_s == 0.0 { String::new() } else { format!("; its stamps are {lag_s:.4} s late, as calibrated") };
    let mut reason = format!(
        "{} ({} messages{rate}), {how}: {}{late}",
        topic.name,
        grouped(topic.usable()),
        angles_words(&robot_from_imu.rotation)
    );
    if !others.is_empty() {
        reason += &format!("; not used: {}", list(others.iter().map(|topic| topic.name.as_str())));
    }
    let source = ImuSource {
        name: topic.name.clone(),
        messages: topic.usable(),
        frame: topic.frame().to_owned(),
        robot_from_imu: robot_from_imu.rotation,
        lag_s,
    };
    Found { source: Some(source), reason: Some(reason), assumed }
}

/// Whether a topic has inertial readings; those in a lidar's packets are by the clock of its clouds, and of no use without these.
fn is_inertial(topic: &TopicSurvey, mapped: &TopicSurvey) -> bool {
    let is_of_packets = topic.packets.is_inertial && mapped.kind == TopicKind::OusterPackets;
    topic.kind == TopicKind::Imu || is_of_packets
}

/// Roll, pitch and yaw in words.
pub(super) fn angles_words(robot_from_sensor: &UnitQuaternion<f64>) -> String {
    let (roll, pitch, yaw) = robot_from_sensor.euler_angles();
    let [roll, pitch, yaw] = [roll, pitch, yaw].map(|rad| (10.0 * rad.to_degrees()).round() / 10.0 + 0.0);
    format!("roll {roll:.1}, pitch {pitch:.1}, yaw {yaw:.1} deg")
}

/// A reading in the frame of the lidar that it is in, in that of the robot.
pub(super) fn turned(source: &ImuSource, reading: ImuReading) -> ImuReading {
    ImuReading {
        turn_rate_rad_per_s: source.robot_from_imu * reading.turn_rate_rad_per_s,
        specific_force_m_per_s2: reading.specific_force_m_per_s2.map(|force| source.robot_from_imu * force),
        ..reading
    }
}

/// How it sits on the robot, by transforms or because it is in the mapped sensor; none where nothing says so.
fn mount(survey: &Survey, mapped: &TopicSurvey, place: &Place, frame: &str) -> Result<Option<Pose3>, String> {
    let (robot, sensor) = (place.robot_frame.as_str(), bare(mapped.frame()));
    let by_robot = survey.links.constant(robot, frame);
    match by_robot {
        Ok(pose) => Ok(Some(pose)),
        Err(Some(link)) => Err(format!("'{frame}' moves on '{robot}' ('{}' in '{}')", link.child, link.parent)),
        Err(None) if frame == bare(robot) => Ok(Some(Pose3::identity())),
        Err(None) if frame == sensor => Ok(Some(place.robot_from_sensor)),
        Err(None) => {
            let in_sensor = survey.links.constant(sensor, frame).ok();
            Ok(in_sensor.map(|sensor_from_imu| place.robot_from_sensor * sensor_from_imu))
        }
    }
}

/// How many names of the folders that two topics stand in are the same, from the beginning.
fn shared_names(a: &str, b: &str) -> usize {
    let folders = |name: &str| -> Vec<String> {
        let names: Vec<String> = name.trim_start_matches('/').split('/').map(str::to_owned).collect();
        names[..names.len() - 1].to_vec()
    };
    folders(a).iter().zip(&folders(b)).take_while(|(a, b)| a == b).count()
}

/// A message as a reading in the robot's frame, and whether its header had no stamp.
///
/// # Errors
/// Why it is none, in words.
pub(super) fn reading(
    source: &ImuSource,
    messages: &mut Messages,
    data: &[u8],
    recorded: Stamp,
) -> Result<(ImuReading, bool), String> {
    let imu = match messages {
        Messages::Imu(decoder) => decoder.decode(data).map_err(|error| error.to_string())?,
        Messages::None(Some(reason)) => return Err(reason.clone()),
        _ => return Err("messages of another kind".to_owned()),
    };
    if !has_turn_rate(&imu) {
        return Err(NO_TURN_RATE.to_owned());
    }
    if imu.header.frame() != source.frame {
        return Err(format!("in '{}', not in '{}'", imu.header.frame(), source.frame));
    }
    let (stamp, is_unstamped) = stamp_or(imu.header.stamp, recorded);
    let rate = Vector3::new(imu.angular_velocity.x, imu.angular_velocity.y, imu.angular_velocity.z);
    let reading = ImuReading {
        stamp,
        turn_rate_rad_per_s: source.robot_from_imu * rate,
        specific_force_m_per_s2: force(&imu).map(|force| source.robot_from_imu * force),
    };
    if !reading.is_sound() {
        return Err(format!(
            "{} rad/s and {:?} m/s^2: not finite, or beyond 100 rad/s, were these degrees, or 500 m/s^2",
            rate.norm(),
            force(&imu).map(|force| force.norm())
        ));
    }
    Ok((reading, is_unstamped))
}

/// None where the covariance says that there is no such reading, and where all is zero, as of a gyroscope alone.
fn force(imu: &Imu<'_>) -> Option<Vector3<f64>> {
    let force = Vector3::new(imu.linear_acceleration.x, imu.linear_acceleration.y, imu.linear_acceleration.z);
    let is_there = imu.linear_acceleration_covariance.0[0] != -1.0 && force != Vector3::zeros();
    is_there.then_some(force)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_share_the_folders_that_they_stand_in() {
        for (a, b, expected) in [
            ("/os_cloud_node/imu", "/os_cloud_node/points", 1),
            ("/imu/data", "/velodyne_points", 0),
            ("/a/b/imu", "a/b/points", 2),
            ("imu", "imu", 0),
            ("", "/", 0),
        ] {
            assert_eq!(shared_names(a, b), expected, "{a} {b}");
        }
    }
}
