//! The commands beside `map`.

use crate::support::{SAME_BYTES, assert_code, assert_refused, folder, json, run, small_log_in, text, three_rooms};
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
    let words = text(&run(&["calibrate", log.to_str().unwrap(), "--quiet"]).stdout);
    assert!(words.is_empty());
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
