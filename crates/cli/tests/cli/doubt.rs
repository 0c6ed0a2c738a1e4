//! A run that comes into doubt says where, for how long and why.

use crate::support::{assert_code, folder, json, run, small_log_in, text};
use mapwright_formats::CarmenWriter;
use mapwright_sim::{Drive, DriveSettings, Incident, Rng, worlds};
use std::f64::consts::FRAC_PI_2;
use std::fs;

/// Twenty seconds of driving, three without a scan in which the robot turns by 90 degrees, and then twenty scans of
/// noise.
fn gap_with_a_turn_and_then_noise() -> Vec<u8> {
    let (from_s, to_s) = (20.05, 23.05);
    let incidents = vec![
        Incident::Turn { from_s, duration_s: 3.0, angle_rad: FRAC_PI_2, odometry_share: 0.0 },
        Incident::Outage { from_s, to_s, odometry_lost: true },
    ];
    let settings = DriveSettings { incidents, duration_s: 40.0, seed: 5, ..DriveSettings::default() };
    let mut writer = CarmenWriter::new(Vec::new());
    let mut rng = Rng::new(5);
    for (number, mut taken) in Drive::new(worlds::three_rooms(5).into(), settings).scans().enumerate() {
        if (201..221).contains(&number) {
            taken.scan.ranges_m.iter_mut().for_each(|range_m| *range_m = rng.uniform(0.5, 6.0) as f32);
        }
        writer.scan(&taken.scan).unwrap();
    }
    writer.finish().unwrap()
}

#[test]
fn a_robot_that_is_lost_is_reported_with_scan_stamp_and_reason() {
    let folder = folder("doubt");
    let (log, out) = (folder.join("gap.clf"), folder.join("out"));
    fs::write(&log, gap_with_a_turn_and_then_noise()).unwrap();
    let output = run(&["map", log.to_str().unwrap(), "-o", out.to_str().unwrap(), "--no-odometry"]);
    assert_code(&output, 3);
    let report = json(&out.join("report.json"));
    let doubt = &report["status"]["doubt"];
    println!("{}\n{doubt:#}", text(&output.stdout));
    let first = &doubt["first"];
    // Scans come every 0.1 s from zero on; the first after the gap is number 201.
    assert_eq!(first["scan"], 201);
    assert!((first["stamp_s"].as_f64().unwrap() - 23.1).abs() < 1e-6);
    assert_eq!(first["gap_before"]["scan"], 201);
    assert!((first["gap_before"]["seconds"].as_f64().unwrap() - 3.1).abs() < 1e-6);
    assert!(first["scans"].as_u64().unwrap() >= 20 && first["least_inlier_share"].as_f64().unwrap() < 0.35);
    let lost = &doubt["first_lost"];
    assert!((201..=221).contains(&lost["scan"].as_u64().unwrap()));
    assert!(lost["inlier_share"].as_f64().unwrap() < 0.35 && lost["searched"] == true);
    let said = text(&output.stdout);
    let expected =
        ["from scan 201 at 23.100", "of the beams fit the map", "3.1 s without a scan", "left out of the map"];
    expected.iter().for_each(|what| assert!(said.contains(what), "expected {what:?}, found {said}"));
}

#[test]
fn a_run_without_doubt_says_nothing_of_it() {
    let folder = folder("no_doubt");
    let (log, out) = (small_log_in(&folder), folder.join("out"));
    let output = run(&["map", &log, "-o", out.to_str().unwrap()]);
    assert_code(&output, 0);
    assert!(!text(&output.stdout).contains("doubt    "));
    let doubt = &json(&out.join("report.json"))["status"]["doubt"];
    assert!(doubt["spells"] == 0 && doubt["first"].is_null() && doubt["first_lost"].is_null());
}
