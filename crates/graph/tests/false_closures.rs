//! False closures among true ones: alone, in groups, too many.
#![allow(clippy::unwrap_used, reason = "a test may fail loudly")]

use mapwright_geom::Pose2;
use mapwright_graph::{Consensus, Edge, Gnc, PoseGraph2, Refusal, Solution, SolverSettings, Start, Vertex, optimize};
use nalgebra::{Matrix3, Vector3};

const POSES: usize = 600;

/// Three rounds of the same blocks.
fn truth(k: usize) -> Pose2 {
    let (side, along) = ((k % 200) / 50, (k % 50) as f64);
    let lane = 0.1 * (k / 200) as f64;
    match side {
        0 => Pose2::new(along, lane, 0.0),
        1 => Pose2::new(50.0 - lane, along, std::f64::consts::FRAC_PI_2),
        2 => Pose2::new(50.0 - along, 50.0 - lane, std::f64::consts::PI),
        _ => Pose2::new(lane, 50.0 - along, -std::f64::consts::FRAC_PI_2),
    }
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

    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.unit()).sum::<f64>() - 6.0
    }

    fn noise(&mut self) -> Pose2 {
        Pose2::new(0.02 * self.normal(), 0.02 * self.normal(), 0.004 * self.normal())
    }

    fn anywhere(&mut self) -> Pose2 {
        Pose2::new(20.0 * self.unit() - 10.0, 20.0 * self.unit() - 10.0, 6.2 * self.unit())
    }
}

/// The drive and its 100 true closures.
fn drive(dice: &mut Dice) -> PoseGraph2 {
    let mut graph = PoseGraph2::default();
    for k in 0..POSES {
        graph.vertices.push(Vertex { id: k as u64, world_from_vertex: truth(k), fixed: false });
    }
    for k in 1..POSES {
        connect(&mut graph, k - 1, k, truth(k - 1).between(truth(k)) * dice.noise());
    }
    for k in 0..100 {
        let (from, to) = (4 * k, 4 * k + 200);
        connect(&mut graph, from, to, truth(from).between(truth(to)) * dice.noise());
    }
    graph
}

fn connect(graph: &mut PoseGraph2, from: usize, to: usize, from_from_to: Pose2) {
    let information = Matrix3::from_diagonal(&Vector3::new(2500.0, 2500.0, 62_500.0));
    graph.edges.push(Edge { from, to, from_from_to, information });
}

/// False closures in groups of a size, members of which agree with each other.
fn add_false(graph: &mut PoseGraph2, wanted: usize, group: usize, dice: &mut Dice) {
    for _ in 0..wanted / group {
        let (from, to) = (dice.below(POSES / 2 - 50), POSES / 2 + dice.below(POSES / 2 - 50));
        let claimed = dice.anywhere();
        for k in 0..group {
            let sides = [from, to].map(|v| truth(v).between(truth(v + 2 * k)));
            connect(graph, from + 2 * k, to + 2 * k, sides[0].inverse() * claimed * sides[1] * dice.noise());
        }
    }
}

fn solved(graph: &mut PoseGraph2) -> Solution {
    let robust = Some(Gnc::default());
    optimize(graph, &SolverSettings { start: Start::Odometry, robust, ..SolverSettings::default() }).unwrap()
}

fn error(graph: &PoseGraph2) -> f64 {
    graph.vertices.iter().enumerate().map(|(k, v)| v.world_from_vertex.distance(truth(k))).fold(0.0, f64::max)
}

#[test]
fn ten_times_as_many_random_ones_and_half_as_many_in_groups_do_no_harm() {
    for seed in 1..5 {
        for (wanted, group) in [(0, 1), (100, 1), (1000, 1), (50, 5), (50, 10), (50, 25)] {
            let mut dice = Dice(seed);
            let mut clean = drive(&mut dice);
            let mut harder = clean.clone();
            add_false(&mut harder, wanted, group, &mut dice);
            optimize(&mut clean, &SolverSettings::default()).unwrap();
            let solution = solved(&mut harder);
            let (with, without) = (error(&harder), error(&clean));
            assert_eq!(solution.refused, None, "{wanted} in groups of {group}");
            assert!(with <= 1.1 * without, "{wanted} in groups of {group}: {with} {without}");
        }
    }
}

#[test]
fn where_false_ones_are_as_good_a_case_all_are_refused_and_odometry_is_kept() {
    for seed in 1..4 {
        let mut dice = Dice(seed);
        let mut graph = drive(&mut dice);
        add_false(&mut graph, 120, 20, &mut dice);
        let mut expected = graph.clone();
        expected.start_from_odometry().unwrap();
        let solution = solved(&mut graph);
        assert!(matches!(solution.refused, Some(Refusal::Rivals { .. })), "{:?}", solution.refused);
        for (found, odometry) in graph.vertices.iter().zip(&expected.vertices) {
            assert!(found.world_from_vertex.distance(odometry.world_from_vertex) < 1e-6);
        }
        assert!(
            graph.odometry().iter().zip(&solution.weights).all(|(odometry, w)| *w == f64::from(u8::from(*odometry)))
        );
    }
}

/// Beyond ten for each true one nothing is promised, unless asked for.
#[test]
fn many_times_as_many_are_refused_and_odometry_is_kept() {
    for seed in 1..4 {
        let mut dice = Dice(seed);
        let mut graph = drive(&mut dice);
        add_false(&mut graph, 2000, 1, &mut dice);
        let (mut expected, mut all_the_same) = (graph.clone(), graph.clone());
        expected.start_from_odometry().unwrap();
        let solution = solved(&mut graph);
        assert!(matches!(solution.refused, Some(Refusal::Outnumbered { .. })), "{:?}", solution.refused);
        for (found, odometry) in graph.vertices.iter().zip(&expected.vertices) {
            assert!(found.world_from_vertex.distance(odometry.world_from_vertex) < 1e-6);
        }
        let consensus = Some(Consensus { most_doubted: f64::INFINITY, ..Consensus::default() });
        let robust = Some(Gnc { consensus, ..Gnc::default() });
        let settings = SolverSettings { start: Start::Odometry, robust, ..SolverSettings::default() };
        assert_eq!(optimize(&mut all_the_same, &settings).unwrap().refused, None);
        assert!(error(&all_the_same) < 0.5 * error(&graph), "{} {}", error(&all_the_same), error(&graph));
    }
}

#[test]
fn random_ones_alone_are_refused() {
    for seed in 1..4 {
        let mut dice = Dice(seed);
        let mut graph = drive(&mut dice);
        graph.edges.truncate(POSES - 1);
        add_false(&mut graph, 300, 1, &mut dice);
        let solution = solved(&mut graph);
        assert!(solution.refused.is_some());
    }
}

/// The drive with only every so manieth closure, and odometry whose information is too large by a factor; and how many
/// edges it has.
fn overconfident_drive(factor: f64, every: usize, dice: &mut Dice) -> (PoseGraph2, usize) {
    let mut graph = drive(dice);
    graph.edges[..POSES - 1].iter_mut().for_each(|edge| edge.information *= factor);
    let closures: Vec<_> = graph.edges.drain(POSES - 1..).collect();
    graph.edges.extend(closures.into_iter().skip(every - 1).step_by(every));
    let edges = graph.edges.len();
    (graph, edges)
}

#[test]
fn odometry_that_claims_too_much_does_not_outvote_the_closures() {
    for seed in 1..4 {
        for factor in [4.0, 25.0, 100.0, 1000.0] {
            for (every, wanted, group) in [(1, 0, 1), (1, 100, 1), (1, 20, 10), (12, 0, 1), (12, 1, 1), (12, 4, 4)] {
                let mut dice = Dice(seed);
                let (mut clean, edges) = overconfident_drive(factor, every, &mut dice);
                let mut harder = clean.clone();
                add_false(&mut harder, wanted, group, &mut dice);
                optimize(&mut clean, &SolverSettings::default()).unwrap();
                let solution = solved(&mut harder);
                let named = format!("{factor} {every}: {wanted} in groups of {group}, seed {seed}");
                assert_eq!(solution.refused, None, "{named}");
                assert!(solution.weights[edges..].iter().all(|weight| *weight == 0.0), "{named}");
                let (with, without) = (error(&harder), error(&clean));
                assert!(with <= 1.1 * without, "{named}: {with} {without}");
            }
        }
    }
}
