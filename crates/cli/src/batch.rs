//! What can be had at best: a run's own keyframes and steps, and every true closure, solved in one go.

use crate::pose_graph::{pose_graph, poses_of, standing};
use crate::simulated::{PoseError, Scored, Simulated};
use mapwright::EdgeKind;
use mapwright_geom::{Pose, TangentMatrix};
use mapwright_graph::{Edge, GraphError, PoseGraph, SolverSettings, optimize};
use mapwright_record::Measurement;
use mapwright_sim::{Revisit, Revisits};

/// A true closure's standard deviations, metres and radians.
const SIGMA_M: f64 = 0.01;
const SIGMA_RAD: f64 = 0.002;

/// Information of a closure with these standard deviations.
pub(crate) fn information<T: TangentMatrix>(sigma_m: f64, sigma_rad: f64) -> T {
    let [position, heading] = [sigma_m, sigma_rad].map(|sigma| 1.0 / (sigma * sigma));
    T::from_variances(position, heading)
}

/// An edge that says the truth about two keyframes.
pub(crate) fn true_edge<M: Measurement<Pose: Scored>>(
    world: &Simulated<M>,
    [from, to]: [usize; 2],
    information: <M::Pose as Pose>::Matrix,
) -> Edge<M::Pose> {
    Edge { from, to, from_from_to: world.true_between(from, to), information }
}

/// Every keyframe on ground seen before, with the earlier keyframe that it truly overlaps most: earlier, later.
pub(crate) fn true_pairs<M: Measurement<Pose: Scored>>(
    world: &Simulated<M>,
    revisits: &Revisits<M::Pose>,
) -> Vec<[usize; 2]> {
    let pairs = revisits.pairs();
    let stretches = revisits.stretches();
    let seen_before = |to: &usize| {
        let stamp = world.stamp(*to);
        stretches.iter().any(|[from, until]| (*from..=*until).contains(&stamp))
    };
    let earlier = |to: usize| {
        let revisit = best_revisit(of_later_nearest(pairs, world.stamp(to).0))?;
        world.keyframe_at(revisit.earlier).filter(|from| *from < to).map(|from| [from, to])
    };
    (0..world.keyframe_count()).filter(seen_before).filter_map(earlier).collect()
}

/// The pairs of the later time nearest to a stamp; the list is in the order of the later times.
fn of_later_nearest<P>(pairs: &[Revisit<P>], stamp_ns: i64) -> &[Revisit<P>] {
    let after = pairs.partition_point(|pair| pair.later.0 < stamp_ns);
    let around = [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|at| pairs.get(at));
    let Some(nearest) = around.map(|pair| pair.later).min_by_key(|later| later.0.abs_diff(stamp_ns)) else {
        return &[];
    };
    let [from, until] = [0, 1].map(|more| pairs.partition_point(|pair| pair.later.0 < nearest.0 + more));
    &pairs[from..until]
}

/// The one that overlaps most, the first of equals.
pub(crate) fn best_revisit<P>(pairs: &[Revisit<P>]) -> Option<&Revisit<P>> {
    pairs.iter().rev().max_by(|a, b| a.overlap.total_cmp(&b.overlap))
}

/// The keyframes where a batch solve puts them: steps along the way, none of the closings that were found, and all true
/// closures.
pub(crate) fn batch_poses<M: Measurement<Pose: Scored>>(
    world: &Simulated<M>,
    true_pairs: &[[usize; 2]],
) -> Result<Vec<M::Pose>, GraphError> {
    let mut graph = open_graph(world);
    let information = information(SIGMA_M, SIGMA_RAD);
    graph.edges.extend(true_pairs.iter().map(|&pair| true_edge(world, pair, information)));
    optimize(&mut graph, &SolverSettings::default())?;
    Ok(poses_of(&graph))
}

/// A run's keyframes and the steps between them, as if nothing had ever been recognised.
///
/// Where old parts of the map came into view the pose may have jumped. A step that is wrong, or ends at a keyframe that
/// was matched there, counts with what the wheels say where they are nearer to the truth; matches across it are left out.
pub(crate) fn open_graph<M: Measurement<Pose: Scored>>(world: &Simulated<M>) -> PoseGraph<M::Pose> {
    let session = world.session();
    let mut suspect = vec![false; world.keyframe_count()];
    for (ends, _) in standing(session).filter(|(ends, edge)| edge.kind == EdgeKind::Match && world.closes(*ends, edge))
    {
        suspect[ends[1]] = true;
    }
    let mut by_wheels = vec![None; world.keyframe_count()];
    for ([from, to], edge) in standing(session).filter(|(_, edge)| edge.kind == EdgeKind::Odometry) {
        let error = |step| PoseError::of(step, world.true_between(from, to));
        let found = error(edge.from_from_to);
        let wheels = world.wheels_between(from, to).filter(|&step| error(step).size() < found.size());
        by_wheels[to] = wheels.filter(|_| suspect[to] || !found.is_right());
    }
    let smooth = |[from, to]: [usize; 2]| by_wheels[from.min(to) + 1..=from.max(to)].iter().all(Option::is_none);
    let wanted = |ends: [usize; 2], edge: &mapwright::Edge<M::Pose>| match edge.kind {
        EdgeKind::Odometry => true,
        EdgeKind::Match => !world.closes(ends, edge) && smooth(ends),
        EdgeKind::Closure => false,
    };
    let mut graph = pose_graph(session, session.map_from_keyframe(), wanted);
    for edge in &mut graph.edges {
        edge.from_from_to = by_wheels[edge.to].unwrap_or(edge.from_from_to);
    }
    graph
}
