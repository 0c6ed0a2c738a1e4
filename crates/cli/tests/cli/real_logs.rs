//! The classic logs, where they are at hand.

use crate::support::{assert_code, folder, run};
use std::path::{Path, PathBuf};

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
    let trajectory = out.join("trajectory.tum");
    let args = ["eval", trajectory.to_str().unwrap(), "--relations", relations.to_str().unwrap(), "--json"];
    let eval = run(&args);
    assert_code(&eval, 0);
    let value: serde_json::Value = serde_json::from_slice(&eval.stdout).unwrap();
    let mean_m = value[0]["all"]["translation_m"]["mean"].as_f64().unwrap();
    assert_eq!(value[0]["missing"], 0);
    assert!(mean_m < mean_below_m, "{name}: {mean_m} m");
}

#[test]
fn intel_is_mapped_within_two_centimetres() {
    check("intel", 0.02);
}

#[test]
fn fr079_is_mapped_within_its_references_noise() {
    check("fr079", 0.033);
}
