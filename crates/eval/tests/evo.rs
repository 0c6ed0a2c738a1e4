//! The same numbers as the evo tool; `fixtures/make.py` made the trajectories and wrote down what evo printed.

#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use mapwright_eval::{Alignment, Delta, ErrorStats, RpeSettings, StampedPose, ate, rpe};
use mapwright_geom::{Pose2, Stamp};
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

/// Computes what an evo command line asks for.
fn run(command: &str) -> ErrorStats {
    let words: Vec<_> = command.split_whitespace().collect();
    let has = |flag: &str| words.contains(&flag);
    let (reference, estimate) = (trajectory(words[2]), trajectory(words[3]));
    let (translation_m, rotation_deg) = if words[0] == "evo_ape" {
        let alignment = match (has("-a"), has("-s")) {
            (false, _) => Alignment::None,
            (true, false) => Alignment::Rigid,
            (true, true) => Alignment::Similarity,
        };
        let got = ate(&reference, &estimate, alignment).unwrap();
        (got.translation_m, got.rotation_deg)
    } else {
        let delta = value_of(&words, "-d").unwrap();
        let in_frames = value_of(&words, "-u") == Some("f");
        let settings = RpeSettings {
            delta: if in_frames {
                Delta::Frames(delta.parse().unwrap())
            } else {
                Delta::Metres(delta.parse().unwrap())
            },
            all_pairs: has("--all_pairs"),
            relative_tolerance: value_of(&words, "-t").map_or(0.1, |t| t.parse().unwrap()),
            pairs_from_reference: has("--pairs_from_reference"),
        };
        let got = rpe(&reference, &estimate, &settings).unwrap();
        (got.translation_m, got.rotation_deg)
    };
    if value_of(&words, "-r") == Some("angle_deg") { rotation_deg } else { translation_m }
}

fn check(command: &str, printed: &[&str]) {
    let got = run(command);
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
        check(lines[0], &lines[1..]);
        checked += 1;
    }
    assert_eq!(checked, 40);
}
