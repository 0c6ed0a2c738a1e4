//! Time of the solve alone: `cargo run --release -p mapwright-graph --example solve_g2o -- [--odometry] [--robust] [--plain] [--angles] FILE...`
#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "an example")]

use mapwright_geom::Pose;
use mapwright_graph::g2o::{AnyPoseGraph, read_g2o};
use mapwright_graph::{Gnc, PoseGraph, RotationError, SolverSettings, Start, optimize};
use std::time::Instant;

fn main() {
    let (options, files): (Vec<_>, Vec<_>) = std::env::args().skip(1).partition(|argument| argument.starts_with("--"));
    let has = |option: &str| options.iter().any(|o| o == option);
    let settings = SolverSettings {
        start: if has("--odometry") { Start::Odometry } else { Start::Given },
        chordal: !has("--plain"),
        robust: has("--robust").then(Gnc::default),
        ..SolverSettings::default()
    };
    let metric = if has("--angles") { RotationError::RotationVector } else { RotationError::QuaternionVector };
    for file in files {
        match read_g2o(std::fs::File::open(&file).unwrap(), metric).unwrap().graph {
            AnyPoseGraph::Planar(graph) => solve(&file, &graph, &settings),
            AnyPoseGraph::Spatial(graph) => solve(&file, &graph, &settings),
        }
    }
}

fn solve<P: Pose>(file: &str, graph: &PoseGraph<P>, settings: &SolverSettings) {
    let runs = (0..7).map(|_| {
        let mut graph = graph.clone();
        let started = Instant::now();
        let solution = optimize(&mut graph, settings).unwrap();
        (started.elapsed().as_secs_f64() * 1e3, solution)
    });
    let (milliseconds, solution) = runs.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
    let name = file.rsplit('/').next().unwrap_or(file);
    println!(
        "{name:22} {milliseconds:8.1} ms  chi2 {:14.4} -> {:12.6}  {:3} iterations{}{}",
        solution.chi2_before,
        solution.chi2_after,
        solution.iterations,
        if solution.from_chordal { ", from the chordal relaxation" } else { "" },
        if solution.converged { "" } else { ", not converged" },
    );
}
