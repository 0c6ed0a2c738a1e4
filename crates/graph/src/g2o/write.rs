//! Graph to text.

use super::AnyPoseGraph;
use super::prior::of_gravity;
use super::read::scaled_rotations;
use crate::group::{PoseGroup, RotationError};
use crate::pose_graph::{PoseGraph, PoseGraph3};
use mapwright_geom::Pose3;
use nalgebra::{Matrix6, SMatrix};
use std::fmt::Write as _;
use std::io::{self, Write};

/// Writes a graph with g2o's tags; every number reads back as the same double, but for the rounding of the quaternion's
/// norm. Gravity is a prior of the vertex's pose, without information on position and heading.
///
/// # Errors
/// Those of the stream.
pub fn write_g2o(graph: &AnyPoseGraph, stream: &mut impl Write) -> io::Result<()> {
    match graph {
        AnyPoseGraph::Planar(graph) => {
            write_parts(graph, stream, "SE2", |pose| pose.to_vector().as_slice().to_vec(), |i| *i)
        }
        AnyPoseGraph::Spatial(graph) => {
            let scale = match graph.metric {
                RotationError::QuaternionVector => 2.0,
                RotationError::RotationVector => 1.0,
            };
            let convert = |information: &Matrix6<f64>| scaled_rotations(information, scale);
            write_parts(graph, stream, "SE3:QUAT", numbers_of, convert)?;
            write_gravity(graph, stream, convert)
        }
    }
}

/// Which sensor gravity is felt by: one that sits at the vertex.
const SENSOR: u64 = 0;

fn write_gravity(
    graph: &PoseGraph3,
    stream: &mut impl Write,
    convert: impl Fn(&Matrix6<f64>) -> Matrix6<f64>,
) -> io::Result<()> {
    if graph.gravity.is_empty() {
        return Ok(());
    }
    let mut line = format!("PARAMS_SE3OFFSET {SENSOR} 0 0 0 0 0 0 1\n");
    for gravity in &graph.gravity {
        let Some(vertex) = graph.vertices.get(gravity.vertex) else {
            return Err(io::Error::other("gravity of the graph names a vertex that is not there"));
        };
        let (world_from_vertex, information) = of_gravity(gravity, vertex.world_from_vertex);
        let _ = write!(line, "EDGE_SE3_PRIOR {} {SENSOR}", vertex.id);
        push_numbers(&mut line, numbers_of(&world_from_vertex).into_iter().chain(upper(&convert(&information))));
        stream.write_all(line.as_bytes())?;
        line.clear();
    }
    Ok(())
}

/// `x y z qx qy qz qw`.
fn numbers_of(pose: &Pose3) -> Vec<f64> {
    pose.translation.iter().chain(pose.rotation.coords.iter()).copied().collect()
}

/// The upper triangle, row by row.
fn upper<const D: usize>(information: &SMatrix<f64, D, D>) -> impl Iterator<Item = f64> {
    (0..D).flat_map(|r| (r..D).map(move |c| (r, c))).map(|at| information[at])
}

fn write_parts<P: PoseGroup<D>, const D: usize>(
    graph: &PoseGraph<P>,
    stream: &mut impl Write,
    tag: &str,
    numbers: impl Fn(&P) -> Vec<f64>,
    convert: impl Fn(&SMatrix<f64, D, D>) -> SMatrix<f64, D, D>,
) -> io::Result<()> {
    let mut line = String::new();
    for vertex in &graph.vertices {
        line.clear();
        let _ = write!(line, "VERTEX_{tag} {}", vertex.id);
        push_numbers(&mut line, numbers(&vertex.world_from_vertex).into_iter());
        stream.write_all(line.as_bytes())?;
    }
    for vertex in graph.vertices.iter().filter(|vertex| vertex.fixed) {
        writeln!(stream, "FIX {}", vertex.id)?;
    }
    for edge in &graph.edges {
        let [from, to] = [edge.from, edge.to].map(|at| graph.vertices.get(at).map(|vertex| vertex.id));
        let Some((from, to)) = from.zip(to) else {
            return Err(io::Error::other("an edge of the graph names a vertex that is not there"));
        };
        let information = convert(&edge.information);
        line.clear();
        let _ = write!(line, "EDGE_{tag} {from} {to}");
        push_numbers(&mut line, numbers(&edge.from_from_to).into_iter().chain(upper(&information)));
        stream.write_all(line.as_bytes())?;
    }
    Ok(())
}

fn push_numbers(line: &mut String, numbers: impl Iterator<Item = f64>) {
    // `+ 0.0` spares minus zero its sign
    for number in numbers {
        let _ = write!(line, " {}", number + 0.0);
    }
    line.push('\n');
}
