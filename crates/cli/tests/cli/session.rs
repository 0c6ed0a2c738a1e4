//! `session.mapwright`: everything else that `mapwright map` writes can be made of it, and what is left of one is of use.

use crate::support::{assert_code, folder, json, log_of, run, small_log_in, text};
use mapwright::{EdgeKind, Session};
use mapwright_formats::TumWriter;
use mapwright_graph::g2o::{AnyPoseGraph, write_g2o};
use mapwright_graph::{Edge, PoseGraph2, Vertex};
use mapwright_sim::{Drive, DriveSettings, worlds};
use serde_json::Value;
use std::fs;
use std::path::Path;

/// A session that nothing is lost of.
fn session_in(folder: &Path) -> Session {
    let (session, report) = Session::read(&fs::read(folder.join("session.mapwright")).unwrap()).unwrap();
    assert!(report.is_whole() && report.unknown == 0, "{report:?}");
    session
}

fn trajectory(session: &Session) -> Vec<u8> {
    let mut writer = TumWriter::new(Vec::new());
    session.trajectory().for_each(|pose| writer.write_planar(pose.stamp, pose.map_from_robot).unwrap());
    writer.finish().unwrap()
}

fn graph(session: &Session) -> Vec<u8> {
    let poses = session.map_from_keyframe().iter().enumerate();
    let vertices = poses.map(|(k, &world_from_vertex)| Vertex { id: k as u64, world_from_vertex, fixed: k == 0 });
    let edges = session.edges().map(|edge| Edge {
        from: session.place(edge.from).unwrap(),
        to: session.place(edge.to).unwrap(),
        from_from_to: edge.from_from_to,
        information: edge.information,
    });
    let graph = PoseGraph2 { vertices: vertices.collect(), edges: edges.collect(), ..PoseGraph2::default() };
    let mut bytes = Vec::new();
    write_g2o(&AnyPoseGraph::Planar(graph), &mut bytes).unwrap();
    bytes
}

#[test]
fn trajectory_graph_closures_and_report_say_what_the_session_says() {
    let folder = folder("session");
    let (log, out) = (folder.join("loop.clf"), folder.join("out"));
    fs::write(&log, log_of(Drive::new(worlds::loop_of(3, 150.0).into(), DriveSettings::long_drive(3)))).unwrap();
    assert_code(&run(&["map", log.to_str().unwrap(), "-o", out.to_str().unwrap(), "--quiet"]), 0);
    let session = session_in(&out);
    let closures = session.edges().filter(|edge| edge.kind == EdgeKind::Closure).count();
    assert!(closures > 0 && session.corrections() > 0, "{closures} closures, {} corrections", session.corrections());
    assert!(fs::read(out.join("trajectory.tum")).unwrap() == trajectory(&session));
    assert!(fs::read(out.join("graph.g2o")).unwrap() == graph(&session));
    let report = json(&out.join("report.json"));
    assert_eq!(report["keyframes"], session.keyframes().len());
    assert_eq!(report["edges"], session.edges().count());
    assert_eq!(report["read"]["scans"], session.scans().len());
    assert_same_closures(&json(&out.join("closures.json")), &session);
}

fn assert_same_closures(file: &Value, session: &Session) {
    assert_eq!(file["keyframes"], session.keyframes().len());
    let (candidates, slips) = (file["candidates"].as_array().unwrap(), file["slips"].as_array().unwrap());
    assert_eq!((candidates.len(), slips.len()), (session.candidates().len(), session.slips().len()));
    for (found, expected) in candidates.iter().zip(session.candidates()) {
        assert_eq!(found["from"], session.place(expected.from).unwrap());
        assert_eq!(found["to"], session.place(expected.to).unwrap());
        assert_eq!(found["verdict"], expected.verdict.name());
        assert_eq!(found["detection"], expected.detection.name());
        assert_eq!(found["evidence"]["points"], expected.evidence.points);
        assert_eq!(found["evidence"]["agreeing"], expected.evidence.agreeing);
        let pose =
            found["from_from_to"].as_array().map(|numbers| [0, 1, 2].map(|k: usize| numbers[k].as_f64().unwrap()));
        let off = pose.zip(expected.from_from_to).map(|([x, y, theta], expected)| {
            [x - expected.x, y - expected.y, theta - expected.theta].into_iter().map(f64::abs).fold(0.0, f64::max)
        });
        assert_eq!(pose.is_some(), expected.from_from_to.is_some());
        assert!(off.unwrap_or(0.0) < 1e-12, "{off:?}");
    }
    for (found, expected) in slips.iter().zip(session.slips()) {
        assert_eq!((&found["scan"], &found["from"]), (&expected.scan.into(), &session.place(expected.from).into()));
    }
}

#[test]
fn what_is_left_of_a_run_that_was_cut_short_is_exported_and_told_about() {
    let folder = folder("session_cut_short");
    let (log, out, left) = (small_log_in(&folder), folder.join("out"), folder.join("left"));
    assert_code(&run(&["map", &log, "-o", out.to_str().unwrap(), "--quiet"]), 0);
    let mut bytes = fs::read(out.join("session.mapwright")).unwrap();
    bytes.truncate(bytes.len() / 2);
    let (session, report) = Session::read(&bytes).unwrap();
    assert!(!session.scans().is_empty() && !report.is_whole(), "half of the log ends within an entry: {report:?}");
    fs::create_dir(&left).unwrap();
    fs::write(left.join("session.mapwright.part"), &bytes).unwrap();
    for (to, file) in [("tum", "export.tum"), ("mcap", "export.mcap"), ("pgm", "export.pgm")] {
        let output = run(&["export", left.to_str().unwrap(), "--to", to]);
        assert_code(&output, 3);
        let said = text(&output.stdout);
        let loss = report.losses[0].to_string();
        assert!(said.contains("session.mapwright.part") && said.contains(&loss), "expected {loss:?}, found {said:?}");
        assert!(left.join(file).exists(), "{file}");
    }
    assert!(fs::read(left.join("export.tum")).unwrap() == trajectory(&session));
    // Where there is a whole session too, that one counts.
    fs::copy(out.join("session.mapwright"), left.join("session.mapwright")).unwrap();
    assert_code(&run(&["export", left.to_str().unwrap(), "--to", "tum"]), 0);
    assert!(fs::read(left.join("export.tum")).unwrap() == fs::read(out.join("trajectory.tum")).unwrap());
}
