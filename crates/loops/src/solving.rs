//! The graph brought to its optimum.

use crate::submaps::Submaps;
use mapwright_geom::{Pose, Pose2, TangentMatrix};
use mapwright_graph::{PoseGraph, SolverSettings, optimize};
use mapwright_record::Measurement;

/// Closures that one solution may take back.
const TAKEN_BACK_AT_MOST: usize = 16;
const ITERATIONS_AT_MOST: usize = 25;

fn settings() -> SolverSettings {
    SolverSettings { chordal: false, max_iterations: ITERATIONS_AT_MOST, ..SolverSettings::default() }
}

/// A graph to be brought to its optimum.
#[derive(Debug, Clone)]
pub struct Solving<P: Pose = Pose2> {
    /// The graph.
    pub graph: PoseGraph<P>,
    /// Places of the closures among its edges.
    pub closures: Vec<usize>,
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
    pub fn of<S: Submaps>(graph: PoseGraph<P>, closures: Vec<usize>) -> Self
    where
        S::Measurement: Measurement<Pose = P>,
    {
        Self { graph, closures, strained_chi2: S::POLICY.strained_chi2 }
    }

    /// The optimum; none where there is none to be found.
    #[must_use]
    pub fn run(mut self) -> Option<Solved<P>> {
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

    /// The closure with the largest chi-square, where that is too large.
    fn most_strained(&self) -> Option<usize> {
        let chi2 = |&at: &usize| (at, self.graph.edge_chi2(at));
        let worst = self.closures.iter().map(chi2).max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
        worst.filter(|(_, chi2)| *chi2 > self.strained_chi2).map(|(at, _)| at)
    }
}
