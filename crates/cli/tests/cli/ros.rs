//! `mapwright live` in a ROS 2 system: a simulated robot drives beside it, and hears what it is told.

use crate::support::{assert_code, folder, text};
use mapwright_dds::{Configuration, Dds, Range};
use mapwright_geom::{Pose2, Pose3, Stamp};
use mapwright_live::wire::{Delivery, Publisher, Topic, Wire};
use mapwright_ros::messages::{Header, LaserScan, PoseWithCovarianceStamped, TfMessage, TransformStamped};
use mapwright_ros::{Channel, Decoder, Encoding, encode};
use mapwright_sim::{Drive, DriveSettings, Event, worlds};
use nalgebra::{UnitQuaternion, Vector3};
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

const DOMAIN: u16 = 151;
/// Stamps of zero are none.
const BEGIN: Stamp = Stamp(1_000_000_000_000);
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

fn link(parent: &str, child: &str, stamp: Stamp, pose: Pose2) -> Vec<u8> {
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), pose.theta);
    let pose = Pose3 { translation: Vector3::new(pose.x, pose.y, 0.0), rotation };
    let header = Header::new(stamp, parent);
    let transform = TransformStamped { header, child_frame_id: child.into(), transform: pose.into() };
    encode(&TfMessage { transforms: vec![transform] }, Encoding::Cdr).unwrap()
}

fn hear(wire: &mut Dds, told: &Arc<Mutex<Told>>) {
    let of = |name: &str| Channel::new(name, Encoding::Cdr, None).unwrap();
    let mut transforms = Decoder::<TfMessage<'_>>::new(&of("tf2_msgs/msg/TFMessage")).unwrap();
    let mut poses =
        Decoder::<PoseWithCovarianceStamped<'_>>::new(&of("geometry_msgs/msg/PoseWithCovarianceStamped")).unwrap();
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
    let transforms = advertise(&mut wire, "/tf", "tf2_msgs/msg/TFMessage", reliable);
    let scans = advertise(&mut wire, "/scan", "sensor_msgs/msg/LaserScan", reliable);
    let settings = DriveSettings { duration_s: 30.0, ..DriveSettings::default() };
    fixed.publish(&link("base_link", "laser", BEGIN, settings.laser.model.robot_from_laser)).unwrap();
    let begun = Instant::now();
    while scans.listeners() < 1 || transforms.listeners() < 1 {
        assert!(begun.elapsed() < FOUND && child.try_wait().unwrap().is_none(), "it is not there");
        thread::sleep(Duration::from_millis(50));
    }
    thread::sleep(2 * SETTLED);
    // Its odometry is older than the map.
    let elsewhere = Pose2::new(-70.0, 31.0, 2.4);
    let (mut newest, mut sent, mut compared) = (Vec::new(), 0, 0);
    for event in Drive::new(worlds::loop_of(1, 60.0).into(), settings) {
        match event {
            Event::Odometry(odometry) => {
                let (stamp, pose) = (Stamp(odometry.stamp.0 + BEGIN.0), elsewhere * odometry.odom_from_robot);
                newest.push((stamp, pose));
                transforms.publish(&link("odom", "base_link", stamp, pose)).unwrap();
            }
            Event::Scan(taken) => {
                let (laser, ranges_m) = (&taken.scan.laser, &taken.scan.ranges_m);
                let last_rad = laser.angle_min_rad + (ranges_m.len() - 1) as f64 * laser.angle_step_rad;
                let message = LaserScan {
                    header: Header::new(Stamp(taken.scan.stamp.0 + BEGIN.0), "laser"),
                    angle_min: laser.angle_min_rad as f32,
                    angle_max: last_rad as f32,
                    angle_increment: laser.angle_step_rad as f32,
                    range_min: laser.range_min_m as f32,
                    range_max: laser.range_max_m as f32,
                    ranges: ranges_m[..].into(),
                    ..Default::default()
                };
                scans.publish(&encode(&message, Encoding::Cdr).unwrap()).unwrap();
                sent += 1;
                // Three times as fast as it was driven, and looked up where it waits.
                thread::sleep(Duration::from_millis(if sent % 75 == 0 { 0 } else { 33 }));
            }
        }
        if sent > 0 && sent % 75 == 0 && compared < sent / 75 {
            // A scan waits for odometry on both sides of it; the next one has not been told yet.
            thread::sleep(SETTLED);
            let told = told.lock().unwrap();
            let ((stamp, map_from_robot), map_from_odom) = (told.pose.unwrap(), told.map_from_odom.unwrap());
            let Some((_, pose)) = newest.iter().find(|(at, _)| *at == stamp) else { continue };
            let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), pose.theta);
            let found = map_from_odom * Pose3 { translation: Vector3::new(pose.x, pose.y, 0.0), rotation };
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
