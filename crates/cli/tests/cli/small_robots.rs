//! Robots with short, slow or sparse lidars: recordings of the kinds that fail elsewhere, where they are at hand.

use crate::real_logs::shared_data;
use crate::support::{assert_code, folder, run};
use serde_json::Value;
use std::path::Path;

/// Maps a recording; what `report.json` says.
fn mapped(name: &str, log: &Path) -> (std::path::PathBuf, Value) {
    let out = folder(name);
    let run = run(&["map", log.to_str().unwrap(), "-o", out.to_str().unwrap()]);
    assert_code(&run, 0);
    let report = std::fs::read_to_string(out.join("report.json")).unwrap();
    (out, serde_json::from_str(&report).unwrap())
}

fn ate_m(out: &Path, truth: &Path) -> f64 {
    let trajectory = out.join("trajectory.tum");
    let eval = run(&["eval", trajectory.to_str().unwrap(), "--reference", truth.to_str().unwrap(), "--json"]);
    let value: Value = serde_json::from_slice(&eval.stdout).unwrap();
    value[0]["ate"]["translation_m"]["rmse"].as_f64().unwrap()
}

fn way_m(out: &Path) -> f64 {
    let trajectory = std::fs::read_to_string(out.join("trajectory.tum")).unwrap();
    let poses: Vec<[f64; 2]> = trajectory
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| {
            let mut numbers = line.split_whitespace().skip(1).map(|word| word.parse().unwrap());
            [numbers.next().unwrap(), numbers.next().unwrap()]
        })
        .collect();
    poses.windows(2).map(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1])).sum()
}

#[test]
fn a_laser_that_sees_three_and_a_half_metres_maps_a_building() {
    let case = "cases/short_range_lidar/tb3_3m5";
    let (Some(log), Some(truth)) = (shared_data(&format!("{case}.bag")), shared_data(&format!("{case}.truth.tum")))
    else {
        return;
    };
    let (out, report) = mapped("short_range", &log);
    assert_eq!(report["verdict"]["word"], "good");
    assert!(ate_m(&out, &truth) < 0.02, "{} m", ate_m(&out, &truth));
}

#[test]
fn readings_that_many_beams_share_at_the_far_end_are_no_wall() {
    let Some(log) = shared_data("cases/sick8m_corridor/sick8m_corridor.clf.gz") else { return };
    let (out, report) = mapped("sick8m", &log);
    let said = report["read"]["ranges"]["codes"].as_str().unwrap_or_default();
    assert!(said.contains("8.183 m"), "{said}");
    assert!((16.0..18.5).contains(&way_m(&out)), "{} m of way, the wheels say 17", way_m(&out));
}

#[test]
fn a_lidar_in_a_finer_grid_of_bearings_is_mapped_as_in_its_own() {
    let [sparse, dense] = ["1440", "360"].map(|beams| {
        let log = shared_data(&format!("cases/sparse_beams_{beams}/sparse_beams_{beams}.clf.gz"))?;
        Some(way_m(&mapped(&format!("beams_{beams}"), &log).0))
    });
    let (Some(sparse), Some(dense)) = (sparse, dense) else { return };
    assert!(dense > 1.0 && (sparse - dense).abs() < 0.1, "{sparse} and {dense} m of way");
}
