//! What is switched on the command line beside the settings, to be recorded with them.

use super::SourceArgs;
use mapwright::Pose2;
use mapwright_logs::{MountChoice, SliceBounds};
use nalgebra::UnitQuaternion;
use std::collections::BTreeMap;

impl SourceArgs {
    /// Options that change what is made of a log, and their values, as they can be typed; of a calibration what the file says.
    pub(crate) fn switched(&self, start: Option<Pose2>) -> BTreeMap<&'static str, String> {
        let of_pose = |pose: Pose2| format!("{},{},{}", pose.x, pose.y, pose.theta);
        let of_mount = |MountChoice { robot_from_laser, inverted }: MountChoice| {
            of_pose(robot_from_laser) + if inverted { ",flipped" } else { "" }
        };
        let of_angles = |rotation: UnitQuaternion<f64>| {
            let (roll, pitch, yaw) = rotation.euler_angles();
            format!("{roll},{pitch},{yaw}")
        };
        let of_slice = |SliceBounds { z_min_m, z_max_m }: SliceBounds| format!("{z_min_m}:{z_max_m}");
        let of_intrinsics = |numbers: [f64; 4]| numbers.map(|number| number.to_string()).join(",");
        let options = [
            ("--topic", (!self.topic.is_empty()).then(|| self.topic.join(", "))),
            ("--frame", self.frame.clone()),
            ("--robot", self.robot.clone()),
            ("--mount", self.mount.map(of_mount)),
            ("--imu-mount", self.imu_mount.map(of_angles)),
            ("--calibration", self.calibration.map(|found| found.in_words())),
            ("--slice", self.slice.map(of_slice)),
            ("--range-unit", self.range_unit.map(|unit_m| unit_m.to_string())),
            ("--intrinsics", self.intrinsics.map(of_intrinsics)),
            ("--depth-scale", self.depth_scale.map(|scale| scale.to_string())),
            ("--baseline", self.baseline.map(|metres| metres.to_string())),
            ("--start", start.map(of_pose)),
        ];
        options.into_iter().filter_map(|(option, value)| Some((option, value?))).collect()
    }
}
