//! Any bytes as a pose graph: no panic, no endless loop, and what is written reads back.
//! `cargo +nightly fuzz run g2o -- -max_total_time=60`
#![no_main]

use libfuzzer_sys::fuzz_target;
use mapwright_graph::g2o::{AnyPoseGraph, read_g2o, write_g2o};
use mapwright_graph::{RotationError, SolverSettings, optimize};

fuzz_target!(|text: &[u8]| {
    let Ok(mut file) = read_g2o(text, RotationError::default()) else { return };
    let _ = match &mut file.graph {
        AnyPoseGraph::Planar(graph) => optimize(graph, &SolverSettings::default()),
        AnyPoseGraph::Spatial(graph) => optimize(graph, &SolverSettings::default()),
    };
    let mut bytes = Vec::new();
    write_g2o(&file.graph, &mut bytes).expect("a vector does not fail");
    let _ = read_g2o(bytes.as_slice(), RotationError::default());
});
