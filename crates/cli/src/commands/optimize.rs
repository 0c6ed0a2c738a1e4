//! `mapwright optimize`

use crate::args::{Information, OptimizeArgs, StartFrom};
use crate::failure::{Failure, Outcome};
use crate::foreign::kind_at;
use crate::report::remarks;
use crate::terminal::{count, grouped, say, say_json};
use mapwright_geom::Pose;
use mapwright_graph::g2o::{AnyPoseGraph, G2oReport, read_g2o, write_g2o};
use mapwright_graph::{Gnc, PoseGraph, Refusal, RotationError, Solution, SolverSettings, Start, optimize};
use serde_json::{Value, json};
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::Path;
use std::time::Instant;

pub(super) fn run(args: &OptimizeArgs) -> Result<Outcome, Failure> {
    let (mut graph, report) = read(&args.graph, args.information)?;
    let settings = SolverSettings {
        start: match args.from {
            StartFrom::File => Start::Given,
            StartFrom::Odometry => Start::Odometry,
        },
        max_iterations: args.max_iterations as usize,
        robust: args.robust.then(Gnc::default),
        ..SolverSettings::default()
    };
    let started = Instant::now();
    let solved = match &mut graph {
        AnyPoseGraph::Planar(graph) => solve(graph, &settings),
        AnyPoseGraph::Spatial(graph) => solve(graph, &settings),
    };
    let (size, solution) = solved.map_err(|cause| Failure::Solve { path: args.graph.clone(), cause })?;
    let solve_s = started.elapsed().as_secs_f64();
    write(&args.output, &graph)?;
    let (losses, oddities) = (losses(&report, &solution), oddities(&report, &solution, &size));
    if args.voice.json {
        say_json(&to_json(args, &size, &solution, solve_s, &losses, &oddities))?;
    } else if !args.voice.quiet {
        let written = format!("written to {}\n", args.output.display());
        say(&(to_words(args, &size, &solution, solve_s) + &remarks(&losses, &oddities) + &written))?;
    }
    Ok(Outcome::of_losses(&losses))
}

/// How large a graph is.
struct Size {
    dimensions: usize,
    vertices: usize,
    edges: usize,
    odometry: usize,
    /// Directions of gravity.
    gravity: usize,
}

fn read(path: &Path, information: Information) -> Result<(AnyPoseGraph, G2oReport), Failure> {
    if path.is_dir() {
        return Err(Failure::open(path, "expected a pose graph, found a directory"));
    }
    let file = File::open(path).map_err(|error| Failure::open(path, error))?;
    let metric = match information {
        Information::Quaternions => RotationError::QuaternionVector,
        Information::Angles => RotationError::RotationVector,
    };
    let read = read_g2o(file, metric).map_err(|cause| match kind_at(path).filter(|kind| !kind.is_graph()) {
        Some(kind) => Failure::Log(kind.instead(&path.display().to_string(), "a pose graph")),
        None => Failure::Graph { path: path.to_owned(), cause },
    })?;
    Ok((read.graph, read.report))
}

fn solve<P: Pose>(
    graph: &mut PoseGraph<P>,
    settings: &SolverSettings,
) -> Result<(Size, Solution), mapwright_graph::GraphError> {
    let odometry = graph.odometry().into_iter().filter(|is| *is).count();
    let (vertices, edges) = (graph.vertices.len(), graph.edges.len());
    let size = Size { dimensions: P::TRANSLATION, vertices, edges, odometry, gravity: graph.gravity.len() };
    Ok((size, optimize(graph, settings)?))
}

/// The file takes its name only when it is complete.
fn write(path: &Path, graph: &AnyPoseGraph) -> Result<(), Failure> {
    if path.is_dir() {
        return Err(Failure::write(path, std::io::Error::other("expected a file, found a directory")));
    }
    let mut part = path.as_os_str().to_owned();
    part.push(".part");
    let written = File::create(&part).and_then(|file| {
        let mut writer = BufWriter::new(file);
        write_g2o(graph, &mut writer)?;
        writer.flush()?;
        fs::rename(&part, path)
    });
    written.map_err(|error| {
        // nothing helps where cleaning up fails as well
        let _ = fs::remove_file(&part);
        Failure::write(path, error)
    })
}

/// What of the file has no part in the result.
fn losses(report: &G2oReport, solution: &Solution) -> Vec<String> {
    let mut losses = Vec::new();
    if let Some((tag, line)) = &report.first_unknown {
        let lines = count(report.unknown_lines as u64, "line");
        losses.push(format!("{lines} with an unknown tag left out, the first {tag} at line {line}"));
    }
    let counted = [
        (report.self_edges, "edge", " from a vertex to itself left out"),
        (report.indefinite_information, "edge", " whose information is not positive semidefinite; the nearest taken"),
        (report.zero_information, "edge", " without information"),
        (report.other_priors, "prior", " other than of gravity left out"),
        (report.unknown_fixes, "FIX line", " of unknown vertices left out"),
        (report.duplicate_vertices, "vertex line", " given again left out"),
    ];
    losses.extend(counted.iter().filter(|c| c.0 > 0).map(|(n, what, why)| count(*n as u64, what) + why));
    if let Some(refusal) = &solution.refused {
        losses.push(format!("closures refused, poses of odometry kept: {}", refusal_in_words(refusal)));
    }
    if !solution.converged {
        losses.push(format!("not converged after {}", count(solution.iterations as u64, "iteration")));
    }
    losses
}

/// What was noticed and did no harm.
fn oddities(report: &G2oReport, solution: &Solution, size: &Size) -> Vec<String> {
    let mut oddities = Vec::new();
    if solution.connected_parts > 1 {
        oddities.push(format!("{} parts that no edge connects", grouped(solution.connected_parts as u64)));
    }
    if report.vertices_from_edges > 0 && report.vertices_from_edges < size.vertices {
        let vertices = count(report.vertices_from_edges as u64, "pose");
        oddities.push(format!("{vertices} not in the file, taken from the edges"));
    }
    if report.without_information > 0 {
        let edges = count(report.without_information as u64, "edge");
        oddities.push(format!("{edges} without information: the identity taken, as TORO and GTSAM do"));
    }
    if report.unnormalised_quaternions > 0 {
        oddities.push(count(report.unnormalised_quaternions as u64, "quaternion") + " normalised");
    }
    oddities
}

fn silenced(solution: &Solution) -> usize {
    solution.weights.iter().filter(|weight| **weight < 0.5).count()
}

fn believed(size: &Size, solution: &Solution) -> usize {
    (size.edges - size.odometry).saturating_sub(silenced(solution))
}

/// Why no closure was followed.
fn refusal_in_words(refusal: &Refusal) -> String {
    let closures = |n: usize| count(n as u64, "closure");
    match refusal {
        Refusal::NothingBelieved => "no closure agrees with odometry and others".to_owned(),
        Refusal::Rivals { believed, rivals } => {
            format!("{} agree with each other against {} that do", closures(*rivals), grouped(*believed as u64))
        }
        Refusal::Outnumbered { believed, doubted } => {
            let believed = grouped(*believed as u64);
            format!("{} are doubted and {believed} believed, of which some may be accidents", closures(*doubted))
        }
        Refusal::Chance { believed, expected } => {
            format!("{} agree, of random ones {expected:.0} would", closures(*believed))
        }
        Refusal::Strained { chi2_per_freedom } => {
            format!(
                "closures and odometry contradict each other, chi-square per degree of freedom {chi2_per_freedom:.1}"
            )
        }
        other => format!("{other:?}"),
    }
}

/// What rotations of errors are measured by.
fn convention(args: &OptimizeArgs, size: &Size) -> &'static str {
    match (size.dimensions, args.information) {
        (2, _) => "",
        (_, Information::Angles) => " over angles",
        (_, Information::Quaternions) => " over quaternions",
    }
}

fn to_words(args: &OptimizeArgs, size: &Size, solution: &Solution, solve_s: f64) -> String {
    let mut text = format!(
        "{}: {}D, {} vertices, {} edges, {} of them closures{}\nchi-square{} {:.6} -> {:.6} in {}, {:.1} ms\n",
        args.graph.display(),
        size.dimensions,
        grouped(size.vertices as u64),
        grouped(size.edges as u64),
        grouped((size.edges - size.odometry) as u64),
        if size.gravity > 0 { format!("; {} of gravity", count(size.gravity as u64, "edge")) } else { String::new() },
        convention(args, size),
        solution.chi2_before,
        solution.chi2_after,
        count(solution.iterations as u64, "iteration"),
        solve_s * 1e3,
    );
    if args.robust {
        let (believed, outvoted) = (believed(size, solution) as u64, silenced(solution) as u64);
        text.push_str(&format!("believed: {}, outvoted: {}\n", count(believed, "closure"), grouped(outvoted)));
    }
    text
}

fn to_json(
    args: &OptimizeArgs,
    size: &Size,
    solution: &Solution,
    solve_s: f64,
    losses: &[String],
    odd: &[String],
) -> Value {
    json!({
        "graph": args.graph.display().to_string(),
        "written": args.output.display().to_string(),
        "dimensions": size.dimensions,
        "vertices": size.vertices,
        "edges": size.edges,
        "closures": size.edges - size.odometry,
        "gravity": size.gravity,
        "chi2_before": solution.chi2_before,
        "chi2_after": solution.chi2_after,
        "iterations": solution.iterations,
        "converged": solution.converged,
        "from_chordal": solution.from_chordal,
        "connected_parts": solution.connected_parts,
        "information": if args.information == Information::Angles { "angles" } else { "quaternions" },
        "believed": believed(size, solution),
        "outvoted": silenced(solution),
        "refused": solution.refused.as_ref().map(refusal_in_words),
        "weights": args.robust.then_some(&solution.weights),
        "solve_s": solve_s,
        "odd": odd,
        "losses": losses,
    })
}
