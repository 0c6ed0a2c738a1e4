//! Sparse least squares on a pose graph.

use crate::consensus::{Consensus, Refusal, believe};
use crate::descent::Descent;
use crate::error::GraphError;
use crate::gnc::{Gnc, graduate};
use crate::group::PoseGroup;
use crate::initial::chordal_poses;
use crate::pose_graph::PoseGraph;
use crate::problem::{Normal, Problem};
use mapwright_geom::{Apart, Pose, Pose2, Pose3};

/// Where the search starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Start {
    /// From the poses as they are.
    #[default]
    Given,
    /// From odometry alone, see [`PoseGraph::start_from_odometry`].
    Odometry,
}

/// How a graph is optimised.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolverSettings {
    /// Where the search starts.
    pub start: Start,
    /// Whether the chordal relaxation's solution is started from where its chi-square is lower and a first step from the
    /// poses given does not keep its promise; never where [gravity](PoseGraph::gravity) levels a part, which it does not know.
    pub chordal: bool,
    /// Steps at most, for each stage of [`SolverSettings::robust`].
    pub max_iterations: usize,
    /// The search ends with the step that promises to lower chi-square by less than this share.
    pub relative_decrease: f64,
    /// Graduated non-convexity on all edges that are not odometry.
    pub robust: Option<Gnc>,
}

impl Default for SolverSettings {
    fn default() -> Self {
        Self { start: Start::Given, chordal: true, max_iterations: 100, relative_decrease: 1e-6, robust: None }
    }
}

/// What came out; the poses are in the graph.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// Chi-square at the start, before the chordal relaxation, all weights being one.
    pub chi2_before: f64,
    /// Chi-square at the end, each edge with its weight.
    pub chi2_after: f64,
    /// Steps tried, each a solution of the normal equations.
    pub iterations: usize,
    /// Whether the stop rule was met before the iterations were used up.
    pub converged: bool,
    /// Whether the chordal relaxation's solution was started from.
    pub from_chordal: bool,
    /// Parts that no information connects; each keeps its first vertex or those that are fixed.
    pub connected_parts: usize,
    /// Information matrices replaced by the nearest that are symmetric and positive semidefinite.
    pub projected: usize,
    /// Why no closure was followed and all vertices are where odometry alone puts them, if that is so; only with
    /// [`Gnc::consensus`].
    pub refused: Option<Refusal>,
    /// Weight of each edge, one without [`SolverSettings::robust`].
    pub weights: Vec<f64>,
}

/// Moves the vertices to where chi-square is least.
///
/// # Errors
/// See [`PoseGraph::check`]; or the factor does not fit into memory.
pub fn optimize<P: Pose>(graph: &mut PoseGraph<P>, settings: &SolverSettings) -> Result<Solution, GraphError> {
    P::apart::<Optimising>((graph, settings))
}

/// The solver knows the number of components when it is compiled.
struct Optimising;

impl Apart for Optimising {
    type Of<'a, P: Pose> = (&'a mut PoseGraph<P>, &'a SolverSettings);
    type Output<P: Pose> = Result<Solution, GraphError>;

    fn plane((graph, settings): Self::Of<'_, Pose2>) -> Self::Output<Pose2> {
        optimized(graph, settings)
    }

    fn space((graph, settings): Self::Of<'_, Pose3>) -> Self::Output<Pose3> {
        optimized(graph, settings)
    }
}

fn optimized<P: PoseGroup<D>, const D: usize>(
    graph: &mut PoseGraph<P>,
    settings: &SolverSettings,
) -> Result<Solution, GraphError> {
    if settings.start == Start::Odometry {
        graph.start_from_odometry()?;
    }
    if let Some(consensus) = settings.robust.as_ref().and_then(|gnc| gnc.consensus.as_ref()) {
        return optimize_believed(graph, settings, consensus);
    }
    let problem = Problem::new(graph)?;
    let mut poses: Vec<P> = graph.vertices.iter().map(|vertex| vertex.world_from_vertex).collect();
    let mut weights = vec![1.0; problem.terms.len()];
    let chi2_before = problem.chi2(&poses, &weights);
    let mut normal = Normal::new(&problem);
    let mut descent = Descent::new(settings.relative_decrease, chi2_before);
    let relax = settings.chordal
        && settings.robust.is_none()
        && !problem.floats()
        && !descent.begins_well(&problem, &mut normal, &mut poses);
    let relaxed = if relax { chordal_poses(&problem, &poses) } else { None };
    let relaxed_chi2 = relaxed.as_ref().map_or(f64::INFINITY, |relaxed| problem.chi2(relaxed, &weights));
    let from_chordal = relaxed_chi2 < chi2_before;
    if let Some(relaxed) = relaxed.filter(|_| from_chordal) {
        (poses, descent.chi2) = (relaxed, relaxed_chi2);
    }
    if let Some(gnc) = &settings.robust {
        graduate(gnc, &graph.odometry(), &problem, &mut normal, &mut poses, &mut weights, &mut descent);
        descent.chi2 = problem.chi2(&poses, &weights);
    }
    let converged = descent.run(&problem, &mut normal, &mut poses, &weights, settings.max_iterations);
    for (vertex, pose) in graph.vertices.iter_mut().zip(&poses) {
        vertex.world_from_vertex = *pose;
    }
    Ok(Solution {
        chi2_before,
        chi2_after: descent.chi2,
        iterations: descent.iterations,
        converged,
        from_chordal,
        connected_parts: graph.connected_parts(),
        projected: problem.projected,
        refused: None,
        weights,
    })
}

/// With the closures that find believers, or none of them.
fn optimize_believed<P: PoseGroup<D>, const D: usize>(
    graph: &mut PoseGraph<P>,
    settings: &SolverSettings,
    consensus: &Consensus,
) -> Result<Solution, GraphError> {
    let chi2_before = graph.chi2()?;
    let belief = believe(graph, consensus)?;
    let (refused, odometry) = (belief.refused, graph.odometry());
    let kept = if refused.is_some() { odometry } else { belief.believed };
    let edges = graph.edges.clone();
    graph.edges = edges.iter().zip(&kept).filter(|(_, kept)| **kept).map(|(edge, _)| *edge).collect();
    let solved = if refused.is_some() { graph.start_from_odometry() } else { Ok(()) };
    if refused.is_none() {
        graph.vertices.iter_mut().zip(&belief.poses).for_each(|(vertex, pose)| vertex.world_from_vertex = *pose);
    }
    let solution =
        solved.and_then(|()| optimized(graph, &SolverSettings { start: Start::Given, robust: None, ..*settings }));
    graph.edges = edges;
    let weights = kept.iter().map(|kept| f64::from(u8::from(*kept))).collect();
    Ok(Solution { chi2_before, refused, weights, ..solution? })
}
