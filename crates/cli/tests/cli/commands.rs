//! The commands beside `map`.

use crate::support::{
    SAME_BYTES, assert_code, assert_refused, folder, json, run, run_with_input, small_log, small_log_in, text,
    three_rooms,
};
use mapwright_geom::Pose2;
use std::fs;

#[test]
fn the_printed_settings_are_read_back() {
    let folder = folder("config");
    let log = small_log_in(&folder);
    let printed = run(&["config", "--set", "map.resolution_m=0.1"]);
    assert_code(&printed, 0);
    assert!(text(&printed.stdout).contains("resolution_m = 0.1 # [m]"));
    let config = folder.join("settings.toml");
    fs::write(&config, &printed.stdout).unwrap();
    let again = run(&["config", "--config", config.to_str().unwrap()]);
    assert_eq!(text(&again.stdout), text(&printed.stdout));
    let map = |out: &str, how: [&str; 2]| {
        let out = folder.join(out);
        assert_code(&run(&["map", &log, "-o", out.to_str().unwrap(), how[0], how[1]]), 0);
        fs::read(out.join("report.json")).unwrap()
    };
    assert!(map("file", ["--config", config.to_str().unwrap()]) == map("set", ["--set", "map.resolution_m=0.1"]));
}

#[test]
fn the_demo_maps_an_office_and_knows_its_error() {
    let folder = folder("demo");
    let out = folder.join("mapwright-demo");
    let output = run(&["demo", "-o", out.to_str().unwrap()]);
    assert_code(&output, 0);
    assert!(text(&output.stdout).contains("ATE rmse"));
    SAME_BYTES.iter().for_each(|name| assert!(out.join(name).exists(), "{name}"));
    let ate_rmse_m = json(&out.join("report.json"))["against_truth"]["ate_rmse_m"].as_f64().unwrap();
    assert!(ate_rmse_m < 0.5, "{ate_rmse_m}");
    let (trajectory, truth) = (out.join("trajectory.tum"), out.join("truth.tum"));
    let eval = run(&["eval", trajectory.to_str().unwrap(), "--reference", truth.to_str().unwrap(), "--json"]);
    assert_code(&eval, 0);
    let value: serde_json::Value = serde_json::from_slice(&eval.stdout).unwrap();
    assert!((value[0]["ate"]["translation_m"]["rmse"].as_f64().unwrap() - ate_rmse_m).abs() < 1e-6);
}

#[test]
fn a_trajectory_is_scored_against_relations() {
    let folder = folder("eval");
    let path = |name: &str, text: &str| {
        fs::write(folder.join(name), text).unwrap();
        folder.join(name).display().to_string()
    };
    let straight = path("straight.tum", "0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n100 2 0 0 0 0 0 1\n");
    let longer = path("longer.tum", "0 0 0 0 0 0 0 1\n1 1.2 0 0 0 0 0 1\n100 2.4 0 0 0 0 0 1\n");
    let relations = path("some.relations", "0 1 1.1 0 0 0 0 0\n0 100 2 0 0 0 0 0\n0 7 1 0 0 0 0 0\n");
    let output = run(&["eval", &straight, &longer, "--relations", &relations]);
    assert_code(&output, 0);
    let said = text(&output.stdout);
    for what in ["2 relations used, 1 missing", "0.0500 +- 0.0500 m", "relation 3", "over all 2: mean 0.1500 m"] {
        assert!(said.contains(what), "expected {what:?}, found {said}");
    }
    let torn = path("torn.tum", "0 0 0 0 0 0 0 1\n1 1 0 0\n2 x 0 0\n");
    assert_refused(&run(&["eval", &torn, "--relations", &relations]), 1, &["torn.tum", "line 3"]);
}

#[test]
fn info_says_what_is_in_a_log() {
    let log = small_log_in(&folder("info"));
    let output = run(&["info", &log]);
    assert_code(&output, 0);
    let said = text(&output.stdout);
    for what in ["180 beams over 180 deg", "10.0 a second", "of path", "odometry"] {
        assert!(said.contains(what), "expected {what:?}, found {said}");
    }
    let value: serde_json::Value = serde_json::from_slice(&run(&["info", &log, "--json"]).stdout).unwrap();
    assert_eq!(value["lasers"][0]["beams"], serde_json::json!([180, 180]));
    assert_eq!(value["lasers"][0]["topic"]["events"], value["read"]["scans"]);
}

#[test]
fn the_laser_is_found_where_it_sits() {
    let folder = folder("calibrate");
    let log = folder.join("offset.clf");
    let robot_from_laser = Pose2::new(-0.04, 0.03, 0.02);
    fs::write(&log, three_rooms(300.0, robot_from_laser, Pose2::IDENTITY)).unwrap();
    let output = run(&["calibrate", log.to_str().unwrap(), "--json"]);
    assert_code(&output, 0);
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    for (key, truth, within) in [("x_m", -0.04, 0.01), ("y_m", 0.03, 0.01), ("yaw_rad", 0.02, 0.005)] {
        let [found, sigma] = ["value", "sigma"].map(|part| value[key][part].as_f64().unwrap());
        assert!((found - truth).abs() < within && (found - truth).abs() < 5.0 * sigma, "{key} {found} +- {sigma}");
    }
    let file = folder.join("found.toml").display().to_string();
    let words = text(&run(&["calibrate", log.to_str().unwrap(), "--quiet", "--apply", &file]).stdout);
    assert!(words.is_empty());

    // the next run has the laser where it was found, of this log and of the same as a recording
    let recorded = folder.join("offset.mcap").display().to_string();
    assert_code(&run(&["convert", log.to_str().unwrap(), &recorded]), 0);
    for (name, log) in [("clf", log.to_str().unwrap()), ("mcap", &recorded)] {
        let value: serde_json::Value =
            serde_json::from_slice(&run(&["info", log, "--calibration", &file, "--json"]).stdout).unwrap();
        let mount = value["lasers"][0]["robot_from_laser"].as_array().unwrap();
        let off_m = (mount[0].as_f64().unwrap() + 0.04).hypot(mount[1].as_f64().unwrap() - 0.03);
        assert!(off_m < 0.01, "{name}: {mount:?}");
        let out = folder.join(name);
        assert_code(&run(&["map", log, "-o", out.to_str().unwrap(), "--calibration", &file, "--quiet"]), 0);
        // what was taken out is not there any more
        let again = run(&["calibrate", log, "--calibration", &file, "--json"]);
        assert_code(&again, 0);
        let again: serde_json::Value = serde_json::from_slice(&again.stdout).unwrap();
        for (key, expected, within) in
            [("translation_scale", 1.0, 0.004), ("rotation_scale", 1.0, 0.004), ("drift_rad_per_m", 0.0, 0.004)]
        {
            let left = again[key]["value"].as_f64().unwrap() - expected;
            assert!(left.abs() < within, "{name} {key}: {left}");
        }
    }
    assert_refused(
        &run(&["map", &recorded, "-o", "x", "--calibration", "none.toml"]),
        2,
        &["none.toml", "cannot read"],
    );
    fs::write(&file, "[laser]\nx_m = 1e9\n").unwrap();
    assert_refused(&run(&["map", &recorded, "-o", "x", "--calibration", &file]), 2, &["found.toml"]);
}

#[test]
fn a_harder_log_can_be_made_and_mapped() {
    let folder = folder("perturb");
    let (log, harder) = (small_log_in(&folder), folder.join("harder.clf"));
    let scans = |path: &str| {
        let value: serde_json::Value = serde_json::from_slice(&run(&["info", path, "--json"]).stdout).unwrap();
        value["read"]["scans"].as_u64().unwrap()
    };
    let harder = harder.to_str().unwrap();
    let output = run(&[
        "perturb",
        &log,
        "-o",
        harder,
        "--every",
        "2",
        "--noise-beams",
        "0.05",
        "--scale-odometry",
        "1.1",
        "--odometry-noise",
        "0.05",
        "--seed",
        "3",
    ]);
    assert_code(&output, 0);
    assert_eq!(scans(harder), scans(&log).div_ceil(2));
    assert_code(&run(&["map", harder, "-o", folder.join("out").to_str().unwrap()]), 0);
}

fn lines_of(log: &str) -> Vec<String> {
    fs::read_to_string(log).unwrap().lines().map(str::to_owned).collect()
}

/// Stamp of a line, seconds; none of `PARAM` lines.
fn stamp_s(line: &str) -> Option<f64> {
    let is_event = line.starts_with("ODOM") || line.starts_with("ROBOTLASER");
    is_event.then(|| line.split(' ').rev().nth(2).unwrap().parse().unwrap())
}

#[test]
fn gaps_take_lines_out_and_leave_the_others_to_the_byte() {
    let folder = folder("perturb_gaps");
    let (log, broken) = (small_log_in(&folder), folder.join("broken.clf").display().to_string());
    let output = run(&["perturb", &log, "--gap", "0.25:10", "--gap", "0.75:2", "-o", &broken]);
    assert_code(&output, 0);
    let (before, after) = (lines_of(&log), lines_of(&broken));
    let stamps: Vec<f64> =
        before.iter().filter(|line| line.starts_with("ROBOTLASER")).filter_map(|l| stamp_s(l)).collect();
    let (first, last) = (stamps[0], stamps[stamps.len() - 1]);
    let begin = |share: f64| *stamps.iter().find(|&&s| s - first >= share * (last - first)).unwrap();
    let gaps = [(begin(0.25), 10.0), (begin(0.75), 2.0)];
    // the readings at the very stamp of the scan that begins a gap come before it
    let is_missing = |line: &String| {
        stamp_s(line).is_some_and(|s| {
            gaps.iter().any(|(from, lasts)| {
                (*from..from + lasts - 1e-6).contains(&s) && (line.starts_with("ROBOTLASER") || s > *from)
            })
        })
    };
    let (gone, left): (Vec<_>, Vec<_>) = before.iter().cloned().partition(is_missing);
    assert!(left == after, "{} of {} lines, {} expected", after.len(), before.len(), left.len());
    let scans = gone.iter().filter(|line| line.starts_with("ROBOTLASER")).count();
    assert_eq!(scans, 120, "ten a second");
    let said = text(&output.stdout);
    let readings = format!("120 scans and {} odometry readings taken out in 2 gaps", gone.len() - scans);
    assert!(said.contains(&readings) && said.contains(&format!(": {} scans;", stamps.len() - scans)), "{said}");
    let piped = run_with_input(&["perturb", "-", "--gap", "0.25:10", "--gap", "0.75:2", "-o", &broken], small_log());
    assert_code(&piped, 0);
    assert!(lines_of(&broken) == after);
}

#[test]
fn gaps_go_with_everything_else_and_with_recordings() {
    let folder = folder("perturb_gaps_more");
    let path = |name: &str| folder.join(name).display().to_string();
    let log = small_log_in(&folder);
    let harder = |out: &str, gap: &[&str]| {
        let how = ["perturb", &log, "-o", out, "--every", "2", "--odometry-noise", "0.1", "--noise-beams", "0.1"];
        assert_code(&run(&[&how, gap].concat()), 0);
        lines_of(out)
    };
    let (whole, broken) = (harder(&path("whole.clf"), &[]), harder(&path("broken.clf"), &["--gap", "0.5:5"]));
    assert_eq!(whole.len() - broken.len(), 25, "five seconds of ten scans a second, every other of which is there");
    let mut rest = whole.iter();
    assert!(broken.iter().all(|line| rest.any(|other| other == line)), "what is left is as without the gap");
    // written as MCAP and broken there the log is the same as broken in CARMEN's format
    let (mcap, of_mcap, of_carmen) = (path("log.mcap"), path("of_mcap.clf"), path("of_carmen.clf"));
    assert_code(&run(&["convert", &log, &mcap]), 0);
    for (from, to) in [(&mcap, &of_mcap), (&log, &of_carmen)] {
        assert_code(&run(&["perturb", from, "--gap", "0.5:5", "-o", to]), 0);
    }
    let poses = |log: &str| {
        let out = path("map");
        assert_code(&run(&["map", log, "-o", &out]), 0);
        fs::read_to_string(folder.join("map/trajectory.tum")).unwrap()
    };
    let stamps = |text: String| text.lines().map(|l| l.split(' ').next().unwrap().to_owned()).collect::<Vec<_>>();
    assert_eq!(stamps(poses(&of_mcap)), stamps(poses(&of_carmen)));
}

#[test]
fn gaps_that_cannot_be_are_refused() {
    let folder = folder("perturb_no_gap");
    let (log, out) = (small_log_in(&folder), folder.join("broken.clf"));
    let refused = |log: &str, gap: &str, code: i32, says: &[&str]| {
        assert_refused(&run(&["perturb", log, "--gap", gap, "-o", out.to_str().unwrap()]), code, says);
        assert!(!out.exists());
    };
    refused(&log, "1.5:3", 2, &["share from 0 to 1", "1.5"]);
    refused(&log, "0.5:0", 2, &["more than 0 seconds"]);
    refused(&log, "0.5:-3", 2, &["more than 0 seconds"]);
    refused(&log, "0.5", 2, &["such as 0.25:30"]);
    refused(&log, "0:1e9", 1, &["small.clf", "expected scans after it"]);
    refused(&log, "0.9:30", 1, &["gap 0.9:30", "expected scans after it"]);
    let single = folder.join("single.clf").display().to_string();
    let scan = lines_of(&log).into_iter().find(|line| line.starts_with("ROBOTLASER")).unwrap();
    fs::write(&single, scan + "\n").unwrap();
    refused(&single, "0.5:1", 1, &["single.clf", "expected scans over some time", "found 1"]);
    fs::write(&single, "ODOM 0 0 0 0 0 0 1 host 1\n").unwrap();
    refused(&single, "0.5:1", 1, &["expected laser scans", "1 odometry reading"]);
    let nothing = ["perturb", &log, "--gap", "0:30", "--every", "1000", "-o", out.to_str().unwrap()];
    assert_refused(&run(&nothing), 1, &["nothing is left"]);
}

#[test]
fn completions_manual_pages_and_the_version_know_every_command() {
    let help = text(&run(&["--help"]).stdout);
    let listed = help.lines().skip_while(|line| !line.starts_with("Commands:")).skip(1);
    let indented = listed.take_while(|line| line.starts_with("  "));
    let names = indented.filter(|line| !line.starts_with("   ")).filter_map(|line| line.split_whitespace().next());
    let names: Vec<&str> = names.filter(|name| *name != "help").collect();
    assert!(names.len() > 15 && names.contains(&"report"), "{names:?}");
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = run(&["completions", shell]);
        assert_code(&script, 0);
        let script = text(&script.stdout);
        names.iter().for_each(|name| assert!(script.contains(name), "{shell}: {name}"));
        assert!(script.contains("reference"), "{shell}: options");
    }
    let folder = folder("man").join("pages");
    assert_code(&run(&["man", folder.to_str().unwrap()]), 0);
    for name in &names {
        let page = fs::read_to_string(folder.join(format!("mapwright-{name}.1"))).unwrap();
        assert!(page.starts_with(".ie") && page.contains(".SH NAME"), "{name}");
    }
    assert!(fs::read_to_string(folder.join("mapwright.1")).unwrap().contains("compare"));
    let version = text(&run(&["--version"]).stdout);
    assert!(version.starts_with("mapwright 0.") && version.contains("sqlite)"), "{version}");
}

#[test]
fn what_is_said_and_what_fails_is_said_as_json_too() {
    let folder = folder("json");
    let log = small_log_in(&folder);
    let file = |name: &str| folder.join(name).display().to_string();
    let value = |args: &[&str], code: i32| -> serde_json::Value {
        let output = run(args);
        assert_code(&output, code);
        serde_json::from_slice(&output.stdout).unwrap()
    };
    assert!(value(&["convert", &log, &file("a.mcap"), "--json"], 0)["scans"].as_u64() > Some(10));
    assert!(value(&["perturb", &log, "-o", &file("a.clf"), "--every", "2", "--json"], 0)["scans"].as_u64() > Some(5));
    assert_code(&run(&["map", &log, "-o", &file("out")]), 0);
    for command in [&["report", &file("out")][..], &["compare", &file("out"), &file("out"), "-o", &file("both.html")]] {
        let said = value(&[command, &["--json"]].concat(), 0);
        assert!(said["bytes"].as_u64() > Some(1000) && said["file"].as_str().unwrap().ends_with(".html"), "{said}");
    }
    let failed = value(&["map", &file("nothing.clf"), "-o", &file("none"), "--json"], 1);
    assert!(failed["error"].as_str().unwrap().contains("nothing.clf") && failed["exit_code"] == 1, "{failed}");
}
