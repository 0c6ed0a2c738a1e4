//! The robot as a node of ROS 2 among others.

use super::clock::Clock;
use super::drawer::Outlet;
use super::{Entrance, Lanes};
use crate::args::RosArgs;
use crate::failure::Failure;
use mapwright_live::Heard;
use mapwright_live::wire::{Delivery, Hear, Publisher, Topic, Wire, WireError};
use std::sync::Arc;

const SCAN: &str = "sensor_msgs/msg/LaserScan";
const TF: &str = "tf2_msgs/msg/TFMessage";
const POSE: &str = "geometry_msgs/msg/PoseWithCovarianceStamped";
/// Readings that are kept for who is slow, as `rclcpp::SensorDataQoS` has them twice.
const SENSOR: Delivery = Delivery::BestEffort { depth: 10 };
const EVENTS: Delivery = Delivery::Reliable { depth: 100 };
const LATEST: Delivery = Delivery::Latched { depth: 1 };

impl From<WireError> for Failure {
    fn from(error: WireError) -> Self {
        Self::Log(error.to_string())
    }
}

/// Joins the system that the environment names.
#[cfg(feature = "dds")]
pub(super) fn join(names: &RosArgs) -> Result<Box<dyn Wire>, Failure> {
    use mapwright_dds::{Configuration, Dds};
    let configuration = Configuration::from_environment().map_err(|error| Failure::Usage(error.to_string()))?;
    Ok(Box::new(Dds::join(&configuration, "/", &names.node)?))
}

/// There is no wire in this build.
#[cfg(not(feature = "dds"))]
pub(super) fn join(_names: &RosArgs) -> Result<Box<dyn Wire>, Failure> {
    Err(Failure::Usage(
        "this mapwright was built without ROS 2; build it with `cargo build --release --features dds` (needs cmake and libclang), or use a \
         package"
            .to_owned(),
    ))
}

/// Hears sensors, transforms and the clock.
pub(super) fn hear(
    wire: &mut dyn Wire,
    names: &RosArgs,
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
    for name in &names.scans {
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
    if names.use_sim_time {
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
    pub(super) fn advertise(wire: &mut dyn Wire) -> Result<Self, Failure> {
        let mut topic = |name, kind, delivery| wire.advertise(&Topic::new(name, kind, delivery));
        let tf = topic("/tf", TF, EVENTS)?;
        let (pose, amcl_pose) =
            (topic("/pose", POSE, Delivery::Reliable { depth: 10 })?, topic("/amcl_pose", POSE, LATEST)?);
        Ok(Self { tf, pose, amcl_pose })
    }
}

impl Outlet {
    pub(super) fn advertise(wire: &mut dyn Wire, names: &RosArgs) -> Result<Self, Failure> {
        let map = wire.advertise(&Topic::new("/map", "nav_msgs/msg/OccupancyGrid", LATEST))?;
        let metadata = wire.advertise(&Topic::new("/map_metadata", "nav_msgs/msg/MapMetaData", LATEST))?;
        Ok(Self { map, metadata, frame: names.map_frame.clone() })
    }
}
