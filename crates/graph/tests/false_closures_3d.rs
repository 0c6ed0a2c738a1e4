//! False closures among true ones in space: a drive up the ramps of a garage.
#![allow(clippy::unwrap_used, reason = "a test may fail loudly")]

use mapwright_geom::{Pose, Pose2, Pose3};
use mapwright_graph::{Edge, Gnc, PoseGraph3, RotationError, Solution, SolverSettings, Start, Vertex, optimize};
use nalgebra::{Matrix6, Vector6};

const POSES: usize = 450;
const AROUND: usize = 150;
const CLOSURES: usize = 75;

/// Three floors, each once around a square; the robot pitches and rolls on the way.
fn truth(k: usize) -> Pose3 {
    let turn = std::f64::consts::TAU * (k % AROUND) as f64 / AROUND as f64;
    let level = Pose2::new(20.0 * turn.cos(), 15.0 * turn.sin(), turn + 1.5).in_space();
    let wave = 0.3 * (0.2 * k as f64).sin();
    level.moved([0.0, 0.0, 3.0 * k as f64 / AROUND as f64]) * Pose3::exp([0.0, 0.0, 0.0, wave, 0.7 * wave, 0.0].into())
}

/// Numbers that are the same everywhere.
struct Dice(u64);

impl Dice {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn below(&mut self, sides: usize) -> usize {
        (self.unit() * sides as f64) as usize
    }

    fn noise(&mut self) -> Pose3 {
        let mut normal = || (0..12).map(|_| self.unit()).sum::<f64>() - 6.0;
        Pose3::exp(Vector6::from_fn(|k, _| normal() * if k < 3 { 0.02 } else { 0.004 }))
    }

    fn anywhere(&mut self) -> Pose3 {
        Pose3::exp(Vector6::from_fn(|k, _| (self.unit() - 0.5) * if k < 3 { 20.0 } else { 3.0 }))
    }
}

/// The drive, and its true closures from floor to floor.
fn drive(dice: &mut Dice) -> PoseGraph3 {
    let mut graph = PoseGraph3 { metric: RotationError::RotationVector, ..PoseGraph3::default() };
    for k in 0..POSES {
        graph.vertices.push(Vertex { id: k as u64, world_from_vertex: truth(k), fixed: false });
    }
    for k in 1..POSES {
        connect(&mut graph, k - 1, k, truth(k - 1).between(truth(k)) * dice.noise());
    }
    for k in 0..CLOSURES {
        let (from, to) = (4 * k, 4 * k + AROUND);
        connect(&mut graph, from, to, truth(from).between(truth(to)) * dice.noise());
    }
    graph
}

fn connect(graph: &mut PoseGraph3, from: usize, to: usize, from_from_to: Pose3) {
    let information = Matrix6::from_diagonal(&Vector6::from_fn(|k, _| if k < 3 { 0.02_f64 } else { 0.004 }.powi(-2)));
    graph.edges.push(Edge { from, to, from_from_to, information });
}

/// False closures in groups of a size, members of which agree with each other.
fn add_false(graph: &mut PoseGraph3, wanted: usize, group: usize, dice: &mut Dice) {
    for _ in 0..wanted / group {
        let (from, to) = (dice.below(POSES / 2 - 50), POSES / 2 + dice.below(POSES / 2 - 50));
        let claimed = dice.anywhere();
        for k in 0..group {
            let sides = [from, to].map(|v| truth(v).between(truth(v + 2 * k)));
            connect(graph, from + 2 * k, to + 2 * k, sides[0].inverse() * claimed * sides[1] * dice.noise());
        }
    }
}

fn solved(graph: &mut PoseGraph3, gnc: Gnc) -> Solution {
    optimize(graph, &SolverSettings { start: Start::Odometry, robust: Some(gnc), ..SolverSettings::default() }).unwrap()
}

fn error(graph: &PoseGraph3) -> f64 {
    graph.vertices.iter().enumerate().map(|(k, v)| v.world_from_vertex.distance(truth(k))).fold(0.0, f64::max)
}

#[test]
fn as_many_random_ones_and_some_in_groups_do_no_harm() {
    for seed in 1..3 {
        for (wanted, group) in [(0, 1), (75, 1), (300, 1), (20, 5)] {
            let mut dice = Dice(seed);
            let mut clean = drive(&mut dice);
            let mut harder = clean.clone();
            add_false(&mut harder, wanted, group, &mut dice);
            optimize(&mut clean, &SolverSettings::default()).unwrap();
            let solution = solved(&mut harder, Gnc::default());
            assert_eq!(solution.refused, None, "{wanted} in groups of {group}");
            let believed = solution.weights[POSES - 1 + CLOSURES..].iter().filter(|w| **w > 0.0).count();
            assert_eq!(believed, 0, "{wanted} in groups of {group}");
            assert!(error(&harder) <= 1.1 * error(&clean), "{wanted} in groups of {group}");
        }
    }
}

#[test]
fn graduated_non_convexity_alone_outvotes_some() {
    let mut dice = Dice(3);
    let mut clean = drive(&mut dice);
    let mut harder = clean.clone();
    add_false(&mut harder, 15, 1, &mut dice);
    optimize(&mut clean, &SolverSettings::default()).unwrap();
    let solution = solved(&mut harder, Gnc { consensus: None, ..Gnc::default() });
    let (true_ones, false_ones) = solution.weights[POSES - 1..].split_at(CLOSURES);
    assert!(false_ones.iter().all(|w| *w == 0.0), "{false_ones:?}");
    assert!(true_ones.iter().filter(|w| **w == 1.0).count() >= CLOSURES - 3, "{true_ones:?}");
    assert!(error(&harder) <= 1.5 * error(&clean), "{} {}", error(&harder), error(&clean));
}
