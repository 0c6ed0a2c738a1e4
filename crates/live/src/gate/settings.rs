//! What a gate is told of the robot.

use mapwright_geom::Pose2;
use mapwright_sensor::OdometryCalibration;
use nalgebra::UnitQuaternion;
use std::time::Duration;

/// What is known of the robot's sensors, whatever messages say: by a calibration, or by who mounted them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct KnownSensors {
    /// Where the planar laser sits, metres and radians, and whether it hangs upside down.
    pub laser: Option<(Pose2, bool)>,
    /// Where the sensor of clouds sits in the plane of the robot, metres and radians; height, roll and pitch are those of the transforms.
    pub lidar: Option<Pose2>,
    /// How the inertial sensor sits: turns what it reads into the robot's frame.
    pub imu: Option<UnitQuaternion<f64>>,
    /// By how much the inertial sensor's stamps are late, seconds.
    pub imu_lag_s: f64,
    /// What is wrong with odometry.
    pub odometry: Option<OdometryCalibration>,
}

/// What a gate is told of the robot.
#[derive(Debug, Clone, PartialEq)]
pub struct GateSettings {
    /// The robot's own frame.
    pub robot_frame: String,
    /// The frame in which odometry has the robot.
    pub odom_frame: String,
    /// A scan waits for its transforms so long at most.
    pub wait: Duration,
    /// So many scans wait at most; the oldest makes room.
    pub waiting_most: usize,
    /// Whether it is clouds that are mapped, in space.
    pub is_in_space: bool,
    /// What is known of its sensors.
    pub known: KnownSensors,
}

impl Default for GateSettings {
    fn default() -> Self {
        Self {
            robot_frame: "base_link".to_owned(),
            odom_frame: "odom".to_owned(),
            wait: Duration::from_millis(500),
            waiting_most: 100,
            is_in_space: false,
            known: KnownSensors::default(),
        }
    }
}
