//! The classic logs, where they are at hand.

use crate::support::{assert_code, folder, run};
use bzip2::read::MultiBzDecoder;
use serde_json::Value;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::Output;

/// `../shared/data` beside the workspace, or `MAPWRIGHT_DATA`.
pub(crate) fn shared_data(name: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let root = std::env::var_os("MAPWRIGHT_DATA").map_or_else(beside, PathBuf::from);
    let path = root.join(name);
    if !path.exists() {
        eprintln!("real logs: skipped: no data ({})", path.display());
        return None;
    }
    Some(path)
}

fn data(name: &str) -> Option<PathBuf> {
    shared_data(&format!("2d_benchmark/{name}"))
}

/// Maps the log and checks the mean relation error.
fn check(name: &str, mean_below_m: f64) {
    let (Some(log), Some(relations)) = (data(&format!("{name}.clf.bz2")), data(&format!("{name}.relations"))) else {
        return;
    };
    let out = folder(name);
    assert_code(&run(&["map", log.to_str().unwrap(), "-o", out.to_str().unwrap()]), 0);
    let (eval, value) = evaluated(&out, &relations);
    assert_code(&eval, 0);
    assert_eq!(value["missing"], 0);
    assert!(mean_m(&value) < mean_below_m, "{name}: {} m", mean_m(&value));
}

/// What `eval` says of a folder of results.
fn evaluated(out: &Path, relations: &Path) -> (Output, Value) {
    let trajectory = out.join("trajectory.tum");
    let eval = run(&["eval", trajectory.to_str().unwrap(), "--relations", relations.to_str().unwrap(), "--json"]);
    let value: Value = serde_json::from_slice(&eval.stdout).unwrap();
    (eval, value[0].clone())
}

fn mean_m(value: &Value) -> f64 {
    value["all"]["translation_m"]["mean"].as_f64().unwrap()
}

#[test]
fn intel_is_mapped_within_two_centimetres() {
    check("intel", 0.02);
}

#[test]
fn fr079_is_mapped_within_its_references_noise() {
    check("fr079", 0.033);
}

/// Its wheels count forwards while the robot drives backwards, which every sixth scan, up to a metre and a half after the one before,
/// does not show so easily.
#[test]
fn fr079_with_every_sixth_scan_is_mapped_too() {
    let (Some(log), Some(relations)) = (data("fr079.clf.bz2"), data("fr079.relations")) else { return };
    let folder = folder("fr079_every_sixth");
    std::fs::create_dir_all(&folder).unwrap();
    let mut text = String::new();
    MultiBzDecoder::new(File::open(log).unwrap()).read_to_string(&mut text).unwrap();
    let mut scans = 0;
    let is_kept = |line: &&str| {
        scans += usize::from(line.starts_with("FLASER"));
        !line.starts_with("FLASER") || scans % 6 == 1
    };
    let lines: Vec<&str> = text.lines().filter(is_kept).collect();
    let (thin, out) = (folder.join("log.clf"), folder.join("out"));
    std::fs::write(&thin, lines.join("\n")).unwrap();
    assert_code(&run(&["map", thin.to_str().unwrap(), "-o", out.to_str().unwrap()]), 0);
    let (_, value) = evaluated(&out, &relations);
    assert!(mean_m(&value) < 0.06, "{} m", mean_m(&value));
}

/// Maps the logs of a folder of `cases` in a row.
fn mapped_case(case: &str, logs: &[&str]) -> Option<PathBuf> {
    let logs = logs.iter().map(|log| shared_data(&format!("cases/{case}/{log}"))).collect::<Option<Vec<_>>>()?;
    let out = folder(case);
    let mut args = vec!["map"];
    args.extend(logs.iter().map(|log| log.to_str().unwrap()));
    let output = run(&[&args[..], &["-o", out.to_str().unwrap()]].concat());
    assert!(matches!(output.status.code(), Some(0 | 3)), "{output:?}");
    Some(out)
}

fn report_of(out: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap()
}

/// The recording's scans lag behind its odometry, which says nothing for 20 s of a gap in which the robot is carried back to where it came from:
/// it drives to and fro along three metres of a hall.
#[test]
fn a_robot_that_was_carried_back_in_a_gap_is_joined_where_it_is() {
    let Some(out) = mapped_case("carried_in_gap_hall", &["carried_in_gap_hall.clf.gz"]) else { return };
    let report = report_of(&out);
    let pieces = report["pieces"].as_array().unwrap();
    let starts: Vec<_> = pieces.iter().flat_map(|piece| piece["fragments"].as_array().unwrap()).collect();
    assert!(starts.iter().any(|fragment| fragment["start"] == "blind"), "{starts:?}");
    let trajectory = std::fs::read_to_string(out.join("trajectory.tum")).unwrap();
    let place = |line: &str| line.split(' ').skip(1).take(2).map(|word| word.parse().unwrap()).collect::<Vec<f64>>();
    let places: Vec<_> = trajectory.lines().map(place).collect();
    let away_m = |a: &[f64], b: &[f64]| (a[0] - b[0]).hypot(a[1] - b[1]);
    let farthest_m = places.iter().flat_map(|a| places.iter().map(move |b| away_m(a, b))).fold(0.0, f64::max);
    assert!(pieces.len() > 1 || farthest_m < 3.5, "{farthest_m} m");
}

/// Between two logs the robot was lifted and turned, which its odometry tells the other way.
#[test]
fn a_robot_that_was_lifted_and_turned_is_not_said_to_be_upside_down() {
    let Some(out) = mapped_case("carried_spin", &["before.clf.gz", "after.clf.gz"]) else { return };
    let verdict = &report_of(&out)["verdict"];
    assert_ne!(verdict["word"], "unusable", "{verdict}");
    assert!(verdict["reasons"].as_array().unwrap().iter().all(|reason| reason["what"] != "mirrored"), "{verdict}");
}
