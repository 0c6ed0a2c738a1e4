//! Recordings of `sensor_msgs/Range`: rings put together by transforms, and single cones that cannot be.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests may")]

mod common;

use common::{Recorder, ms};
use mapwright_formats::LogEvent;
use mapwright_geom::{Pose3, Stamp};
use mapwright_logs::{Choice, Drive, Input, LogReport, Plan, Survey};
use mapwright_ros::messages::{Header, Odometry, Range, TfMessage, Transform, TransformStamped};
use mapwright_sensor::SonarReading;
use nalgebra::{UnitQuaternion, Vector3};
use std::path::Path;

impl Recorder {
    fn range(&mut self, topic: &str, frame: &str, at: Stamp, [opening_rad, max, range]: [f32; 3]) {
        let header = Header::new(at, frame);
        let message =
            Range { header, field_of_view: opening_rad, min_range: 0.1, max_range: max, range, ..Default::default() };
        self.write(topic, "sensor_msgs/msg/Range", at, &message);
    }

    fn odometry(&mut self, at: Stamp, x: f64) {
        let header = Header::new(at, "odom");
        let mut odometry = Odometry { header, child_frame_id: "base_link".into(), ..Default::default() };
        odometry.pose.pose.position.x = x;
        odometry.pose.pose.orientation.w = 1.0;
        self.write("/odom", "nav_msgs/msg/Odometry", at, &odometry);
    }

    /// A sonar's frame, turned by these angles on the robot.
    fn mount(&mut self, frame: &str, [pitch_rad, yaw_rad]: [f64; 2]) {
        let rotation = UnitQuaternion::from_euler_angles(0.0, pitch_rad, yaw_rad);
        let pose = Pose3 { translation: Vector3::new(0.2, 0.0, 0.3), rotation };
        let header = Header::new(ms(0), "base_link");
        let transform = Transform::from(pose);
        let transforms = vec![TransformStamped { header, child_frame_id: frame.into(), transform }];
        self.write("/tf_static", "tf2_msgs/msg/TFMessage", ms(0), &TfMessage { transforms });
    }
}

/// All readings of sonars of a recording, and how many could not be used.
fn readings(path: &Path) -> (Vec<SonarReading>, u64) {
    let input = vec![("log".to_owned(), Input::Recording(path.to_owned()))];
    let mut drive = Drive::open(input, &Choice::default()).unwrap();
    let mut readings = Vec::new();
    while let Some(event) = drive.next_event().unwrap() {
        if let LogEvent::Sonar(reading) = event {
            readings.push(reading.clone());
        }
    }
    let reports = drive.into_reports();
    let LogReport::Recording(report) = &reports[0].1 else { panic!("a recording") };
    assert_eq!(report.stream.sonar_readings, readings.len() as u64);
    (readings, report.stream.unusable.count)
}

#[test]
fn topics_and_frames_make_up_one_ring() {
    let mut recorder = Recorder::new("ring.mcap");
    recorder.mount("left", [0.0, 1.5]);
    recorder.mount("right", [0.0, -1.5]);
    for k in 0..20 {
        recorder.odometry(ms(100 * k), 0.05 * k as f64);
        recorder.range("/sonar_left", "left", ms(100 * k + 20), [0.5, 4.0, 1.0]);
        recorder.range("/sonar_right", "right", ms(100 * k + 40), [0.5, 4.0, 2.0]);
    }
    let (readings, unusable) = readings(&recorder.finish());
    assert_eq!((readings.len(), unusable), (40, 0));
    let ring = &readings[0].ring;
    assert_eq!(ring.sonars.len(), 2);
    assert!(
        (ring.sonars[0].robot_from_sonar.theta - 1.5).abs() < 1e-6
            && (ring.sonars[0].robot_from_sonar.x - 0.2).abs() < 1e-9
    );
    assert!(readings.windows(2).all(|pair| pair[0].stamp <= pair[1].stamp));
    let heard = |reading: &SonarReading| reading.ranges_m.iter().filter(|range_m| !range_m.is_nan()).count();
    assert!(readings.iter().all(|reading| heard(reading) == 1));
}

#[test]
fn bad_cones_are_counted_and_millimetres_are_used() {
    let mut recorder = Recorder::new("bad_cones.mcap");
    recorder.mount("front", [0.0, 0.0]);
    for k in 0..20 {
        recorder.odometry(ms(100 * k), 0.05 * k as f64);
        let opening_rad = if k % 5 == 4 { 0.0 } else { 0.5 };
        recorder.range("/sonar", "front", ms(100 * k + 20), [opening_rad, 4000.0, 1500.0]);
    }
    let (readings, unusable) = readings(&recorder.finish());
    assert_eq!((readings.len(), unusable), (16, 4));
    let sonar = &readings[0].ring.sonars[0];
    assert!(readings[0].ranges_m == [1.5] && (sonar.range_max_m - 4.0).abs() < 1e-9, "{sonar:?}");
}

/// Why a recording is refused.
fn refusal(path: &Path) -> String {
    Plan::of(&Survey::of(path).unwrap(), &Choice::default()).unwrap_err()
}

#[test]
fn sonars_that_cannot_be_placed_are_refused_with_the_reason() {
    let mut unplaced = Recorder::new("unplaced.mcap");
    let mut tilted = Recorder::new("tilted.mcap");
    let mut without = Recorder::new("without_odometry.mcap");
    tilted.mount("front", [0.6, 0.0]);
    without.mount("front", [0.0, 0.0]);
    for k in 0..10 {
        unplaced.odometry(ms(100 * k), 0.05 * k as f64);
        tilted.odometry(ms(100 * k), 0.05 * k as f64);
        for recorder in [&mut unplaced, &mut tilted, &mut without] {
            recorder.range("/sonar", "front", ms(100 * k + 20), [0.5, 4.0, 1.0]);
        }
    }
    let reason = refusal(&unplaced.finish());
    assert!(reason.contains("where the sonar sits"), "{reason}");
    let reason = refusal(&tilted.finish());
    assert!(reason.contains("leaves the plane by") && reason.contains("34 deg"), "{reason}");
    let reason = refusal(&without.finish());
    assert!(reason.contains("expected odometry beside sonars"), "{reason}");
}
