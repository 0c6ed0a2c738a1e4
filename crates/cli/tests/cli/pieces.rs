//! What a break leaves: pieces that nothing holds together are maps of their own, and joins are told.

use crate::support::{assert_code, assert_refused, folder, json, log_of, run, small_log_in, spawn, text};
use mapwright_geom::{Pose2, Stamp};
use mapwright_sim::{Drive, DriveSettings, Event, worlds};
use serde_json::Value;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// How long the laser of these logs is covered, seconds.
const COVERED_S: f64 = 8.0;

/// A drive through three rooms.
fn drive(seed: u64, duration_s: f64) -> Vec<Event> {
    Drive::new(worlds::three_rooms(seed).into(), DriveSettings { duration_s, seed, ..DriveSettings::default() })
        .collect()
}

/// The same with the laser covered for a while: no beam comes back.
fn covered(drive: Vec<Event>, from_s: f64) -> Vec<Event> {
    let mut drive = drive;
    for event in &mut drive {
        if let Event::Scan(scan) = event
            && (from_s..from_s + COVERED_S).contains(&scan.scan.stamp.as_secs_f64())
        {
            let range_max_m = scan.scan.laser.range_max_m;
            scan.scan.ranges_m.fill(range_max_m as f32);
        }
    }
    drive
}

/// One drive, and after the laser was covered another, in a building that the robot was carried to; its wheels never noticed.
fn two_buildings() -> &'static [u8] {
    static LOG: OnceLock<Vec<u8>> = OnceLock::new();
    LOG.get_or_init(|| {
        let first = covered(drive(5, 48.0), 40.0);
        let last_odometry = first.iter().rev().find_map(|event| match event {
            Event::Odometry(odometry) => Some(odometry.odom_from_robot),
            Event::Scan(_) => None,
        });
        let (odom_from_start, later) = (last_odometry.unwrap(), |stamp: Stamp| Stamp(stamp.0 + 48_000_000_000));
        let second = drive(11, 40.0).into_iter().map(|event| match event {
            Event::Odometry(mut odometry) => {
                odometry.stamp = later(odometry.stamp);
                odometry.odom_from_robot = odom_from_start * odometry.odom_from_robot;
                Event::Odometry(odometry)
            }
            Event::Scan(mut scan) => {
                scan.scan.stamp = later(scan.scan.stamp);
                scan.scan.odom_from_robot = scan.scan.odom_from_robot.map(|pose: Pose2| odom_from_start * pose);
                Event::Scan(scan)
            }
        });
        log_of(first.into_iter().chain(second))
    })
}

/// Maps a log that is written as `name.clf` into the folder; the folder of results.
fn map(folder: &Path, name: &str, log: &[u8], code: i32) -> (PathBuf, String) {
    let (path, out) = (folder.join(format!("{name}.clf")), folder.join(name));
    fs::write(&path, log).unwrap();
    let output = run(&["map", path.to_str().unwrap(), "-o", out.to_str().unwrap()]);
    assert_code(&output, code);
    (out, text(&output.stdout))
}

/// Width and height of a PGM, and how many of its cells are occupied.
fn cells(path: &Path) -> ([usize; 2], usize) {
    let bytes = fs::read(path).unwrap();
    let mut lines = bytes.split(|&byte| byte == b'\n').filter(|line| !line.starts_with(b"#"));
    assert_eq!(lines.next().unwrap(), b"P5");
    let sides: Vec<usize> = text(lines.next().unwrap()).split(' ').map(|side| side.parse().unwrap()).collect();
    let pixels = &bytes[bytes.len() - sides[0] * sides[1]..];
    ([sides[0], sides[1]], pixels.iter().filter(|&&pixel| pixel < 80).count())
}

#[test]
fn buildings_that_nothing_holds_together_are_maps_of_their_own() {
    let folder = folder("two_buildings");
    let (out, said) = map(&folder, "both", two_buildings(), 3);
    let says =
        ["pieces   2, of 2 fragments (1 break); held by nothing: 1", "maps of their own", "map-2.png", "\nmap-2    "];
    says.iter().for_each(|what| assert!(said.contains(what), "expected {what:?}, found {said}"));
    // Either shows what it shows mapped alone: the first one to the cell, the other one turned, for it begins as the robot stood. The one with
    // more keyframes is `map`.
    for (number, seed) in [("-2", 5), ("", 11)] {
        let (alone, _) = map(&folder, &format!("alone{number}"), &log_of(drive(seed, 40.0).into_iter()), 0);
        let [found, expected] = [out.join(format!("map{number}.pgm")), alone.join("map.pgm")].map(|path| cells(&path));
        assert!(seed == 11 || found.0 == expected.0, "{found:?} {expected:?}");
        let walls = found.1 as f64 / expected.1 as f64;
        assert!((0.9..1.1).contains(&walls), "{found:?} {expected:?}");
        let diagonal = |sides: [usize; 2]| (sides[0] as f64).hypot(sides[1] as f64);
        assert!((0.9..1.1).contains(&(diagonal(found.0) / diagonal(expected.0))), "{found:?} {expected:?}");
        let yaml = fs::read_to_string(out.join(format!("map{number}.yaml"))).unwrap();
        assert!(yaml.contains(&format!("image: map{number}.pgm")), "{yaml}");
    }
    let report = json(&out.join("report.json"));
    let pieces = report["pieces"].as_array().unwrap();
    let told = |key: &str| pieces.iter().map(|piece| piece[key].clone()).collect::<Vec<Value>>();
    assert_eq!(told("map"), ["map-2.png", "map.png"]);
    assert_eq!(told("held_by"), ["the beginning", "nothing"]);
    assert_eq!(told("odometry"), [Value::Null, Value::Null]);
    assert_eq!(pieces[1]["fragments"][0]["start"], "blind");
    let keyframes: u64 = pieces.iter().map(|piece| piece["keyframes"].as_u64().unwrap()).sum();
    assert_eq!(report["keyframes"], keyframes);
    assert_eq!(report["further_maps"].as_array().unwrap().len(), 1);
    assert_eq!(report["further_maps"][0]["file"], "map-2.png");
    assert!(report["further_maps"][0]["certainty"]["worst_sigma_m"].as_f64().unwrap() < 1.0, "{report}");
    assert_eq!(report["further_maps"][0]["certainty"]["unlinked_keyframes"], 0);

    // Each can be exported; where it is not said which, it is told that there are more.
    let export = |more: &[&str]| run(&[&["export", out.to_str().unwrap(), "--to", "pgm"], more].concat());
    let first = export(&[]);
    assert_code(&first, 3);
    assert!(
        text(&first.stdout).contains("1 further map of pieces that nothing holds to the first: --map 2"),
        "{first:?}"
    );
    assert_eq!(cells(&out.join("export.pgm")), cells(&out.join("map.pgm")));
    assert_code(&export(&["--map", "2"]), 0);
    assert_eq!(cells(&out.join("export.pgm")), cells(&out.join("map-2.pgm")));
    assert_refused(&export(&["--map", "3"]), 2, &["expected map 3, found 2 maps"]);
    let trajectory = run(&["export", out.to_str().unwrap(), "--to", "tum", "--map", "2"]);
    assert_refused(&trajectory, 2, &["--map is for --to pgm, worldfile and mcap"]);

    // A run with fewer maps leaves none of those behind, and nothing else is touched.
    fs::write(out.join("map-4.png"), "mine").unwrap();
    fs::write(out.join("map-2.txt"), "mine").unwrap();
    let log = small_log_in(&folder);
    assert_code(&run(&["map", &log, "-o", out.to_str().unwrap()]), 0);
    let there = |name: &str| out.join(name).exists();
    assert_eq!(
        ["map-2.png", "map-2.pgm", "map-2.yaml", "map-4.png", "map-2.txt"].map(there),
        [false, false, false, true, true]
    );
    assert!(there("map.png") && !there(".mapwright.lock"));
}

#[test]
fn a_piece_on_odometry_is_drawn_where_that_has_it_and_how_surely_is_told() {
    let folder = folder("on_odometry");
    let (log, gap, out) = (small_log_in(&folder), folder.join("gap.clf"), folder.join("out"));
    assert_code(&run(&["perturb", &log, "--gap", "0.8:3.8", "-o", gap.to_str().unwrap()]), 0);
    // Too short a gap to have been carried away in, and without wheels so long that it may be anywhere in the room.
    let output = run(&["map", gap.to_str().unwrap(), "-o", out.to_str().unwrap(), "--no-odometry"]);
    assert_code(&output, 3);
    let said = text(&output.stdout);
    let report = json(&out.join("report.json"));
    let piece = &report["pieces"][1];
    let sigmas = ["sigma_m", "sigma_rad"].map(|key| piece["odometry"][key].as_f64().unwrap());
    assert!((1.0..8.0).contains(&sigmas[0]) && sigmas[1] > 0.0, "{piece}");
    assert!(
        piece["held_by"] == "odometry" && piece["map"] == "map.png" && piece["odometry"]["to_piece"] == 0,
        "{piece}"
    );
    let says = format!("drawn where odometry over a break has it, within {:.2} m (one sigma)", sigmas[0]);
    assert!(said.contains(&says) && said.contains("on odometry alone: 1"), "expected {says:?}, found {said}");
    assert!(!out.join("map-2.png").exists() && report["further_maps"] == Value::Array(Vec::new()));
}

#[test]
fn a_join_is_told_with_its_fragments_and_its_evidence() {
    let folder = folder("join_told");
    let (out, said) = map(&folder, "out", &log_of(covered(drive(5, 150.0), 70.0).into_iter()), 0);
    assert!(
        said.contains("pieces   1, of 2 fragments (1 break); ") && said.contains(" over breaks, with a cycle"),
        "{said}"
    );
    let report = json(&out.join("report.json"));
    let joined = &report["pieces"][0]["joined_by"];
    let closures = joined["closures"].as_u64().unwrap();
    assert!(closures >= 2 && joined["worst_cycle_chi2"].as_f64().unwrap() < 16.8, "{joined}");
    assert!(joined["least_cycle_chi2"].as_f64() <= joined["worst_cycle_chi2"].as_f64(), "{joined}");
    let explained = run(&["explain", out.to_str().unwrap(), "--accepted"]);
    assert_code(&explained, 0);
    let words = text(&explained.stdout);
    assert!(words.contains("join fragments over a break"), "{words}");
    let joins: Vec<&str> =
        words.lines().filter(|line| line.contains("joins the fragment that began blind at 7")).collect();
    assert!(
        joins.len() as u64 == closures && joins[0].contains("with the one that began at 0.000 s (switched on)"),
        "{words}"
    );
    let file = json(&out.join("closures.json"));
    let joined = |candidate: &&Value| candidate["verdict"] == "accepted" && candidate["joins"][1]["start"] == "blind";
    assert_eq!(file["candidates"].as_array().unwrap().iter().filter(joined).count() as u64, closures);
}

#[test]
fn a_folder_that_another_run_is_filling_is_refused_until_it_ends() {
    let folder = folder("two_writers");
    let (log, out) = (small_log_in(&folder), folder.join("out"));
    let path = out.to_str().unwrap();
    let mut first = spawn(&["map", "-", "-o", path]);
    let mut stdin = first.stdin.take().unwrap();
    // The log of standard input has no end yet: the run waits for more.
    stdin.write_all(&fs::read(&log).unwrap()[..20_000]).unwrap();
    while !out.join("trajectory_online.tum.part").exists() {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    assert_refused(&run(&["map", &log, "-o", path]), 1, &["cannot write", path, "another run of mapwright is writing"]);
    assert!(out.join("session.mapwright.part").exists() && out.join("trajectory_online.tum.part").exists());
    // A run that is killed leaves its files, and keeps nobody out.
    first.kill().unwrap();
    first.wait().unwrap();
    drop(stdin);
    assert!(out.join(".mapwright.lock").exists() && out.join("session.mapwright.part").exists());
    assert_code(&run(&["map", &log, "-o", path]), 0);
    assert!(out.join("session.mapwright").exists() && !out.join(".mapwright.lock").exists());
}
