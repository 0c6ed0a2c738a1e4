//! What becomes of a graph when false closures are added, beside what becomes of it without them:
//! `cargo run --release -p mapwright-graph --example false_closures -- [--seed S] [--group N] [--gnc] [--only NAME] DATA`,
//! where `DATA` is the folder with the graphs.
#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "an example")]

use mapwright_geom::Pose2;
use mapwright_graph::g2o::{AnyPoseGraph, read_g2o};
use mapwright_graph::{Edge, Gnc, PoseGraph2, RotationError, Solution, SolverSettings, Start, optimize};
use std::f64::consts::{PI, TAU};
use std::path::Path;
use std::time::Instant;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let value = |name: &str| arguments.iter().position(|a| a == name).and_then(|at| arguments.get(at + 1));
    let seed = value("--seed").map_or(1, |seed| seed.parse().unwrap());
    let group = value("--group").map_or(10, |group| group.parse().unwrap());
    let consensus = if arguments.iter().any(|a| a == "--gnc") { None } else { Gnc::default().consensus };
    let settings = SolverSettings {
        start: Start::Odometry,
        robust: Some(Gnc { consensus, ..Gnc::default() }),
        ..SolverSettings::default()
    };
    let data = Path::new(arguments.last().unwrap());
    println!("| graph | false closures | error | without | ratio | believed true | believed false | s | |");
    println!("|---|---|---|---|---|---|---|---|---|");
    let only = value("--only");
    for (name, graph, truth) in graphs(data).iter().filter(|(name, ..)| only.is_none_or(|only| only == name)) {
        study(name, graph, truth, (seed, group), &settings);
    }
}

/// Name, graph and true poses; where none are known, those of the optimum.
fn graphs(data: &Path) -> Vec<(&'static str, PoseGraph2, Vec<Pose2>)> {
    let read = |path: &str| match read_g2o(std::fs::File::open(data.join(path)).unwrap(), RotationError::default()) {
        Ok(file) => match file.graph {
            AnyPoseGraph::Planar(graph) => graph,
            AnyPoseGraph::Spatial(_) => unreachable!("of the plane"),
        },
        Err(error) => unreachable!("{error}"),
    };
    let nodes = "vertigo_manhattan/groundTruth/manhattanOlson3500_nodes_groundTruth.dat";
    let manhattan = truth(&std::fs::read_to_string(data.join(nodes)).unwrap());
    let ring = truth(&std::fs::read_to_string(data.join("vertigo_ring/groundTruth/poses.txt")).unwrap());
    let intel = read("intel.g2o");
    let optimum = solved(&intel, &SolverSettings::default()).0;
    vec![
        ("ring", read("vertigo_ring/originalDataset/ring.g2o"), ring),
        ("intel", intel, optimum),
        ("manhattan", read("M3500.g2o"), manhattan),
    ]
}

/// `x y theta`, the last three numbers of each line.
fn truth(text: &str) -> Vec<Pose2> {
    let pose = |line: &str| {
        let numbers: Vec<f64> = line.split_whitespace().map(|word| word.parse().unwrap()).collect();
        let at = numbers.len() - 3;
        Pose2::new(numbers[at], numbers[at + 1], numbers[at + 2])
    };
    text.lines().filter(|line| !line.trim().is_empty()).map(pose).collect()
}

fn study(name: &str, graph: &PoseGraph2, truth: &[Pose2], (seed, group): (u64, usize), settings: &SolverSettings) {
    let closures = graph.odometry().iter().filter(|is| !**is).count();
    let plain = SolverSettings { start: Start::Odometry, ..SolverSettings::default() };
    let without = error(&solved(graph, &plain).0, truth);
    let random = [0.0, 0.1, 0.5, 1.0, 3.0, 10.0, 30.0].map(|share| (share, 1));
    let grouped = [0.1, 0.25, 0.5, 1.0, 2.0].map(|share| (share, group));
    let near = [1.0, 10.0].map(|share| (share, 0));
    for (share, group) in random.into_iter().chain(near).chain(grouped) {
        let mut dice = Dice(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xD1CE);
        let mut harder = graph.clone();
        let wanted = (share * closures as f64).round() as usize;
        add_false(&mut harder, truth, wanted, group, &mut dice);
        let started = Instant::now();
        let (poses, solution) = solved(&harder, settings);
        let seconds = started.elapsed().as_secs_f64();
        let (found, clean) = (error(&poses, truth), without.max(0.001));
        let kind = ["random, near", "random", "in groups"][group.min(2)];
        let (right, wrong) = believed(&harder, &solution, graph.edges.len());
        let verdict = solution.refused.map_or_else(String::new, |refused| format!("refused: {refused:?}"));
        println!(
            "| {name} | {wanted} {kind} | {found:.4} | {without:.4} | {:.3} | {right} of {closures} | {wrong} | {seconds:.2} | {verdict} |",
            found / clean
        );
    }
}

fn solved(graph: &PoseGraph2, settings: &SolverSettings) -> (Vec<Pose2>, Solution) {
    let mut graph = graph.clone();
    let solution = optimize(&mut graph, settings).unwrap();
    (graph.vertices.iter().map(|vertex| vertex.world_from_vertex).collect(), solution)
}

fn believed(graph: &PoseGraph2, solution: &Solution, true_edges: usize) -> (usize, usize) {
    let odometry = graph.odometry();
    let counted =
        |range: std::ops::Range<usize>| range.filter(|&at| !odometry[at] && solution.weights[at] > 0.5).count();
    (counted(0..true_edges), counted(true_edges..graph.edges.len()))
}

/// Closures between random places. Groups of several: the same false transform for a run of poses along either side, as
/// when one corridor is taken for another. Groups of none: single ones that claim to be at the same place.
fn add_false(graph: &mut PoseGraph2, truth: &[Pose2], wanted: usize, group: usize, dice: &mut Dice) {
    let typical =
        graph.edges.iter().zip(graph.odometry()).find(|(_, odometry)| !odometry).map(|(edge, _)| *edge).unwrap();
    let last = graph.vertices.len() - group.max(1) - 1;
    let mut added = 0;
    while added < wanted {
        let (from, to) = (dice.below(last), dice.below(last));
        if from.abs_diff(to) < 20 {
            continue;
        }
        let reach = if group == 0 { 1.0 } else { 10.0 };
        let claimed = Pose2::new(dice.within(reach), dice.within(reach), dice.within(PI));
        for k in 0..group.max(1).min(wanted - added) {
            // where the claim, and the truth along both sides, put the pair
            let (along, across) = (truth[from].between(truth[from + k]), truth[to].between(truth[to + k]));
            let noise = Pose2::new(dice.normal() * 0.02, dice.normal() * 0.02, dice.normal() * 0.01);
            let from_from_to = along.inverse() * claimed * across * noise;
            graph.edges.push(Edge { from: from + k, to: to + k, from_from_to, information: typical.information });
            added += 1;
        }
    }
}

/// Root of the mean squared distance after the best rigid motion.
fn error(poses: &[Pose2], truth: &[Pose2]) -> f64 {
    let n = poses.len().min(truth.len()) as f64;
    let mean = |of: &[Pose2]| {
        let sum = of.iter().fold((0.0, 0.0), |sum, pose| (sum.0 + pose.x, sum.1 + pose.y));
        (sum.0 / n, sum.1 / n)
    };
    let (a, b) = (mean(poses), mean(truth));
    let (mut dot, mut cross) = (0.0, 0.0);
    for (p, t) in poses.iter().zip(truth) {
        let (px, py, tx, ty) = (p.x - a.0, p.y - a.1, t.x - b.0, t.y - b.1);
        dot += px * tx + py * ty;
        cross += px * ty - py * tx;
    }
    let motion = Pose2::new(0.0, 0.0, cross.atan2(dot));
    let squared = poses.iter().zip(truth).map(|(p, t)| {
        let [x, y] = motion.transform([p.x - a.0, p.y - a.1]);
        (x - t.x + b.0).powi(2) + (y - t.y + b.1).powi(2)
    });
    (squared.sum::<f64>() / n).sqrt()
}

/// Numbers that are the same everywhere (SplitMix64).
struct Dice(u64);

impl Dice {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ (mixed >> 31)
    }

    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn below(&mut self, sides: usize) -> usize {
        (self.unit() * sides as f64) as usize
    }

    fn within(&mut self, reach: f64) -> f64 {
        reach * (2.0 * self.unit() - 1.0)
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.unit()).ln()).sqrt() * (TAU * self.unit()).cos()
    }
}
