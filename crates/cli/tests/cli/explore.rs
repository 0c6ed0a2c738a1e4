//! Simulated robots that explore.

use crate::support::{folder, json, run, text};
use std::fs;

#[test]
fn robots_explore_rooms_to_the_end_and_say_what_is_left() {
    let folder = folder("explore");
    let explore = |name: &str, more: &[&str]| {
        let out = folder.join(name);
        let output = run(&[&["explore", "--rooms", "--robots", "2", "-o", out.to_str().unwrap()], more].concat());
        // Corners behind furniture may be more than a hundredth of so small a place.
        assert!(matches!(output.status.code(), Some(0 | 3)), "{}", text(&output.stderr));
        (out, text(&output.stdout).to_owned())
    };
    let (first, words) = explore("first", &[]);
    let report = json(&first.join("explore.json"));
    assert!(report["share_seen"].as_f64().unwrap() > 0.97);
    assert!(report["done_s"].as_f64().unwrap() < 400.0, "{}", report["done_s"]);
    assert!(report["keyframe_error_m"].as_f64().unwrap() < 0.1);
    assert!(words.contains("three rooms") && words.contains("nothing left to do after"), "{words}");
    let curve = fs::read_to_string(first.join("area.csv")).unwrap();
    let areas: Vec<f64> = curve.lines().skip(1).map(|line| line.split(',').nth(1).unwrap().parse().unwrap()).collect();
    assert!(areas.len() > 20 && areas.windows(2).all(|pair| pair[0] <= pair[1]));
    let (again, _) = explore("again", &[]);
    for name in ["explore.json", "area.csv", "area.png", "map.png"] {
        assert!(fs::read(first.join(name)).unwrap() == fs::read(again.join(name)).unwrap(), "{name}");
    }
    // One that dies leaves its work to the other.
    let (dead, _) = explore("dead", &["--dies", "10"]);
    assert!(json(&dead.join("explore.json"))["share_seen"].as_f64().unwrap() > 0.97);
    let (alone, _) = explore("alone", &["--alone", "--true-poses"]);
    assert!(json(&alone.join("explore.json"))["keyframe_error_m"].is_null());
}

#[test]
fn robots_explore_by_what_they_tell_each_other() {
    let folder = folder("explore_radio");
    let explore = |name: &str| {
        let out = folder.join(name);
        let path = out.to_str().unwrap().to_owned();
        let args = ["explore", "--rooms", "--robots", "2", "--radio", "--loss", "0.3", "--dies", "12", "-o", &path];
        let output = run(&args);
        assert!(matches!(output.status.code(), Some(0 | 3)), "{}", text(&output.stderr));
        out
    };
    let (first, again) = (explore("first"), explore("again"));
    let report = json(&first.join("explore.json"));
    assert!(report["share_seen"].as_f64().unwrap() > 0.95, "{report}");
    assert!(report["done_s"].as_f64().is_some_and(|done_s| done_s < 400.0), "{report}");
    assert!(report["keyframe_error_m"].as_f64().unwrap() < 0.05, "{report}");
    for name in ["explore.json", "area.csv", "map.png"] {
        assert!(fs::read(first.join(name)).unwrap() == fs::read(again.join(name)).unwrap(), "{name}");
    }
}

#[test]
fn a_fleet_explores_meets_and_ends_with_one_map() {
    let folder = folder("demo_fleet");
    let out = folder.to_str().unwrap();
    let output = run(&["demo", "--fleet", "--seconds", "25", "-o", out]);
    assert_eq!(output.status.code(), Some(0), "{}{}", text(&output.stdout), text(&output.stderr));
    let words = text(&output.stdout);
    assert!(words.contains("to the byte for all who live") && words.contains("robot-4 after"), "{words}");
    let told = json(&folder.join("fleet.json"));
    assert_eq!(told["pieces"], 1);
    let robots = told["robots"].as_array().unwrap();
    assert!(robots.len() == 4 && robots.iter().all(|robot| robot["keyframes"].as_u64().unwrap() > 10), "{told}");
    assert!(told["keyframe_error_m"].as_f64().unwrap() < 0.05 && told["share_seen"].as_f64().unwrap() > 0.1, "{told}");
    for name in ["map.png", "area.png", "session.mapwright", "report.html", "trajectory-robot-2.tum"] {
        assert!(folder.join(name).metadata().is_ok_and(|file| file.len() > 100), "{name}");
    }
    let output = run(&["demo", "--seconds", "25", "-o", out]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stdout));
}
