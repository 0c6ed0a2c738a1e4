//! Bags, MCAP files and several logs in a row: what is found, used, refused and lost.

use crate::real_logs::shared_data;
use crate::robot::Robot;
use crate::support::{apart_m, assert_code, assert_refused, folder, json, map, poses, run, run_with_input, text};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

fn bag(name: &str) -> Option<String> {
    shared_data(&format!("ros_bags/{name}")).map(|path| path.display().to_string())
}

/// ATE of a run's trajectory, metres.
fn ate_m(out: &Path, reference: &Path) -> f64 {
    let trajectory = out.join("trajectory.tum");
    let args = ["eval", trajectory.to_str().unwrap(), "--reference", reference.to_str().unwrap(), "--json"];
    let eval = run(&args);
    assert_code(&eval, 0);
    let value: serde_json::Value = serde_json::from_slice(&eval.stdout).unwrap();
    value[0]["ate"]["translation_m"]["rmse"].as_f64().unwrap()
}

fn assert_says(output: &Output, says: &[&str]) {
    let said = text(&output.stdout);
    says.iter().for_each(|what| assert!(said.contains(what), "expected {what:?}, found {said:?}"));
}

#[test]
fn the_same_drive_from_any_container_is_the_same_trajectory() {
    let folder = folder("containers");
    let names = ["intel_180s.bag", "intel_180s_db3", "intel_180s_mcap"];
    let mut outs: Vec<PathBuf> = Vec::new();
    for name in names {
        let Some(log) = bag(&format!("derived_intel/{name}")) else { return };
        outs.push(folder.join(name));
        let output = map(&log, &folder.join(name), &[]);
        assert_code(&output, 0);
        assert_says(&output, &["/scan", "/odom", "'base_link'", "assumed", "no transform says where 'laser' sits"]);
    }
    for other in &outs[1..] {
        let apart_m = apart_m(&outs[0], other);
        assert!(apart_m < 1e-6, "{apart_m} m");
        assert_eq!(poses(&outs[0]).len(), 913);
    }
}

/// The lines of the intel log that are in the bags.
fn carmen_180s(folder: &Path) -> Option<String> {
    let packed = shared_data("2d_benchmark/intel.clf.bz2")?;
    let mut log = String::new();
    std::io::Read::read_to_string(&mut bzip2::read::MultiBzDecoder::new(fs::File::open(packed).unwrap()), &mut log)
        .unwrap();
    let stamp = |line: &str| line.split_whitespace().rev().nth(2).and_then(|word| word.parse::<f64>().ok());
    let events = log.lines().filter(|line| line.starts_with("ODOM") || line.starts_with("FLASER"));
    let first = events.clone().find_map(stamp).unwrap();
    let early: Vec<_> = events.filter(|line| stamp(line).is_some_and(|stamp| stamp <= first + 180.0)).collect();
    let path = folder.join("first_180s.clf");
    fs::write(&path, early.join("\n") + "\n").unwrap();
    Some(path.display().to_string())
}

#[test]
fn carmen_and_a_bag_of_the_same_drive_agree_and_their_input_is_compared() {
    let folder = folder("carmen_and_bag");
    let (Some(log), Some(carmen)) = (bag("derived_intel/intel_180s.bag"), carmen_180s(&folder)) else { return };
    let (from_bag, from_carmen) = (folder.join("bag"), folder.join("carmen"));
    assert_code(&map(&log, &from_bag, &[]), 0);
    assert_code(&map(&carmen, &from_carmen, &[]), 0);
    let ate_m = ate_m(&from_bag, &from_carmen.join("trajectory.tum"));
    assert!(ate_m <= 0.05, "{ate_m} m");

    let info = run(&["info", &carmen, &log]);
    assert_code(&info, 0);
    assert_says(&info, &["same     scans: 913", "as well: 913 of 913", "largest range: 80.0000 and 81.0000 m"]);
    let value: serde_json::Value = serde_json::from_slice(&run(&["info", &carmen, &log, "--json"]).stdout).unwrap();
    let most_m = value["differences"]["odometry_step_most_m"].as_f64().unwrap();
    assert!((0.2..0.3).contains(&most_m), "{most_m} m");
}

#[test]
fn recordings_without_a_plane_to_map_are_refused_with_what_is_there() {
    let folder = folder("nothing_to_map");
    let no_scans = "expected laser scans, found no topic of LaserScan";
    for (name, says) in [
        ("evo/nav2_turtlebot.mcap", &[no_scans, "/odom (nav_msgs/msg/Odometry, 2,639)"][..]),
        ("evo/ROS_example.bag", &[no_scans, "groundtruth (geometry_msgs/PoseStamped, 12,765)"]),
        ("evo/tf_example", &[no_scans, "/tf (tf2_msgs/msg/TFMessage, 517)"]),
        ("plotjuggler/rosbag2_test", &[no_scans, "/imu (sensor_msgs/msg/Imu, 1,565)"]),
    ] {
        let Some(log) = bag(name) else { return };
        assert_refused(&map(&log, &folder.join("out"), &[]), 1, says);
        assert!(!folder.join("out").exists(), "{name}");
        let info = run(&["info", &log]);
        assert_code(&info, 0);
        assert_says(&info, &["topic ", "no map ", says[0]]);
    }
}

#[test]
fn a_real_laser_that_tilts_is_mapped_in_space() {
    let Some(log) = bag("plotjuggler/tilt_laser.bag") else { return };
    let folder = folder("tilting");
    let output = map(&log, &folder.join("out"), &[]);
    assert_code(&output, 0);
    assert_says(&output, &["swings of the laser of /scan in ROS 1 bag, 2 clouds", "'tilt_axis' swings in 'tilt_base'"]);
    // half a turn, and what is left of the second one, from a robot that stands
    let poses = fs::read_to_string(folder.join("out/trajectory.tum")).unwrap();
    let last: Vec<f64> = poses.lines().last().unwrap().split(' ').map(|word| word.parse().unwrap()).collect();
    assert!(last[1..4].iter().all(|part| part.abs() < 0.1), "{last:?}");
}

#[test]
fn a_real_laser_without_odometry_is_mapped() {
    let Some(log) = bag("scan_tools/laser_scan_matcher_demo.bag") else { return };
    let output = map(&log, &folder("no_odometry"), &[]);
    assert_code(&output, 0);
    assert_says(&output, &["tracking 100.00 %", "odometry none in the log", "odd      irregular", "byte 792650"]);
}

#[test]
fn mounting_is_found_even_where_it_is_said_last_and_upside_down() {
    let folder = folder("upside_down");
    let (plain, hanging) = (folder.join("plain"), folder.join("hanging"));
    let log = Robot::default().record(&folder.join("plain.mcap"));
    let output = map(&log, &plain, &[]);
    assert_code(&output, 0);
    assert_says(&output, &["upright", "/odom (nav_msgs/msg/Odometry", "preferred to the transforms"]);
    let robot = Robot { laser_roll_pitch: [std::f64::consts::PI, 0.0], ..Robot::default() };
    let output = map(&robot.record(&folder.join("hanging.mcap")), &hanging, &[]);
    assert_code(&output, 0);
    assert_says(&output, &["upside down"]);
    assert!(!text(&output.stdout).contains("assumed"));
    for name in ["plain", "hanging"] {
        let ate_m = ate_m(&folder.join(name), &folder.join(format!("{name}.tum")));
        assert!(ate_m < 0.02, "{name}: {ate_m} m");
    }
}

#[test]
fn odometry_comes_from_transforms_where_there_are_no_messages() {
    let folder = folder("transforms");
    let robot = Robot { odometry_messages: false, ..Robot::default() };
    let (by_messages, by_transforms) = (folder.join("messages"), folder.join("transforms"));
    assert_code(&map(&Robot::default().record(&folder.join("a.mcap")), &by_messages, &[]), 0);
    let output = map(&robot.record(&folder.join("b.mcap")), &by_transforms, &[]);
    assert_code(&output, 0);
    assert_says(&output, &["odometry the transforms 'odom' -> 'base_link'"]);
    assert!(apart_m(&by_messages, &by_transforms) < 1e-6);
    let asked = map(&folder.join("a.mcap").display().to_string(), &folder.join("asked"), &["--topic", "/tf"]);
    assert_code(&asked, 0);
    assert_says(&asked, &["odometry the transforms"]);
}

#[test]
fn a_laser_that_is_mounted_tilted_is_refused_in_degrees() {
    let folder = folder("tilted");
    let robot = Robot { laser_roll_pitch: [0.0, 0.5], to_s: 3.0, ..Robot::default() };
    let log = robot.record(&folder.join("tilted.mcap"));
    assert_refused(&map(&log, &folder.join("out"), &[]), 1, &["/scan", "tilted by 28.6 deg", "base_link"]);
    let other = map(&log, &folder.join("out"), &["--frame", "laser"]);
    assert_code(&other, 0);
    assert_says(&other, &["'laser', as asked for"]);
    assert_refused(&map(&log, &folder.join("out"), &["--frame", "nose"]), 1, &["'nose'", "base_link"]);
    assert_refused(&map(&log, &folder.join("out"), &["--topic", "/lidar"]), 1, &["no topic /lidar", "/scan"]);
}

#[test]
fn clouds_are_mapped_as_a_slice_where_that_is_asked_for() {
    let folder = folder("clouds");
    let log = Robot { clouds: true, says_times: false, ..Robot::default() }.record(&folder.join("clouds.mcap"));
    let output = map(&log, &folder.join("out"), &["--slice", "0.1:1.0"]);
    assert_code(&output, 0);
    assert_says(&output, &["/points", "tracking", "motion   not undone"]);
    assert_eq!(json(&folder.join("out/report.json"))["status"]["lost"], 0);
    assert_code(&map(&log, &folder.join("wrong"), &["--slice", "2:1"]), 2);
}

#[test]
fn clouds_are_mapped_in_space_where_there_are_no_scans() {
    let folder = folder("in_space");
    let robot = Robot { clouds: true, says_times: false, to_s: 15.0, ..Robot::default() };
    let log = robot.record(&folder.join("clouds.mcap"));
    let info = run(&["info", &log]);
    assert_code(&info, 0);
    assert_says(&info, &["space    /points can be mapped", &format!("mapwright map {log} --space -o OUT")]);
    let output = map(&log, &folder.join("out"), &[]);
    assert_says(&output, &["clouds of /points in MCAP", "clouds   /points", "odometry /odom", "tracked ", "map.ply"]);
    let report = json(&folder.join("out/report.json"));
    assert_eq!(report["clouds"], report["recording"]["frames"]);
    let asked = map(&log, &folder.join("asked"), &["--space", "--quiet"]);
    assert_eq!(asked.status.code(), output.status.code());
    assert_code(&map(&log, &folder.join("both"), &["--space", "--slice", "0.1:1"]), 2);
    let scans = Robot { to_s: 2.0, ..Robot::default() }.record(&folder.join("scans.mcap"));
    assert_refused(
        &map(&scans, &folder.join("none"), &["--space"]),
        1,
        &["expected clouds, images of depth or scans of a laser that tilts", "/scan"],
    );
    assert_refused(&run(&["map", &log, &scans, "--space", "-o", &log]), 1, &["expected one recording"]);
    assert!(!folder.join("none").exists());
}

#[test]
fn logs_of_one_drive_in_a_row_are_one_drive() {
    let folder = folder("in_a_row");
    let whole = Robot::default().record(&folder.join("whole.mcap"));
    let first = Robot { to_s: 15.0, ..Robot::default() }.record(&folder.join("first.mcap"));
    let second = Robot { from_s: 15.01, says_mounting: false, ..Robot::default() }.record(&folder.join("second.mcap"));
    let (one, two) = (folder.join("one"), folder.join("two"));
    assert_code(&map(&whole, &one, &[]), 0);
    let output = run(&["map", &first, &second, "-o", two.to_str().unwrap()]);
    assert_code(&output, 0);
    assert_says(&output, &["odometry goes on", "first.mcap", "second.mcap"]);
    assert!(!text(&output.stdout).contains("assumed"), "frames of the first hold for the second");
    let (whole, parts) = (poses(&one), poses(&two));
    let last = |poses: &[Vec<f64>]| poses.last().map(|pose| (pose[1], pose[2])).unwrap();
    let apart_m = (last(&whole).0 - last(&parts).0).hypot(last(&whole).1 - last(&parts).1);
    assert!(apart_m < 0.01, "{apart_m} m");

    let again = run(&["map", &first, &first, "-o", folder.join("again").to_str().unwrap()]);
    assert_refused(&again, 1, &["first.mcap cannot follow", "before that ends", "mapwright merge"]);
}

#[test]
fn a_damaged_recording_is_used_up_to_the_damage_which_is_told_with_its_offset() {
    let folder = folder("damaged");
    let log = Robot::default().record(&folder.join("whole.mcap"));
    let bytes = fs::read(log).unwrap();
    let cut = folder.join("cut.mcap");
    fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let output = map(cut.to_str().unwrap(), &folder.join("out"), &[]);
    assert_code(&output, 3);
    assert_says(&output, &["lost     truncated", "byte "]);
    let report = json(&folder.join("out/report.json"));
    assert!(report["read"]["scans"].as_u64().unwrap() > 20, "{report}");
    let streamed = run_with_input(&["map", "-", "-o", folder.join("out").to_str().unwrap()], &bytes);
    assert_refused(&streamed, 1, &["found a stream: recordings are read twice"]);
    let losses = report["losses"].as_array().unwrap();
    assert!(losses.iter().any(|loss| loss.as_str().unwrap().contains("first at byte ")), "{losses:?}");
    let damage = &report["read"]["damages"][0]["first"][0];
    assert!(damage.as_str().unwrap().starts_with("byte "), "{damage}");
    assert_code(&run(&["info", cut.to_str().unwrap()]), 3);
}

/// ATE of a drive with fast turns and sweeps of 90 ms, with the times of beams or points and without.
fn errors_of_fast_turns(name: &str, clouds: bool, more: &[&str]) -> [f64; 2] {
    let folder = folder(name);
    [true, false].map(|says_times| {
        let name = format!("times_{says_times}");
        let (path, out) = (folder.join(&name).with_extension("mcap"), folder.join(&name));
        let robot = Robot { sweep_s: 0.09, says_times, clouds, turn_rate_rad_per_s: 2.5, ..Robot::default() };
        let output = map(&robot.record(&path), &out, more);
        assert_code(&output, 0);
        assert_says(&output, &[if says_times { "motion   undone" } else { "motion   not undone" }]);
        ate_m(&out, &path.with_extension("tum"))
    })
}

#[test]
fn time_increment_undoes_fast_turns() {
    let [with_m, without_m] = errors_of_fast_turns("fast_turns", false, &[]);
    assert!(with_m < 0.02 && with_m < 0.5 * without_m, "{with_m} m with times, {without_m} m without");
}

#[test]
fn times_of_points_undo_fast_turns() {
    let [with_m, without_m] = errors_of_fast_turns("fast_clouds", true, &["--slice", "0.1:1.0"]);
    assert!(with_m < 0.02 && with_m < 0.5 * without_m, "{with_m} m with times, {without_m} m without");
}
