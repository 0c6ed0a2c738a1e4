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
