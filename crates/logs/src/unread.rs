//! Types of messages that hold scans or points and are not read: what they are, and what makes them readable.

use crate::channel::TopicKind;
use crate::frames::list;
use crate::survey::{Survey, TopicSurvey};
use crate::words::grouped;

/// Beginnings of types' names, what their messages are, and what to do.
const TYPES: [(&str, &str, &str); 25] = [
    ("robosense_msgs/", "a RoboSense's packets", ROBOSENSE),
    ("rslidar_msgs/", "a RoboSense's packets", ROBOSENSE),
    ("rslidar_msg/", "a RoboSense's packets", ROBOSENSE),
    (
        "lslidar_msgs/",
        "a Leishen's packets",
        "play it through `ros2 launch lslidar_driver lslidar_launch.py` and record its PointCloud2",
    ),
    ("innovusion_msgs/", "a Seyond's packets", SEYOND),
    ("seyond/", "a Seyond's packets", SEYOND),
    ("cepton_messages/", "a Cepton's points", "play it through cepton_ros2 and record its PointCloud2"),
    ("pandar_msgs/", "a Hesai's packets", HESAI),
    ("hesai_lidar/", "a Hesai's packets", HESAI),
    ("hesai_ros_driver/", "a Hesai's packets", HESAI),
    (
        "nebula_msgs/",
        "a lidar's packets",
        "play it through nebula_ros with `launch_hw:=false` and record its PointCloud2",
    ),
    (
        "velodyne_msgs/",
        "a Velodyne's packets",
        "play it through velodyne_pointcloud of its model and record its PointCloud2",
    ),
    ("ouster_ros/", "an Ouster's messages", OUSTER),
    ("ouster_msgs/", "an Ouster's messages", OUSTER),
    ("ouster_sensor_msgs/", "an Ouster's messages", OUSTER),
    ("livox_ros_driver/", "a Livox's messages", LIVOX),
    ("livox_ros_driver2/", "a Livox's messages", LIVOX),
    ("foxglove.LaserScan", "scans in Foxglove's schema", FOXGLOVE),
    ("foxglove.", "messages in Foxglove's schema", FOXGLOVE),
    ("foxglove_msgs/", "messages in Foxglove's schema", FOXGLOVE),
    (
        "sensor_msgs/PointCloud",
        "clouds of ROS's old kind",
        "play it through `rosrun point_cloud_converter point_cloud_converter_node` and record its PointCloud2",
    ),
    ("laser_assembler/", "scans put together", "record the LaserScan that they are put together of"),
    ("sick_scan_xd/", "a SICK's own messages", "record the PointCloud2 or LaserScan of sick_scan_xd"),
    ("sensor_msgs/PointField", "the fields of points without the points", "record their PointCloud2"),
    ("octomap_msgs/", "a finished map", "record the PointCloud2 that it was made of"),
];

const ROBOSENSE: &str = "play it through rslidar_sdk (`msg_source: 2` in its config.yaml, `ros2 launch rslidar_sdk start.py`) and record its PointCloud2";
const SEYOND: &str = "play it through `ros2 launch seyond start.py` and record its PointCloud2";
const HESAI: &str = "play it through hesai_ros_driver (`source_type: 3` in its config.yaml, `ros2 launch hesai_ros_driver start.py`) and record its PointCloud2";
const OUSTER: &str =
    "play it through `ros2 launch ouster_ros replay.launch.xml bag_file:=FILE` and record its PointCloud2";
const LIVOX: &str = "record the lidar's CustomMsg, or its PointCloud2 (`xfer_format` 0)";
const FOXGLOVE: &str =
    "record foxglove.PointCloud (which is read), or the LaserScan or PointCloud2 that it was made of";

/// What recordings without anything to map are made again with.
const ANYTHING: &str = "record the lidar's LaserScan or PointCloud2 (`ros2 topic list -t` shows which there are)";

/// What is there of such types, and what to do; of any other types, what to do to have something to map.
pub(crate) fn words(survey: &Survey) -> String {
    let in_space = survey.topics.iter().find(|topic| topic.messages > 0 && topic.kind.is_clouds());
    if let Some(topic) = in_space {
        return format!("`--space` maps {} ({})", topic.name, topic.type_name);
    }
    let topics = || survey.topics.iter().filter(|topic| topic.messages > 0 && topic.kind == TopicKind::Other);
    let known: Vec<String> = topics().filter_map(of).take(4).collect();
    if !known.is_empty() {
        return known.join("; ");
    }
    let all = survey.topics.iter().filter(|topic| topic.messages > 0);
    match all.clone().count() {
        0 => format!("to have something to map, {ANYTHING}"),
        _ => {
            let unread: Vec<&str> = topics().map(|topic| topic.type_name.as_str()).collect();
            let types =
                unread.iter().enumerate().filter(|(at, name)| !unread[..*at].contains(name)).map(|(_, name)| *name);
            let first = if unread.is_empty() {
                String::new()
            } else {
                format!("messages of the types {} are not read; ", list(types))
            };
            format!("{first}to have something to map, {ANYTHING}")
        }
    }
}

/// A topic of a type that holds scans or points and is not read, in words.
fn of(topic: &TopicSurvey) -> Option<String> {
    let name = topic.type_name.replace("/msg/", "/");
    let (_, what, remedy) = TYPES.iter().find(|(beginning, ..)| name.starts_with(beginning))?;
    let count = grouped(topic.messages);
    Some(format!("{} ({}, {count}) has {what}, which are not read: {remedy}", topic.name, topic.type_name))
}
