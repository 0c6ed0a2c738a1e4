//! How long a graph of 10,000 keyframes takes when one more closure comes: `cargo run --release -p mapwright-graph --example one_more_closure`
#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "an example")]

use mapwright_geom::Pose2;
use mapwright_graph::{Edge, PoseGraph2, SolverSettings, Vertex, optimize};
use nalgebra::{Matrix3, Vector3};
use std::time::Instant;

const KEYFRAMES: u32 = 10_000;
const CLOSURES: u32 = 50;

fn main() {
    let mut graph = drive();
    optimize(&mut graph, &SolverSettings::default()).unwrap();
    close(&mut graph, 123, 9_623, 77.0);
    let runs = (0..7).map(|_| {
        let mut graph = graph.clone();
        let started = Instant::now();
        let solution = optimize(&mut graph, &SolverSettings::default()).unwrap();
        (started.elapsed().as_secs_f64() * 1e3, solution)
    });
    let (milliseconds, solution) = runs.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
    println!(
        "{} keyframes, {} edges: {milliseconds:.1} ms, chi2 {:.3} -> {:.3} in {} iterations",
        graph.vertices.len(),
        graph.edges.len(),
        solution.chi2_before,
        solution.chi2_after,
        solution.iterations
    );
}

/// Rounds of 500 keyframes; an edge by odometry and one by matching each, closures between rounds.
fn drive() -> PoseGraph2 {
    let mut graph = PoseGraph2::default();
    for k in 0..KEYFRAMES {
        graph.vertices.push(Vertex { id: u64::from(k), world_from_vertex: truth(k), fixed: false });
    }
    for k in 1..KEYFRAMES {
        connect(&mut graph, k - 1, k, Pose2::new(wave(k, 1.3, 0.01), wave(k, 2.1, 0.01), wave(k, 0.7, 0.004)), 1e4);
        connect(&mut graph, k - 1, k, Pose2::new(wave(k, 3.3, 0.005), wave(k, 4.1, 0.005), wave(k, 1.7, 0.002)), 4e4);
    }
    for k in 0..CLOSURES {
        let from = (k * 180) % (KEYFRAMES - 1000);
        close(&mut graph, from, from + 500 * (1 + k % 2), f64::from(k));
    }
    graph
}

fn truth(k: u32) -> Pose2 {
    let turn = f64::from(k) * std::f64::consts::TAU / 500.0;
    let radius = 40.0 + 5.0 * (3.0 * turn).sin();
    Pose2::new(radius * turn.cos(), radius * turn.sin(), turn)
}

fn wave(k: u32, rate: f64, scale: f64) -> f64 {
    scale * (rate * f64::from(k)).sin()
}

fn close(graph: &mut PoseGraph2, from: u32, to: u32, phase: f64) {
    connect(graph, from, to, Pose2::new(0.02 * phase.sin(), 0.02 * phase.cos(), 0.005 * (2.0 * phase).sin()), 2e3);
}

fn connect(graph: &mut PoseGraph2, from: u32, to: u32, error: Pose2, weight: f64) {
    let from_from_to = truth(from).between(truth(to)) * error;
    let information = Matrix3::from_diagonal(&Vector3::new(weight, weight, 4.0 * weight));
    graph.edges.push(Edge { from: from as usize, to: to as usize, from_from_to, information });
}
