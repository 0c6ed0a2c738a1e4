//! Which closures are true, found before any of them moves a pose: neighbours that agree make a hypothesis, the sharpest
//! hypotheses are believed first, and every one believed sharpens the test of the others.
//!
//! After Latif, Cadena, Neira 2013, "Robust loop closing over time for pose graph SLAM" (clusters of closures, believed or
//! not as a whole) and Olson 2009 (what is certain relative to each other is decided first), with the exact covariance of
//! the graph so far in every test.

mod grow;
mod neighbours;
mod review;

use self::neighbours::{Chain, FEW, Neighbours, Odometry, Pair, inflations, poses_by_odometry};
use crate::consistency::{Closure, Relative, quantile_99};
use crate::descent::Descent;
use crate::error::GraphError;
use crate::group::PoseGroup;
use crate::pose_graph::{Edge, Parts, PoseGraph, nearest_information};
use crate::problem::{Normal, Problem};
use mapwright_geom::Pose;
use nalgebra::SMatrix;

/// How closures find believers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Consensus {
    /// Closures whose ends lie up to so many steps of odometry apart are compared.
    pub neighbourhood: usize,
    /// Rounds of believing and solving at most.
    pub max_rounds: usize,
    /// Refuses where those that agree with each other but not with what is believed are more than this share of the believed.
    pub largest_rival: f64,
    /// Refuses where more than this many are doubted for each that is believed; infinity never does. Up to ten false ones
    /// for each true one were found to do no harm; of thirty some may be believed.
    pub most_doubted: f64,
}

impl Default for Consensus {
    fn default() -> Self {
        Self { neighbourhood: 8, max_rounds: 40, largest_rival: 0.7, most_doubted: 12.0 }
    }
}

/// Why closures were not followed at all.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Refusal {
    /// No closure found believers.
    NothingBelieved,
    /// Closures that contradict the believed ones agree with each other, and they are nearly as many.
    Rivals {
        /// Closures believed.
        believed: usize,
        /// Closures that agree with each other against them.
        rivals: usize,
    },
    /// So many are doubted that some of the believed ones may be accidents.
    Outnumbered {
        /// Closures believed.
        believed: usize,
        /// Closures that are not.
        doubted: usize,
    },
    /// So many agree by chance.
    Chance {
        /// Closures believed.
        believed: usize,
        /// How many would be, were all of them random.
        expected: f64,
    },
    /// The believed closures and odometry contradict each other.
    Strained {
        /// Chi-square per degree of freedom.
        chi2_per_freedom: f64,
    },
}

/// Which closures are believed, and the poses they lead to.
pub(crate) struct Belief<P> {
    /// For every edge; odometry always is.
    pub(crate) believed: Vec<bool>,
    pub(crate) poses: Vec<P>,
    pub(crate) refused: Option<Refusal>,
}

/// Share in which hardly one in a thousand hypotheses passes by accident.
const SHARP: f64 = 0.001;
/// The same for closures without support.
const VAGUE_ALONE: f64 = 0.002;
/// By how much the variance of true closures is taken larger than it seems, their tails being heavier than the model's.
const TAILS: f64 = 3.0;
/// Beliefs that are tried without afterwards, at most.
const SECOND_THOUGHTS: usize = 8;
/// Members from which on a hypothesis cannot be an accident.
const GROUP: usize = 3;
/// Chi-square per degree of freedom that refuses.
const STRAINED: f64 = 2.0;

/// See the module.
pub(crate) fn believe<P: PoseGroup<D>, const D: usize>(
    graph: &PoseGraph<P>,
    settings: &Consensus,
) -> Result<Belief<P>, GraphError> {
    let odometry = Odometry::new(graph);
    let inflated = odometry.inflated_as_neighbours_say(settings);
    let few = inflated.mixture.agreeing < FEW;
    let mut search = Search::new(graph, settings, &odometry, inflated)?;
    search.run()?;
    if few {
        // too few neighbours to say how honest odometry is: what lets most closures agree, and not just some few
        for inflation in inflations().skip(1) {
            let mut other = Search::new(graph, settings, &odometry, odometry.inflated(settings, inflation))?;
            other.run()?;
            if other.believed_closures() > search.believed_closures().max(GROUP - 1) {
                search = other;
            }
        }
    }
    let refused = search.refusal();
    Ok(Belief { believed: search.believed, poses: search.poses, refused })
}

/// Closures that are true or false together.
#[derive(Debug, Clone)]
struct Hypothesis {
    /// Places among the closures.
    members: Vec<usize>,
    state: State,
    /// That of the test it passed.
    vagueness: f64,
}

impl Hypothesis {
    /// The member that is tested for all.
    fn middle(&self) -> usize {
        self.members[self.members.len() / 2]
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Open,
    Believed,
    Refuted,
}

/// How near a closure lies to where the graph puts it.
#[derive(Debug, Clone, Copy)]
struct Test {
    chi2: f64,
    /// Share of random closures that would pass.
    vagueness: f64,
}

impl Test {
    /// Share of random closures that would lie as near.
    fn share(&self, freedom: usize) -> f64 {
        self.vagueness * (self.chi2 / quantile_99(freedom)).powf(freedom as f64 / 2.0)
    }
}

struct Search<'a, P: Pose, const D: usize> {
    graph: &'a PoseGraph<P>,
    settings: &'a Consensus,
    /// Edges that are no odometry, and what they measure, forwards along odometry.
    edges: &'a [usize],
    closures: &'a [Closure<P>],
    odometry: &'a [bool],
    chain: Chain<P, D>,
    hypotheses: Vec<Hypothesis>,
    /// Closures that were believed by accident.
    accident: Vec<bool>,
    /// What random closures fill, metres and radians to the power of their dimensions.
    volume: f64,
    /// By how much covariances are too large.
    scale: f64,
    /// Consistent pairs to be expected of closures at random.
    by_chance: f64,
    believed: Vec<bool>,
    poses: Vec<P>,
}

impl<'a, P: PoseGroup<D>, const D: usize> Search<'a, P, D> {
    fn new(
        graph: &'a PoseGraph<P>,
        settings: &'a Consensus,
        odometry: &'a Odometry<'a, P, D>,
        Neighbours { chain, pairs, mixture }: Neighbours<P, D>,
    ) -> Result<Self, GraphError> {
        let poses = poses_by_odometry(graph)?;
        let threshold = quantile_99(D) * mixture.scale;
        Ok(Self {
            graph,
            settings,
            volume: volume::<P, D>(&poses),
            edges: &odometry.closure_edges,
            closures: &odometry.closures,
            odometry: &odometry.is_odometry,
            chain,
            hypotheses: hypotheses(odometry.closures.len(), &pairs, threshold),
            scale: mixture.scale,
            by_chance: mixture.by_chance(threshold),
            accident: vec![false; odometry.closures.len()],
            believed: odometry.is_odometry.clone(),
            poses,
        })
    }

    /// Chi-square up to which a closure agrees.
    fn threshold(&self) -> f64 {
        quantile_99(D) * self.scale
    }

    fn run(&mut self) -> Result<(), GraphError> {
        self.level()?;
        self.begin()?;
        self.think_again()?;
        self.review()?;
        self.take_in_what_is_no_accident()?;
        self.review()
    }

    fn begin(&mut self) -> Result<(), GraphError> {
        self.grow()?;
        self.take_in_what_fits()?;
        self.take_in_what_is_no_accident()
    }

    /// Tries without each of the most strained beliefs that were vague, where groups of closures are left that contradict what is believed; keeps
    /// what more closures agree with.
    fn think_again(&mut self) -> Result<(), GraphError> {
        let is_vague = |hypothesis: &Hypothesis| hypothesis.state == State::Believed && hypothesis.vagueness > SHARP;
        let mut vague: Vec<usize> = (0..self.hypotheses.len()).filter(|&at| is_vague(&self.hypotheses[at])).collect();
        let strain = |at: usize| {
            let members = &self.hypotheses[at].members;
            members.iter().map(|&member| self.closure_chi2(member)).sum::<f64>() / members.len() as f64
        };
        vague.sort_by(|&a, &b| strain(b).total_cmp(&strain(a)));
        for &without in vague.iter().take(SECOND_THOUGHTS) {
            if self.rivals() == 0 {
                break;
            }
            let (hypotheses, believed, poses) = (self.hypotheses.clone(), self.believed.clone(), self.poses.clone());
            let believed_closures = self.believed_closures();
            self.forget_all_but_odometry(without)?;
            self.begin()?;
            if self.believed_closures() <= believed_closures {
                (self.hypotheses, self.believed, self.poses) = (hypotheses, believed, poses);
            }
        }
        Ok(())
    }

    fn forget_all_but_odometry(&mut self, refuted: usize) -> Result<(), GraphError> {
        for at in 0..self.hypotheses.len() {
            self.set_state(at, if at == refuted { State::Refuted } else { State::Open });
        }
        self.poses = poses_by_odometry(self.graph)?;
        self.level()
    }

    /// Odometry where gravity levels it.
    fn level(&mut self) -> Result<(), GraphError> {
        if self.graph.gravity.is_empty() { Ok(()) } else { self.solve() }
    }

    /// Closures in groups that are not believed.
    fn rivals(&self) -> usize {
        let groups = self.hypotheses.iter().filter(|hypothesis| hypothesis.members.len() >= GROUP);
        groups.flat_map(|group| &group.members).filter(|&&at| !self.believed[self.edges[at]]).count()
    }

    fn set_state(&mut self, hypothesis: usize, state: State) {
        self.hypotheses[hypothesis].state = state;
        for &member in &self.hypotheses[hypothesis].members {
            self.believed[self.edges[member]] = state == State::Believed;
        }
    }

    /// Chi-square of a closure given the graph so far, and its vagueness.
    fn tested(&self, at: usize, problem: &Problem<P, D>, normal: &mut Normal<'_, D>) -> Option<Test> {
        let closure = &self.closures[at];
        let (from, to) = (self.chain.vertices[closure.from], self.chain.vertices[closure.to]);
        let predicted = Relative {
            pose: self.poses[from].inverse() * self.poses[to],
            covariance: relative_covariance(problem, normal, &self.poses, from, to),
        };
        let cycle = closure.measured.then(&predicted.inverse());
        let scaled = Relative { pose: cycle.pose, covariance: cycle.covariance * self.scale };
        let chi2 = scaled.chi2_of_cycle();
        chi2.is_finite().then(|| self.test(chi2, deviation(&scaled.covariance)))
    }

    /// A test by an ellipsoid of some product of standard deviations.
    fn test(&self, chi2: f64, deviation: f64) -> Test {
        let passing = ball(D) * deviation * quantile_99(D).powf(D as f64 / 2.0);
        Test { chi2, vagueness: (passing / self.volume).min(1.0) }
    }

    /// Odometry, gravity and what is believed.
    fn subgraph(&self) -> PoseGraph<P> {
        let mut graph = PoseGraph {
            vertices: self.graph.vertices.clone(),
            edges: Vec::new(),
            gravity: self.graph.gravity.clone(),
            metric: self.graph.metric,
        };
        let kept = (0..self.believed.len()).filter(|&at| self.believed[at]);
        graph.edges.extend(kept.map(|at| {
            let edge = self.graph.edges[at];
            Edge { information: edge.information / self.inflation(at), ..edge }
        }));
        graph
    }

    /// By how much the covariance of an edge is larger than stated.
    fn inflation(&self, edge: usize) -> f64 {
        if self.odometry[edge] { self.chain.inflation } else { 1.0 }
    }

    fn solve(&mut self) -> Result<(), GraphError> {
        let problem = Problem::new(&self.subgraph())?;
        let every = vec![1.0; problem.terms.len()];
        let mut descent = Descent::new(1e-4, problem.chi2(&self.poses, &every));
        descent.run(&problem, &mut Normal::new(&problem), &mut self.poses, &every, 12);
        Ok(())
    }

    /// Chi-square of a closure at the present poses.
    fn closure_chi2(&self, at: usize) -> f64 {
        let edge = &self.graph.edges[self.edges[at]];
        let [first, second] = [edge.from, edge.to].map(|v| self.poses[v]);
        let error = edge.from_from_to.inverse().error_between(first, second, self.graph.metric);
        error.dot(&(edge.information * error))
    }

    /// Does something with the factor of what is believed so far.
    fn with_factor<R: Default>(
        &self,
        work: impl FnOnce(&Self, &Problem<P, D>, &mut Normal<'_, D>) -> R,
    ) -> Result<R, GraphError> {
        let problem = Problem::new(&self.subgraph())?;
        let mut normal = Normal::new(&problem);
        let every = vec![1.0; problem.terms.len()];
        normal.linearise(&problem, &self.poses, &every);
        Ok(if normal.system.factorise() { work(self, &problem, &mut normal) } else { R::default() })
    }

    fn believed_closures(&self) -> usize {
        self.edges.iter().filter(|&&edge| self.believed[edge]).count()
    }

    fn refusal(&self) -> Option<Refusal> {
        let believed = self.believed_closures();
        if self.closures.is_empty() {
            return None;
        }
        if believed == 0 {
            return Some(Refusal::NothingBelieved);
        }
        let rivals = self.rivals();
        if rivals as f64 > self.settings.largest_rival * believed as f64 {
            return Some(Refusal::Rivals { believed, rivals });
        }
        let doubted = self.closures.len() - believed;
        if doubted as f64 > self.settings.most_doubted * believed as f64 {
            return Some(Refusal::Outnumbered { believed, doubted });
        }
        if (believed as f64) < 2.0 * self.by_chance {
            return Some(Refusal::Chance { believed, expected: self.by_chance });
        }
        let chi2: f64 = (0..self.graph.edges.len()).filter(|&at| self.believed[at]).map(|at| self.edge_chi2(at)).sum();
        let chi2_per_freedom = chi2 / (D * believed) as f64;
        (chi2_per_freedom > STRAINED).then_some(Refusal::Strained { chi2_per_freedom })
    }

    fn edge_chi2(&self, at: usize) -> f64 {
        let edge = &self.graph.edges[at];
        let [first, second] = [edge.from, edge.to].map(|v| self.poses[v]);
        let error = edge.from_from_to.inverse().error_between(first, second, self.graph.metric);
        error.dot(&(nearest_information(&edge.information).0 * error)) / self.inflation(at)
    }
}

/// Covariance of `first_from_second`, from the last factor.
fn relative_covariance<P: PoseGroup<D>, const D: usize>(
    problem: &Problem<P, D>,
    normal: &mut Normal<'_, D>,
    poses: &[P],
    first: usize,
    second: usize,
) -> SMatrix<f64, D, D> {
    // first_from_second moves by its adjoint where the first moves
    let moved = -(poses[second].inverse() * poses[first]).adjoint().transpose();
    let blocks = [(first, moved), (second, SMatrix::identity())];
    let blocks: Vec<_> = blocks.into_iter().filter_map(|(v, block)| Some((problem.places[v]?, block))).collect();
    let covariance = normal.system.covariance(&blocks);
    (covariance + covariance.transpose()) * 0.5
}

/// Closures joined by consistent pairs.
fn hypotheses(closures: usize, pairs: &[Pair], threshold: f64) -> Vec<Hypothesis> {
    let mut parts = Parts::new(closures);
    for pair in pairs.iter().filter(|pair| pair.chi2 <= threshold) {
        parts.join(pair.first, pair.second);
    }
    let mut members = vec![Vec::new(); closures];
    (0..closures).for_each(|at| members[parts.root(at)].push(at));
    let found = members.into_iter().filter(|members| !members.is_empty());
    found.map(|members| Hypothesis { members, state: State::Open, vagueness: 0.0 }).collect()
}

/// Volume of the unit ball.
fn ball(freedom: usize) -> f64 {
    let pi = std::f64::consts::PI;
    if freedom == 3 { 4.0 / 3.0 * pi } else { pi.powi(3) / 6.0 }
}

/// What the errors of random closures fill: a box as wide as the middle half of the poses is twice, all rotations.
fn volume<P: PoseGroup<D>, const D: usize>(poses: &[P]) -> f64 {
    let width = |axis: usize| {
        let mut along: Vec<f64> = poses.iter().map(|pose| pose.parts().1[axis]).collect();
        along.sort_by(f64::total_cmp);
        let quartile = |part: usize| along.get(part * along.len() / 4).copied().unwrap_or(0.0);
        (2.0 * (quartile(3) - quartile(1))).max(1.0)
    };
    let pi = std::f64::consts::PI;
    let area = width(0) * width(1);
    if D == 3 { area * 2.0 * pi } else { area * width(2) * 8.0 * pi * pi }
}

/// Root of the determinant; infinite where the covariance is not positive definite.
fn deviation<const D: usize>(covariance: &SMatrix<f64, D, D>) -> f64 {
    covariance.cholesky().map_or(f64::INFINITY, |factor| factor.l().diagonal().product())
}
