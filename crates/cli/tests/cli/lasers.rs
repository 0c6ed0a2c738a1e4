//! A robot with a front and a rear scanner, recorded as CARMEN log, ROS 1 bag and MCAP.

use crate::support::{assert_code, folder, json, map, run, text};
use mapwright_exports::EventWriter;
use mapwright_formats::{LogEvent, TumWriter};
use mapwright_geom::{Pose2, Stamp};
use mapwright_sensor::{LaserModel, LaserScan, Odometry};
use mapwright_sim::{Drive, DriveSettings, Event, LaserSettings, worlds};
use std::f64::consts::{FRAC_PI_4, PI};
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::Arc;

enum Reading {
    Scan(LaserScan),
    Odometry(Odometry),
}

impl Reading {
    fn stamp(&self) -> Stamp {
        match self {
            Self::Scan(scan) => scan.stamp,
            Self::Odometry(odometry) => odometry.stamp,
        }
    }
}

/// Three quarters of a turn from either of two opposite corners, at different rates; and where the robot was at each scan.
fn drive() -> (Vec<Reading>, Vec<(Stamp, Pose2)>) {
    let site = Arc::new(worlds::three_rooms(5));
    let (mut all, mut truth) = (Vec::new(), Vec::new());
    let corners = [("front", 0.3, FRAC_PI_4, 10.0), ("rear", -0.3, FRAC_PI_4 - PI, 7.0)];
    for (name, x, yaw, scan_rate_hz) in corners {
        let mut laser = LaserSettings::with_field_of_view(1.5 * PI, 270);
        let model = LaserModel::clone(&laser.model);
        let robot_from_laser = Pose2::new(x, 0.6 * x, yaw);
        laser.model = Arc::new(LaserModel { name: name.to_owned(), robot_from_laser, range_max_m: 12.0, ..model });
        let settings = DriveSettings { laser, scan_rate_hz, seed: 5, duration_s: 60.0, ..DriveSettings::default() };
        for event in Drive::new(Arc::clone(&site), settings) {
            match event {
                Event::Scan(scan) => {
                    truth.push((scan.scan.stamp, scan.world_from_robot));
                    all.push(Reading::Scan(LaserScan { odom_from_robot: None, ..scan.scan }));
                }
                Event::Odometry(odometry) if name == "front" => all.push(Reading::Odometry(odometry)),
                Event::Odometry(_) => {}
            }
        }
    }
    all.sort_by_key(Reading::stamp);
    truth.sort_by_key(|(stamp, _)| *stamp);
    truth.dedup_by_key(|(stamp, _)| *stamp);
    (all, truth)
}

fn write(path: &Path, readings: &[Reading]) {
    let file = BufWriter::new(File::create(path).unwrap());
    let mut writer = match path.extension().unwrap().to_str().unwrap() {
        "bag" => EventWriter::bag1(file).unwrap(),
        "mcap" => EventWriter::mcap(file).unwrap(),
        _ => EventWriter::carmen(file),
    };
    // ROS 1 has no stamps before 1970, and none at 0
    let later = |stamp: Stamp| Stamp(stamp.0 + 1_000_000_000_000);
    for reading in readings {
        match reading {
            Reading::Scan(scan) => {
                writer.write(LogEvent::Scan(&LaserScan { stamp: later(scan.stamp), ..scan.clone() })).unwrap();
            }
            Reading::Odometry(said) => {
                writer.write(LogEvent::Odometry(&Odometry { stamp: later(said.stamp), ..*said })).unwrap();
            }
        }
    }
    writer.finish().unwrap();
}

fn write_truth(path: &Path, truth: &[(Stamp, Pose2)]) {
    let mut writer = TumWriter::new(File::create(path).unwrap());
    truth.iter().for_each(|(stamp, pose)| writer.write_planar(Stamp(stamp.0 + 1_000_000_000_000), *pose).unwrap());
    writer.finish().unwrap();
}

fn ate_m(out: &Path, truth: &Path) -> f64 {
    let output = run(&["eval", out.to_str().unwrap(), "--reference", truth.to_str().unwrap(), "--json"]);
    assert_code(&output, 0);
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    value[0]["ate"]["translation_m"]["rmse"].as_f64().unwrap()
}

#[test]
fn front_and_rear_scanners_are_both_mapped_from_every_format() {
    let folder = folder("two_lasers");
    let (readings, truth) = drive();
    let reference = folder.join("truth.tum");
    write_truth(&reference, &truth);
    let path = |name: &str| -> PathBuf { folder.join(name) };
    for (ending, one) in [("bag", Some("/scan")), ("mcap", Some("/scan_rear")), ("clf", None)] {
        let (log, out) = (path(&format!("drive.{ending}")), path(ending));
        write(&log, &readings);
        let log = log.to_str().unwrap();
        assert_code(&map(log, &out, &[]), 0);
        let scans = json(&out.join("report.json"))["status"]["tracking"].as_u64();
        let both_m = ate_m(&out, &reference);
        assert!(both_m < 0.02, "{ending}: {both_m} m");
        let info = text(&run(&["info", log]).stdout);
        assert_eq!(info.matches("laser    ").count(), 2, "{info}");
        let Some(topic) = one else { continue };
        assert!(info.contains("/scan_rear") && info.contains("mapped too, it sees"), "{info}");
        let alone = path(&format!("{ending}_alone"));
        assert_code(&map(log, &alone, &["--topic", topic]), 0);
        assert!(json(&alone.join("report.json"))["status"]["tracking"].as_u64() < scans);
        let alone_m = ate_m(&alone, &reference);
        assert!(both_m < alone_m + 2e-3, "{ending}: {both_m} m with both, {alone_m} m with {topic} alone");
    }
    let out = path("bag");
    let out = out.to_str().unwrap();
    for what in [&["explain", out][..], &["report", out], &["export", out, "--to", "mcap"]] {
        assert_code(&run(what), 0);
    }
    // scans of both lasers at keyframes, which the folder's own export is not mapped for
    let exported = text(&run(&["info", &format!("{out}/export.mcap")]).stdout);
    assert!(exported.contains("/scan_rear"), "{exported}");
    let again = run(&["map", out, "-o", path("again").to_str().unwrap()]);
    assert_code(&again, 1);
    assert!(text(&again.stderr).contains("found a folder of results"), "{again:?}");
}

#[test]
fn calibration_is_of_one_laser_and_says_of_which() {
    let folder = folder("two_lasers_calibrated");
    let log = folder.join("drive.mcap");
    write(&log, &drive().0);
    let log = log.to_str().unwrap();
    let first = run(&["calibrate", log]);
    assert_code(&first, 0);
    let said = text(&first.stdout);
    assert!(said.contains("of       front, the first of the robot's lasers; left out: rear"), "{said}");
    let rear = run(&["calibrate", log, "--topic", "/scan_rear", "--json"]);
    assert_code(&rear, 0);
    let value: serde_json::Value = serde_json::from_slice(&rear.stdout).unwrap();
    assert_eq!((&value["laser"], &value["lasers_left_out"]), (&serde_json::json!("rear"), &serde_json::json!([])));
    let x_m = value["x_m"]["value"].as_f64().unwrap();
    assert!((x_m + 0.3).abs() < 0.02, "{x_m} m");
}
