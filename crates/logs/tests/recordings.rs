//! Recordings with everything that goes wrong, made here.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests may")]

mod common;

use common::{Recorder, ms};
use mapwright_formats::LogEvent;
use mapwright_geom::{Pose3, Stamp};
use mapwright_logs::{Choice, Drive, Input, LogError, LogReport, OdometrySource, Plan, RecordingReport, Survey};
use mapwright_ros::messages::{
    Header, Imu, LaserEcho, LaserScan, MultiEchoLaserScan, Odometry, TfMessage, Transform, TransformStamped,
};
use std::path::{Path, PathBuf};

const SCAN: &str = "sensor_msgs/msg/LaserScan";
const ODOMETRY: &str = "nav_msgs/msg/Odometry";
const IMU: &str = "sensor_msgs/msg/Imu";
const TRANSFORMS: &str = "tf2_msgs/msg/TFMessage";

impl Recorder {
    fn scan(&mut self, recorded: Stamp, stamp: Stamp, ranges: &[f32]) {
        let header = Header::new(stamp, "laser");
        let scan =
            LaserScan { header, angle_increment: 0.01, range_max: 9.0, ranges: ranges.into(), ..Default::default() };
        self.write("/scan", SCAN, recorded, &scan);
    }

    fn odometry(&mut self, topic: &str, recorded: Stamp, stamp: Stamp, x: f64) {
        let header = Header::new(stamp, "odom");
        let mut odometry = Odometry { header, child_frame_id: "base_link".into(), ..Default::default() };
        odometry.pose.pose.position.x = x;
        odometry.pose.pose.orientation.w = 1.0;
        self.write(topic, ODOMETRY, recorded, &odometry);
    }

    fn sweep(&mut self, recorded: Stamp, stamp: Stamp, beams: usize) {
        let ranges = vec![1.0_f32; beams];
        let scan = LaserScan {
            header: Header::new(stamp, "laser"),
            angle_increment: 0.01,
            time_increment: 0.001,
            range_max: 9.0,
            ranges: ranges.as_slice().into(),
            ..Default::default()
        };
        self.write("/scan", SCAN, recorded, &scan);
    }

    fn imu(&mut self, topic: &str, frame: &str, stamp: Stamp, omega: [f64; 3], is_there: bool) {
        let mut imu = Imu { header: Header::new(stamp, frame), ..Default::default() };
        (imu.angular_velocity.x, imu.angular_velocity.y, imu.angular_velocity.z) = omega.into();
        if !is_there {
            imu.angular_velocity_covariance.0[0] = -1.0;
        }
        self.write(topic, IMU, stamp, &imu);
    }

    fn link(&mut self, topic: &str, stamp: Stamp, parent: &str, child: &str, x: f64) {
        let mut pose = Pose3::identity();
        pose.translation.x = x;
        let header = Header::new(stamp, parent);
        let transform = Transform::from(pose);
        let transforms = vec![TransformStamped { header, child_frame_id: child.into(), transform }];
        self.write(topic, TRANSFORMS, stamp, &TfMessage { transforms });
    }
}

/// Stamps in ms and odometry's x of the scans, and the report.
fn read(path: PathBuf) -> (Vec<(i64, Option<f64>)>, RecordingReport) {
    let mut drive = Drive::open(vec![("log".to_owned(), Input::Recording(path))], &Choice::default()).unwrap();
    let mut scans = Vec::new();
    while let Some(event) = drive.next_event().unwrap() {
        if let LogEvent::Scan(scan) = event {
            let x = scan.odom_from_robot.map(|pose| (pose.x * 1e9).round() / 1e9);
            scans.push(((scan.stamp.0 - ms(0).0) / 1_000_000, x));
        }
    }
    match drive.into_reports().pop() {
        Some((_, LogReport::Recording(report))) => (scans, *report),
        other => panic!("{other:?}"),
    }
}

#[test]
fn odometry_jumps_where_no_robot_can_have_driven_in_the_time() {
    let mut recorder = Recorder::new("jumps.mcap");
    for (at_ms, x_m) in [(0, 0.0), (60_000, 50.0), (60_100, 90.0)] {
        recorder.scan(ms(at_ms), ms(at_ms), &[1.0; 4]);
        recorder.odometry("/odom", ms(at_ms), ms(at_ms), x_m);
    }
    let (_, report) = read(recorder.finish());
    assert_eq!(report.stream.topics[1].odometry.jumps.first_places, [6]);
}

#[test]
fn who_watches_a_recording_being_looked_through_can_stop_it() {
    let mut recorder = Recorder::new("watched.mcap");
    (0..300).for_each(|k| recorder.scan(ms(k), ms(k), &[1.0; 4]));
    let path = recorder.finish();
    let mut heard = Vec::new();
    let whole = Survey::watched(&path, &mut |messages| {
        heard.push(messages);
        true
    });
    assert_eq!(whole.unwrap().unwrap().topics[0].messages, 300);
    assert_eq!(heard, [64, 128, 192, 256]);
    assert!(Survey::watched(&path, &mut |messages| messages < 128).unwrap().is_none());
    let inputs = vec![("log".to_owned(), Input::Recording(path))];
    let stopped = Drive::open_watched(inputs, &Choice::default(), &mut |name, messages| {
        assert_eq!((name, messages), ("log", 64));
        false
    });
    assert!(matches!(stopped, Err(LogError::Stopped { name }) if name == "log"));
}

fn plan(path: &Path) -> Result<Plan, String> {
    Plan::of(&Survey::of(path).unwrap(), &Choice::default())
}

#[test]
fn scans_get_odometry_at_their_stamps_whatever_comes_first() {
    let mut recorder = Recorder::new("order.mcap");
    recorder.odometry("/odom", ms(5), ms(0), 0.0);
    recorder.scan(ms(60), ms(50), &[1.0; 3]);
    recorder.scan(ms(70), ms(40), &[1.0; 4]); // recorded after a later one: so the robot would go to and fro
    recorder.odometry("/odom", ms(300), ms(100), 1.0); // comes late, but within the window
    recorder.scan(ms(400), Stamp(0), &[1.0; 4]); // no stamp: the time of recording
    recorder.odometry("/odom", ms(500), ms(500), 2.0);
    recorder.scan(ms(9000), ms(9000), &[f32::NAN; 4]); // no odometry for so long
    let (scans, report) = read(recorder.finish());
    assert_eq!(scans, [(40, Some(0.4)), (50, Some(0.5)), (400, Some(1.75)), (9000, None)]);
    let stream = &report.stream;
    assert_eq!((stream.scans, stream.odometry, stream.unstamped.count, stream.late.count), (4, 3, 1, 0));
    assert_eq!((stream.without_odometry.count, stream.odometry_behind_s), (1, Some(8.5)));
    assert_eq!(stream.topics[0].stamps.backward.first_places, [3]);
    assert_eq!((stream.order.disordered, stream.order.moved), (1, 1));
    assert_eq!(stream.topics[0].beam_count_changes.count, 1);
    assert_eq!(stream.non_finite_ranges, 4);
}

#[test]
fn odometry_that_comes_after_the_window_is_counted_as_late() {
    let mut recorder = Recorder::new("late.mcap");
    recorder.odometry("/odom", ms(0), ms(0), 0.0);
    recorder.scan(ms(100), ms(100), &[1.0; 3]);
    recorder.scan(ms(3000), ms(3000), &[1.0; 3]);
    recorder.odometry("/odom", ms(3100), ms(50), 1.0);
    let (scans, report) = read(recorder.finish());
    assert_eq!(scans, [(100, Some(0.0)), (3000, None)]);
    assert_eq!(report.stream.late.first_places, [4]);
}

#[test]
fn bad_messages_are_counted_with_their_place_and_the_others_are_used() {
    let mut recorder = Recorder::new("bad.mcap");
    recorder.scan(ms(0), ms(0), &[1.0; 3]);
    recorder.raw("/scan", SCAN, ms(100), &[0, 1, 0, 0, 1, 2]);
    recorder.odometry("/odom", ms(150), ms(150), f64::NAN);
    recorder.write("/scan", SCAN, ms(200), &LaserScan { angle_min: f32::NAN, ..Default::default() });
    recorder.scan(ms(300), ms(300), &[1.0; 3]);
    let (scans, report) = read(recorder.finish());
    assert_eq!(scans.len(), 2);
    let (undecodable, unusable) = (&report.stream.undecodable, &report.stream.unusable);
    assert_eq!((undecodable.count, unusable.count), (1, 2));
    assert!(undecodable.first.as_ref().unwrap().starts_with("message 2 at byte "), "{undecodable:?}");
    assert!(unusable.first.as_ref().unwrap().contains("expected a finite pose"), "{unusable:?}");
}

#[test]
fn of_several_topics_of_odometry_the_fullest_is_used_and_never_another_mappers() {
    let mut recorder = Recorder::new("several.mcap");
    for k in 0..10 {
        recorder.odometry("/filtered", ms(k * 100), ms(k * 100), 1.0);
        recorder.odometry("/wheels", ms(k * 100), ms(k * 100), 1.0);
        recorder.odometry("/wheels", ms(k * 100 + 50), ms(k * 100 + 50), 1.0);
        recorder.link("/tf", ms(k * 100), "map", "odom", 0.1 * k as f64);
        recorder.link("/tf", ms(k * 100), "odom", "base_link", 0.1 * k as f64);
        recorder.scan(ms(k * 100), ms(k * 100), &[1.0; 3]);
    }
    recorder.link("/tf_static", ms(0), "base_link", "laser", 0.25);
    let path = recorder.finish();
    let found = plan(&path).unwrap();
    assert!(matches!(&found.odometry, OdometrySource::Topic { name, .. } if name == "/wheels"), "{found:?}");
    assert!(
        found.assumed.is_empty() && found.reasons.iter().any(|(_, why)| why.contains("/filtered (10)")),
        "{found:?}"
    );
    let choice = Choice { topics: vec!["filtered".to_owned()], ..Choice::default() };
    let asked = Plan::of(&Survey::of(&path).unwrap(), &choice).unwrap();
    assert!(matches!(&asked.odometry, OdometrySource::Topic { name, .. } if name == "/filtered"), "{asked:?}");

    let mut recorder = Recorder::new("mapped.mcap");
    for k in 0..10 {
        recorder.link("/tf", ms(k * 100), "map", "base_link", 0.1 * k as f64);
        recorder.link("/tf", ms(k * 100), "base_link", "laser", 0.2);
        recorder.scan(ms(k * 100), ms(k * 100), &[1.0; 3]);
    }
    let found = plan(&recorder.finish()).unwrap();
    assert_eq!((&found.odometry, found.robot_frame.as_str()), (&OdometrySource::None, "base_link"));
    assert!(found.reasons.iter().any(|(_, why)| why.contains("another mapper")), "{found:?}");
}

#[test]
fn a_laser_that_moves_on_the_robot_is_refused_and_cycles_end() {
    let mut recorder = Recorder::new("moving.mcap");
    for k in 0..10 {
        recorder.link("/tf", ms(k * 100), "odom", "base_link", 0.1 * k as f64);
        recorder.link("/tf", ms(k * 100), "base_link", "laser", 0.05 * k as f64);
        recorder.scan(ms(k * 100), ms(k * 100), &[1.0; 3]);
    }
    let refused = plan(&recorder.finish()).unwrap_err();
    assert!(refused.contains("'laser' moves on the robot") && refused.contains("0.450 m"), "{refused}");

    let mut recorder = Recorder::new("root.mcap");
    recorder.scan(ms(0), ms(0), &[1.0; 3]);
    recorder.link("/tf_static", ms(0), "laser", "base_link", -0.3);
    let found = plan(&recorder.finish()).unwrap();
    assert!(found.robot_frame == "base_link" && found.assumed.is_empty(), "{found:?}");
    assert!(found.reasons.iter().any(|(_, why)| why.contains("x 0.300 m")), "{found:?}");

    let mut recorder = Recorder::new("cycle.mcap");
    recorder.scan(ms(0), ms(0), &[1.0; 3]);
    for (parent, child) in [("a", "laser"), ("b", "a"), ("a", "b"), ("laser", "b")] {
        recorder.link("/tf", ms(0), parent, child, 0.1);
    }
    assert!(plan(&recorder.finish()).is_ok());
}

#[test]
fn of_several_echoes_the_first_counts() {
    let mut recorder = Recorder::new("echoes.mcap");
    let echo = |echoes: &'static [f32]| LaserEcho { echoes: echoes.into() };
    let header = Header::new(ms(0), "laser");
    let ranges = vec![echo(&[2.0, 5.0]), echo(&[]), echo(&[3.0])];
    let scan = MultiEchoLaserScan { header, angle_increment: 0.1, range_max: 9.0, ranges, ..Default::default() };
    recorder.write("/echoes", "sensor_msgs/msg/MultiEchoLaserScan", ms(0), &scan);
    let (scans, report) = read(recorder.finish());
    assert_eq!((scans.len(), report.stream.non_finite_ranges, report.plan.scans.as_str()), (1, 1, "/echoes"));
}

#[test]
fn memory_does_not_depend_on_a_recordings_length() {
    let held = |name: &str, scans: i64| {
        let mut recorder = Recorder::new(name);
        for k in 0..scans {
            recorder.odometry("/odom", ms(k * 25), ms(k * 25), 0.0);
            recorder.scan(ms(k * 25), ms(k * 25), &[1.0; 1000]);
        }
        let path = recorder.finish();
        let megabytes = std::fs::metadata(&path).unwrap().len() >> 20;
        let (scans, report) = read(path.clone());
        std::fs::remove_file(path).unwrap();
        assert!(!scans.is_empty() && report.survey.held_bytes > 0);
        (megabytes, report.stream.held_bytes.max(report.survey.held_bytes))
    };
    let ((short_mb, short), (long_mb, long)) = (held("short.mcap", 800), held("long.mcap", 8000));
    assert!(long_mb >= 9 * short_mb, "{short_mb} and {long_mb} MiB");
    assert!(long as f64 <= 1.02 * short as f64, "{short} and {long} bytes held");
}

/// An inertial sensor that lies on its side: its x axis points up.
fn lying(parent: &'static str, child: &'static str) -> TfMessage<'static> {
    let mut transform = Transform::from(Pose3::identity());
    let half = std::f64::consts::FRAC_1_SQRT_2;
    (transform.rotation.y, transform.rotation.w) = (-half, half);
    let header = Header::new(ms(0), parent);
    TfMessage { transforms: vec![TransformStamped { header, child_frame_id: child.into(), transform }] }
}

#[test]
fn turn_rates_come_before_the_scan_in_whose_sweep_they_were_read() {
    let mut recorder = Recorder::new("imu.mcap");
    recorder.link("/tf_static", ms(0), "base_link", "laser", 0.1);
    recorder.write("/tf_static", TRANSFORMS, ms(0), &lying("base_link", "imu"));
    for k in 0..30 {
        recorder.imu("/imu", "imu", ms(10 * k), [0.1 * k as f64, 5.0, 7.0], true);
        recorder.imu("/tilted", "elsewhere", ms(10 * k), [0.0; 3], true);
        if k % 10 == 9 {
            recorder.sweep(ms(10 * k + 5), ms(10 * k - 90), 90);
        }
    }
    recorder.imu("/imu", "imu", ms(301), [f64::NAN; 3], true);
    recorder.imu("/imu", "imu", ms(302), [1.0; 3], false);
    let path = recorder.finish();
    let found = plan(&path).unwrap();
    let turning = found.turning.as_ref().unwrap();
    assert_eq!(turning.name, "/imu");
    assert!(turning.up_in_sensor.iter().zip([1.0, 0.0, 0.0]).all(|(a, b)| (a - b).abs() < 1e-12), "{turning:?}");
    assert!(found.reasons.iter().any(|(what, why)| *what == "turning" && why.contains("/imu (31 messages)")));
    let mut drive = Drive::open(vec![("log".to_owned(), Input::Recording(path))], &Choice::default()).unwrap();
    let (mut order, mut rates) = (Vec::new(), Vec::new());
    while let Some(event) = drive.next_event().unwrap() {
        match event {
            LogEvent::Scan(scan) => order.push((rates.len(), scan.stamp)),
            LogEvent::TurnRate(rate) => rates.push(*rate),
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(order, [(10, ms(0)), (20, ms(100)), (30, ms(200))]);
    assert!(rates.iter().enumerate().all(|(k, rate)| (rate.rad_per_s - 0.1 * k as f64).abs() < 1e-9), "{rates:?}");
    match drive.into_reports().pop() {
        Some((_, LogReport::Recording(report))) => {
            let (refused, unusable) = (&report.stream.refused_turn_rates, &report.stream.unusable);
            assert_eq!((report.stream.turn_rates, refused.count, unusable.count), (30, 2, 0));
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_gyroscope_that_nothing_places_or_nobody_needs_is_not_used() {
    for (name, placed, sweeps, why) in [
        ("unplaced.mcap", false, true, "nothing says how 'imu' sits on 'base_link'"),
        ("at_once.mcap", true, false, "all beams count as taken at once"),
        ("both.mcap", true, true, "says how the robot turned"),
    ] {
        let mut recorder = Recorder::new(name);
        recorder.link("/tf_static", ms(0), "base_link", "laser", 0.1);
        if placed {
            recorder.write("/tf_static", TRANSFORMS, ms(0), &lying("base_link", "imu"));
        }
        recorder.imu("/imu", "imu", ms(5), [1.0; 3], true);
        if sweeps {
            recorder.sweep(ms(100), ms(0), 90);
        } else {
            recorder.scan(ms(100), ms(0), &[1.0; 90]);
        }
        let plan = plan(&recorder.finish()).unwrap();
        assert_eq!(plan.turning.is_some(), placed && sweeps, "{name}");
        assert!(
            plan.reasons.iter().any(|(what, words)| *what == "turning" && words.contains(why)),
            "{:?}",
            plan.reasons
        );
    }
}
