//! What a user wants to have otherwise.

use crate::survey::same_name;
use mapwright_geom::Pose2;
use mapwright_ros::PlanarSlice;
use mapwright_sensor::OdometryCalibration;
use nalgebra::UnitQuaternion;

/// Where a planar laser sits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MountChoice {
    /// Its place, metres and radians.
    pub robot_from_laser: Pose2,
    /// Whether it hangs upside down.
    pub inverted: bool,
}

/// What is known of the sensors of a recording of clouds, beside how the inertial one sits.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SpaceCalibration {
    /// Where the clouds' sensor sits in the plane of the robot, metres, and its yaw, radians; height, roll and pitch are the log's.
    pub robot_from_sensor: Option<Pose2>,
    /// By how much the inertial sensor's stamps are late beside the clouds', seconds.
    pub imu_lag_s: f64,
}

/// Heights between which points of a cloud become a scan, metres in the robot's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SliceBounds {
    /// Points below are left out.
    pub z_min_m: f64,
    /// Points above are left out.
    pub z_max_m: f64,
}

impl SliceBounds {
    pub(crate) fn planar(self) -> PlanarSlice {
        PlanarSlice { z_min_m: self.z_min_m, z_max_m: self.z_max_m, ..PlanarSlice::default() }
    }
}

/// What overrides what would be found.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Choice {
    /// Topics to use: one of scans, or those of several lasers of one robot, and one of odometry (or of transforms, to take odometry from
    /// them), in any order.
    pub topics: Vec<String>,
    /// The robot's frame.
    pub frame: Option<String>,
    /// Makes scans of point clouds.
    pub slice: Option<SliceBounds>,
    /// What one stands for in the log's ranges, metres, where its scans are not in metres.
    pub range_unit_m: Option<f64>,
    /// The robot of several, by the namespace of its topics.
    pub robot: Option<String>,
    /// Where the planar laser sits on the robot, whatever the log says.
    pub mount: Option<MountChoice>,
    /// How the inertial sensor sits on the robot, whatever the log says: turns what it reads into the robot's frame.
    pub imu_mount: Option<UnitQuaternion<f64>>,
    /// What a calibration of clouds says besides; it is of no use in the plane.
    pub space: Option<SpaceCalibration>,
    /// What is wrong with odometry; else by how much it lags is learnt from the log.
    pub odometry: Option<OdometryCalibration>,
    /// Odometry keeps its stamps, and lasers the times of their beams, whatever scans say.
    pub odometry_as_stamped: bool,
}

impl Choice {
    /// Whether a topic is asked for by its name.
    pub(crate) fn asks_for(&self, topic: &str) -> bool {
        self.topics.iter().any(|name| same_name(name, topic))
    }

    /// Why a calibration of clouds is none of a planar laser, where one is given.
    pub(crate) fn not_in_plane(&self) -> Result<(), String> {
        let why = "--calibration: expected that of a planar laser, found that of a lidar or depth camera; --space maps clouds with it";
        if self.space.is_some() { Err(why.to_owned()) } else { Ok(()) }
    }

    /// What is overridden of it that only recordings of messages have, as it is typed.
    #[must_use]
    pub fn of_recordings(&self) -> Option<&'static str> {
        let given = [
            (!self.topics.is_empty(), "--topic"),
            (self.frame.is_some(), "--frame"),
            (self.slice.is_some(), "--slice"),
            (self.space.is_some(), "the calibration of a lidar"),
            (self.imu_mount.is_some(), "--imu-mount"),
        ];
        given.into_iter().find(|(is_given, _)| *is_given).map(|(_, option)| option)
    }

    /// Whether nothing is overridden.
    #[must_use]
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }
}
