//! `mapwright optimize`: what it says, what it writes, what it refuses.

use crate::support::{assert_code, assert_refused, folder, run, text};
use std::fs;
use std::path::{Path, PathBuf};

/// Five poses around a square of 2 m, closed by one edge, with some error.
const SQUARE: &str = "VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 2.1 0 1.5
VERTEX_SE2 2 2 2.2 3.1
VERTEX_SE2 3 0 2 -1.6
EDGE_SE2 0 1 2 0 1.5708 10 0 0 10 0 100
EDGE_SE2 1 2 2 0 1.5708 10 0 0 10 0 100
EDGE_SE2 2 3 2 0 1.5708 10 0 0 10 0 100
EDGE_SE2 3 0 2 0 1.5708 10 0 0 10 0 100
";

fn optimized(folder: &Path, graph: &str, more: &[&str]) -> std::process::Output {
    let (input, output) = (folder.join("in.g2o"), folder.join("out.g2o"));
    fs::write(&input, graph).unwrap();
    run(&[&["optimize", input.to_str().unwrap(), "-o", output.to_str().unwrap()], more].concat())
}

#[test]
fn a_square_is_closed_and_told_about() {
    let folder = folder("optimize");
    let output = optimized(&folder, SQUARE, &[]);
    assert_code(&output, 0);
    let said = text(&output.stdout);
    ["2D, 4 vertices, 4 edges, 1 of them closures", "chi-square", "iteration", "written to", "out.g2o"]
        .iter()
        .for_each(|what| assert!(said.contains(what), "{said}"));
    let written = fs::read_to_string(folder.join("out.g2o")).unwrap();
    assert_eq!(written.lines().filter(|line| line.starts_with("VERTEX_SE2")).count(), 4);
    let again = optimized(&folder, &written, &["--json", "--from", "odometry"]);
    let value: serde_json::Value = serde_json::from_slice(&again.stdout).unwrap();
    assert!(value["chi2_after"].as_f64().unwrap() < 1e-6 && value["converged"].as_bool().unwrap());
}

#[test]
fn a_false_closure_is_outvoted() {
    let folder = folder("optimize_robust");
    let graph = format!("{SQUARE}EDGE_SE2 0 2 -9 4 1 10 0 0 10 0 100\n");
    let output = optimized(&folder, &graph, &["--robust", "--json"]);
    assert_code(&output, 0);
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(value["outvoted"], 1, "{value}");
    assert_eq!(value["weights"], serde_json::json!([1.0, 1.0, 1.0, 1.0, 0.0]));
}

/// A way of 60 m whose odometry pitches by 0.02 rad a metre while the robot is level, with true closures, a false one, and where down is.
fn drifting() -> String {
    let mut text = String::new();
    for k in 0..60 {
        let (s, c) = (0.01 * f64::from(k)).sin_cos();
        text += &format!("VERTEX_SE3:QUAT {k} {k} 0 0 0 {s} 0 {c}\n");
    }
    let edge = |from: i32, to: i32, x: f64, pitch_rad: f64, turns: &str| {
        let (s, c) = (0.5 * pitch_rad).sin_cos();
        let turns = format!("{turns} 0 0 {turns} 0 {turns}");
        format!("EDGE_SE3:QUAT {from} {to} {x} 0 0 0 {s} 0 {c} 1e4 0 0 0 0 0 1e4 0 0 0 0 1e4 0 0 0 {turns}\n")
    };
    (1..60).for_each(|k| text += &edge(k - 1, k, 1.0, 0.02, "2500"));
    (0..12).for_each(|k| text += &edge(k, k + 45, 45.0, 0.0, "1e4"));
    text += &edge(3, 40, -9.0, 0.0, "1e4");
    text += "PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1\n";
    for k in 0..60 {
        text += &format!("EDGE_SE3_PRIOR {k} 0 0 0 0 0 0 0 1{} 2500 0 0 2500 0 0\n", " 0".repeat(15));
    }
    text
}

#[test]
fn gravity_levels_a_graph_with_robust_as_without() {
    let folder = folder("optimize_gravity");
    let graph = drifting();
    let is_false = |line: &&str| !line.starts_with("EDGE_SE3:QUAT 3 40 ");
    let without_false: String = graph.lines().filter(is_false).map(|line| format!("{line}\n")).collect();
    let poses = |graph: &str, more: &[&str]| {
        let output = optimized(&folder, graph, &[&["--json"], more].concat());
        assert_code(&output, 0);
        let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(value["gravity"], 60, "{value}");
        let written = fs::read_to_string(folder.join("out.g2o")).unwrap();
        assert_eq!(written.lines().filter(|line| line.starts_with("EDGE_SE3_PRIOR ")).count(), 60);
        let pose = |line: &str| line.split(' ').skip(2).map(|word| word.parse().unwrap()).collect::<Vec<f64>>();
        let poses: Vec<_> = written.lines().filter(|line| line.starts_with("VERTEX")).map(pose).collect();
        (value, poses)
    };
    let (value, robust) = poses(&graph, &["--robust"]);
    assert_eq!((&value["believed"], &value["outvoted"]), (&12.into(), &1.into()), "{value}");
    let (_, plain) = poses(&without_false, &[]);
    for (a, b) in robust.iter().zip(&plain) {
        assert!(a[3].hypot(a[4]) < 0.02, "leans by half of {a:?}");
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-3), "{a:?} {b:?}");
    }
    let said = text(&optimized(&folder, &graph, &["--robust"]).stdout);
    assert!(said.contains("13 of them closures; 60 edges of gravity"), "{said}");
    let other = format!("{graph}EDGE_SE3_PRIOR 5 0 0 0 0 0 0 0 1 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1\n");
    let output = optimized(&folder, &other, &["--robust"]);
    assert_code(&output, 3);
    assert!(text(&output.stdout).contains("1 prior other than of gravity left out"), "{output:?}");
}

#[test]
fn bad_files_are_refused_with_the_line_or_repaired_and_told() {
    let folder = folder("optimize_bad");
    let refused = |graph: &str, says: &[&str]| assert_refused(&optimized(&folder, graph, &[]), 1, says);
    refused("", &["in.g2o", "expected a vertex or an edge"]);
    refused("VERTEX_SE2 0 0 nan 0\n", &["line 1", "nan"]);
    refused(&SQUARE[..SQUARE.len() - 12], &["line 8", "expected"]);
    refused(&format!("{SQUARE}VERTEX_SE3:QUAT 9 0 0 0 0 0 0 1\n"), &["line 9", "all of the plane"]);
    refused("VERTEX_SE2 0 1e300 0 0\n", &["line 1", "within 10^6", "1e300"]);
    assert!(!folder.join("out.g2o").exists());
    let odd = format!("{SQUARE}VERTEX_XY 7 1 1\nEDGE_SE2 1 1 0 0 0 1 0 0 1 0 1\nEDGE_SE2 0 2 2 2 3 -1 0 0 1 0 1\n");
    let output = optimized(&folder, &odd, &[]);
    assert_code(&output, 3);
    let said = text(&output.stdout);
    ["\"VERTEX_XY\" at line 9", "1 edge from a vertex to itself", "1 edge whose information is not positive"]
        .iter()
        .for_each(|what| assert!(said.contains(what), "{said}"));
}

/// Optima of the classic graphs; those of space belong to information over angles, the default.
#[test]
fn the_classic_graphs_reach_their_optima_from_both_starts() {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let root = std::env::var_os("MAPWRIGHT_DATA").map_or_else(beside, PathBuf::from).join("g2o");
    let folder = folder("optimize_classic");
    let out = folder.join("out.g2o").display().to_string();
    let optima = [("M3500", 137.913), ("intel", 45.005), ("sphere2500", 1351.402), ("parking-garage", 1.2684)];
    for (name, chi2) in optima {
        let path = root.join(format!("{name}.g2o"));
        if !path.exists() {
            eprintln!("classic graphs: skipped: no data ({})", path.display());
            continue;
        }
        for from in ["file", "odometry"] {
            let path = path.to_str().unwrap();
            let output = run(&["optimize", path, "-o", &out, "--from", from, "--json"]);
            assert_code(&output, 0);
            let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
            let found = value["chi2_after"].as_f64().unwrap();
            assert!((found / chi2 - 1.0).abs() < 1e-4, "{name} from {from}: {found}");
        }
    }
}

#[test]
fn closures_that_nothing_supports_are_refused_and_odometry_kept() {
    let folder = folder("optimize_refused");
    let square = SQUARE.replace("EDGE_SE2 3 0 2 0 1.5708", "EDGE_SE2 3 0 -9 4 1");
    let output = optimized(&folder, &square, &["--robust"]);
    assert_code(&output, 3);
    let said = text(&output.stdout);
    ["believed: 0 closures, outvoted: 1", "closures refused, poses of odometry kept", "no closure agrees"]
        .iter()
        .for_each(|what| assert!(said.contains(what), "{said}"));
    let written = fs::read_to_string(folder.join("out.g2o")).unwrap();
    let corner: Vec<f64> = written.lines().nth(2).unwrap().split(' ').skip(2).map(|v| v.parse().unwrap()).collect();
    assert!((corner[0] - 2.0).abs() < 1e-4 && (corner[1] - 2.0).abs() < 1e-4, "{written}");
}

#[test]
fn chi_square_of_space_names_its_convention() {
    let folder = folder("optimize_convention");
    let graph = "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 1 0 0 0 0 0 0.09983341664682815 0.9950041652780258
EDGE_SE3:QUAT 0 1 0 0 0 0 0 0 1 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 400 0 0 400 0 400
";
    let said = |more: &[&str]| text(&optimized(&folder, graph, more).stdout);
    assert!(said(&[]).contains("chi-square over angles 16.000000 ->"), "{}", said(&[]));
    let quaternions = said(&["--information", "quaternions"]);
    assert!(quaternions.contains("chi-square over quaternions 3.986"), "{quaternions}");
}
