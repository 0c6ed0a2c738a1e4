//! Everything that can be wrong: a clear message, the right exit code, and whatever could be used is used.

use crate::support::{assert_code, assert_refused, folder, json, run, run_with_input, small_log, small_log_in, text};
use flate2::Compression;
use flate2::write::GzEncoder;
use std::fs;
use std::io::Write;
use std::path::Path;

/// Maps bytes as a file of this name.
fn map(folder: &Path, name: &str, bytes: &[u8]) -> std::process::Output {
    let (log, out) = (folder.join(name), folder.join("out"));
    fs::write(&log, bytes).unwrap();
    run(&["map", log.to_str().unwrap(), "-o", out.to_str().unwrap()])
}

#[test]
fn files_without_a_scan_are_refused_and_leave_nothing() {
    let folder = folder("no_scan");
    assert_refused(&map(&folder, "empty.clf", b""), 1, &["empty.clf", "expected laser scans", "empty file"]);
    let binary: Vec<u8> = (0..40_000_u32).map(|k| (k.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    assert_refused(&map(&folder, "binary.clf", &binary), 1, &["binary.clf", "expected laser scans", "line 1"]);
    let odometry = b"ODOM 1 0 0 0 0 0 12.5 host 0.1\n";
    assert_refused(&map(&folder, "odom.clf", odometry), 1, &["odom.clf", "1 odometry reading"]);
    assert!(!folder.join("out").exists());
}

#[test]
fn a_log_that_is_missing_or_a_directory_is_refused() {
    let folder = folder("not_a_log");
    let out = folder.join("out").display().to_string();
    let missing = folder.join("missing.clf").display().to_string();
    assert_refused(&run(&["map", &missing, "-o", &out]), 1, &["missing.clf", "No such file"]);
    let directory = folder.display().to_string();
    assert_refused(&run(&["map", &directory, "-o", &out]), 1, &["not_a_log", "found a directory"]);
    assert_refused(&run(&["info", &directory]), 1, &["found a directory"]);
    assert!(!folder.join("out").exists());
}

#[test]
fn a_cut_log_is_mapped_up_to_the_cut() {
    let folder = folder("cut");
    let cut = &small_log()[..small_log().len() * 2 / 3 + 7];
    let output = map(&folder, "cut.clf", cut);
    assert_code(&output, 3);
    assert!(text(&output.stdout).contains("truncated last line"));
    assert_eq!(json(&folder.join("out/report.json"))["read"]["dropped_lines"], 1);
}

#[test]
fn a_torn_stream_is_mapped_up_to_the_tear() {
    let folder = folder("torn");
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(small_log()).unwrap();
    let packed = encoder.finish().unwrap();
    let output = map(&folder, "torn.clf.gz", &packed[..packed.len() / 2]);
    assert_code(&output, 3);
    assert!(text(&output.stdout).contains("torn at byte"));
    assert!(json(&folder.join("out/report.json"))["read"]["scans"].as_u64().unwrap() > 50);
}

#[test]
fn flipped_bits_cost_lines_and_nothing_else() {
    let folder = folder("flipped");
    for seed in 0..6_u64 {
        let mut bytes = small_log()[..200_000].to_vec();
        let mut state = seed + 1;
        for _ in 0..60 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let at = (state >> 20) as usize % bytes.len();
            bytes[at] ^= 1 << (state >> 61);
        }
        let output = map(&folder, "flipped.clf", &bytes);
        assert_code(&output, 3);
        assert!(json(&folder.join("out/report.json"))["status"]["tracking"].as_u64().unwrap() > 20);
    }
}

#[test]
fn hostile_lines_are_dropped_with_line_and_reason() {
    let folder = folder("hostile");
    let hostile = "FLASER 3 1.0 2.0\nFLASER 0 0 0 0 0 0 0 1.0 host 1.0\nFLASER 1000001 1.0 0 0 0 0 0 0 1.0 host 1.0\n\
                   ODOM nan 0 0 0 0 0 1.0 host 1.0\nODOM 1e300 0 0 0 0 0 1.0 host 1.0\nODOM x 0 0 0 0 0 1.0 host 1.0\n";
    let bytes = [hostile.as_bytes(), small_log()].concat();
    let output = map(&folder, "hostile.clf", &bytes);
    assert_code(&output, 3);
    let said = text(&output.stdout);
    assert!(said.contains("first line 1") && said.contains("bad number of beams"), "{said}");
    assert_eq!(json(&folder.join("out/report.json"))["read"]["dropped_lines"], 6);
}

#[test]
fn readings_that_make_no_sense_are_survived() {
    let folder = folder("nonsense");
    let poses = ["0 0 0", "1000 0 0", "1000 1000 3", "nan nan nan", "-999999 999999 1e5"];
    let ranges = ["1 1 1", "nan inf -inf", "-1 0 1e30", "1e300 0.001 80", "30 30 30"];
    let mut log = String::new();
    for (k, (pose, range)) in poses.iter().cycle().zip(ranges.iter().cycle().skip(1)).take(60).enumerate() {
        log += &format!("FLASER 3 {range} {pose} {pose} {} host 0\n", [1e9, 5.0, 5.0, -7.0][k % 4]);
    }
    let output = map(&folder, "nonsense.clf", log.as_bytes());
    assert!(matches!(output.status.code(), Some(0 | 1 | 3)), "{output:?}");
    assert!(!text(&output.stderr).contains("panicked"), "{output:?}");
}

#[test]
fn a_folder_that_cannot_be_made_is_told_before_the_log_is_read() {
    let folder = folder("no_folder");
    let log = small_log_in(&folder);
    for out in [log.clone(), format!("{log}/out")] {
        assert_refused(&run(&["map", &log, "-o", &out]), 1, &["cannot write", "small.clf"]);
    }
    let piped = run_with_input(&["map", "-", "-o", &log], small_log());
    assert_refused(&piped, 1, &["cannot write", "expected a folder"]);
}

/// The names under which files are written at first lead to a device that is always full.
#[cfg(unix)]
#[test]
fn a_full_disk_is_told_with_the_file_and_leaves_old_results_alone() {
    if !Path::new("/dev/full").exists() {
        eprintln!("a full disk: skipped: no /dev/full");
        return;
    }
    for name in ["session.mapwright", "trajectory_online.tum", "trajectory.tum", "map.pgm", "map.png", "report.json"] {
        let folder = folder(&format!("full_{name}"));
        let (log, out) = (small_log_in(&folder), folder.join("out"));
        fs::create_dir(&out).unwrap();
        fs::write(out.join("map.yaml"), "old").unwrap();
        std::os::unix::fs::symlink("/dev/full", out.join(format!("{name}.part"))).unwrap();
        let output = run(&["map", &log, "-o", out.to_str().unwrap()]);
        assert_refused(&output, 1, &["cannot write", name, "No space left"]);
        // What was mapped stays, to go on with, unless that is what cannot be written.
        let is_kept = name != "session.mapwright";
        assert_eq!(out.join("session.mapwright.part").exists(), is_kept, "{name}");
        assert_eq!(fs::read_dir(&out).unwrap().count(), 1 + usize::from(is_kept), "{name}: parts are left behind");
        assert_eq!(fs::read_to_string(out.join("map.yaml")).unwrap(), "old");
    }
}

#[test]
fn wrong_usage_ends_with_two_and_says_what_is_wrong() {
    let folder = folder("usage");
    let log = small_log_in(&folder);
    let out = folder.join("out").display().to_string();
    let map = |more: &[&str]| run(&[&["map", log.as_str(), "-o", out.as_str()], more].concat());
    assert_refused(&map(&["--set", "map.colour=1"]), 2, &["map.colour"]);
    assert_refused(&map(&["--set", "map.resolution_m=9"]), 2, &["map.resolution_m", "9"]);
    assert_refused(&map(&["--set", "map.resolution_m"]), 2, &["KEY=VALUE"]);
    assert_refused(&map(&["--start", "1,2"]), 2, &["three numbers"]);
    assert_refused(&map(&["--threads", "0"]), 2, &["--threads"]);
    assert_refused(&run(&["eval", &log]), 2, &["--relations"]);
    let config = folder.join("wrong.toml");
    fs::write(&config, "[map]\nresolution = 0.1\n").unwrap();
    assert_refused(&map(&["--config", config.to_str().unwrap()]), 2, &["wrong.toml", "line 2", "resolution"]);
    assert!(!Path::new(&out).exists());
}
