//! The graph brought to its optimum, or the part of it alone that a join has moved.

use crate::submaps::Submaps;
use mapwright_geom::{Pose, Pose2, TangentMatrix};
use mapwright_graph::{Edge, PoseGraph, SolverSettings, optimize};
use mapwright_record::Measurement;

/// Closures that one solution may take back.
const TAKEN_BACK_AT_MOST: usize = 16;
const ITERATIONS_AT_MOST: usize = 25;

fn settings() -> SolverSettings {
    SolverSettings { chordal: false, max_iterations: ITERATIONS_AT_MOST, ..SolverSettings::default() }
}

/// What of a graph is solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// All of it.
    Whole,
    /// The part from a vertex on, which was joined with what was before: that stays where it is if the edges between the two allow it.
    Joined(usize),
}

/// A graph to be brought to its optimum.
#[derive(Debug, Clone)]
pub struct Solving<P: Pose = Pose2> {
    /// The graph.
    pub graph: PoseGraph<P>,
    /// Places of the closures among its edges.
    pub closures: Vec<usize>,
    /// What of it.
    pub scope: Scope,
    /// A closure that the optimum strains more than this, a chi-square, is withdrawn.
    pub strained_chi2: f64,
}

/// A solved graph.
#[derive(Debug, Clone)]
pub struct Solved<P: Pose = Pose2> {
    /// The poses.
    pub map_from_keyframe: Vec<P>,
    /// Places of the closures, among the edges, that the others contradict.
    pub taken_back: Vec<usize>,
}

impl<P: Pose> Solving<P> {
    /// One of keyframes of which such submaps are made.
    #[must_use]
    pub fn of<S: Submaps>(graph: PoseGraph<P>, closures: Vec<usize>, scope: Scope) -> Self
    where
        S::Measurement: Measurement<Pose = P>,
    {
        Self { graph, closures, scope, strained_chi2: S::POLICY.strained_chi2 }
    }

    /// The optimum; none where there is none to be found.
    #[must_use]
    pub fn run(mut self) -> Option<Solved<P>> {
        if let Scope::Joined(first) = self.scope
            && let Some(map_from_keyframe) = self.with_fixed_before(first)
        {
            return Some(Solved { map_from_keyframe, taken_back: Vec::new() });
        }
        let before: Vec<P> = self.graph.vertices.iter().map(|v| v.world_from_vertex).collect();
        let mut taken_back = Vec::new();
        loop {
            optimize(&mut self.graph, &settings()).ok()?;
            let Some(worst) = self.most_strained().filter(|_| taken_back.len() < TAKEN_BACK_AT_MOST) else { break };
            taken_back.push(worst);
            self.graph.edges[worst].information = P::Matrix::zero();
            self.graph.vertices.iter_mut().zip(&before).for_each(|(vertex, &pose)| vertex.world_from_vertex = pose);
        }
        let map_from_keyframe = self.graph.vertices.iter().map(|v| v.world_from_vertex).collect();
        Some(Solved { map_from_keyframe, taken_back })
    }

    /// The optimum of the vertices from `first` on, where those before stay: what a join moves is one piece against another, and neither in
    /// itself. None where the edges between the two are strained by more than chance explains, for then what was before has to give way as well.
    fn with_fixed_before(&self, first: usize) -> Option<Vec<P>> {
        let mut vertices = self.graph.vertices.clone();
        vertices.iter_mut().take(first).for_each(|vertex| vertex.fixed = true);
        let moves = |edge: &&Edge<P>| edge.from >= first || edge.to >= first;
        let edges = self.graph.edges.iter().filter(moves).copied().collect();
        let gravity = self.graph.gravity.iter().filter(|gravity| gravity.vertex >= first).copied().collect();
        let mut part = PoseGraph { vertices, edges, gravity, metric: self.graph.metric };
        optimize(&mut part, &settings()).ok()?;
        let is_between = |&at: &usize| (part.edges[at].from < first) != (part.edges[at].to < first);
        let between: Vec<usize> = (0..part.edges.len()).filter(is_between).collect();
        let chi2: f64 = between.iter().map(|&at| part.edge_chi2(at)).sum();
        let is_explained = chi2 <= (P::DIMENSION * between.len()) as f64;
        is_explained.then(|| part.vertices.iter().map(|v| v.world_from_vertex).collect())
    }

    /// The closure with the largest chi-square, where that is too large.
    fn most_strained(&self) -> Option<usize> {
        let chi2 = |&at: &usize| (at, self.graph.edge_chi2(at));
        let worst = self.closures.iter().map(chi2).max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
        worst.filter(|(_, chi2)| *chi2 > self.strained_chi2).map(|(at, _)| at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plane::PlaneSubmaps;
    use mapwright_geom::Cov3;
    use mapwright_graph::Vertex;

    /// Two straight ways of ten keyframes a metre apart beside each other; what is known of the second begins 5 m off, and findings say that
    /// each of its keyframes is `aside_m` beside that of the first.
    fn two_ways(aside_m: impl Fn(usize) -> f64) -> Solving {
        let start =
            |k: usize| if k < 10 { Pose2::new(k as f64, 0.0, 0.0) } else { Pose2::new(k as f64 - 5.0, 3.0, 0.2) };
        let vertex = |k: usize| Vertex { id: k as u64, world_from_vertex: start(k), fixed: k == 0 };
        let edge = |from, to, from_from_to, sigma_m: f64| Edge {
            from,
            to,
            from_from_to,
            information: Cov3::identity() / (sigma_m * sigma_m),
        };
        let mut edges: Vec<Edge<Pose2>> =
            (1..20).filter(|k| *k != 10).map(|k| edge(k - 1, k, Pose2::new(1.0, 0.0, 0.0), 0.01)).collect();
        let closures = (edges.len()..edges.len() + 10).collect();
        edges.extend((0..10).map(|k| edge(k, k + 10, Pose2::new(0.0, aside_m(k), 0.0), 0.02)));
        let graph = PoseGraph { vertices: (0..20).map(vertex).collect(), edges, ..PoseGraph::default() };
        Solving::of::<PlaneSubmaps>(graph, closures, Scope::Joined(10))
    }

    #[test]
    fn what_is_joined_comes_to_the_rest_and_the_rest_stays() {
        let solving = two_ways(|k| 2.0 + if k % 2 == 0 { 0.005 } else { -0.005 });
        let before = solving.graph.vertices.clone();
        let whole = Solving { scope: Scope::Whole, ..solving.clone() }.run().expect("it can be solved");
        let joined = solving.run().expect("it can be solved");
        for (k, vertex) in before.iter().enumerate() {
            let (pose, best) = (joined.map_from_keyframe[k], whole.map_from_keyframe[k]);
            assert!(
                if k < 10 { pose == vertex.world_from_vertex } else { pose.distance(best) < 0.005 },
                "{k}: {pose:?}"
            );
        }
    }

    #[test]
    fn the_rest_gives_way_where_chance_does_not_explain_the_strain() {
        let solving = two_ways(|k| 2.0 + 0.02 * (k * k) as f64);
        let whole = Solving { scope: Scope::Whole, ..solving.clone() }.run().expect("it can be solved");
        let joined = solving.run().expect("it can be solved");
        assert_eq!(joined.map_from_keyframe, whole.map_from_keyframe);
        assert!(joined.map_from_keyframe[9].distance(Pose2::new(9.0, 0.0, 0.0)) > 0.01);
    }
}
