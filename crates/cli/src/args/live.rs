//! What can be asked for of a robot that drives.

use super::{MappingArgs, SettingsArgs, SourceArgs};
use clap::{Args as ClapArgs, ValueEnum};
use mapwright::Pose2;
use mapwright_lidars::LidarPlace;
use mapwright_logs::SliceBounds;
use std::net::SocketAddr;
use std::path::PathBuf;

#[derive(Debug, ClapArgs)]
pub(crate) struct LiveArgs {
    /// A recording that is played through the same door, at its own pace: for trying things out. Without one, and without `--lidar`, the robot is
    /// heard over ROS 2.
    #[arg(value_name = "LOG")]
    pub(crate) log: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) source: SourceArgs,
    /// A lidar on a cable: ld06, ld19 or rplidar, and its port, as ld06:/dev/ttyUSB0; and @ and the baud rate where it is another. Or one of space on
    /// the network: velodyne, ouster or hesai, and the port or the address at which its datagrams arrive, as velodyne:2368.
    #[arg(long, value_name = "KIND:PORT", conflicts_with = "log")]
    pub(crate) lidar: Option<LidarPlace>,
    /// Where that lidar sits on the robot: metres, metres, radians.
    #[arg(long, value_name = "X,Y,YAW", value_parser = super::parse_pose, allow_hyphen_values = true, requires = "lidar")]
    pub(crate) lidar_mount: Option<Pose2>,
    /// What an Ouster says of itself (`curl http://SENSOR/api/v1/sensor/metadata`).
    #[arg(long, value_name = "FILE", requires = "lidar")]
    pub(crate) lidar_metadata: Option<PathBuf>,
    /// The recording is played so many times as fast as it was made.
    #[arg(long, value_name = "N", default_value_t = 1.0, value_parser = super::parse_factor)]
    pub(crate) rate: f64,
    /// Replay what this run has heard, recorded meanwhile (`ros2 bag record`), to the same bytes: the scans it has mapped, and what came of
    /// loop closing taken in where it was then. A folder of results or its `session.mapwright`.
    #[arg(long, value_name = "SESSION", requires = "log", conflicts_with = "localise")]
    pub(crate) replay: Option<PathBuf>,
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
    pub(crate) view: ViewArgs,
    #[command(flatten)]
    pub(crate) ros_names: RosArgs,
    #[command(flatten)]
    pub(crate) mapping: MappingArgs,
}

/// Names in a ROS 2 system.
#[derive(Debug, Clone, ClapArgs)]
#[command(next_help_heading = "ROS 2")]
pub(crate) struct RosArgs {
    /// What nodes of ROS 2 speak. Otherwise what RMW_IMPLEMENTATION says, as for them.
    #[arg(long, value_enum)]
    pub(crate) wire: Option<WireKind>,
    /// Name of the node, with its namespace if it has one. A node that is called slam_toolbox has that one's services.
    #[arg(long, value_name = "NAME", default_value = "mapwright")]
    pub(crate) node: String,
    /// Parameters by the names of slam_toolbox and AMCL, as a file of ROS 2.
    #[arg(long, value_name = "FILE")]
    pub(crate) params_file: Option<PathBuf>,
    /// One of these parameters, such as map_update_interval=2.0; may be repeated.
    #[arg(long = "param", value_name = "NAME=VALUE", value_parser = super::parse_assignment)]
    pub(crate) params: Vec<(String, String)>,
    /// Topic of scans (`sensor_msgs/LaserScan`); may be repeated. Otherwise that of the parameter scan_topic.
    #[arg(long = "scan", value_name = "TOPIC")]
    pub(crate) scans: Vec<String>,
    /// Topic of clouds (`sensor_msgs/PointCloud2`), of a lidar or a depth camera: they are mapped, in space, and no scans; may be repeated.
    #[arg(long = "points", value_name = "TOPIC", conflicts_with_all = ["log", "lidar", "scans", "localise"])]
    pub(crate) points: Vec<String>,
    /// Of clouds: tell a grid on `/map` as well, for Nav2. What stands between these heights above the robot's way is an obstacle, metres.
    #[arg(long, value_name = "ZMIN:ZMAX", value_parser = super::values::parse_slice, allow_hyphen_values = true)]
    pub(crate) band: Option<SliceBounds>,
    /// Topic of odometry (`nav_msgs/Odometry`), used where transforms do not say the same.
    #[arg(long, value_name = "TOPIC", default_value = "/odom")]
    pub(crate) odometry: String,
    /// Topic of inertial readings (`sensor_msgs/Imu`).
    #[arg(long, value_name = "TOPIC", default_value = "/imu")]
    pub(crate) imu: String,
    /// Tell goals (`goal_pose`) until the map shows all that the robot can reach: Nav2 drives there.
    #[arg(long, conflicts_with_all = ["localise", "points"])]
    pub(crate) explore: bool,
    /// Radius of the circle that the robot needs, metres.
    #[arg(long, value_name = "METRES", default_value_t = 0.2, value_parser = super::parse_radius, requires = "explore")]
    pub(crate) robot_radius: f64,
    /// Wait until a lifecycle manager configures and activates the node.
    #[arg(long)]
    pub(crate) managed: bool,
}

/// What nodes of ROS 2 speak.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum WireKind {
    /// DDS, as Fast DDS and Cyclone DDS do
    Dds,
    /// Zenoh, as rmw_zenoh does
    Zenoh,
}

/// A page in a browser.
#[derive(Debug, Clone, ClapArgs)]
pub(crate) struct ViewArgs {
    /// Show a page in a browser, on this machine alone unless another address is given; the address of the page is said. Port 0 is any that is
    /// free.
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub(crate) view: Option<Option<SocketAddr>>,
    /// What whoever looks from another machine must know: 16 to 128 characters.
    #[arg(long, value_name = "TOKEN")]
    pub(crate) view_token: Option<String>,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct ViewResultsArgs {
    /// A folder of results, or its `session.mapwright`.
    #[arg(value_name = "RESULTS")]
    pub(crate) results: PathBuf,
    #[command(flatten)]
    pub(crate) view: ViewArgs,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
}
