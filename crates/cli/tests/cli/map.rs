//! `mapwright map` on logs that are as they should be.

use crate::support::{
    SAME_BYTES, assert_code, folder, json, picture_size, run, run_with_input, small_log, small_log_in, spawn, text,
};
use flate2::Compression;
use flate2::write::GzEncoder;
use std::fs;
use std::io::Write;
use std::path::Path;

#[test]
fn two_runs_and_any_number_of_threads_give_the_same_bytes() {
    let folder = folder("same_bytes");
    let log = small_log_in(&folder);
    for (name, threads) in [("one", "1"), ("again", "1"), ("two", "2")] {
        let out = folder.join(name).display().to_string();
        assert_code(&run(&["map", &log, "-o", &out, "--threads", threads]), 0);
    }
    for name in SAME_BYTES {
        let read = |run: &str| fs::read(folder.join(run).join(name)).unwrap();
        assert!(read("one") == read("again") && read("one") == read("two"), "{name} differs");
    }
}

#[test]
fn the_stages_of_a_run_take_all_of_its_time() {
    let folder = folder("stages");
    let (log, out) = (small_log_in(&folder), folder.join("out"));
    assert_code(&run(&["map", &log, "-o", out.to_str().unwrap()]), 0);
    let timing = json(&out.join("timing.json"));
    let stages = timing["stages_s"].as_object().unwrap();
    let names: Vec<&str> = stages.keys().map(String::as_str).collect();
    assert_eq!(names, ["read", "prepare", "predict", "match", "insert", "close", "write"]);
    let sum: f64 = stages.values().map(|seconds| seconds.as_f64().unwrap()).sum();
    let total = timing["total_s"].as_f64().unwrap();
    assert!((sum - total).abs() < 1e-6 && stages["match"].as_f64() > Some(0.0), "{sum} of {total} s");
}

#[test]
fn every_scan_has_a_line_and_the_last_lines_say_what_was_made() {
    let folder = folder("every_scan");
    let (log, out) = (small_log_in(&folder), folder.join("out"));
    let output = run(&["map", &log, "-o", out.to_str().unwrap(), "--align", "walls"]);
    assert_code(&output, 0);
    let scans = text(small_log()).lines().filter(|line| line.starts_with("ROBOTLASER1")).count();
    let lines = |name: &str| fs::read_to_string(out.join(name)).unwrap().lines().count();
    assert_eq!((lines("trajectory.tum"), lines("trajectory_online.tum")), (scans, scans));
    let said = text(&output.stdout);
    for what in ["scans over 40", "keyframes", "tracking", "real time", "map.png"] {
        assert!(said.contains(what), "expected {what:?}, found {said:?}");
    }
    assert!(output.stderr.is_empty(), "a bar where there is no terminal");
    let report = json(&out.join("report.json"));
    assert_eq!(report["read"]["scans"], scans);
    assert!(report["status"]["tracking"].as_u64().unwrap() as usize > scans * 9 / 10);
    assert!(fs::read_to_string(out.join("map.yaml")).unwrap().contains("image: map.pgm"));
}

#[test]
fn plain_gzip_and_standard_input_give_the_same_trajectory() {
    let folder = folder("streams");
    let log = small_log_in(&folder);
    let packed = folder.join("small.clf.gz");
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(small_log()).unwrap();
    fs::write(&packed, encoder.finish().unwrap()).unwrap();
    let out = |name: &str| folder.join(name).display().to_string();
    assert_code(&run(&["map", &log, "-o", &out("plain"), "--quiet"]), 0);
    assert_code(&run(&["map", packed.to_str().unwrap(), "-o", &out("gzip"), "--quiet"]), 0);
    let piped = run_with_input(&["map", "-", "-o", &out("piped"), "--quiet"], small_log());
    assert_code(&piped, 0);
    assert!(piped.stdout.is_empty() && piped.stderr.is_empty());
    let trajectory = |name: &str| fs::read(folder.join(name).join("trajectory.tum")).unwrap();
    assert!(trajectory("plain") == trajectory("gzip") && trajectory("plain") == trajectory("piped"));
}

#[test]
fn start_pose_and_missing_odometry_are_as_asked_for() {
    let folder = folder("start");
    let (log, out) = (small_log_in(&folder), folder.join("out"));
    let args = ["map", &log, "-o", out.to_str().unwrap(), "--start", "-3,4.5,0.5", "--no-odometry", "--json"];
    let output = run(&args);
    assert_code(&output, 0);
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(value["report"]["settings"]["motion"]["use_odometry"], false);
    assert!(value["timing"]["scans_per_second"].as_f64().unwrap() > 0.0);
    let trajectory = fs::read_to_string(out.join("trajectory.tum")).unwrap();
    assert!(trajectory.lines().next().unwrap().contains(" -3.000000000 4.500000000 0.000000000 "));
}

#[test]
fn stamps_that_step_back_are_kept_or_repaired() {
    let folder = folder("stamps");
    let lines: Vec<String> = text(small_log()).lines().map(str::to_owned).collect();
    let mut lines: Vec<_> = lines.into_iter().filter(|line| !line.starts_with("ODOM")).collect();
    let last = lines.len() - 1;
    // the robot drives as the lines stand, and their stamps are wrong
    let stamp = |line: &str| line.rsplitn(4, ' ').take(3).map(str::to_owned).collect::<Vec<_>>();
    let with_stamp = |line: &str, [logged, host, stamp]: [&String; 3]| {
        format!("{} {stamp} {host} {logged}", line.rsplitn(4, ' ').last().unwrap())
    };
    let [before, after] = [stamp(&lines[last - 1]), stamp(&lines[last])];
    lines[last - 1] = with_stamp(&lines[last - 1], [&after[0], &after[1], &after[2]]);
    lines[last] = with_stamp(&lines[last], [&before[0], &before[1], &before[2]]);
    let log = folder.join("back.clf");
    fs::write(&log, lines.join("\n") + "\n").unwrap();
    for (policy, increasing) in [("log", false), ("repaired", true)] {
        let out = folder.join(policy);
        let output = run(&["map", log.to_str().unwrap(), "-o", out.to_str().unwrap(), "--stamps", policy]);
        assert_code(&output, 0);
        assert!(text(&output.stdout).contains("step backwards"));
        assert_eq!(stamps(&out.join("trajectory.tum")).is_sorted(), increasing);
        assert_eq!(stamps(&out.join("trajectory_online.tum")).is_sorted(), increasing);
    }
}

#[test]
fn lines_that_were_written_late_are_put_in_order() {
    let folder = folder("late_lines");
    let mut lines: Vec<String> = text(small_log()).lines().map(str::to_owned).collect();
    for at in (60..lines.len()).step_by(12) {
        lines.swap(at, at - 5);
    }
    let log = folder.join("late.clf");
    fs::write(&log, lines.join("\n") + "\n").unwrap();
    let mapped = |log: &str, name: &str| {
        let out = folder.join(name);
        let output = run(&["map", log, "-o", out.to_str().unwrap()]);
        assert_code(&output, 0);
        (text(&output.stdout), fs::read(out.join("trajectory.tum")).unwrap())
    };
    let (said, late) = mapped(log.to_str().unwrap(), "late");
    let (clean_said, clean) = mapped(&small_log_in(&folder), "clean");
    let order = "in another order than they were taken in";
    assert!(said.contains(order) && !clean_said.contains(order), "{said}");
    assert!(late == clean, "the same trajectory to the byte");
}

fn stamps(path: &Path) -> Vec<f64> {
    let text = fs::read_to_string(path).unwrap();
    text.lines().map(|line| line.split(' ').next().unwrap().parse().unwrap()).collect()
}

#[test]
fn the_gated_live_map_exports_everything_that_was_seen() {
    let folder = folder("gated");
    let log = small_log_in(&folder);
    let bytes = |name: &str, policy: &str| {
        let out = folder.join(name);
        assert_code(&run(&["map", &log, "-o", out.to_str().unwrap(), "--set", policy]), 0);
        fs::metadata(out.join("map.pgm")).unwrap().len()
    };
    let (all, gated) = (bytes("all", "live.policy=everything"), bytes("gated", "live.policy=gated"));
    assert!(gated > all / 2, "{gated} of {all}");
}

#[cfg(unix)]
#[test]
fn ctrl_c_leaves_the_complete_map_so_far() {
    let folder = folder("ctrl_c");
    let out = folder.join("out");
    let mut child = spawn(&["map", "-", "-o", out.to_str().unwrap()]);
    let mut stdin = child.stdin.take().unwrap();
    let half = small_log().len() / 2;
    let half = half + small_log()[half..].iter().position(|&b| b == b'\n').unwrap() + 1;
    stdin.write_all(&small_log()[..half]).unwrap();
    while !out.join("trajectory_online.tum.part").exists() {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let killed = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(killed.success());
    let _ = stdin.write_all(&small_log()[half..]);
    drop(stdin);
    let output = child.wait_with_output().unwrap();
    assert_code(&output, 3);
    assert!(text(&output.stdout).contains("interrupted"));
    SAME_BYTES.iter().for_each(|name| assert!(out.join(name).exists(), "{name}"));
}

#[test]
fn a_picture_has_the_side_that_is_asked_for() {
    let folder = folder("picture_side");
    let (log, out) = (small_log_in(&folder), folder.join("out"));
    for more in [&["--picture-side", "900"][..], &["--picture-side", "1201", "--align", "walls"]] {
        assert_code(&run(&[&["map", &log, "-o", out.to_str().unwrap(), "--quiet"], more].concat()), 0);
        let longer = picture_size(&out.join("map.png")).into_iter().max().unwrap();
        assert_eq!(longer.to_string(), more[1]);
    }
}

#[test]
fn the_picture_alone_is_turned_upright() {
    let folder = folder("upright");
    let (log, out) = (small_log_in(&folder), |name: &str| folder.join(name));
    let map = |name: &str, more: &[&str]| {
        let fixed =
            ["map", &log, "-o", out(name).to_str().unwrap(), "--quiet", "--start", "0,0,0.4"].map(str::to_owned);
        let arguments: Vec<&str> = fixed.iter().map(String::as_str).chain(more.iter().copied()).collect();
        assert_code(&run(&arguments), 0);
        json(&out(name).join("report.json"))["map"]["wall_angle_rad"].as_f64()
    };
    let (turned, left) = (map("turned", &[]), map("left", &["--align", "none"]));
    assert!(turned.is_some_and(|angle_rad| angle_rad.abs() > 0.05) && left.is_none(), "{turned:?} {left:?}");
    let same = |file: &str| fs::read(out("turned").join(file)).unwrap() == fs::read(out("left").join(file)).unwrap();
    assert!(["map.pgm", "map.yaml", "trajectory.tum", "graph.g2o"].into_iter().all(same) && !same("map.png"));
}

#[test]
fn the_length_of_the_way_is_that_of_the_trajectory() {
    let folder = folder("way_length");
    let (log, out) = (small_log_in(&folder), folder.join("out"));
    assert_code(&run(&["map", &log, "-o", out.to_str().unwrap(), "--quiet"]), 0);
    let rows = fs::read_to_string(out.join("trajectory.tum")).unwrap();
    let place = |row: &str| {
        let numbers: Vec<f64> = row.split(' ').map(|number| number.parse().unwrap()).collect();
        [numbers[1], numbers[2]]
    };
    let places: Vec<[f64; 2]> = rows.lines().filter(|row| !row.starts_with('#')).map(place).collect();
    let length_m: f64 = places.windows(2).map(|p| (p[1][0] - p[0][0]).hypot(p[1][1] - p[0][1])).sum();
    let told_m = json(&out.join("report.json"))["path_m"].as_f64().unwrap();
    assert!((told_m - length_m).abs() < 1e-3 * length_m, "{told_m} m beside {length_m} m");
}
