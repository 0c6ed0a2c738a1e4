//! A sphere whose rotations are so noisy that a descent from odometry does not find home.
#![allow(clippy::unwrap_used, reason = "a test may fail loudly")]

use mapwright_geom::Pose3;
use mapwright_graph::{Edge, PoseGraph3, RotationError, SolverSettings, Start, Vertex, optimize};
use nalgebra::{Matrix6, SMatrix, UnitQuaternion, Vector3, Vector6};
use std::f64::consts::{PI, TAU};

const RINGS: u32 = 20;
const AROUND: u32 = 30;

fn truth(k: u32) -> Pose3 {
    let (ring, step) = (f64::from(k / AROUND), f64::from(k % AROUND));
    let (latitude, longitude) = (PI * (ring + 1.0) / f64::from(RINGS + 1), TAU * step / f64::from(AROUND));
    let up = Vector3::new(latitude.sin() * longitude.cos(), latitude.sin() * longitude.sin(), latitude.cos());
    let rotation = UnitQuaternion::from_euler_angles(0.0, latitude, longitude);
    Pose3 { translation: up * 20.0, rotation }
}

/// Numbers that are nearly normal, and the same everywhere.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        (0..12).map(|_| uniform()).sum()
    }
}

fn sphere(turn_noise: f64, seed: u64) -> PoseGraph3 {
    let mut graph = PoseGraph3 { metric: RotationError::RotationVector, ..PoseGraph3::default() };
    let mut noise = Noise(seed);
    let count = RINGS * AROUND;
    for k in 0..count {
        graph.vertices.push(Vertex { id: u64::from(k), world_from_vertex: truth(k), fixed: false });
    }
    let pairs = (1..count).map(|k| (k - 1, k)).chain((AROUND..count).map(|k| (k - AROUND, k)));
    for (from, to) in pairs {
        let error = Vector6::from_fn(|k, _| noise.next() * if k < 3 { 0.1 } else { turn_noise });
        let from_from_to = truth(from).inverse() * truth(to) * Pose3::exp(error);
        let information: SMatrix<f64, 6, 6> =
            Matrix6::from_diagonal(&Vector6::from_fn(|k, _| if k < 3 { 100.0 } else { turn_noise.powi(-2) }));
        graph.edges.push(Edge { from: from as usize, to: to as usize, from_from_to, information });
    }
    graph
}

#[test]
fn a_sphere_with_big_noise_is_solved_from_odometry() {
    for seed in 1..4 {
        let mut from_truth = sphere(0.15, seed);
        let mut from_odometry = from_truth.clone();
        let best = optimize(&mut from_truth, &SolverSettings { chordal: false, ..SolverSettings::default() }).unwrap();
        let settings = SolverSettings { start: Start::Odometry, ..SolverSettings::default() };
        let found = optimize(&mut from_odometry, &settings).unwrap();
        assert!(found.converged && found.from_chordal);
        assert!((found.chi2_after / best.chi2_after - 1.0).abs() < 1e-4, "{} {}", found.chi2_after, best.chi2_after);
    }
}
