//! The same numbers as the evo tool; `fixtures/make.py` made the trajectories and wrote down what evo printed.

#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use mapwright_eval::{Alignment, Delta, ErrorStats, RpeSettings, SpaceErrors, StampedPose, ate, rpe, space_errors};
use mapwright_geom::{Pose2, Pose3, Stamp};
use nalgebra::{Quaternion, UnitQuaternion};
use std::path::PathBuf;

fn fixture(name: &str) -> String {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name);
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// `stamp tx ty tz qx qy qz qw` of poses in the plane.
fn trajectory(name: &str) -> Vec<StampedPose> {
    let number = |word: &str| word.parse::<f64>().unwrap();
    let pose = |line: &str| {
        let words: Vec<_> = line.split(' ').collect();
        let (seconds, micros) = words[0].split_once('.').unwrap();
        let stamp = Stamp(format!("{seconds}{micros}000").parse().unwrap());
        let theta = 2.0 * number(words[6]).atan2(number(words[7]));
        StampedPose { stamp, world_from_robot: Pose2::new(number(words[1]), number(words[2]), theta) }
    };
    fixture(name).lines().filter(|l| !l.starts_with('#')).map(pose).collect()
}

fn value_of<'a>(words: &[&'a str], flag: &str) -> Option<&'a str> {
    words.iter().position(|w| *w == flag).map(|place| words[place + 1])
}

fn alignment(words: &[&str]) -> Alignment {
    match (words.contains(&"-a"), words.contains(&"-s")) {
        (false, _) => Alignment::None,
        (true, false) => Alignment::Rigid,
        (true, true) => Alignment::Similarity,
    }
}

fn steps(words: &[&str]) -> RpeSettings {
    let Some(delta) = value_of(words, "-d") else { return RpeSettings::default() };
    let in_frames = value_of(words, "-u") == Some("f");
    RpeSettings {
        delta: if in_frames { Delta::Frames(delta.parse().unwrap()) } else { Delta::Metres(delta.parse().unwrap()) },
        all_pairs: words.contains(&"--all_pairs"),
        relative_tolerance: value_of(words, "-t").map_or(0.1, |t| t.parse().unwrap()),
        pairs_from_reference: words.contains(&"--pairs_from_reference"),
    }
}

/// Computes what an evo command line asks for.
fn run(command: &str) -> ErrorStats {
    let words: Vec<_> = command.split_whitespace().collect();
    let (reference, estimate) = (trajectory(words[2]), trajectory(words[3]));
    let (translation_m, rotation_deg) = if words[0] == "evo_ape" {
        let got = ate(&reference, &estimate, alignment(&words)).unwrap();
        (got.translation_m, got.rotation_deg)
    } else {
        let got = rpe(&reference, &estimate, &steps(&words)).unwrap();
        (got.translation_m, got.rotation_deg)
    };
    if value_of(&words, "-r") == Some("angle_deg") { rotation_deg } else { translation_m }
}

fn check(command: &str, got: &ErrorStats, printed: &[&str]) {
    for row in printed {
        let (name, value) = row.split_once(' ').unwrap();
        let ours = match name {
            "max" => got.max,
            "mean" => got.mean,
            "median" => got.median,
            "min" => got.min,
            "rmse" => got.rmse,
            "sse" => got.sse,
            "std" => got.std,
            other => panic!("unknown statistic {other}"),
        };
        let theirs: f64 = value.parse().unwrap();
        assert!((ours - theirs).abs() <= 1e-6, "{command}: {name} is {ours}, evo says {theirs}");
    }
}

#[test]
fn evo_prints_the_same() {
    let text = fixture("evo.txt");
    let mut checked = 0;
    for block in text.split("$ ").skip(1) {
        let lines: Vec<_> = block.lines().collect();
        check(lines[0], &run(lines[0]), &lines[1..]);
        checked += 1;
    }
    assert_eq!(checked, 40);
}

/// The same in space, which `fixtures/make_space.py` wrote.
fn space_trajectory(name: &str) -> Vec<(Stamp, Pose3)> {
    let pose = |line: &str| {
        let words: Vec<_> = line.split(' ').collect();
        let n: Vec<f64> = words[1..].iter().map(|word| word.parse().unwrap()).collect();
        let (seconds, micros) = words[0].split_once('.').unwrap();
        let rotation = UnitQuaternion::from_quaternion(Quaternion::new(n[6], n[3], n[4], n[5]));
        let stamp = Stamp(format!("{seconds}{micros}000").parse().unwrap());
        (stamp, Pose3 { translation: [n[0], n[1], n[2]].into(), rotation })
    };
    fixture(name).lines().filter(|l| !l.starts_with('#')).map(pose).collect()
}

fn run_in_space(command: &str) -> SpaceErrors {
    let words: Vec<_> = command.split_whitespace().collect();
    let (reference, estimate) = (space_trajectory("space_reference.tum"), space_trajectory("space_estimate.tum"));
    space_errors(&reference, &estimate, alignment(&words), &steps(&words)).unwrap()
}

#[test]
fn evo_and_kitti_print_the_same_in_space() {
    let text = fixture("evo_space.txt");
    let mut checked = 0;
    for block in text.split("$ ").skip(1) {
        let lines: Vec<_> = block.lines().collect();
        let got = run_in_space(lines[0]);
        if lines[0] == "kitti" {
            let all = got.segments.unwrap().all;
            let ours = [all.count as f64, all.translation_percent, all.rotation_deg_per_100_m];
            for (ours, row) in ours.iter().zip(&lines[1..]) {
                let theirs: f64 = row.split(' ').nth(1).unwrap().parse().unwrap();
                assert!((ours - theirs).abs() <= 1e-6, "{row}, but {ours}");
            }
        } else {
            let errors = if lines[0].starts_with("evo_ape") { got.absolute } else { got.relative };
            let of_angles = lines[0].contains("angle_deg");
            check(lines[0], if of_angles { &errors.rotation_deg } else { &errors.translation_m }, &lines[1..]);
        }
        checked += 1;
    }
    assert_eq!(checked, 19);
}
