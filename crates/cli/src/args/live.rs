//! What can be asked for of a robot that drives.

use super::{MappingArgs, SourceArgs};
use clap::Args as ClapArgs;
use std::path::PathBuf;

#[derive(Debug, ClapArgs)]
pub(crate) struct LiveArgs {
    /// A recording that is played through the same door, at its own pace: for trying things out. Without one, and without `--lidar`, the robot is
    /// heard over ROS 2.
    #[arg(value_name = "LOG")]
    pub(crate) log: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) source: SourceArgs,
    /// The recording is played so many times as fast as it was made.
    #[arg(long, value_name = "N", default_value_t = 1.0, value_parser = super::parse_factor)]
    pub(crate) rate: f64,
    /// Tell others over ROS 2 even where a recording is played.
    #[arg(long)]
    pub(crate) ros: bool,
    /// Folder for the results; made if need be. The session is written there while the robot drives.
    #[arg(short, long, value_name = "FOLDER", default_value = "mapwright-live")]
    pub(crate) output: PathBuf,
    /// Go on with what is in the folder, a run that was killed included; begin where there is nothing.
    #[arg(long = "continue", conflicts_with_all = ["start", "resume", "localise"])]
    pub(crate) goes_on: bool,
    /// Say where the robot is in this finished map, which stays as it is: a folder of results or its `session.mapwright`.
    #[arg(long, value_name = "SESSION", conflicts_with_all = ["start", "resume"])]
    pub(crate) localise: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) ros_names: RosArgs,
    #[command(flatten)]
    pub(crate) mapping: MappingArgs,
}

/// Names in a ROS 2 system.
#[derive(Debug, Clone, ClapArgs)]
#[command(next_help_heading = "ROS 2")]
pub(crate) struct RosArgs {
    /// Name of the node.
    #[arg(long, value_name = "NAME", default_value = "mapwright")]
    pub(crate) node: String,
    /// Topic of scans (`sensor_msgs/LaserScan`); may be repeated.
    #[arg(long = "scan", value_name = "TOPIC", default_value = "/scan")]
    pub(crate) scans: Vec<String>,
    /// Topic of odometry (`nav_msgs/Odometry`), used where transforms do not say the same.
    #[arg(long, value_name = "TOPIC", default_value = "/odom")]
    pub(crate) odometry: String,
    /// Topic of inertial readings (`sensor_msgs/Imu`).
    #[arg(long, value_name = "TOPIC", default_value = "/imu")]
    pub(crate) imu: String,
    /// Frame of the map.
    #[arg(long, value_name = "FRAME", default_value = "map")]
    pub(crate) map_frame: String,
    /// Frame of odometry.
    #[arg(long, value_name = "FRAME", default_value = "odom")]
    pub(crate) odom_frame: String,
    /// Frame of the robot.
    #[arg(long, value_name = "FRAME", default_value = "base_link")]
    pub(crate) robot_frame: String,
    /// Seconds between two drawings of the map.
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = super::parse_period)]
    pub(crate) map_every: f64,
    /// `map -> odom` is told as holding for so many seconds more, so that who reads it need not wait.
    #[arg(long, value_name = "S", default_value_t = 0.1, value_parser = super::parse_period)]
    pub(crate) transform_tolerance: f64,
    /// The time is what `/clock` says.
    #[arg(long)]
    pub(crate) use_sim_time: bool,
}
