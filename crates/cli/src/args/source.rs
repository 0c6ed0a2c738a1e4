//! What to use of a recording.

use super::values::{parse_baseline, parse_imu_mount, parse_intrinsics, parse_mount, parse_range_unit, parse_slice};
use crate::calibrated::Calibrated;
use clap::Args as ClapArgs;
use mapwright_clouds::CameraOptions;
use mapwright_logs::{Choice, MountChoice, SliceBounds};
use nalgebra::UnitQuaternion;

/// What to use of a recording instead of what would be found.
#[derive(Debug, Clone, Default, ClapArgs)]
pub(crate) struct SourceArgs {
    /// Topic to use, of scans or of odometry (of transforms, to take odometry from them); may be repeated, also for several lasers or
    /// lidars of one robot.
    #[arg(long, value_name = "TOPIC")]
    pub(super) topic: Vec<String>,
    /// The robot's frame.
    #[arg(long, value_name = "FRAME")]
    pub(super) frame: Option<String>,
    /// Of several robots in one recording: the one whose topics are in this namespace.
    #[arg(long, value_name = "NAME")]
    pub(super) robot: Option<String>,
    /// Where the planar laser sits on the robot, whatever the log says: metres, metres, radians; and `,flipped` where it hangs upside
    /// down.
    #[arg(long, value_name = "X,Y,YAW[,flipped]", value_parser = parse_mount, allow_hyphen_values = true)]
    pub(super) mount: Option<MountChoice>,
    /// How the inertial sensor sits on the robot, whatever the log says: it is turned by so much about the robot's x axis, then about its y
    /// axis, then about its z axis; radians.
    #[arg(long, value_name = "ROLL,PITCH,YAW", value_parser = parse_imu_mount, allow_hyphen_values = true)]
    pub(super) imu_mount: Option<UnitQuaternion<f64>>,
    /// What `mapwright calibrate --apply FILE` has found: where the laser or lidar sits, what is wrong with odometry, how an inertial
    /// sensor sits and by how much its stamps are late.
    #[arg(long, value_name = "FILE", value_parser = Calibrated::read)]
    pub(super) calibration: Option<Calibrated>,
    /// Make scans of point clouds: of the points between these heights above the robot's origin, metres.
    #[arg(long, value_name = "ZMIN:ZMAX", value_parser = parse_slice, allow_hyphen_values = true)]
    pub(super) slice: Option<SliceBounds>,
    /// What one stands for in the ranges of scans, or the coordinates of clouds, that are not in metres, metres: 0.001 for millimetres.
    #[arg(long, value_name = "M", value_parser = parse_range_unit)]
    pub(super) range_unit: Option<f64>,
    /// Of a depth camera, or of a rectified pair of cameras: focal lengths and the optical axis, pixels.
    #[arg(long, value_name = "FX,FY,CX,CY", value_parser = parse_intrinsics)]
    pub(super) intrinsics: Option<[f64; 4]>,
    /// Of a depth camera: the number that stands for a metre in its images.
    #[arg(long, value_name = "S")]
    pub(super) depth_scale: Option<f64>,
    /// Of a pair of cameras: from the left one to the right one, metres.
    #[arg(long, value_name = "M", value_parser = parse_baseline)]
    pub(super) baseline: Option<f64>,
}

impl SourceArgs {
    pub(crate) fn camera(&self) -> CameraOptions {
        CameraOptions {
            intrinsics: self.intrinsics,
            depth_scale: self.depth_scale,
            range_unit_m: self.range_unit,
            baseline_m: self.baseline,
        }
    }

    pub(crate) fn choice(&self) -> Choice {
        Choice {
            topics: self.topic.clone(),
            frame: self.frame.clone(),
            slice: self.slice,
            range_unit_m: self.range_unit,
            robot: self.robot.clone(),
            mount: self.mount.or_else(|| self.calibration?.mount()),
            imu_mount: self.imu_mount.or_else(|| self.calibration?.imu_mount()),
            space: self.calibration.and_then(|found| found.in_space()),
            odometry: self.calibration.and_then(|found| found.odometry()),
            odometry_as_stamped: false,
        }
    }

    /// Whether the mounting of a planar laser is asked for.
    pub(crate) fn has_mount(&self) -> bool {
        self.choice().mount.is_some()
    }

    /// The same with what was found of the sensors of a recording of clouds, which counts before what was asked for.
    pub(crate) fn calibrated(&self, found: Calibrated) -> Self {
        let imu_mount = self.imu_mount.filter(|_| found.imu_mount().is_none());
        Self { imu_mount, calibration: Some(self.calibration.map_or(found, |known| found.or(known))), ..self.clone() }
    }

    /// Whether one of several robots is asked for.
    pub(crate) fn has_robot(&self) -> bool {
        self.robot.is_some()
    }

    /// The same for one robot of several.
    pub(crate) fn of_robot(&self, robot: &str) -> Self {
        Self { robot: Some(robot.to_owned()), ..self.clone() }
    }
}
