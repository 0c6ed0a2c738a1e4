//! Recordings of sensors in space, and trajectories there.

use crate::support::{assert_code, assert_refused, folder, json, run, small_log_in, text};
use std::fmt::Write;
use std::fs;
use std::path::Path;

const FRAMES: usize = 8;

/// A room of 8 by 6 by 2.6 m in the layout of KITTI, seen on a way along x; with poses of a camera, and with times.
fn room(folder: &Path) -> String {
    room_from(folder, 2.0)
}

/// The same, the way begins so far from one wall.
fn room_from(folder: &Path, begin_m: f64) -> String {
    fs::create_dir_all(folder.join("velodyne")).unwrap();
    let (mut poses, mut times) = (String::new(), String::new());
    for frame in 0..FRAMES {
        let at = [begin_m + 0.2 * frame as f64, 3.0, 1.2];
        let mut bytes = Vec::new();
        for ray in 0..12_000 {
            let (azimuth, height) = (f64::from(ray % 600) * 0.010_472, f64::from(ray / 600) * 0.1 - 0.95);
            let (s, c) = (azimuth.sin(), azimuth.cos());
            let along = [c, s, height];
            let wall = |k: usize| ((if along[k] > 0.0 { [8.0, 6.0, 2.6][k] } else { 0.0 }) - at[k]) / along[k];
            let range = (0..3).filter(|&k| along[k].abs() > 1e-6).map(wall).fold(f64::INFINITY, f64::min);
            let point = along.map(|v| (v * range) as f32);
            point.iter().chain(&[0.5]).for_each(|value| bytes.extend(value.to_le_bytes()));
        }
        fs::write(folder.join(format!("velodyne/{frame:06}.bin")), bytes).unwrap();
        writeln!(poses, "1 0 0 0 0 1 0 0 0 0 1 {}", 0.2 * frame as f64).unwrap();
        writeln!(times, "{:e}", 0.1 * frame as f64).unwrap();
    }
    fs::write(folder.join("poses_cam0.txt"), poses).unwrap();
    fs::write(folder.join("times.txt"), times).unwrap();
    folder.display().to_string()
}

#[test]
fn a_room_is_mapped_with_a_picture_and_poses_of_an_unknown_camera_are_not_compared() {
    let folder = folder("space_map");
    let recording = room(&folder.join("room"));
    let map = |out: &str| {
        let out = folder.join(out);
        let output = run(&["map", &recording, "-o", out.to_str().unwrap()]);
        assert_code(&output, 0);
        (out, text(&output.stdout))
    };
    let (out, said) = map("out");
    let why = "poses_cam0.txt not compared: its poses are those of camera 0";
    assert!(said.contains(why) && said.contains("map.png"), "{said}");
    let report = json(&out.join("report.json"));
    assert!(report["reference"].is_null(), "{report}");
    assert!(report["not_compared"][0].as_str().unwrap().starts_with(why), "{report}");
    let picture = fs::read(out.join("map.png")).unwrap();
    let side = |at: usize| u32::from_be_bytes(picture[at..at + 4].try_into().unwrap());
    assert_eq!(side(16).max(side(20)), 1600);
    assert!(picture == fs::read(map("again").0.join("map.png")).unwrap());
}

#[test]
fn the_demo_maps_a_building_and_knows_its_error() {
    let folder = folder("demo_space");
    let demo = |out: &str| {
        let out = folder.join(out);
        let output = run(&["demo", "--3d", "--seed", "2", "--seconds", "8", "-o", out.to_str().unwrap()]);
        assert_code(&output, 0);
        assert!(text(&output.stdout).contains("truth    ATE rmse"), "{}", text(&output.stdout));
        out
    };
    let (out, again) = (demo("out"), demo("again"));
    let made = [
        "trajectory.tum",
        "trajectory_online.tum",
        "truth.tum",
        "session.mapwright",
        "graph.g2o",
        "map.ply",
        "map.png",
    ];
    for file in made.iter().chain(&["report.json"]) {
        assert!(fs::read(out.join(file)).unwrap() == fs::read(again.join(file)).unwrap(), "{file} differs");
    }
    let report = json(&out.join("report.json"));
    assert_eq!(report["verdict"]["word"], "good", "{report}");
    let truth = &report["against_truth"];
    let ate_rmse_m = truth["ate_rmse_m"].as_f64().unwrap();
    assert!(ate_rmse_m < 0.05 && truth["wrong_closings"] == 0 && truth["closures"] == 0, "{truth}");
    let path = |file: &str| out.join(file).display().to_string();
    let eval = run(&["eval", &path("trajectory.tum"), "--reference", &path("truth.tum"), "--json"]);
    assert_code(&eval, 0);
    let value: serde_json::Value = serde_json::from_slice(&eval.stdout).unwrap();
    assert!((value[0]["ate"]["translation_m"]["rmse"].as_f64().unwrap() - ate_rmse_m).abs() < 1e-6, "{value}");
    let refused = run(&["demo", "--3d", "--show", "spread"]);
    assert_refused(&refused, 2, &["--3d", "--show"]);
}

#[test]
fn the_demo_is_good_and_with_voxels_as_large_as_rooms_it_is_not() {
    let folder = folder("demo_space_verdict");
    let demo = |name: &str, settings: &[&str]| {
        let out = folder.join(name);
        let args = ["demo", "--3d", "--seed", "3", "--seconds", "20", "-o", out.to_str().unwrap()];
        let output = run(&[args.as_slice(), settings].concat());
        let said = text(&output.stdout);
        let verdict = json(&out.join("report.json"))["verdict"].clone();
        let word = verdict["word"].as_str().unwrap();
        assert!(said.starts_with(word) && said.contains(verdict["words"].as_str().unwrap()), "{said}");
        assert_code(&output, if word == "unusable" { 3 } else { 0 });
        verdict
    };
    let good = demo("good", &[]);
    assert!(good["word"] == "good" && good["words"].as_str().unwrap().contains("wheels say the same way"), "{good}");
    let coarse = demo("coarse", &["--set", "space.resolution_m=8"]);
    assert!(coarse["word"] == "check" || coarse["word"] == "unusable", "{coarse}");
    let reasons = coarse["reasons"].as_array().unwrap();
    let blurred = reasons.iter().find(|reason| reason["what"] == "blurred").unwrap();
    assert!(blurred["evidence"]["off_m"].as_f64().unwrap() > 0.05, "{coarse}");
}

#[test]
fn info_says_what_is_in_a_recording_of_space_by_its_first_clouds() {
    let folder = folder("space_info");
    let recording = room(&folder.join("room"));
    fs::write(folder.join("room/velodyne/000006.bin"), b"").unwrap(); // it is not read
    let output = run(&["info", &recording]);
    assert_code(&output, 0);
    let said = text(&output.stdout);
    let expected = [
        "clouds in the layout of KITTI's odometry benchmark, 8 frames, 0.7 s by their stamps",
        "0.5 to 120 m",
        "12,000 points, 12,000 in range",
        "the other 5 were not read",
        "poses_cam0.txt: 8 poses, of camera 0",
        "1.4 m of way",
        "decided  the robot's frame is the lidar's",
    ];
    expected.iter().for_each(|what| assert!(said.contains(what), "expected {what:?}, found {said}"));
    let output = run(&["info", &recording, "--json"]);
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((value["frames"].as_u64(), value["first_clouds"].as_array().unwrap().len()), (Some(8), 3));
    assert!((value["span_s"].as_f64().unwrap() - 0.7).abs() < 1e-9 && value["camera"].is_null(), "{value}");
    let output = run(&["info", &recording, &recording, "--json"]);
    let both: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(both["differences"].is_null() && both["logs"][1] == value);
}

#[test]
fn trajectories_in_space_are_compared_there() {
    let folder = folder("space_eval");
    let path = |name: &str, rows: &dyn Fn(f64) -> String| {
        let text: String = (0..300).map(|k| rows(f64::from(k)) + "\n").collect();
        fs::write(folder.join(name), text).unwrap();
        folder.join(name).display().to_string()
    };
    let at = |k: f64| [k, 10.0 * (0.05 * k).sin(), 3.0 * (0.1 * k).cos()];
    let matrix = |[x, y, z]: [f64; 3]| format!("1 0 0 {x} 0 1 0 {y} 0 0 1 {z}");
    let truth = path("truth.tum", &|k| at(k).iter().fold(k.to_string(), |row, v| format!("{row} {v}")) + " 0 0 0 1");
    // the same, lifted by a metre, and 2 % too long
    let lifted = path("lifted.txt", &|k| matrix([at(k)[0], at(k)[1], at(k)[2] + 1.0]));
    let longer = path("longer.txt", &|k| matrix(at(k).map(|v| 1.02 * v)));
    let times = path("times.txt", &|k| format!("{k}"));
    let eval = |args: &[&str]| run(&[&["eval"], args].concat());
    let found = |args: &[&str]| {
        let output = eval(args);
        assert_code(&output, 0);
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()
    };
    let value = found(&[&lifted, &longer, "--reference", &truth, "--times", &times, "--json"]);
    let of = |at: usize, what: &str| value[at][what]["translation_m"]["rmse"].as_f64().unwrap();
    assert!(of(0, "ate") < 1e-9 && of(0, "rpe") < 1e-9 && of(1, "ate") > 0.1, "{value}");
    let percent = value[1]["kitti"]["all"]["translation_percent"].as_f64().unwrap();
    assert!((1.5..=2.1).contains(&percent) && value[1]["kitti"]["by_length"].as_array().unwrap().len() == 3, "{value}");
    let value = found(&[&longer, "--reference", &lifted, "--alignment", "similarity", "--json"]);
    assert!((value[0]["scale"].as_f64().unwrap() - 1.0 / 1.02).abs() < 1e-9, "{value}");
    let said = text(&eval(&[&longer, "--reference", &truth, "--times", &times]).stdout);
    assert!(said.contains("in space") && said.contains("deg in 100 m"), "{said}");
    // as many rows as the other has poses belong to these one by one; otherwise stamps are asked for
    let mixed = eval(&[&longer, "--reference", &truth]);
    assert_code(&mixed, 0);
    let by_number = text(&mixed.stdout);
    assert!(by_number.contains("paired by their numbers") && said.ends_with(by_number.split_once('\n').unwrap().1));
    let fewer = fs::read_to_string(&longer).unwrap();
    let fewer = fewer.lines().take(299).collect::<Vec<_>>().join("\n");
    let fewer = path("fewer.txt", &|k| fewer.lines().nth(k as usize).unwrap_or_default().to_owned());
    assert_refused(&eval(&[&fewer, "--reference", &truth]), 1, &["fewer.txt", "299", "--times FILE"]);
    fs::write(folder.join("few.txt"), "0\n1\n").unwrap();
    let few = folder.join("few.txt").display().to_string();
    assert_refused(&eval(&[&longer, "--reference", &truth, "--times", &few]), 1, &["300 stamps", "found 2 in"]);
}

#[test]
fn revisits_judge_a_map_and_other_trajectories_on_its_clouds() {
    let folder = folder("space_revisits");
    let (recording, out) = (room(&folder.join("room")), folder.join("out").display().to_string());
    assert_code(&run(&["map", &recording, "-o", &out, "--quiet"]), 0);
    let eval = |args: &[&str]| run(&[&["eval", &out, "--revisits"], args].concat());
    let found = |args: &[&str]| {
        let output = eval(&[&["--apart", "4", "--json"], args].concat());
        assert_code(&output, 0);
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()[0].clone()
    };
    let median_m = |value: &serde_json::Value| value["corrections"]["translation_m"]["median"].as_f64().unwrap();
    let own = found(&[]);
    assert!(own["pairs"].as_u64().unwrap() >= 3 && median_m(&own) < 0.02, "{own}");
    let written = fs::read_to_string(folder.join("out/trajectory.tum")).unwrap();
    // Of eight scans the last five lie 0.1 m higher.
    let lifted = written.lines().enumerate().map(|(k, row)| {
        let mut numbers: Vec<f64> = row.split(' ').map(|number| number.parse().unwrap()).collect();
        numbers[3] += if k >= 3 { 0.1 } else { 0.0 };
        numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ") + "\n"
    });
    let path = folder.join("lifted.tum").display().to_string();
    fs::write(&path, lifted.collect::<String>()).unwrap();
    let other = found(&["--trajectory", &path]);
    assert!(other["pairs"].as_u64() > Some(0) && (median_m(&other) - 0.1).abs() < 0.03, "{other}");
    assert_eq!((&other["trajectory"], &other["clouds_of"]), (&path.clone().into(), &out.clone().into()));
    let said = text(&eval(&["--apart", "4"]).stdout);
    assert!(
        said.contains("of different visits (4 scans and more apart) registered,") && said.contains("median 0.0"),
        "{said}"
    );
    // Twice 5 m, 0.2 m a cloud.
    assert_refused(&eval(&[]), 1, &["expected clouds 51 scans and more apart", "found none"]);
    // a run in space leaves no closures.json
    let explained = run(&["explain", &out]);
    assert_code(&explained, 0);
    assert!(text(&explained.stdout).starts_with("0 candidates among"), "{explained:?}");
    let rows = format!("{recording}/poses_cam0.txt");
    assert_refused(&eval(&["--trajectory", &rows]), 1, &["poses_cam0.txt", "expected stamps"]);
    let plane = folder.join("plane").display().to_string();
    let log = small_log_in(&folder);
    assert_code(&run(&["map", &log, "-o", &plane, "--quiet"]), 0);
    assert_refused(&run(&["eval", &plane, "--revisits"]), 1, &["--revisits needs a session of space"]);
}

/// Wherever a run was killed, its log ends somewhere.
#[test]
fn a_run_in_space_that_was_killed_goes_on_to_the_same_bytes() {
    let folder = folder("space_killed");
    let recording = room(&folder.join("room"));
    let (whole, killed) = (folder.join("whole"), folder.join("killed"));
    let out = killed.display().to_string();
    assert_code(&run(&["map", &recording, "-o", whole.to_str().unwrap(), "--quiet"]), 0);
    let read = |folder: &Path, file: &str| fs::read(folder.join(file)).unwrap();
    let log = read(&whole, "session.mapwright");
    let ways = [8, 30, 55, 80, 99].map(|percent| {
        fs::remove_dir_all(&killed).ok();
        fs::create_dir_all(&killed).unwrap();
        fs::write(killed.join("session.mapwright.part"), &log[..log.len() * percent / 100]).unwrap();
        let output = run(&["map", &recording, "-o", &out, "--continue"]);
        assert!([0, 3].contains(&output.status.code().unwrap()), "{percent}: {output:?}");
        for file in ["trajectory.tum", "graph.g2o", "map.ply"] {
            assert!(read(&whole, file) == read(&killed, file), "{percent} %: {file} differs");
        }
        json(&killed.join("report.json"))["clouds"].as_u64().unwrap()
    });
    assert!(ways[0] == FRAMES as u64 && ways[4] < FRAMES as u64 && ways.is_sorted_by(|a, b| a >= b), "{ways:?}");
    // All that was mapped is passed over, and a session that is made of more than the recording is kept.
    assert_code(&run(&["map", &recording, "-o", &out, "--continue"]), 0);
    assert!(read(&whole, "trajectory.tum") == read(&killed, "trajectory.tum"));
    let before = read(&killed, "session.mapwright");
    fs::remove_file(folder.join(format!("room/velodyne/{:06}.bin", FRAMES - 1))).unwrap();
    let times: String = (0..FRAMES - 1).map(|frame| format!("{:e}\n", 0.1 * frame as f64)).collect();
    fs::write(folder.join("room/times.txt"), times).unwrap();
    let refused = run(&["map", &recording, "-o", &out, "--continue"]);
    assert_refused(&refused, 1, &["ends 1 clouds before the session does"]);
    assert!(before == read(&killed, "session.mapwright"));
}

#[test]
fn a_recording_in_two_parts_is_mapped_like_the_whole_and_sessions_of_other_kinds_are_refused() {
    let folder = folder("space_resume");
    let whole = folder.join("whole");
    room(&whole);
    for (part, frames) in [("first", 0..FRAMES / 2), ("second", FRAMES / 2..FRAMES)] {
        let part = folder.join(part);
        fs::create_dir_all(part.join("velodyne")).unwrap();
        let mut times = String::new();
        for frame in frames {
            let name = format!("velodyne/{frame:06}.bin");
            fs::copy(whole.join(&name), part.join(&name)).unwrap();
            writeln!(times, "{:e}", 0.1 * frame as f64).unwrap();
        }
        fs::write(part.join("times.txt"), times).unwrap();
    }
    let path = |name: &str| folder.join(name).display().to_string();
    let map = |recording: &str, out: &str, earlier: Option<&str>| {
        let (recording, out) = (path(recording), path(out));
        let mut arguments = vec!["map", &recording, "-o", &out];
        let earlier = earlier.map(path);
        arguments.extend(earlier.iter().flat_map(|earlier| ["--resume", earlier]));
        run(&arguments)
    };
    assert_code(&map("whole", "whole_out", None), 0);
    assert_code(&map("first", "first_out", None), 0);
    assert_code(&map("second", "both_out", Some("first_out")), 0);
    for file in ["trajectory.tum", "graph.g2o", "map.ply"] {
        let read = |out: &str| fs::read(folder.join(out).join(file)).unwrap();
        assert!(read("whole_out") == read("both_out"), "{file} differs");
    }
    let before = fs::read(folder.join("first_out/session.mapwright")).unwrap();
    let refused = run(&["map", &path("second"), "-o", &path("first_out"), "--continue"]);
    assert_refused(&refused, 2, &["--continue", "--resume"]);
    assert_eq!(fs::read(folder.join("first_out/session.mapwright")).unwrap(), before);
    let log = small_log_in(&folder);
    let plane = path("plane_out");
    assert_code(&run(&["map", &log, "-o", &plane, "--quiet"]), 0);
    assert_refused(&map("second", "refused", Some("plane_out")), 1, &["it is of the plane"]);
    let refused = run(&["map", &log, "-o", &path("refused"), "--resume", &path("first_out")]);
    assert_refused(&refused, 1, &["it is of space"]);
}

#[test]
fn recordings_that_nothing_joins_are_merged_to_maps_of_their_own_and_kinds_are_not_mixed() {
    let folder = folder("space_merge");
    let [room_a, room_b] = [("a", 2.0), ("b", 2.5)].map(|(name, begin_m)| room_from(&folder.join(name), begin_m));
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    assert_code(&run(&["map", &room_b, "-o", &path("session")]), 0);
    // A way of 1.4 m in a room that looks the same from either end tells nothing.
    let merged = run(&["merge", &room_a, &path("session"), "-o", &path("out")]);
    assert_code(&merged, 3);
    let said = text(&merged.stdout);
    assert!(said.contains("written as maps of their own, for nothing holds them: map-2.png"), "{said}");
    let out = folder.join("out");
    assert!(out.join("map-2.ply").exists() && out.join("map-2.png").exists());
    let report = json(&out.join("report.json"));
    assert_eq!((report["pieces"].as_array().unwrap().len(), report["clouds"].as_u64()), (2, Some(FRAMES as u64)));
    let ways = fs::read_to_string(out.join("trajectory.tum")).unwrap();
    assert_eq!(ways.lines().count(), 2 * FRAMES);

    let located = run(&["localise", "--map", &path("session"), &room_a, "-o", &path("poses.csv")]);
    assert_code(&located, 3);
    assert!(text(&located.stdout).contains("the robot was nowhere recognised in the map"), "{:?}", located.stdout);
    let poses = fs::read_to_string(folder.join("poses.csv")).unwrap();
    assert_eq!(poses.lines().count(), 1 + FRAMES);
    assert!(poses.lines().skip(1).all(|line| line.split(',').count() == 17 && line.contains(",0,")), "{poses}");

    let twice = run(&["merge", &path("session"), &path("session"), "-o", &path("twice")]);
    assert_refused(&twice, 2, &["is given twice"]);
    let log = small_log_in(&folder);
    let mixed = run(&["merge", &room_a, &log, "-o", &path("mixed")]);
    assert_refused(&mixed, 2, &["is of the plane"]);
    let one = run(&["merge", &room_a, "-o", &path("one")]);
    assert_refused(&one, 2, &["one recording is for `map`"]);
}
