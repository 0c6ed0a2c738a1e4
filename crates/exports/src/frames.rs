//! Frames and their names, as REP 103 and REP 105 have them.

use mapwright_geom::{Pose2, Pose3};
use mapwright_sensor::{LaserModel, SpaceSensor};
use nalgebra::{UnitQuaternion, Vector3};
use std::f64::consts::PI;

/// The corrected map.
pub(crate) const MAP: &str = "map";
/// Where odometry started; never jumps.
pub(crate) const ODOM: &str = "odom";
/// The robot.
pub(crate) const ROBOT: &str = "base_link";
/// A laser without a name.
const LASER: &str = "laser";
/// A sensor in space without a name.
const SENSOR: &str = "sensor";

/// The frame of a laser: its name, where it has one that is no other frame's.
pub(crate) fn frame_of(laser: &LaserModel) -> &str {
    frame_named(&laser.name, LASER)
}

/// The frame of a sensor in space, as that of a laser.
pub(crate) fn frame_of_space(sensor: &SpaceSensor) -> &str {
    frame_named(&sensor.name, SENSOR)
}

fn frame_named<'a>(name: &'a str, otherwise: &'a str) -> &'a str {
    match name.trim_start_matches('/') {
        "" | MAP | ODOM | ROBOT => otherwise,
        name => name,
    }
}

/// The topic of a laser's scans: `/scan` for the first, and then with its name.
pub(crate) fn scan_topic(frame: &str, is_first: bool) -> String {
    if is_first {
        return "/scan".to_owned();
    }
    let named = frame.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' });
    "/scan_".chars().chain(named).collect()
}

/// A pose of the plane z = 0 in space.
pub(crate) fn in_space(pose: Pose2) -> Pose3 {
    Pose3 {
        translation: Vector3::new(pose.x, pose.y, 0.0),
        rotation: UnitQuaternion::from_axis_angle(&Vector3::z_axis(), pose.theta),
    }
}

/// Pose of a laser on the robot; one upside down is rolled by half a turn.
pub(crate) fn robot_from_laser(laser: &LaserModel) -> Pose3 {
    let mut pose = in_space(laser.robot_from_laser);
    if laser.inverted {
        pose.rotation *= UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
    }
    pose
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_ros::Mounting;

    #[test]
    fn mountings_are_read_back_as_they_were() {
        for inverted in [false, true] {
            let laser = LaserModel {
                robot_from_laser: Pose2::new(0.3, -0.1, 2.5),
                inverted,
                ..LaserModel::half_circle("front", 9)
            };
            let mounting = Mounting::project(robot_from_laser(&laser), 1.0).unwrap();
            assert_eq!(mounting.inverted, inverted);
            assert!(mounting.robot_from_laser.distance(laser.robot_from_laser) < 1e-12);
            assert!((mounting.robot_from_laser.theta - 2.5).abs() < 1e-12);
        }
    }

    #[test]
    fn a_lasers_frame_is_no_other() {
        let named = |name: &str| LaserModel::half_circle(name, 9);
        assert_eq!(["", "/map", "FLASER"].map(|name| frame_of(&named(name)).to_owned()), ["laser", "laser", "FLASER"]);
        assert_eq!((scan_topic("a/b", true), scan_topic("a/b", false)), ("/scan".to_owned(), "/scan_a_b".to_owned()));
    }
}
