//! Odometry that is stamped late or early, and lasers that sit the wrong way round.

use crate::real_logs::shared_data;
use crate::support::{assert_code, assert_refused, folder, json, log_of, map, poses, run, text, three_rooms};
use mapwright_geom::{Pose2, Stamp};
use mapwright_sensor::Odometry;
use mapwright_sim::{Drive, DriveSettings, Event, LaserSettings, OdometryNoise, RobotSettings, worlds};
use serde_json::Value;
use std::f64::consts::{PI, TAU};
use std::fs;
use std::path::Path;
use std::sync::Arc;

/// Logs of this kind begin then, seconds.
const BEGIN_S: f64 = 1000.0;

fn nanoseconds(s: f64) -> i64 {
    (s * 1e9).round() as i64
}

/// A minute with a lidar that turns five times a second, and with wheels that say where the robot was so long before; and where it was.
fn late_drive(lag_s: f64) -> (Vec<u8>, Vec<Pose2>) {
    let mut laser = LaserSettings::with_field_of_view(TAU, 360);
    Arc::make_mut(&mut laser.model).beam_period_s = 0.19 / 360.0;
    let settings = DriveSettings {
        robot: RobotSettings {
            turn_rate_rad_per_s: 1.5,
            turn_acceleration_rad_per_s2: 4.0,
            ..RobotSettings::default()
        },
        laser,
        scan_rate_hz: 5.0,
        odometry_rate_hz: 100.0,
        odometry: OdometryNoise::default().times(0.2),
        duration_s: 60.0,
        seed: 5,
        ..DriveSettings::default()
    };
    let drive: Vec<Event> = Drive::new(worlds::three_rooms(5).into(), settings).collect();
    let readings: Vec<Odometry> = drive
        .iter()
        .filter_map(|event| if let Event::Odometry(odometry) = event { Some(*odometry) } else { None })
        .collect();
    let said_at = |stamp: Stamp| {
        let at = Stamp(stamp.0 - nanoseconds(lag_s));
        readings.iter().min_by_key(|reading| (reading.stamp.0 - at.0).abs()).map(|reading| reading.odom_from_robot)
    };
    let mut events = Vec::new();
    let mut world_from_robot = Vec::new();
    for event in &drive {
        events.push(match event.clone() {
            Event::Scan(mut taken) => {
                world_from_robot.push(taken.world_from_robot);
                taken.scan.odom_from_robot = said_at(taken.scan.stamp);
                taken.scan.stamp = Stamp(taken.scan.stamp.0 + nanoseconds(BEGIN_S));
                Event::Scan(taken)
            }
            Event::Odometry(odometry) => {
                let stamp = Stamp(odometry.stamp.0 + nanoseconds(BEGIN_S + lag_s));
                Event::Odometry(Odometry { stamp, ..odometry })
            }
        });
    }
    events.sort_by_key(|event| match event {
        Event::Scan(taken) => taken.scan.stamp,
        Event::Odometry(odometry) => odometry.stamp,
    });
    (log_of(events.into_iter()), world_from_robot)
}

/// Root mean square of the headings' errors, radians.
fn heading_error(out: &Path, truth: &[Pose2]) -> f64 {
    let poses = poses(out);
    assert_eq!(poses.len(), truth.len());
    let heading = |pose: &Vec<f64>| 2.0 * pose[6].atan2(pose[7]);
    let squares = poses.iter().zip(truth).map(|(pose, world_from_robot)| {
        let off = heading(pose) - heading(&poses[0]) - (world_from_robot.theta - truth[0].theta);
        off.sin().atan2(off.cos()).powi(2)
    });
    (squares.sum::<f64>() / poses.len() as f64).sqrt()
}

/// Reads `info --json`'s lag, or none.
fn lag_of(log: &str) -> Option<f64> {
    let info = run(&["info", log, "--json"]);
    let value: Value = serde_json::from_slice(&info.stdout).unwrap();
    value["read"]["order"]["odometry_lag_s"].as_f64()
}

#[test]
fn odometry_that_lags_is_put_right_in_every_format_and_that_is_said() {
    let folder = folder("lag");
    for (name, lag_s) in [("late", 0.3), ("early", -0.25)] {
        let log = folder.join(format!("{name}.clf")).display().to_string();
        fs::write(&log, late_drive(lag_s).0).unwrap();
        for ending in ["clf", "bag", "mcap"] {
            let same = folder.join(format!("{name}.{ending}")).display().to_string();
            if ending != "clf" {
                assert_code(&run(&["convert", &log, &same]), 0);
            }
            let found_s = lag_of(&same).unwrap_or_else(|| panic!("{same}: no lag found"));
            assert!((found_s - lag_s).abs() < 0.05, "{same}: {found_s} s instead of {lag_s}");
            let out = folder.join(format!("{name}_{ending}"));
            let mapped = map(&same, &out, &[]);
            assert_code(&mapped, 0);
            let which = if lag_s > 0.0 { "behind the scans" } else { "ahead of the scans" };
            assert!(text(&mapped.stdout).contains(which), "{}", text(&mapped.stdout));
            let status = &json(&out.join("report.json"))["status"];
            assert!(status["tracking"].as_u64().unwrap() > 294, "{same}: {}", status["tracking"]);
        }
    }
}

#[test]
fn a_drive_whose_odometry_lags_is_mapped_as_one_whose_does_not() {
    let folder = folder("lag_mapped");
    let mapped = |name: &str, lag_s: f64, more: &[&str]| {
        let log = folder.join(format!("{name}.clf")).display().to_string();
        let (drive, truth) = late_drive(lag_s);
        fs::write(&log, drive).unwrap();
        let out = folder.join(name);
        assert_code(&map(&log, &out, more), 0);
        let restarted = json(&out.join("report.json"))["matches"]["restarted"].as_u64().unwrap();
        (heading_error(&out, &truth), restarted)
    };
    let as_stamped = folder.join("none.toml");
    let nothing = "[laser]\nx_m = 0.0\ny_m = 0.0\nyaw_rad = 0.0\nupside_down = false\n[odometry]\ntranslation_scale = 1.0\n\
                   rotation_scale = 1.0\ndrift_rad_per_m = 0.0\nlag_s = 0.0\n";
    fs::write(&as_stamped, nothing).unwrap();
    let (sound, _) = mapped("sound", 0.0, &[]);
    let (corrected, corrected_restarts) = mapped("late", 0.3, &[]);
    let (left, left_restarts) = mapped("left", 0.3, &["--calibration", as_stamped.to_str().unwrap()]);
    // As stamped, matches tell the motion within sweeps against the wheels, but have to be looked for elsewhere than these say.
    assert!(
        corrected < 2.0 * sound + 0.005 && left < 2.0 * sound + 0.01,
        "{corrected} rad, {left} as stamped, {sound} without a lag"
    );
    assert!(2 * corrected_restarts < left_restarts, "{corrected_restarts}, {left_restarts} as stamped");
    assert_eq!(lag_of(folder.join("sound.clf").to_str().unwrap()), None, "there is none");
}

#[test]
fn a_laser_the_wrong_way_round_is_said_and_found() {
    let folder = folder("wrong_way_round");
    for turned_deg in [135.0_f64, 180.0] {
        let log = folder.join(format!("turned_{turned_deg}.clf"));
        let mount = Pose2::new(0.1, 0.0, turned_deg.to_radians());
        fs::write(&log, three_rooms(120.0, mount, Pose2::IDENTITY)).unwrap();
        let out = folder.join(format!("out_{turned_deg}"));
        let said = text(&map(log.to_str().unwrap(), &out, &[]).stdout).to_owned();
        assert!(said.starts_with("check") && said.contains("deg beside where odometry says"), "{turned_deg}: {said}");
        let file = folder.join("found.toml").display().to_string();
        let found = run(&["calibrate", log.to_str().unwrap(), "--json", "--apply", &file]);
        assert_code(&found, 0);
        let value: Value = serde_json::from_slice(&found.stdout).unwrap();
        let number = |key: &str| value[key]["value"].as_f64().unwrap();
        let off_rad = (number("yaw_rad") - mount.theta + PI).rem_euclid(TAU) - PI;
        let off_m = (number("x_m") - 0.1).hypot(number("y_m"));
        assert!(off_rad.abs() < 0.02 && off_m < 0.03, "{turned_deg}: off by {off_m} m, {off_rad} rad");
        // the map that is made with it is of another point of the robot, which is said
        let mapped = text(&map(log.to_str().unwrap(), &out, &["--calibration", &file]).stdout).to_owned();
        assert!(mapped.starts_with("good") && mapped.contains("poses are of a point"), "{mapped}");
    }
}

#[test]
fn half_a_minute_can_be_calibrated() {
    let folder = folder("calibrate_short");
    let log = folder.join("short.clf");
    fs::write(&log, three_rooms(30.0, Pose2::new(-0.1, 0.05, 0.05), Pose2::IDENTITY)).unwrap();
    let found = run(&["calibrate", log.to_str().unwrap(), "--json"]);
    assert_code(&found, 0);
    let value: Value = serde_json::from_slice(&found.stdout).unwrap();
    for (key, truth, within) in [("x_m", -0.1, 0.05), ("y_m", 0.05, 0.05), ("yaw_rad", 0.05, 0.03)] {
        let [found, sigma] = ["value", "sigma"].map(|part| value[key][part].as_f64().unwrap());
        assert!((found - truth).abs() < within && (found - truth).abs() < 4.0 * sigma, "{key} {found} +- {sigma}");
    }
}

#[test]
fn a_refused_calibration_writes_nothing() {
    let folder = folder("calibrate_refused");
    let log = folder.join("standing.clf");
    fs::write(&log, three_rooms(3.0, Pose2::IDENTITY, Pose2::IDENTITY)).unwrap();
    let file = folder.join("found.toml");
    let refused = run(&["calibrate", log.to_str().unwrap(), "--apply", file.to_str().unwrap()]);
    assert_refused(&refused, 1, &["expected at least", "stretches"]);
    assert!(!file.exists());
}

#[test]
fn what_was_switched_on_the_command_line_is_recorded_with_the_settings() {
    let folder = folder("switched");
    let log = crate::support::small_log_in(&folder);
    let [a, b, page] = ["a", "b", "page.html"].map(|name| folder.join(name));
    assert_code(&map(&log, &a, &[]), 0);
    assert_code(&map(&log, &b, &["--mount", "0.1,0,0", "--start", "1,2,0.5"]), 0);
    let compared = |a: &Path, b: &Path| {
        let output = ["compare", a.to_str().unwrap(), b.to_str().unwrap(), "-o", page.to_str().unwrap()];
        assert_code(&run(&output), 0);
        fs::read_to_string(&page).unwrap()
    };
    let told = compared(&a, &b);
    assert!(!told.contains("the same settings") && told.contains("--mount") && told.contains("0.1,0,0"));
    assert!(told.contains("--start") && told.contains("1,2,0.5"));
    assert!(compared(&a, &a).contains("the same settings"));
}

/// The share of scans that are tracked by default, of a log that may not be at hand: the middle one of five start poses, for where the
/// map's cells lie is a throw of dice.
fn tracked(name: &str) -> Option<f64> {
    let log = shared_data(name)?;
    let out = folder(&format!("tracked_{}", log.file_stem()?.to_str()?));
    let starts = ["0,0,0", "0.013,0.03,0.7", "0.01,0.01,1.1", "0.03,0.02,2.2", "0.02,0.04,5"];
    let mut shares = starts.map(|start| {
        let output = map(log.to_str().unwrap(), &out, &[&format!("--start={start}")]);
        let said = text(&output.stdout).to_owned();
        let (_, share) = said.split_once("tracking ").unwrap_or_else(|| panic!("{said}"));
        share.split(' ').next().unwrap().parse::<f64>().unwrap()
    });
    shares.sort_by(f64::total_cmp);
    Some(shares[2])
}

#[test]
fn a_lidar_at_five_hertz_behind_a_person_is_tracked() {
    for (name, at_least) in [
        ("cases/deskew_makes_worse/neato_deskew_makes_worse.bag", 96.0),
        ("2d_small/ariana_person1.bag", 96.0),
        ("2d_small/mink_test.bag", 98.6),
        ("2d_small/mink_wall.bag", 98.8),
        ("2d_small/mink_square.bag", 96.0),
    ] {
        let Some(share) = tracked(name) else { continue };
        assert!(share >= at_least, "{name}: {share} % tracked");
    }
}

#[test]
fn the_case_of_a_laser_turned_by_180_degrees() {
    for (name, turned_deg) in [("y135", 135.0), ("y180", 180.0)] {
        let Some(log) = shared_data(&format!("cases/laser_turned_180/{name}.bag")) else { continue };
        let found = run(&["calibrate", log.to_str().unwrap(), "--json"]);
        assert_code(&found, 0);
        let value: Value = serde_json::from_slice(&found.stdout).unwrap();
        let off_deg =
            (value["yaw_rad"]["value"].as_f64().unwrap().to_degrees() - turned_deg + 180.0).rem_euclid(360.0) - 180.0;
        assert!(off_deg.abs() < 1.0, "{name}: {off_deg} deg off");
        let out = folder(&format!("case_{name}"));
        let said = text(&map(log.to_str().unwrap(), &out, &[]).stdout).to_owned();
        assert!(said.starts_with("check") && said.contains("deg beside"), "{name}: {said}");
    }
}
