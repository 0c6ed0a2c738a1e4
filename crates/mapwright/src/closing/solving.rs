//! The whole graph brought to its optimum.

use mapwright_geom::Pose2;
use mapwright_graph::{PoseGraph2, SolverSettings, optimize};

/// A closure that the optimum strains more than this, chi-square with three degrees of freedom, is withdrawn. It is more than
/// the 99.99 % quantile (21.1), for a chain states too little (docs/decisions/0011-closing-loops.md).
const STRAINED_CHI2: f64 = 25.0;
/// Closures that one solution may take back.
const TAKEN_BACK_AT_MOST: usize = 16;
const ITERATIONS_AT_MOST: usize = 25;

/// A graph to be brought to its optimum.
#[derive(Debug, Clone)]
pub(crate) struct Solving {
    pub(crate) graph: PoseGraph2,
    /// Places of the closures among the edges.
    pub(crate) closures: Vec<usize>,
}

/// A solved graph.
#[derive(Debug, Clone)]
pub(crate) struct Solved {
    pub(crate) map_from_keyframe: Vec<Pose2>,
    /// Places of the closures, among the edges, that the others contradict.
    pub(crate) taken_back: Vec<usize>,
}

impl Solving {
    /// The optimum; none where there is none to be found.
    pub(crate) fn run(mut self) -> Option<Solved> {
        let before: Vec<Pose2> = self.graph.vertices.iter().map(|v| v.world_from_vertex).collect();
        let settings =
            SolverSettings { chordal: false, max_iterations: ITERATIONS_AT_MOST, ..SolverSettings::default() };
        let mut taken_back = Vec::new();
        loop {
            optimize(&mut self.graph, &settings).ok()?;
            let Some(worst) = self.most_strained().filter(|_| taken_back.len() < TAKEN_BACK_AT_MOST) else { break };
            taken_back.push(worst);
            self.graph.edges[worst].information.fill(0.0);
            self.graph.vertices.iter_mut().zip(&before).for_each(|(vertex, &pose)| vertex.world_from_vertex = pose);
        }
        let map_from_keyframe = self.graph.vertices.iter().map(|v| v.world_from_vertex).collect();
        Some(Solved { map_from_keyframe, taken_back })
    }

    /// The closure with the largest chi-square, where that is too large.
    fn most_strained(&self) -> Option<usize> {
        let chi2 = |&at: &usize| {
            let edge = &self.graph.edges[at];
            let [from, to] = [edge.from, edge.to].map(|v| self.graph.vertices[v].world_from_vertex);
            let error = edge.from_from_to.between(from.between(to)).to_vector();
            (at, error.dot(&(edge.information * error)))
        };
        let worst = self.closures.iter().map(chi2).max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
        worst.filter(|(_, chi2)| *chi2 > STRAINED_CHI2).map(|(at, _)| at)
    }
}
