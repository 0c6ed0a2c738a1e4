//! The same graph is solved to the same bits, in one thread or several at once.
#![allow(clippy::expect_used, reason = "a test may fail loudly")]

use mapwright_geom::Pose2;
use mapwright_graph::{Edge, Gnc, PoseGraph2, SolverSettings, Vertex, optimize};
use nalgebra::Matrix3;

/// A spiral of 300 poses with closures between its turns, every ninth of them false.
fn spiral() -> PoseGraph2 {
    let mut graph = PoseGraph2::default();
    let pose = |k: u32| {
        let turn = 0.1 * f64::from(k);
        Pose2::new((5.0 + 0.2 * turn) * turn.cos(), (5.0 + 0.2 * turn) * turn.sin(), turn)
    };
    let noisy = |k: u32, scale: f64| {
        let wave = |rate: f64| scale * (rate * f64::from(k)).sin();
        Pose2::new(wave(1.3), wave(2.1), 0.2 * wave(3.7))
    };
    for k in 0..300 {
        graph.vertices.push(Vertex { id: u64::from(k), world_from_vertex: pose(k) * noisy(k, 0.3), fixed: false });
    }
    let mut connect = |from: u32, to: u32, error: Pose2| {
        let from_from_to = pose(from).between(pose(to)) * error;
        graph.edges.push(Edge {
            from: from as usize,
            to: to as usize,
            from_from_to,
            information: Matrix3::identity() * 100.0,
        });
    };
    for k in 1..300 {
        connect(k - 1, k, noisy(k, 0.02));
    }
    for k in 63..300 {
        connect(k - 63, k, if k % 9 == 0 { Pose2::new(4.0, -3.0, 1.0) } else { noisy(2 * k, 0.02) });
    }
    graph
}

#[test]
fn a_graph_is_solved_to_the_same_bits_whatever_else_runs() {
    for robust in [None, Some(Gnc::default())] {
        let solved = || {
            let mut graph = spiral();
            let settings = SolverSettings { robust, ..SolverSettings::default() };
            let solution = optimize(&mut graph, &settings).expect("a sound graph");
            let bits = |pose: Pose2| [pose.x, pose.y, pose.theta].map(f64::to_bits);
            let poses: Vec<_> = graph.vertices.iter().map(|vertex| bits(vertex.world_from_vertex)).collect();
            let weights: Vec<_> = solution.weights.iter().map(|weight| weight.to_bits()).collect();
            (poses, weights)
        };
        let alone = solved();
        let together: Vec<_> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..3).map(|_| scope.spawn(solved)).collect();
            threads.into_iter().map(|thread| thread.join().expect("solved")).collect()
        });
        assert!(together.iter().all(|other| *other == alone), "robust: {}", robust.is_some());
    }
}

#[test]
fn false_closures_of_a_spiral_are_outvoted() {
    let mut graph = spiral();
    let settings = SolverSettings { robust: Some(Gnc::default()), ..SolverSettings::default() };
    let solution = optimize(&mut graph, &settings).expect("a sound graph");
    let (closures, weights) = (&graph.edges[299..], &solution.weights[299..]);
    for (closure, weight) in closures.iter().zip(weights) {
        let is_false = closure.to % 9 == 0;
        assert!(if is_false { *weight < 0.01 } else { *weight > 0.9 }, "{} {weight}", closure.to);
    }
}
