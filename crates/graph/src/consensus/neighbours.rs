//! Odometry as a chain, closures that lie near each other along it, and what their short cycles say of covariances.

use super::{Consensus, TAILS};
use crate::consistency::{Closure, Relative, cycle_of};
use crate::error::GraphError;
use crate::group::PoseGroup;
use crate::pose_graph::{PoseGraph, nearest_information};
use mapwright_geom::Pose;
use nalgebra::SMatrix;

/// Pairs of neighbours that agree up to which they say nothing of covariances.
pub(super) const FEW: f64 = 10.0;
/// By how much more neighbours must agree for odometry's covariances to be inflated.
const MORE_AGREE: f64 = 1.05;

/// Odometry as a chain.
pub(super) struct Chain<P: Pose, const D: usize> {
    /// By how much its covariances are larger than stated.
    pub(super) inflation: f64,
    /// Vertex of each place.
    pub(super) vertices: Vec<usize>,
    /// From each place to the next.
    steps: Vec<Option<Relative<P>>>,
}

/// What neighbouring closures say of each other.
pub(super) struct Neighbours<P: Pose, const D: usize> {
    pub(super) chain: Chain<P, D>,
    pub(super) pairs: Vec<Pair>,
    pub(super) mixture: Mixture,
}

/// A graph as odometry and closures.
pub(super) struct Odometry<'a, P: Pose, const D: usize> {
    graph: &'a PoseGraph<P>,
    pub(super) is_odometry: Vec<bool>,
    /// Edges that are no odometry, and what they measure, forwards along odometry.
    pub(super) closure_edges: Vec<usize>,
    pub(super) closures: Vec<Closure<P>>,
}

impl<'a, P: PoseGroup<D>, const D: usize> Odometry<'a, P, D> {
    pub(super) fn new(graph: &'a PoseGraph<P>) -> Self {
        let is_odometry = graph.odometry();
        let closure_edges: Vec<usize> = (0..is_odometry.len()).filter(|&at| !is_odometry[at]).collect();
        let (rank, _) = graph.ranks();
        let closure = |&at: &usize| {
            let edge = &graph.edges[at];
            let measured = Relative { pose: edge.from_from_to, covariance: covariance(&edge.information) };
            Closure { from: rank[edge.from], to: rank[edge.to], measured }.forwards()
        };
        let closures = closure_edges.iter().map(closure).collect();
        Self { graph, is_odometry, closure_edges, closures }
    }

    /// What neighbouring closures say of each other when odometry's covariances are larger than stated.
    pub(super) fn inflated(&self, settings: &Consensus, inflation: f64) -> Neighbours<P, D> {
        let chain = Chain::new(self.graph, &self.is_odometry, inflation);
        let pairs = neighbouring_pairs(&self.closures, &chain, settings.neighbourhood);
        let mixture = Mixture::fitted(&pairs, D);
        Neighbours { chain, pairs, mixture }
    }

    /// The same with the least inflation beyond which hardly more of them agree; none where covariances are too large anyway.
    pub(super) fn inflated_as_neighbours_say(&self, settings: &Consensus) -> Neighbours<P, D> {
        let stated = self.inflated(settings, 1.0);
        if stated.mixture.scale < 1.0 {
            return stated;
        }
        let inflated = inflations().skip(1).map(|inflation| self.inflated(settings, inflation));
        let all: Vec<Neighbours<P, D>> = std::iter::once(stated).chain(inflated).collect();
        let most = all.iter().map(|neighbours| neighbours.mixture.agreeing).fold(0.0, f64::max);
        let enough = |neighbours: &Neighbours<P, D>| MORE_AGREE * neighbours.mixture.agreeing >= most;
        let mut all = all.into_iter();
        all.find(enough).unwrap_or_else(|| self.inflated(settings, 1.0))
    }
}

/// Factors by which odometry's covariances may be too small.
pub(super) fn inflations() -> impl Iterator<Item = f64> {
    (0..6).map(|step| 4.0_f64.powi(step))
}

pub(super) fn poses_by_odometry<P: PoseGroup<D>, const D: usize>(graph: &PoseGraph<P>) -> Result<Vec<P>, GraphError> {
    let mut started = graph.clone();
    started.start_from_odometry()?;
    Ok(started.vertices.iter().map(|vertex| vertex.world_from_vertex).collect())
}

impl<P: PoseGroup<D>, const D: usize> Chain<P, D> {
    pub(super) fn new(graph: &PoseGraph<P>, odometry: &[bool], inflation: f64) -> Self {
        let (rank, vertices) = graph.ranks();
        let mut steps = vec![None; rank.len()];
        for edge in graph.edges.iter().zip(odometry).filter(|(_, is)| **is).map(|(edge, _)| edge) {
            let covariance = covariance(&edge.information) * inflation;
            let step = Relative { pose: edge.from_from_to, covariance };
            steps[rank[edge.from]].get_or_insert(step);
        }
        Self { inflation, vertices, steps }
    }

    /// Place `b` from place `a`, not after it.
    pub(super) fn leg(&self, a: usize, b: usize) -> Option<Relative<P>> {
        self.steps[a..b].iter().try_fold(Relative::identity(), |so_far, step| Some(so_far.then(step.as_ref()?)))
    }
}

/// Inverse of an information; huge where there is none.
pub(super) fn covariance<const D: usize>(information: &SMatrix<f64, D, D>) -> SMatrix<f64, D, D> {
    let (nearest, _) = nearest_information(information);
    let least = (1e-9 * nearest.amax()).max(1e-12);
    (nearest + SMatrix::from_diagonal_element(least))
        .try_inverse()
        .unwrap_or_else(|| SMatrix::from_diagonal_element(1e12))
}

/// Two closures and chi-square of their cycle.
pub(super) struct Pair {
    pub(super) first: usize,
    pub(super) second: usize,
    pub(super) chi2: f64,
}

/// All pairs of closures both ends of which are near.
fn neighbouring_pairs<P: PoseGroup<D>, const D: usize>(
    closures: &[Closure<P>],
    chain: &Chain<P, D>,
    neighbourhood: usize,
) -> Vec<Pair> {
    let mut order: Vec<usize> = (0..closures.len()).collect();
    order.sort_by_key(|&at| (closures[at].from, closures[at].to, at));
    let mut pairs = Vec::new();
    for (place, &first) in order.iter().enumerate() {
        let a = &closures[first];
        let near = |&&at: &&usize| closures[at].from <= a.from + neighbourhood;
        for &second in order[place + 1..].iter().take_while(near) {
            let b = &closures[second];
            if b.to.abs_diff(a.to) <= neighbourhood && (a.from, a.to) != (b.from, b.to) {
                let cycle = cycle_of(a, b, |from, to| chain.leg(from, to));
                pairs.extend(cycle.map(|cycle| Pair { first, second, chi2: cycle.chi2_of_cycle() }));
            }
        }
    }
    pairs
}

/// Chi-square of neighbouring pairs: of true ones as the covariances say, up to a scale; of others anything.
pub(super) struct Mixture {
    pub(super) scale: f64,
    /// Pairs of true ones.
    pub(super) agreeing: f64,
    /// Pairs of others up to [`WIDEST`].
    others: f64,
    freedom: usize,
}

/// Chi-square up to which pairs that do not agree fill space evenly.
const WIDEST: f64 = 100.0;

impl Mixture {
    /// By expectation and maximisation; covariances are never made larger, and never smaller than a hundredth.
    pub(super) fn fitted(pairs: &[Pair], freedom: usize) -> Self {
        let chi2: Vec<f64> = pairs.iter().map(|pair| pair.chi2).filter(|chi2| *chi2 <= WIDEST).collect();
        let half = freedom as f64 / 2.0;
        let (mut scale, mut share) = (0.1_f64, 0.5);
        let mut agreeing = 0.0;
        for _ in 0..60 {
            let (mut weights, mut sum) = (1e-9, 0.0);
            for &t in &chi2 {
                let even = half * t.max(1e-9).powf(half - 1.0) / WIDEST.powf(half);
                let agrees = density(t / scale, half) / scale;
                let weight = share * agrees / (share * agrees + (1.0 - share) * even).max(1e-300);
                weights += weight;
                sum += weight * t;
            }
            agreeing = weights;
            scale = (sum / weights / freedom as f64).clamp(0.01, 1.0);
            share = (weights / chi2.len().max(1) as f64).clamp(0.001, 0.999);
        }
        // tails are heavier than the model's
        let scale = if agreeing < FEW { 1.0 } else { (TAILS * scale).min(1.0) };
        Self { scale, agreeing, others: chi2.len() as f64 - agreeing, freedom }
    }

    /// How many of the others agree up to a threshold.
    pub(super) fn by_chance(&self, threshold: f64) -> f64 {
        self.others.max(0.0) * (threshold / WIDEST).powf(self.freedom as f64 / 2.0)
    }
}

/// Density of chi-square, three or six degrees of freedom.
fn density(t: f64, half: f64) -> f64 {
    let gamma = if half < 2.0 { 0.886_226_925_452_758 } else { 2.0 };
    (t / 2.0).max(1e-12).powf(half - 1.0) * (-t / 2.0).exp() / (2.0 * gamma)
}
