//! `mapwright rendezvous`: what it says of logs of robots that see each other, and of wrong ones.

use crate::support::{assert_code, assert_refused, folder, run, text};
use std::fs;
use std::path::{Path, PathBuf};

/// Two robots that face each other 2 m apart, and see it.
fn small_set(name: &str) -> PathBuf {
    let folder = folder(name);
    let write = |file: &str, text: &str| fs::write(folder.join(file), text).unwrap();
    write("Barcodes.dat", "# Subject #    Barcode #\n  1 \t   5\n  2 \t  14\n");
    for robot in 1..=2 {
        let stamps = |every: usize| (0..40).step_by(every).map(|k| 100.0 + 0.25 * f64::from(k));
        let odometry: String = stamps(1).map(|s| format!("{s:.3} \t 0.000 \t 0.000\n")).collect();
        write(&format!("Robot{robot}_Odometry.dat"), &format!("# Time [s]\n{odometry}"));
        let barcode = if robot == 1 { 14 } else { 5 };
        let seen: String = stamps(4).map(|s| format!("{s:.3} {barcode} 2.000 0.000\n")).collect();
        write(&format!("Robot{robot}_Measurement.dat"), &seen);
        let x = if robot == 1 { 0.0 } else { 2.0 };
        let heading = if robot == 1 { 0.0 } else { std::f64::consts::PI };
        let truth: String = stamps(1).map(|s| format!("{s:.3} {x} 0 {heading:.6}\n")).collect();
        write(&format!("Robot{robot}_Groundtruth.dat"), &truth);
    }
    folder
}

#[test]
fn two_robots_that_face_each_other_know_where_they_are() {
    let set = small_set("rendezvous");
    let table = set.join("encounters.csv");
    let output = run(&["rendezvous", set.to_str().unwrap(), "-o", table.to_str().unwrap(), "--json"]);
    assert_code(&output, 0);
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let (pair, scores) = (&value["pairs"][0], &value["scores"][0]);
    assert_eq!(
        (pair["mutual"].as_u64(), pair["joins"].as_u64(), pair["waiting"].as_u64()),
        (Some(10), Some(1), Some(0))
    );
    assert!(scores["translation_m"]["median"].as_f64().unwrap() < 1e-3, "{scores}");
    assert_eq!(scores["within_95"].as_f64(), Some(1.0));
    let rows = fs::read_to_string(table).unwrap();
    let first: Vec<&str> = rows.lines().nth(1).unwrap().split(',').collect();
    assert_eq!((first[0], first[1], first[2], rows.lines().count()), ("100.000000000", "1", "2", 11));
    let heading: f64 = first[5].parse().unwrap();
    assert!((heading.abs() - std::f64::consts::PI).abs() < 1e-3, "{heading}");
    let said = text(&run(&["rendezvous", set.to_str().unwrap()]).stdout);
    assert!(said.contains("1 and 2") && said.contains("beside the truth"), "{said}");
}

#[test]
fn wrong_files_are_named_with_their_line() {
    let set = small_set("rendezvous_wrong");
    let path = set.to_str().unwrap();
    fs::write(set.join("Robot2_Measurement.dat"), "# x\n100 5 2 0\n101 5 nan 0\n100.5 5 2 0\n").unwrap();
    let output = run(&["rendezvous", path]);
    assert_code(&output, 3);
    let said = text(&output.stdout);
    ["Robot2_Measurement.dat: 1 row not finite", "Robot2_Measurement.dat: 1 row with a stamp before"]
        .iter()
        .for_each(|what| assert!(said.contains(what), "{said}"));
    fs::write(set.join("Robot2_Odometry.dat"), "# x\n100 0.1 0\n101 0.1\n").unwrap();
    assert_refused(&run(&["rendezvous", path]), 1, &["Robot2_Odometry.dat", "line 3", "angular velocity", "2 columns"]);
    fs::remove_file(set.join("Robot2_Odometry.dat")).unwrap();
    assert_refused(&run(&["rendezvous", path]), 1, &["Robot2_Odometry.dat", "found no such file"]);
    fs::write(set.join("Barcodes.dat"), "1 5\n2 5\n").unwrap();
    assert_refused(&run(&["rendezvous", path]), 1, &["Barcodes.dat", "found 1 and 2 for 5"]);
    let file = set.join("Robot1_Odometry.dat");
    assert_refused(&run(&["rendezvous", file.to_str().unwrap()]), 1, &["expected a folder or an archive"]);
}

/// The floor of the figures: 0.10 m and 1.5 deg in the median, 0.20 m and 5 deg for 95 %.
#[test]
fn robots_of_mrclam_meet_within_the_floor() {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let root = std::env::var_os("MAPWRIGHT_DATA").map_or_else(beside, PathBuf::from);
    let archive = root.join("multi_mrclam/MRCLAM_Dataset6.tar.zst");
    if !archive.exists() {
        eprintln!("rendezvous: skipped: no data ({})", archive.display());
        return;
    }
    let output = run(&["rendezvous", archive.to_str().unwrap(), "--within", "0.25", "--json"]);
    assert_code(&output, 0);
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let of = |kind: &str, number: &str| value["scores"][0][kind][number].as_f64().unwrap();
    assert!(value["scores"][0]["scored"].as_u64() >= Some(195), "{value}");
    assert!(of("translation_m", "median") < 0.07 && of("translation_m", "p95") < 0.2, "{value}");
    assert!(of("rotation_deg", "median") < 0.7 && of("rotation_deg", "p95") < 5.0, "{value}");
    let within = value["scores"][0]["within_95"].as_f64().unwrap();
    assert!((0.9..=0.99).contains(&within), "{within}");
}
