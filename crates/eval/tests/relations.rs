//! Raw odometry of two surveyed logs scores what it is known to score.

#![allow(clippy::unwrap_used, clippy::explicit_write)] // helpers of tests

use bzip2::read::BzDecoder;
use mapwright_eval::{Relation, RelationReport, StampedPose, relation_errors};
use mapwright_geom::{Pose2, Stamp};
use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

fn data() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/2d_benchmark");
    folder.is_dir().then_some(folder)
}

fn numbers(words: &[&str]) -> Vec<f64> {
    words.iter().map(|w| w.parse().unwrap()).collect()
}

/// `FLASER n [n ranges] x y theta odom_x odom_y odom_theta ipc_timestamp host logger_timestamp`.
fn raw_odometry(log: &Path) -> Vec<StampedPose> {
    let lines = BufReader::new(BzDecoder::new(File::open(log).unwrap())).lines().map(Result::unwrap);
    let pose = |line: String| {
        let words: Vec<_> = line.split_whitespace().collect();
        let end = words.len();
        let odometry = numbers(&words[end - 6..end - 2]);
        StampedPose {
            stamp: Stamp::from_secs_f64(odometry[3]),
            world_from_robot: Pose2::new(odometry[0], odometry[1], odometry[2]),
        }
    };
    lines.filter(|line| line.starts_with("FLASER ")).map(pose).collect()
}

/// `t1 t2 x y z roll pitch yaw`.
fn relations(file: &Path) -> Vec<Relation> {
    let relation = |line: &str| {
        let v = numbers(&line.split_whitespace().collect::<Vec<_>>());
        Relation {
            from: Stamp::from_secs_f64(v[0]),
            to: Stamp::from_secs_f64(v[1]),
            from_from_to: Pose2::new(v[2], v[3], v[7]),
        }
    };
    std::fs::read_to_string(file).unwrap().lines().map(relation).collect()
}

/// Odometry's report, if the data are here and every relation finds its poses.
fn odometry_report(log: &str, expected_relations: usize) -> Option<RelationReport> {
    let Some(folder) = data() else {
        // not println!, which the test harness hides when a test passes
        writeln!(std::io::stderr(), "relations of {log}: skipped: no data").unwrap();
        return None;
    };
    let trajectory = raw_odometry(&folder.join(format!("{log}.clf.bz2")));
    let report = relation_errors(&trajectory, &relations(&folder.join(format!("{log}.relations"))));
    assert_eq!((report.used, report.missing, report.not_finite), (expected_relations, 0, 0));
    Some(report)
}

#[test]
fn raw_odometry_of_intel() {
    let Some(report) = odometry_report("intel", 2984) else {
        return;
    };
    let all = report.all.unwrap();
    assert!((all.translation_m.mean - 7.370_24).abs() < 1e-5, "{all:?}");
    assert!((all.translation_m.std - 14.349_12).abs() < 1e-5, "{all:?}");
    assert!((all.rotation_deg.mean - 39.1663).abs() < 1e-4, "{all:?}");
    assert!((all.rotation_deg.std - 53.7906).abs() < 1e-4, "{all:?}");
    let (near, far) = (report.within_10_s.unwrap(), report.beyond_60_s.unwrap());
    assert!(near.translation_m.mean < 0.1 * far.translation_m.mean);
}

#[test]
fn raw_odometry_of_fr079() {
    let Some(report) = odometry_report("fr079", 1685) else {
        return;
    };
    let all = report.all.unwrap();
    assert!((all.translation_m.mean - 6.504).abs() < 1e-3, "{all:?}");
    assert!((all.rotation_deg.mean - 30.29).abs() < 1e-2, "{all:?}");
}
