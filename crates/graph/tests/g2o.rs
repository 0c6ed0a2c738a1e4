//! Reading and writing: what is written reads back, what is broken is refused or counted, and nothing panics.

#![allow(clippy::unwrap_used, clippy::panic, reason = "tests may")]

use mapwright_graph::g2o::{AnyPoseGraph, G2oError, G2oReport, read_g2o, write_g2o};
use mapwright_graph::{Gnc, Gravity, PoseGraph3, RotationError, SolverSettings, optimize};
use nalgebra::Vector3;

const PLANE: &str = "VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0.1 0.5
VERTEX_SE2 2 1.5 1 1.25
VERTEX_SE2 3 0.5 1.5 2
FIX 0
EDGE_SE2 0 1 1 0 0.5 10 1 2 20 3 30
EDGE_SE2 1 2 1 0 0.75 10 1 2 20 3 30
EDGE_SE2 2 3 1 0.25 1 10 1 2 20 3 30
EDGE_SE2 3 0 -1.5 0.5 -2 10 1 2 20 3 30
";

const SPACE: &str = "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 1 1 0.5 0 0 0 0.5 0.8660254037844386
VERTEX_SE3:QUAT 2 1 1.5 0.25 0.5 0 0 0.8660254037844386
EDGE_SE3:QUAT 0 1 1 0.5 0 0 0 0.5 0.8660254037844386 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 4 0 0 4 0 4
EDGE_SE3:QUAT 1 2 1 0.5 0 0 0.5 0 0.8660254037844386 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 4 0 0 4 0 4
EDGE_SE3:QUAT 0 2 1 1.5 0 0.5 0 0 0.8660254037844386 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 4 0 0 4 0 4
";

fn read(text: &str) -> Result<mapwright_graph::g2o::G2oFile, G2oError> {
    read_g2o(text.as_bytes(), RotationError::default())
}

fn written(graph: &AnyPoseGraph) -> String {
    let mut bytes = Vec::new();
    write_g2o(graph, &mut bytes).unwrap();
    String::from_utf8(bytes).unwrap()
}

#[test]
fn what_is_written_reads_back() {
    assert_eq!(written(&read(PLANE).unwrap().graph), PLANE);
    for metric in [RotationError::QuaternionVector, RotationError::RotationVector] {
        let once = written(&read_g2o(SPACE.as_bytes(), metric).unwrap().graph);
        assert_eq!(once.lines().count(), SPACE.lines().count());
        assert_eq!(written(&read_g2o(once.as_bytes(), metric).unwrap().graph), once);
    }
}

fn space(text: &str, metric: RotationError) -> (PoseGraph3, G2oReport) {
    let file = read_g2o(text.as_bytes(), metric).unwrap();
    match file.graph {
        AnyPoseGraph::Spatial(graph) => (graph, file.report),
        AnyPoseGraph::Planar(_) => panic!("expected space"),
    }
}

#[test]
fn gravity_is_written_as_priors_and_read_back() {
    for metric in [RotationError::QuaternionVector, RotationError::RotationVector] {
        let (mut graph, _) = space(SPACE, metric);
        let down = |x: f64, y: f64| Vector3::new(x, y, -1.0).normalize();
        let up = Gravity { vertex: 1, down_in_vertex: Vector3::z(), sigma_rad: 0.01 };
        graph.gravity = vec![
            Gravity { vertex: 2, down_in_vertex: down(0.1, -0.3), sigma_rad: 0.012 },
            Gravity { vertex: 0, down_in_vertex: down(-2.0, 0.5), sigma_rad: 0.5 },
            up,
        ];
        let text = written(&AnyPoseGraph::Spatial(graph.clone()));
        assert_eq!(text.matches("EDGE_SE3_PRIOR ").count(), 3);
        let (read, report) = space(&text, metric);
        assert_eq!((report.other_priors, report.unknown_lines, report.indefinite_information), (0, 0, 0));
        assert_eq!(read.gravity.len(), 3);
        for (read, known) in read.gravity.iter().zip(&graph.gravity) {
            assert_eq!(read.vertex, known.vertex);
            assert!((read.down_in_vertex - known.down_in_vertex).norm() < 1e-12, "{read:?} {known:?}");
            assert!((read.sigma_rad - known.sigma_rad).abs() < 1e-12, "{read:?} {known:?}");
        }
        let chi2 = [&graph, &read].map(|graph| graph.chi2().unwrap());
        assert!((chi2[0] - chi2[1]).abs() < 1e-9 * chi2[0], "{chi2:?}");
    }
}

#[test]
fn priors_that_are_not_of_gravity_are_counted_and_sensors_turned_into_place() {
    let prior = |sensor: &str, pose: &str, information: &str| {
        space(&format!("{SPACE}{sensor}EDGE_SE3_PRIOR 1 7 {pose} {information}\n"), RotationError::RotationVector)
    };
    let level = "0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 100 0 0 100 0 0";
    // A sensor that lies on its side: its y axis is the vertex's z.
    let lying = "PARAMS_SE3OFFSET 7 0 0 0.2 0.7071067811865476 0 0 0.7071067811865476\n";
    let (graph, report) = prior(lying, "5 5 5 0 0 0.6 0.8", level);
    assert_eq!(report.other_priors, 0);
    assert!((graph.gravity[0].down_in_vertex - Vector3::y()).norm() < 1e-9, "{:?}", graph.gravity);
    assert!((graph.gravity[0].sigma_rad - 0.1).abs() < 1e-12);
    for other in [
        "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 100 0 0 100 0 0",
        "0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 100 0 0 100 0 50",
        "0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 100 0 0 25 0 0",
        "0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0",
    ] {
        let (graph, report) = prior(lying, "5 5 5 0 0 0.6 0.8", other);
        assert_eq!((graph.gravity.len(), report.other_priors), (0, 1), "{other}");
    }
    let told = read(&format!("{SPACE}EDGE_SE3_PRIOR 1 7 0 0 0 0 0 0 1 {level}\n")).unwrap_err().to_string();
    assert!(told.starts_with("line 7: expected a sensor that a line PARAMS_SE3OFFSET 7 before"), "{told}");
    let told = read(&format!("{SPACE}{lying}EDGE_SE3_PRIOR 1 7 0 0 0 0 0 0 1 100\n")).unwrap_err().to_string();
    assert!(told.starts_with("line 8: expected an entry of the information matrix"), "{told}");
}

/// One edge off by a rotation of 0.2 rad about z: g2o sees the sine of the half angle.
#[test]
fn information_of_space_belongs_to_half_angles() {
    let text = "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 1 0 0 0 0 0 0.09983341664682815 0.9950041652780258
EDGE_SE3:QUAT 0 1 0 0 0 0 0 0 1 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 400 0 0 400 0 400
";
    let chi2 = |metric| match read_g2o(text.as_bytes(), metric).unwrap().graph {
        AnyPoseGraph::Spatial(graph) => graph.chi2().unwrap(),
        AnyPoseGraph::Planar(_) => panic!("expected space"),
    };
    assert!((chi2(RotationError::QuaternionVector) - 400.0 * 0.1_f64.sin().powi(2)).abs() < 1e-9);
    assert!((chi2(RotationError::RotationVector) - 400.0 * 0.2_f64.powi(2)).abs() < 1e-9);
}

#[test]
fn the_old_tags_mean_the_same() {
    let old =
        PLANE.replace("VERTEX_SE2", "VERTEX2").replace("EDGE_SE2", "EDGE2").replace("10 1 2 20 3 30", "10 1 20 30 2 3");
    assert_eq!(read(&old).unwrap(), read(PLANE).unwrap());
    let space = "VERTEX3 0 0 0 0 0 0 0\nVERTEX3 1 1 2 3 0 0 0.5\nEDGE3 0 1 1 2 3 0 0 0.5 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1\n";
    let AnyPoseGraph::Spatial(graph) = read(space).unwrap().graph else { panic!("expected space") };
    assert!(graph.chi2().unwrap() < 1e-20);
    assert!((graph.vertices[1].world_from_vertex.rotation.angle() - 0.5).abs() < 1e-12);
}

#[test]
fn vertices_that_only_edges_name_get_poses() {
    let edges: String = PLANE.lines().filter(|line| line.starts_with("EDGE")).map(|line| format!("{line}\n")).collect();
    let file = read(&edges).unwrap();
    assert_eq!(file.report.vertices_from_edges, 4);
    let AnyPoseGraph::Planar(graph) = file.graph else { panic!("expected the plane") };
    assert!((graph.vertices[1].world_from_vertex.x - 1.0).abs() < 1e-12);
}

#[test]
fn disconnected_parts_each_keep_their_first_vertex() {
    let text = format!(
        "{PLANE}VERTEX_SE2 10 50 50 1\nVERTEX_SE2 11 51 50 1\nEDGE_SE2 10 11 2 0 0 1 0 0 1 0 1\nVERTEX_SE2 20 9 9 0\n"
    );
    let AnyPoseGraph::Planar(mut graph) = read(&text).unwrap().graph else { panic!("expected the plane") };
    let before = graph.clone();
    let solution = optimize(&mut graph, &SolverSettings::default()).unwrap();
    assert_eq!(solution.connected_parts, 3);
    assert!(solution.converged);
    for kept in [0, 4, 6] {
        assert_eq!(graph.vertices[kept], before.vertices[kept]);
    }
}

#[test]
fn what_is_odd_is_counted() {
    let odd = format!(
        "{PLANE}VERTEX_SE2 0 5 5 5\nFIX 99\nEDGE_SE2 1 3 0 0 0 0 0 0 0 0 0\nEDGE_SE2 1 3 0 0 0 -1 0 0 1 0 1\nWHAT 1\nEDGE_SE2 2 2 0 0 0 1 0 0 1 0 1\n"
    );
    let report = read(&odd).unwrap().report;
    let counts =
        [report.duplicate_vertices, report.unknown_fixes, report.zero_information, report.indefinite_information];
    assert_eq!(counts, [1; 4]);
    assert_eq!(
        (report.self_edges, report.unknown_lines, report.first_unknown),
        (1, 1, Some(("\"WHAT\"".to_owned(), 14)))
    );
}

/// A small generator, so that the corruptions are the same everywhere.
struct Dice(u64);

impl Dice {
    fn below(&mut self, sides: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % sides
    }
}

/// One to four corruptions of a text: bytes changed, cut off, doubled; words replaced by what hurts.
fn corrupted(text: &str, dice: &mut Dice) -> Vec<u8> {
    const WORDS: [&str; 14] = [
        "nan",
        "inf",
        "-1",
        "0",
        "1e300",
        "-1e15",
        "1e-300",
        "999999",
        "VERTEX_SE2",
        "EDGE_SE2",
        "FIX",
        "1e6",
        "3",
        "",
    ];
    let mut bytes = text.as_bytes().to_vec();
    for _ in 0..=dice.below(4) {
        let at = dice.below(bytes.len());
        match dice.below(5) {
            0 => bytes[at] = dice.below(256) as u8,
            1 => bytes.truncate(at + 1),
            2 => {
                let end = (at + dice.below(80)).min(bytes.len());
                let piece = bytes[at..end].to_vec();
                bytes.extend(piece);
            }
            _ => {
                let text = String::from_utf8_lossy(&bytes).into_owned();
                let mut words: Vec<&str> = text.split_inclusive([' ', '\n']).collect();
                let word = format!("{} ", WORDS[dice.below(WORDS.len())]);
                let place = dice.below(words.len());
                words[place] = &word;
                bytes = words.concat().into_bytes();
            }
        }
        bytes.push(b'\n');
    }
    bytes
}

#[test]
fn ten_thousand_corruptions_neither_panic_nor_loop() {
    let prior = "EDGE_SE3_PRIOR 1 7 1 2 3 0 0 0.6 0.8 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 400 0 0 400 0 0";
    let level = format!("{SPACE}PARAMS_SE3OFFSET 7 0 0 0 0 0 0 1\n{prior}\n");
    let mut dice = Dice(7);
    let mut solved = 0;
    for round in 0..10_000 {
        let whole = match round % 4 {
            1 => SPACE,
            3 => &level,
            _ => PLANE,
        };
        let text = corrupted(whole, &mut dice);
        let Ok(file) = read_g2o(text.as_slice(), RotationError::default()) else { continue };
        let settings = SolverSettings { robust: (round % 3 == 0).then(Gnc::default), ..SolverSettings::default() };
        let (chi2, graph) = match file.graph {
            AnyPoseGraph::Planar(mut graph) => {
                (optimize(&mut graph, &settings).map(|s| (s.chi2_before, s.chi2_after)), AnyPoseGraph::Planar(graph))
            }
            AnyPoseGraph::Spatial(mut graph) => {
                (optimize(&mut graph, &settings).map(|s| (s.chi2_before, s.chi2_after)), AnyPoseGraph::Spatial(graph))
            }
        };
        if let Ok((before, after)) = chi2 {
            assert!(
                settings.robust.is_some() || after <= before * (1.0 + 1e-9),
                "{before} -> {after}: {}",
                String::from_utf8_lossy(&text)
            );
            assert!(after.is_finite());
            solved += 1;
        }
        written(&graph);
    }
    assert!(solved > 1000, "{solved}");
}
