//! `mapwright live` in a ROS 2 system: a simulated robot drives beside it, and hears what it is told.

use crate::support::{assert_code, folder, text};
use mapwright_dds::{Configuration, Dds, Range};
use mapwright_geom::{Pose2, Pose3, Stamp};
use mapwright_live::wire::{Delivery, Publisher, Topic, Wire};
use mapwright_live::{Driver, Gate, Heard, Passed, Reading};
use mapwright_ros::messages::{PoseWithCovarianceStamped, TfMessage};
use mapwright_ros::{Channel, Decoder, Encoding};
use mapwright_sim::DriveSettings;
use std::collections::HashMap;
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

#[allow(dead_code, reason = "it maps by itself as well, elsewhere")]
#[path = "../../../live/src/mapping/tests/robot.rs"]
mod robot;

const DOMAIN: u16 = 151;
/// Others have begun and are found by then; a program that was just built starts slowly.
const FOUND: Duration = Duration::from_secs(60);
/// What was told last has arrived, and what follows from it was told, several times over.
const SETTLED: Duration = Duration::from_millis(500);

/// What the robot was told last.
#[derive(Default)]
struct Told {
    pose: Option<(Stamp, Pose3)>,
    map_from_odom: Option<Pose3>,
    poses: usize,
}

fn channel(name: &str) -> Channel {
    Channel::new(name, Encoding::Cdr, None).unwrap()
}

fn transforms() -> Decoder<TfMessage<'static>> {
    Decoder::new(&channel("tf2_msgs/msg/TFMessage")).unwrap()
}

fn hear(wire: &mut Dds, told: &Arc<Mutex<Told>>) {
    let mut transforms = transforms();
    let mut poses =
        Decoder::<PoseWithCovarianceStamped<'_>>::new(&channel("geometry_msgs/msg/PoseWithCovarianceStamped")).unwrap();
    let (at, delivery) = (Arc::clone(told), Delivery::Reliable { depth: 100 });
    let hear_transforms = Box::new(move |bytes: &[u8]| {
        for transform in transforms.decode(bytes).unwrap().transforms {
            if transform.header.frame_id == "map" {
                at.lock().unwrap().map_from_odom = transform.transform.to_pose3();
            }
        }
    });
    wire.subscribe(&Topic::new("/tf", "tf2_msgs/msg/TFMessage", delivery), hear_transforms).unwrap();
    let at = Arc::clone(told);
    let hear_poses = Box::new(move |bytes: &[u8]| {
        let message = poses.decode(bytes).unwrap();
        let pose = message.pose.pose.to_pose3().unwrap();
        let mut told = at.lock().unwrap();
        told.pose = Some((message.header.stamp, pose));
        told.poses += 1;
    });
    let kind = "geometry_msgs/msg/PoseWithCovarianceStamped";
    wire.subscribe(&Topic::new("/pose", kind, delivery), hear_poses).unwrap();
}

/// Whoever looks the robot up in the map finds it where `/pose` has it, wherever its odometry began: `map -> odom` is about the odometry that
/// others are told. What came in over the network is mapped to the last scan.
#[test]
fn who_looks_the_robot_up_finds_it_where_it_is_said_to_be() {
    let out = folder("ros_frames").join("out");
    let mut child = Command::new(env!("CARGO_BIN_EXE_mapwright"))
        .args(["live", "--wire", "dds", "-o", out.to_str().unwrap()])
        .env("ROS_DOMAIN_ID", DOMAIN.to_string())
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let configuration = Configuration { domain: DOMAIN, range: Range::Localhost, ..Configuration::default() };
    let mut wire = Dds::join(&configuration, "/", "robot").unwrap();
    let told = Arc::<Mutex<Told>>::default();
    hear(&mut wire, &told);
    let advertise = |wire: &mut Dds, name: &str, kind: &'static str, delivery| -> Box<dyn Publisher> {
        wire.advertise(&Topic::new(name, kind, delivery)).unwrap()
    };
    let (reliable, latched) = (Delivery::Reliable { depth: 1000 }, Delivery::Latched { depth: 1 });
    let fixed = advertise(&mut wire, "/tf_static", "tf2_msgs/msg/TFMessage", latched);
    let moving = advertise(&mut wire, "/tf", "tf2_msgs/msg/TFMessage", reliable);
    let scans = advertise(&mut wire, "/scan", "sensor_msgs/msg/LaserScan", reliable);
    let begun = Instant::now();
    while scans.listeners() < 1 || moving.listeners() < 1 {
        assert!(begun.elapsed() < FOUND && child.try_wait().unwrap().is_none(), "it is not there");
        thread::sleep(Duration::from_millis(50));
    }
    thread::sleep(2 * SETTLED);
    // Its odometry is older than the map.
    let elsewhere = Pose2::new(-70.0, 31.0, 2.4);
    let settings = DriveSettings { duration_s: 30.0, ..DriveSettings::default() };
    let (mut decoder, mut odometry) = (transforms(), HashMap::<Stamp, Pose3>::new());
    let (mut sent, mut compared) = (0, 0);
    for (stamp, heard) in robot::heard(settings, elsewhere) {
        match heard {
            Heard::Transforms { bytes, is_static: true } => fixed.publish(&bytes).unwrap(),
            Heard::Transforms { bytes, .. } => {
                let [link] = &decoder.decode(&bytes).unwrap().transforms[..] else { panic!("one at a time") };
                odometry.insert(stamp, link.transform.to_pose3().unwrap());
                moving.publish(&bytes).unwrap();
            }
            Heard::Scan { bytes, .. } => {
                scans.publish(&bytes).unwrap();
                sent += 1;
                // Three times as fast as it was driven.
                thread::sleep(Duration::from_millis(33));
            }
            _ => panic!("a robot tells transforms and scans"),
        }
        // Now and then it waits, and is looked up.
        if sent > 0 && sent % 75 == 0 && compared < sent / 75 {
            thread::sleep(SETTLED);
            let told = told.lock().unwrap();
            let ((stamp, map_from_robot), map_from_odom) = (told.pose.unwrap(), told.map_from_odom.unwrap());
            let Some(odom_from_robot) = odometry.get(&stamp) else { continue };
            let found = map_from_odom * *odom_from_robot;
            let apart_m = (found.translation - map_from_robot.translation).norm();
            let apart_rad = found.rotation.angle_to(&map_from_robot.rotation);
            assert!(apart_m < 1e-9 && apart_rad < 1e-7, "{apart_m} m, {apart_rad} rad at {stamp:?}");
            compared += 1;
        }
    }
    thread::sleep(2 * SETTLED);
    let id = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_code(&output, 0);
    let lines = std::fs::read_to_string(out.join("trajectory.tum")).unwrap().lines().count();
    let poses = told.lock().unwrap().poses;
    assert!(compared >= 3 && sent > 250, "{compared} compared, {sent} sent");
    assert!(lines == sent && poses >= sent, "{lines} mapped of {sent}, {poses} told: {}", text(&output.stdout));
}
