//! The robot as a node of ROS 2 among others.

use super::clock::Clock;
use super::{Entrance, Lanes};
use crate::args::{MappingArgs, RosArgs};
use crate::failure::Failure;
use mapwright::{Pose2, Settings};
use mapwright_geom::Cov3;
use mapwright_live::Heard;
use mapwright_live::node::NodeName;
use mapwright_live::node::parameters::{ParameterFile, ParameterValue, Parameters, Setting};
use mapwright_live::wire::{Delivery, Hear, Publisher, Topic, Wire, WireError};
use std::f64::consts::PI;
use std::path::PathBuf;
use std::sync::Arc;

const SCAN: &str = "sensor_msgs/msg/LaserScan";
const CLOUD: &str = "sensor_msgs/msg/PointCloud2";
const TF: &str = "tf2_msgs/msg/TFMessage";
const POSE: &str = "geometry_msgs/msg/PoseWithCovarianceStamped";
/// Readings that are kept for who is slow, as `rclcpp::SensorDataQoS` has them twice.
const SENSOR: Delivery = Delivery::BestEffort { depth: 10 };
/// Clouds are of hundreds of packets each, of which some get lost where nobody asks for them again; not every driver keeps them.
const CLOUDS: Delivery = Delivery::AsOffered { depth: 5 };
const EVENTS: Delivery = Delivery::Reliable { depth: 100 };
const LATEST: Delivery = Delivery::Latched { depth: 1 };

impl From<WireError> for Failure {
    fn from(error: WireError) -> Self {
        Self::Log(error.to_string())
    }
}

/// Names in the system, and what can be set.
pub(super) fn parameters(args: &RosArgs, node: &NodeName) -> Result<(Parameters, Vec<String>), Failure> {
    let mut parameters = Parameters::default();
    let mut words = Vec::new();
    if let Some(path) = &args.params_file {
        let wrong = |cause: String| Failure::Config { path: path.clone(), cause };
        let text = std::fs::read_to_string(path).map_err(|error| Failure::open(path, error))?;
        let file = ParameterFile::parse(&text).map_err(|error| wrong(error.to_string()))?;
        words = parameters.take(&file, node).map_err(|error| wrong(error.to_string()))?.words();
    }
    let given = args.params.iter().map(|(name, value)| (name.as_str(), value_of(value)));
    let managed = args.managed.then_some(("autostart_node", ParameterValue::Bool(false)));
    for (name, value) in given.chain(managed) {
        parameters.set(name, value).map_err(Failure::Usage)?;
    }
    Ok((parameters, words))
}

/// What a text stands for, as ROS 2 reads it on a command line.
fn value_of(text: &str) -> ParameterValue {
    let number = || text.parse().ok().filter(|number: &f64| number.is_finite());
    match text {
        "true" | "True" => ParameterValue::Bool(true),
        "false" | "False" => ParameterValue::Bool(false),
        _ => match (text.parse(), number()) {
            (Ok(integer), _) => ParameterValue::Integer(integer),
            (_, Some(number)) => ParameterValue::Double(number),
            _ => ParameterValue::Text(text.to_owned()),
        },
    }
}

/// What the parameters set of the mapper. What is set by `--set` stays as it is.
pub(super) fn apply(parameters: &Parameters, args: &MappingArgs, settings: &mut Settings) -> Result<(), Failure> {
    let (before, number) = (Parameters::default(), |setting| parameters.number(setting));
    let mut set = |key: &str, value: String| {
        let is_set = args.settings.set.iter().any(|(set, _)| set == key);
        if is_set { Ok(()) } else { settings.set(key, &value).map_err(Failure::from) }
    };
    if parameters.get(Setting::Resolution) != before.get(Setting::Resolution) {
        set("map.resolution_m", number(Setting::Resolution).to_string())?;
    }
    for (setting, key) in [(Setting::MaxRange, "scan.max_range_m"), (Setting::MinRange, "scan.min_range_m")] {
        if number(setting) > 0.0 {
            set(key, number(setting).to_string())?;
        }
    }
    if !parameters.flag(Setting::LoopClosing) {
        set("loops.by_pose", "false".to_owned())?;
        set("loops.by_place", "false".to_owned())?;
    }
    Ok(())
}

/// A session that the parameters name, and whether the robot is only to be found in it.
pub(super) fn session(parameters: &Parameters) -> Result<Option<(PathBuf, bool)>, Failure> {
    let (name, is_found) = (parameters.text(Setting::MapFile), parameters.text(Setting::Mode) == "localization");
    if name.is_empty() {
        return match is_found {
            true => {
                Err(Failure::Usage("mode localization: expected a session in map_file_name, found none".to_owned()))
            }
            false => Ok(None),
        };
    }
    let path = PathBuf::from(name);
    let is_there = path.exists();
    Ok(Some((if is_there { path } else { PathBuf::from(format!("{name}.mapwright")) }, is_found)))
}

/// Where the parameters say that the robot stands in the map, with the covariance that AMCL gives such a pose (0.5 m and pi/12).
pub(super) fn start(parameters: &Parameters) -> Option<(Pose2, Cov3)> {
    let at = match parameters.get(Setting::StartPose) {
        ParameterValue::Doubles(at) if at.len() == 3 => Pose2::new(at[0], at[1], at[2]),
        _ if parameters.flag(Setting::SetInitialPose) => {
            let [x, y, yaw] = [Setting::InitialX, Setting::InitialY, Setting::InitialYaw].map(|s| parameters.number(s));
            Pose2::new(x, y, yaw)
        }
        _ => return None,
    };
    Some((at, Cov3::from_diagonal(&[0.25, 0.25, (PI / 12.0).powi(2)].into())))
}

/// The names that the parameters have.
#[derive(Debug, Clone)]
pub(super) struct Names {
    pub(super) scans: Vec<String>,
    /// Where clouds are mapped.
    pub(super) clouds: Vec<String>,
    pub(super) odometry: String,
    pub(super) imu: String,
    pub(super) map_topic: String,
    pub(super) goal_topic: String,
    pub(super) map_frame: String,
    pub(super) odom_frame: String,
    pub(super) robot_frame: String,
    pub(super) is_simulated: bool,
}

impl Names {
    pub(super) fn of(args: &RosArgs, parameters: &Parameters, node: &NodeName) -> Self {
        let text = |setting| parameters.text(setting).to_owned();
        let topic = |name: &str| node.beside(name);
        let scans: Vec<String> = args.scans.iter().map(|name| topic(name)).collect();
        let scans = if scans.is_empty() { vec![topic(parameters.text(Setting::ScanTopic))] } else { scans };
        let clouds = args.points.iter().map(|name| topic(name)).collect();
        Self {
            scans,
            clouds,
            odometry: topic(&args.odometry),
            imu: topic(&args.imu),
            goal_topic: topic("goal_pose"),
            map_topic: topic(parameters.text(Setting::MapTopic)),
            map_frame: text(Setting::MapFrame),
            odom_frame: text(Setting::OdomFrame),
            robot_frame: text(Setting::RobotFrame),
            is_simulated: parameters.flag(Setting::SimTime),
        }
    }
}

/// Hears sensors, transforms and the clock.
pub(super) fn hear(
    wire: &mut dyn Wire,
    names: &Names,
    lanes: &Lanes,
    door: &Arc<Entrance>,
    clock: &Arc<Clock>,
) -> Result<(), Failure> {
    let into = |lane, heard: Box<dyn Fn(Vec<u8>) -> Heard + Send>| -> Hear {
        let (door, clock) = (Arc::clone(door), Arc::clone(clock));
        Box::new(move |bytes| {
            door.put(lane, (clock.arrived(), heard(bytes.to_vec())));
        })
    };
    for name in &names.clouds {
        let topic = name.clone();
        let heard = Box::new(move |bytes| Heard::Cloud { topic: topic.clone(), bytes });
        wire.subscribe(&Topic::new(name, CLOUD, CLOUDS), into(lanes.of_scan(name), heard))?;
    }
    for name in names.scans.iter().filter(|_| names.clouds.is_empty()) {
        let topic = name.clone();
        let heard = Box::new(move |bytes| Heard::Scan { topic: topic.clone(), bytes });
        wire.subscribe(&Topic::new(name, SCAN, SENSOR), into(lanes.of_scan(name), heard))?;
    }
    for (name, is_static, delivery) in [("/tf", false, EVENTS), ("/tf_static", true, Delivery::Latched { depth: 100 })]
    {
        let heard = Box::new(move |bytes| Heard::Transforms { bytes, is_static });
        wire.subscribe(&Topic::new(name, TF, delivery), into(lanes.transforms(), heard))?;
    }
    let odometry = Topic::new(&names.odometry, "nav_msgs/msg/Odometry", SENSOR);
    wire.subscribe(&odometry, into(lanes.others(), Box::new(|bytes| Heard::Odometry { bytes })))?;
    let imu = Topic::new(&names.imu, "sensor_msgs/msg/Imu", SENSOR);
    wire.subscribe(&imu, into(lanes.others(), Box::new(|bytes| Heard::Imu { bytes })))?;
    if names.is_simulated {
        let clock = Arc::clone(clock);
        // a head of four bytes, seconds, nanoseconds
        let hear = move |bytes: &[u8]| {
            let number =
                |at: usize| bytes.get(at..at + 4).and_then(|four| Some(i32::from_le_bytes(four.try_into().ok()?)));
            if let (Some([_, 1, ..]), Some(seconds), Some(nanoseconds)) = (bytes.get(..4), number(4), number(8)) {
                clock.say(mapwright::Stamp(i64::from(seconds) * 1_000_000_000 + i64::from(nanoseconds)));
            }
        };
        wire.subscribe(&Topic::new("/clock", "rosgraph_msgs/msg/Clock", SENSOR), Box::new(hear))?;
    }
    Ok(())
}

/// Where others are told of what is mapped.
pub(super) struct Told {
    pub(super) tf: Box<dyn Publisher>,
    pub(super) pose: Box<dyn Publisher>,
    pub(super) amcl_pose: Box<dyn Publisher>,
}

impl Told {
    pub(super) fn advertise(wire: &mut dyn Wire, node: &NodeName) -> Result<Self, Failure> {
        let mut topic = |name: &str, kind, delivery| wire.advertise(&Topic::new(name, kind, delivery));
        let tf = topic("/tf", TF, EVENTS)?;
        let pose = topic(&node.beside("pose"), POSE, Delivery::Reliable { depth: 10 })?;
        let amcl_pose = topic(&node.beside("amcl_pose"), POSE, LATEST)?;
        Ok(Self { tf, pose, amcl_pose })
    }
}
