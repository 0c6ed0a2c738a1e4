//! What a robot feels and measures besides scans.

use super::{Header, PoseWithCovariance, Quaternion, TwistWithCovariance, Vector3, message};
use crate::field::Fixed;
use std::borrow::Cow;

message! {
    /// Where a robot believes to be by its wheels.
    Odometry<'a> = ["nav_msgs/Odometry"];
    /// When, and the frame that odometry started in.
    header: Header<'a>,
    /// The robot's frame.
    child_frame_id: Cow<'a, str>,
    /// Pose of the robot in the header's frame.
    pose: PoseWithCovariance,
    /// Velocities in the robot's frame; optional.
    twist: TwistWithCovariance = optional,
}

message! {
    /// An inertial reading. A covariance that begins with -1 says that there is no such reading.
    Imu<'a> = ["sensor_msgs/Imu"];
    /// When, and the sensor's frame.
    header: Header<'a>,
    /// Orientation as estimated by the device.
    orientation: Quaternion,
    /// Of rotations about x, y, z, rad^2; optional.
    orientation_covariance: Fixed<9> = optional,
    /// Radians per second.
    angular_velocity: Vector3,
    /// Its covariance; optional.
    angular_velocity_covariance: Fixed<9> = optional,
    /// Metres per second squared, gravity included.
    linear_acceleration: Vector3,
    /// Its covariance; optional.
    linear_acceleration_covariance: Fixed<9> = optional,
}

message! {
    /// A reading of a sonar or infrared ranger.
    Range<'a> = ["sensor_msgs/Range"];
    /// When, and the sensor's frame, whose x axis is the cone's.
    header: Header<'a>,
    /// 0 ultrasound, 1 infrared.
    radiation_type: u8,
    /// Opening angle of the cone, radians.
    field_of_view: f32,
    /// Readings below are not returns, metres.
    min_range: f32,
    /// Readings above are not returns, metres.
    max_range: f32,
    /// The reading, metres.
    range: f32,
}
