//! What a graph cannot be.

/// Why a graph cannot be solved.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GraphError {
    /// An edge names a vertex that is not there.
    #[error("edge {edge}: expected two different vertices below {vertices}, found {from} and {to}")]
    Vertices {
        /// Place of the edge.
        edge: usize,
        /// Its first vertex.
        from: usize,
        /// Its second vertex.
        to: usize,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A vertex has no finite pose, or one beyond [`FARTHEST_M`](mapwright_geom::FARTHEST_M).
    #[error("vertex {id}: expected a pose within 10^6 m, found {found}")]
    Pose {
        /// The vertex.
        id: u64,
        /// What stands there.
        found: String,
    },
    /// An edge has no finite measurement or information, or one that is too large.
    #[error("edge {edge}: expected a relative pose within 10^6 m and information within 10^15, found otherwise")]
    Measurement {
        /// Place of the edge.
        edge: usize,
    },
    /// Gravity is at a vertex that is not there, no direction or without deviation.
    #[error(
        "gravity {at}: expected a vertex below {vertices}, a direction of length one and a deviation above zero, found {found}"
    )]
    Gravity {
        /// Place of it.
        at: usize,
        /// What stands there.
        found: String,
        /// How many vertices there are.
        vertices: usize,
    },
    /// The factor does not fit into memory.
    #[error("a graph of {vertices} vertices does not fit into memory")]
    TooLarge {
        /// How many can move.
        vertices: usize,
    },
}
