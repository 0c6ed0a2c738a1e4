//! The graph of keyframes: which places are certain relative to each other, and where all of them are.
//!
//! Units are metres and radians; tangents are right perturbations, translation first. Information belongs to them, and
//! chi-square is that of g2o.
//!
//! ```
//! use mapwright_geom::Pose2;
//! use mapwright_graph::{Edge, PoseGraph2, SolverSettings, Vertex, optimize};
//! use nalgebra::Matrix3;
//!
//! let mut graph = PoseGraph2::default();
//! for id in 0..3 {
//!     graph.vertices.push(Vertex { id, world_from_vertex: Pose2::IDENTITY, fixed: false });
//! }
//! for (from, to, x) in [(0, 1, 1.0), (1, 2, 1.0), (0, 2, 2.3)] {
//!     let from_from_to = Pose2::new(x, 0.0, 0.0);
//!     graph.edges.push(Edge { from, to, from_from_to, information: Matrix3::identity() });
//! }
//! let solution = optimize(&mut graph, &SolverSettings::default())?;
//! assert!(solution.converged && (graph.vertices[2].world_from_vertex.x - 2.2).abs() < 1e-9);
//! # Ok::<(), mapwright_graph::GraphError>(())
//! ```

mod certainty;
mod clique;
mod consensus;
mod consistency;
mod descent;
mod error;
pub mod g2o;
mod gnc;
mod gravity;
mod group;
mod initial;
mod linear;
mod optimize;
mod pose_graph;
mod problem;
mod projection;
pub mod spread;

pub use certainty::{CertaintyGraph, Gate, Reached, Uncertainty};
pub use consensus::{Consensus, Refusal};
pub use consistency::{Closure, ConsistencySettings, Consistent, Relative, largest_consistent_set};
pub use error::GraphError;
pub use gnc::Gnc;
pub use gravity::Gravity;
pub use group::RotationError;
pub use optimize::{Solution, SolverSettings, Start, optimize};
pub use pose_graph::{Edge, LARGEST_INFORMATION, PoseGraph, PoseGraph2, PoseGraph3, Vertex, nearest_information};
pub use projection::{CovarianceGraph, Projected};
