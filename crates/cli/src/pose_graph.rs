//! A run's keyframes and edges as a pose graph that can be written, or solved in another way.

use mapwright::{Edge, Mapper, Pose2};
use mapwright_graph::{PoseGraph2, Vertex};

/// Keyframes at these poses, named by their place in the run's order, and those edges that are wanted; the first stays.
pub(crate) fn pose_graph(mapper: &Mapper, world_from_keyframe: &[Pose2], wanted: impl Fn(&Edge) -> bool) -> PoseGraph2 {
    let vertex = |(k, &world_from_vertex): (usize, &Pose2)| Vertex { id: k as u64, world_from_vertex, fixed: k == 0 };
    let edge = |edge: &Edge| mapwright_graph::Edge {
        from: edge.from.seq as usize,
        to: edge.to.seq as usize,
        from_from_to: edge.from_from_to,
        information: edge.information,
    };
    PoseGraph2 {
        vertices: world_from_keyframe.iter().enumerate().map(vertex).collect(),
        edges: mapper.edges().iter().filter(|edge| wanted(edge)).map(edge).collect(),
        ..PoseGraph2::default()
    }
}

/// The poses of a graph in the order of its vertices.
pub(crate) fn poses_of(graph: &PoseGraph2) -> Vec<Pose2> {
    graph.vertices.iter().map(|vertex| vertex.world_from_vertex).collect()
}
