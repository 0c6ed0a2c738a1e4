//! Recordings of a robot with several lasers: which are mapped, and why.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests may")]

mod common;

use common::{Recorder, ms};
use mapwright_formats::LogEvent;
use mapwright_geom::Pose3;
use mapwright_logs::{Choice, Drive, Input, LogReport, Plan, Survey};
use mapwright_ros::messages::{Header, LaserScan, Odometry, TfMessage, Transform, TransformStamped};
use nalgebra::UnitQuaternion;
use std::path::{Path, PathBuf};

/// Where a laser sits: frame, x in metres, yaw in degrees.
type Mount<'a> = (&'a str, f64, f64);

impl Recorder {
    /// A recording in which these transforms are fixed to `base_link`.
    fn with_mounts(name: &str, mounts: &[Mount<'_>]) -> Self {
        let mut recorder = Self::new(name);
        let link = |&(frame, x, yaw_deg): &Mount<'_>| {
            let mut pose = Pose3::identity();
            pose.translation.x = x;
            pose.rotation = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_deg.to_radians());
            let header = Header::new(ms(0), "base_link");
            TransformStamped { header, child_frame_id: frame.to_owned().into(), transform: Transform::from(pose) }
        };
        let transforms = mounts.iter().map(link).collect();
        recorder.write("/tf_static", "tf2_msgs/msg/TFMessage", ms(0), &TfMessage { transforms });
        recorder
    }

    /// 181 beams over half a turn, all of the same range.
    fn scan(&mut self, topic: &str, frame: &str, at_ms: i64, range_m: f32) {
        let ranges = [range_m; 181];
        let scan = LaserScan {
            header: Header::new(ms(at_ms), frame),
            angle_min: -90_f32.to_radians(),
            angle_max: 90_f32.to_radians(),
            angle_increment: 1_f32.to_radians(),
            range_max: 9.0,
            ranges: ranges.as_slice().into(),
            ..Default::default()
        };
        self.write(topic, "sensor_msgs/msg/LaserScan", ms(at_ms), &scan);
    }

    fn odometry(&mut self, at_ms: i64) {
        let mut odometry = Odometry {
            header: Header::new(ms(at_ms), "odom"),
            child_frame_id: "base_link".into(),
            ..Default::default()
        };
        odometry.pose.pose.position.x = at_ms as f64 / 1e3;
        odometry.pose.pose.orientation.w = 1.0;
        self.write("/odom", "nav_msgs/msg/Odometry", ms(at_ms), &odometry);
    }
}

/// A front laser at 10 Hz and a rear one at 5 Hz, which sees `rear_m` far, half a period later; and odometry.
fn front_and_rear(name: &str, mounts: &[Mount<'_>], rear_m: f32) -> PathBuf {
    let mut recorder = Recorder::with_mounts(name, mounts);
    for k in 0..40 {
        recorder.odometry(100 * k);
        recorder.scan("/front/scan", "front", 100 * k, 2.0);
        if k % 2 == 0 {
            recorder.scan("/rear/scan", "rear", 100 * k + 50, rear_m);
        }
    }
    recorder.odometry(4000);
    recorder.finish()
}

fn plan(path: &Path, topics: &[&str]) -> Plan {
    let topics = topics.iter().map(|&topic| topic.to_owned()).collect();
    Plan::of(&Survey::of(path).unwrap(), &Choice { topics, ..Choice::default() }).unwrap()
}

fn why(plan: &Plan, what: &str) -> String {
    plan.reasons.iter().filter(|(name, _)| *name == what).map(|(_, why)| format!("{why}\n")).collect()
}

const BOTH: [Mount<'_>; 2] = [("front", 0.3, 0.0), ("rear", -0.3, 180.0)];

#[test]
fn lasers_that_look_different_ways_are_both_mapped_each_at_its_stamp_and_mount() {
    let path = front_and_rear("both.mcap", &BOTH, 3.0);
    let both = plan(&path, &[]);
    assert_eq!(both.lasers().collect::<Vec<_>>(), ["/front/scan", "/rear/scan"]);
    assert!(why(&both, "scans").contains("mapped too, it sees 1"), "{}", why(&both, "scans"));
    assert!(why(&both, "mounting").contains("'rear' at x -0.300 m, y 0.000 m, yaw 180.0 deg"));
    let mut drive = Drive::open(vec![("log".to_owned(), Input::Recording(path))], &Choice::default()).unwrap();
    let mut seen = Vec::new();
    while let Some(event) = drive.next_event().unwrap() {
        if let LogEvent::Scan(scan) = event {
            let ms = (scan.stamp.0 - ms(0).0) / 1_000_000;
            let x_mm = scan.odom_from_robot.map(|pose| (pose.x * 1e3).round() as i64);
            assert_eq!(x_mm, Some(ms), "odometry at the stamp of {}", scan.laser.name);
            let is_rear = scan.laser.name == "rear";
            assert_eq!(scan.laser.robot_from_laser.x < 0.0, is_rear);
            seen.push((ms, is_rear));
        }
    }
    assert_eq!(seen.len(), 60);
    assert_eq!(seen[..5], [(0, false), (50, true), (100, false), (200, false), (250, true)]);
    let Some((_, LogReport::Recording(report))) = drive.into_reports().pop() else { panic!() };
    let events: Vec<_> = report.stream.topics.iter().map(|topic| (topic.name.as_str(), topic.events)).collect();
    assert_eq!(events, [("/front/scan", 40), ("/odom", 41), ("/rear/scan", 20)]);
}

#[test]
fn topics_choose_one_laser_or_several() {
    let path = front_and_rear("chosen.mcap", &BOTH, 3.0);
    assert_eq!(plan(&path, &["/rear/scan"]).lasers().collect::<Vec<_>>(), ["/rear/scan"]);
    let both = plan(&path, &["/rear/scan", "/front/scan"]);
    assert_eq!(both.lasers().count(), 2);
    assert!(why(&both, "scans").contains("mapped too, as asked for"));
    let by_hand = mapwright_logs::MountChoice { robot_from_laser: mapwright_geom::Pose2::IDENTITY, inverted: false };
    let choice = Choice { mount: Some(by_hand), ..Choice::default() };
    let mounted = Plan::of(&Survey::of(&path).unwrap(), &choice).unwrap();
    assert_eq!(mounted.lasers().count(), 1, "a mounting by hand is that of one laser");
    assert!(why(&mounted, "scans").contains("not used: /rear/scan: a mounting that is asked for"));
}

#[test]
fn a_laser_whose_place_is_unknown_or_that_sees_nothing_else_is_left_out_and_that_is_said() {
    let unknown = plan(&front_and_rear("unknown.mcap", &BOTH[..1], 3.0), &[]);
    assert_eq!(unknown.lasers().collect::<Vec<_>>(), ["/front/scan"]);
    assert!(why(&unknown, "scans").contains("nothing says where 'rear' sits on the robot"), "{unknown:?}");
    let same_way = [("front", 0.3, 0.0), ("rear", 0.1, 0.0)];
    let above = plan(&front_and_rear("above.mcap", &same_way, 3.0), &[]);
    assert_eq!(above.lasers().count(), 1);
    let words = "it sees no direction that the others do not; to map it too: --topic /front/scan --topic /rear/scan";
    assert!(why(&above, "scans").contains(words), "{}", why(&above, "scans"));
    // a topic of the same laser that shows more of its beams
    let mut recorder = Recorder::with_mounts("filtered.mcap", &BOTH);
    for k in 0..40 {
        recorder.odometry(100 * k);
        recorder.scan("/filtered", "front", 100 * k, if k % 8 == 0 { 0.3 } else { 2.0 });
        recorder.scan("/scan", "front", 100 * k, 2.0);
    }
    let filtered = plan(&recorder.finish(), &[]);
    assert_eq!(filtered.lasers().collect::<Vec<_>>(), ["/filtered"]);
    assert!(why(&filtered, "scans").contains("/scan: it has scans of the laser of /filtered"), "{filtered:?}");
    let covered = plan(&front_and_rear("covered.mcap", &BOTH, 0.3), &[]);
    assert_eq!(covered.lasers().count(), 1, "the rear one sees the robot alone");
}
