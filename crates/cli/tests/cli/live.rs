//! `mapwright live`: a recording that is played as if the robot drove.

use crate::space_imu::record_part;
use crate::support::{assert_code, assert_refused, folder, run, small_log_in, spawn, text};
use std::fs;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

/// Nothing is dropped where the mapper keeps up, and then live is as from the log, to the byte, where closures are looked for in between. Jobs
/// beside the mapper close the same loops, a scan sooner or later. Twice the recording's pace is slow enough for a busy machine.
#[test]
fn what_is_played_is_mapped_as_from_the_log() {
    let folder = folder("live_played");
    let log = small_log_in(&folder);
    let [live, beside, map] = ["live", "beside", "map"].map(|name| folder.join(name).display().to_string());
    let inline = spawn(&["live", &log, "--rate", "2", "-o", &live, "--set", "loops.jobs=inline"]);
    let handed_out = spawn(&["live", &log, "--rate", "2", "-o", &beside]);
    assert_code(&run(&["map", &log, "-o", &map, "--quiet"]), 0);
    let [inline, handed_out] = [inline, handed_out].map(|child| child.wait_with_output().unwrap());
    assert_code(&inline, 0);
    assert_code(&handed_out, 0);
    for name in ["trajectory.tum", "trajectory_online.tum", "session.mapwright", "map.pgm"] {
        let read = |run: &str| fs::read(Path::new(run).join(name)).unwrap();
        assert!(read(&live) == read(&map), "{name} differs: {}", text(&inline.stdout));
    }
    // However fast it is replayed, what came of the jobs is taken in where it was.
    let again = folder.join("again").display().to_string();
    assert_code(&run(&["live", &log, "--rate", "50", "--replay", &beside, "-o", &again]), 0);
    for name in ["trajectory.tum", "trajectory_online.tum", "session.mapwright", "map.pgm"] {
        let read = |run: &str| fs::read(Path::new(run).join(name)).unwrap();
        assert!(read(&again) == read(&beside), "{name} differs");
    }
    // With other settings, or without all of what it heard, it is no replay.
    let other = ["live", &log, "--replay", &beside, "-o", &again, "--set", "loops.by_place=false"];
    assert_refused(&run(&other), 1, &["settings"]);
    let short = folder.join("short.clf");
    let whole = fs::read_to_string(&log).unwrap();
    fs::write(&short, whole.lines().take(whole.lines().count() / 2).collect::<Vec<_>>().join("\n")).unwrap();
    let short = run(&["live", short.to_str().unwrap(), "--rate", "50", "--replay", &beside, "-o", &again]);
    assert_code(&short, 3);
    assert!(text(&short.stdout).contains("not the same run: "), "{}", text(&short.stdout));
    let lines = |run: &str| fs::read_to_string(Path::new(run).join("trajectory.tum")).unwrap().lines().count();
    assert_eq!(lines(&beside), lines(&map));
}

/// Clouds as well, with what an inertial sensor feels between them.
#[test]
fn clouds_that_are_played_are_mapped_as_from_the_recording() {
    let folder = folder("live_clouds");
    let recording = folder.join("drive.mcap");
    record_part(&recording, true, 0..16);
    let recording = recording.display().to_string();
    let [live, map] = ["live", "map"].map(|name| folder.join(name).display().to_string());
    let played = spawn(&["live", &recording, "-o", &live, "--set", "loops.jobs=inline"]);
    let mapped = run(&["map", &recording, "-o", &map, "--quiet"]);
    let played = played.wait_with_output().unwrap();
    assert_eq!(played.status.code(), mapped.status.code(), "{}", text(&played.stdout));
    for name in ["trajectory.tum", "trajectory_online.tum", "session.mapwright", "map.ply"] {
        let read = |run: &str| fs::read(Path::new(run).join(name)).unwrap();
        assert!(read(&live) == read(&map), "{name} differs: {}", text(&played.stdout));
    }
}

/// What is no packet of the lidar's makes no cloud, and is not waited for for ever.
#[cfg(unix)]
#[test]
fn datagrams_that_are_none_of_a_lidar_are_said() {
    let folder = folder("live_datagrams");
    let port = std::net::UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let (place, out) = (format!("velodyne:127.0.0.1:{port}"), folder.join("out"));
    let child = spawn(&["live", "--lidar", &place, "-o", out.to_str().unwrap()]);
    let sender = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    for length in 0..300 {
        // While nobody is there yet they are refused.
        let _ = sender.send_to(&vec![length as u8; 5 * length], ("127.0.0.1", port));
        thread::sleep(Duration::from_millis(10));
    }
    let id = child.id().to_string();
    assert!(std::process::Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let said = text(&output.stdout) + &text(&output.stderr);
    assert_code(&output, 1);
    assert!(said.contains(&format!("datagrams are heard at 127.0.0.1:{port}")) && said.contains("0 clouds"), "{said}");
}

/// A run that is killed in the middle leaves what it has mapped, and the next one goes on with it.
#[test]
fn a_killed_robot_goes_on() {
    let folder = folder("live_killed");
    let log = small_log_in(&folder);
    let out = folder.join("out");
    let path = out.display().to_string();
    let mut child = spawn(&["live", &log, "--rate", "5", "-o", &path, "--continue", "--quiet"]);
    let part = out.join("session.mapwright.part");
    let begun = Instant::now();
    while fs::metadata(&part).map_or(0, |part| part.len()) < 20_000 {
        assert!(begun.elapsed() < Duration::from_secs(60), "nothing is written while it drives");
        thread::sleep(Duration::from_millis(20));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let before = fs::metadata(&part).unwrap().len();
    let output = run(&["live", &log, "--rate", "20", "-o", &path, "--continue"]);
    assert!([Some(0), Some(3)].contains(&output.status.code()), "{}", text(&output.stderr));
    assert!(fs::metadata(out.join("session.mapwright")).unwrap().len() > before, "{}", text(&output.stdout));
}

/// Ctrl-C ends a drive with its results.
#[cfg(unix)]
#[test]
fn what_is_interrupted_leaves_results() {
    let folder = folder("live_interrupted");
    let log = small_log_in(&folder);
    let out = folder.join("out");
    let child = spawn(&["live", &log, "-o", out.to_str().unwrap()]);
    thread::sleep(Duration::from_secs(4));
    let id = child.id().to_string();
    assert!(std::process::Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_code(&output, 3);
    assert!(text(&output.stdout).contains("interrupted"), "{}", text(&output.stdout));
    assert!(out.join("map.pgm").exists());
}

#[test]
fn what_cannot_be_is_said() {
    let folder = folder("live_wrong");
    let (log, out) = (small_log_in(&folder), folder.join("out"));
    let out = out.to_str().unwrap();
    assert_refused(&run(&["live", "nowhere.clf", "-o", out]), 1, &["nowhere.clf"]);
    assert_refused(&run(&["live", "--lidar", "sick:/dev/ttyUSB0", "-o", out]), 2, &["sick"]);
    assert_refused(&run(&["live", "--lidar", "velodyne:2368", "-o", out, "--localise", out]), 2, &["planar lasers"]);
    assert_refused(&run(&["live", "--lidar", "ouster:7502", "--lidar-metadata", &log, "-o", out]), 2, &["metadata"]);
    assert_refused(&run(&["live", &log, "-o", out, "--band", "0.1:0.5"]), 2, &["--band is of clouds"]);
    assert_refused(&run(&["live", "--lidar", "velodyne:2368", "-o", out, "--band", "0:1"]), 2, &["--ros"]);
    assert_refused(&run(&["live", &log, "-o", out, "--replay", "nowhere"]), 1, &["nowhere"]);
    assert_refused(&run(&["live", "-o", out, "--replay", out]), 2, &["LOG"]);
    assert_refused(&run(&["live", &log, "-o", out, "--node", "no name"]), 2, &["no name"]);
    assert_refused(&run(&["live", &log, "-o", out, "--param", "mode=flying"]), 2, &["mode"]);
    #[cfg(not(feature = "dds"))]
    assert_refused(&run(&["live", "-o", out, "--wire", "dds"]), 2, &["built without ROS 2", "--features dds"]);
    #[cfg(not(feature = "zenoh"))]
    assert_refused(&run(&["live", "-o", out, "--wire", "zenoh"]), 2, &["built without ROS 2", "--features zenoh"]);
    #[cfg(not(feature = "view"))]
    assert_refused(&run(&["live", &log, "-o", out, "--view"]), 2, &["built without the view"]);
    #[cfg(feature = "view")]
    assert_refused(&run(&["live", &log, "-o", out, "--view", "0.0.0.0:0"]), 2, &["token"]);
}

/// A cable whose other end is silent is no reason to wait: it is said, and Ctrl-C ends it.
#[cfg(unix)]
#[test]
fn a_cable_that_is_not_there_is_looked_for() {
    let folder = folder("live_cable");
    let out = folder.join("out");
    let child = spawn(&["live", "--lidar", "ld06:/dev/none", "-o", out.to_str().unwrap()]);
    thread::sleep(Duration::from_secs(3));
    let id = child.id().to_string();
    assert!(std::process::Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let said = text(&output.stdout) + &text(&output.stderr);
    assert!(said.contains("/dev/none: ") && said.contains("looked for every second"), "{said}");
}
