//! Pose graphs as text: g2o's tags `VERTEX_SE2`, `EDGE_SE2`, `VERTEX_SE3:QUAT`, `EDGE_SE3:QUAT`, `FIX`, and TORO's
//! `VERTEX2`, `EDGE2`, `VERTEX3`, `EDGE3` when reading.
//!
//! [Gravity](crate::Gravity) is what g2o calls a prior: `EDGE_SE3_PRIOR` with no information on the position and on turns about the
//! direction of gravity, seen from a sensor at `PARAMS_SE3OFFSET`. Other priors are counted and left out.
//!
//! Information in space belongs to `x y z qx qy qz` in a g2o file, that is to half angles; here it belongs to angles.

mod prior;
mod read;
mod write;

pub use read::{G2oFile, G2oReport, read_g2o};
pub use write::write_g2o;

use crate::pose_graph::{PoseGraph2, PoseGraph3};
use std::io;

/// A graph of the plane or of space.
#[derive(Debug, Clone, PartialEq)]
pub enum AnyPoseGraph {
    /// Of the plane.
    Planar(PoseGraph2),
    /// Of space.
    Spatial(PoseGraph3),
}

/// Why a file could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum G2oError {
    /// The stream below failed.
    #[error("the stream failed: {0}")]
    Io(#[from] io::Error),
    /// A line is not what its tag says.
    #[error("line {line}: expected {expected}, found {found}")]
    Line {
        /// Number of the line, from 1.
        line: usize,
        /// What should have stood there.
        expected: String,
        /// What stands there, shortened.
        found: String,
    },
    /// There is no vertex and no edge.
    #[error("expected a vertex or an edge, found none in {lines} lines{}", first_unknown.as_ref().map_or(String::new(), |tag| format!(", the first of them {tag}")))]
    Empty {
        /// How many lines there are.
        lines: usize,
        /// The first tag that is not known.
        first_unknown: Option<String>,
    },
}
