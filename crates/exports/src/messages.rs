//! Readings and poses as messages.

use crate::frames::{MAP, ODOM, ROBOT, frame_of, in_space, robot_from_laser};
use mapwright_geom::{Pose2, Pose3, Stamp};
use mapwright_ros::messages::{
    Header, Imu, LaserScan, Odometry, PoseStamped, PoseWithCovariance, TfMessage, TransformStamped,
};
use mapwright_sensor::{LaserModel, TurnRate};

/// A laser's sweep of these ranges.
pub(crate) fn laser_scan<'a>(stamp: Stamp, laser: &'a LaserModel, ranges_m: &'a [f32]) -> LaserScan<'a> {
    let steps = ranges_m.len().saturating_sub(1) as f64;
    LaserScan {
        header: Header::new(stamp, frame_of(laser)),
        angle_min: laser.angle_min_rad as f32,
        angle_max: (laser.angle_min_rad + steps * laser.angle_step_rad) as f32,
        angle_increment: laser.angle_step_rad as f32,
        time_increment: laser.beam_period_s as f32,
        scan_time: (laser.beam_period_s * ranges_m.len() as f64) as f32,
        range_min: laser.range_min_m as f32,
        range_max: laser.range_max_m as f32,
        ranges: ranges_m.into(),
        ..LaserScan::default()
    }
}

/// What the wheels say; velocities are not known and zero.
pub(crate) fn odometry(stamp: Stamp, odom_from_robot: Pose2) -> Odometry<'static> {
    let pose = PoseWithCovariance { pose: in_space(odom_from_robot).into(), ..PoseWithCovariance::default() };
    Odometry { header: Header::new(stamp, ODOM), child_frame_id: ROBOT.into(), pose, ..Odometry::default() }
}

/// How the robot turns; its orientation and acceleration are not known.
pub(crate) fn turn_rate(rate: &TurnRate) -> Imu<'static> {
    let mut imu = Imu { header: Header::new(rate.stamp, ROBOT), ..Imu::default() };
    imu.angular_velocity.z = rate.rad_per_s;
    (imu.orientation_covariance.0[0], imu.linear_acceleration_covariance.0[0]) = (-1.0, -1.0);
    imu
}

/// `parent_from_child` at a time.
pub(crate) fn transform<'a>(
    stamp: Stamp,
    parent: &'a str,
    child: &'a str,
    parent_from_child: Pose3,
) -> TransformStamped<'a> {
    TransformStamped {
        header: Header::new(stamp, parent),
        child_frame_id: child.into(),
        transform: parent_from_child.into(),
    }
}

/// Where the robot is by its wheels.
pub(crate) fn odom_transform(stamp: Stamp, odom_from_robot: Pose2) -> TransformStamped<'static> {
    transform(stamp, ODOM, ROBOT, in_space(odom_from_robot))
}

/// Where lasers sit.
pub(crate) fn mounts<'a>(stamp: Stamp, lasers: impl Iterator<Item = &'a LaserModel>) -> TfMessage<'a> {
    TfMessage {
        transforms: lasers.map(|laser| transform(stamp, ROBOT, frame_of(laser), robot_from_laser(laser))).collect(),
    }
}

/// A pose of the robot in a frame.
pub(crate) fn pose_stamped(stamp: Stamp, frame: &str, frame_from_robot: Pose3) -> PoseStamped<'_> {
    PoseStamped { header: Header::new(stamp, frame), pose: frame_from_robot.into() }
}

/// `map -> odom` such that the two together lead to where the robot is in the map, and `odom -> base_link`.
pub(crate) fn course(stamp: Stamp, map_from_robot: Pose3, odom_from_robot: Pose3) -> TfMessage<'static> {
    let correction = transform(stamp, MAP, ODOM, map_from_robot * odom_from_robot.inverse());
    TfMessage { transforms: vec![correction, transform(stamp, ODOM, ROBOT, odom_from_robot)] }
}
