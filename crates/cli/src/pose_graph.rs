//! A session's keyframes and edges as a pose graph that can be written, or solved in another way.

use mapwright::{Edge, Session};
use mapwright_geom::Pose;
use mapwright_graph::{Gravity, PoseGraph, Vertex};
use mapwright_record::Measurement;

/// Keyframes at these poses, named by their place in the session, those edges that stand and are wanted, and gravity; the first stays,
/// where there is gravity with its position and heading.
pub(crate) fn pose_graph<M: Measurement>(
    session: &Session<M>,
    world_from_keyframe: &[M::Pose],
    wanted: impl Fn([usize; 2], &Edge<M::Pose>) -> bool,
) -> PoseGraph<M::Pose> {
    let gravity = session.gravity().iter().filter_map(|known| {
        let (vertex, down_in_vertex) = (session.place(known.keyframe)?, known.down_in_keyframe.into());
        Some(Gravity { vertex, down_in_vertex, sigma_rad: known.sigma_rad })
    });
    let gravity: Vec<Gravity> = gravity.collect();
    let stays = gravity.is_empty();
    let vertex =
        |(k, &world_from_vertex): (usize, &M::Pose)| Vertex { id: k as u64, world_from_vertex, fixed: k == 0 && stays };
    let edges = standing(session).filter(|(ends, edge)| wanted(*ends, edge)).map(|([from, to], edge)| {
        let Edge { from_from_to, information, .. } = *edge;
        mapwright_graph::Edge { from, to, from_from_to, information }
    });
    PoseGraph {
        vertices: world_from_keyframe.iter().enumerate().map(vertex).collect(),
        edges: edges.collect(),
        gravity,
        ..PoseGraph::default()
    }
}

/// The edges that stand, with the places of their ends.
pub(crate) fn standing<M: Measurement>(session: &Session<M>) -> impl Iterator<Item = ([usize; 2], &Edge<M::Pose>)> {
    let standing = session.recorded_edges().iter().filter(|known| !known.withdrawn);
    standing.map(|known| (known.ends.map(|end| end as usize), &known.recorded.edge))
}

/// The poses of a graph in the order of its vertices.
pub(crate) fn poses_of<P: Pose>(graph: &PoseGraph<P>) -> Vec<P> {
    graph.vertices.iter().map(|vertex| vertex.world_from_vertex).collect()
}
