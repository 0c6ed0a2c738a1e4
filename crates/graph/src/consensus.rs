//! Which closures are true, found before any of them moves a pose: neighbours that agree make a hypothesis, the sharpest
//! hypotheses are believed first, and every one believed sharpens the test of the others.
//!
//! After Latif, Cadena, Neira 2013, "Robust loop closing over time for pose graph SLAM" (clusters of closures, believed or
//! not as a whole) and Olson 2009 (what is certain relative to each other is decided first), with the exact covariance of
//! the graph so far in every test.

use crate::consistency::{Closure, Relative, cycle_of, quantile_99};
use crate::error::GraphError;
use crate::group::PoseGroup;
use crate::optimize::Descent;
use crate::pose_graph::{Edge, Parts, PoseGraph, nearest_information};
use crate::problem::{Normal, Problem};
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
}

impl Default for Consensus {
    fn default() -> Self {
        Self { neighbourhood: 8, max_rounds: 40, largest_rival: 0.7 }
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

/// Share of the volume of all closures in which an accident is no longer excluded.
const VAGUE: f64 = 0.02;
/// Share in which hardly one in a thousand hypotheses passes by accident.
const SHARP: f64 = 0.001;
/// The same for closures without support.
const VAGUE_ALONE: f64 = 0.002;
/// By how much the variance of true closures is taken larger than it seems, their tails being heavier than the model's.
const TAILS: f64 = 3.0;
/// Beliefs that are tried without afterwards, at most.
const SECOND_THOUGHTS: usize = 8;
/// How many random closures may be expected to fit as well as one that is believed without support.
const LIKELY: f64 = 0.1;
/// The same, by the volume that they fill, where nothing else is believed.
const LIKELY_ALONE: f64 = 0.05;
/// By how much the ellipsoid is larger in which random closures are counted.
const WIDER: f64 = 64.0;
/// How many random closures may be expected to lie as near as a believed one does to the graph without it, where that is
/// farther off than its covariance says.
const LIKELY_OUTLIER: f64 = 0.05;
/// Rounds of dropping what is an accident after all, at most.
const MAX_REVIEWS: usize = 20;
/// Hypotheses up to which those without support take part from the beginning.
const ALONE: usize = 400;
/// Pairs of neighbours that agree up to which they say nothing of covariances.
const FEW: f64 = 10.0;
/// By how much more neighbours must agree for odometry's covariances to be inflated.
const MORE_AGREE: f64 = 1.05;
/// Members from which on a hypothesis cannot be an accident.
const GROUP: usize = 3;
/// Share of the believed closures that may be false by accident.
const ACCIDENTS: f64 = 0.001;
/// Chi-square per degree of freedom that refuses.
const STRAINED: f64 = 2.0;

/// See the module.
pub(crate) fn believe<P: PoseGroup<D>, const D: usize>(
    graph: &PoseGraph<P, D>,
    settings: &Consensus,
) -> Result<Belief<P>, GraphError> {
    let odometry = Odometry::new(graph);
    let inflated = odometry.inflated_as_neighbours_say(settings);
    let few = inflated.mixture.agreeing < FEW;
    let mut search = Search::new(graph, settings, &odometry, inflated)?;
    search.run()?;
    if few {
        // too few neighbours to say how honest odometry is: what lets most closures agree
        for inflation in inflations().skip(1) {
            let mut other = Search::new(graph, settings, &odometry, odometry.inflated(settings, inflation))?;
            other.run()?;
            if other.believed_closures() > search.believed_closures() {
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

/// A hypothesis that passes the test of what is believed so far.
struct Candidate {
    hypothesis: usize,
    /// Share of random closures that would pass.
    vagueness: f64,
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

struct Search<'a, P, const D: usize> {
    graph: &'a PoseGraph<P, D>,
    settings: &'a Consensus,
    /// Edges that are no odometry, and what they measure, forwards along odometry.
    edges: &'a [usize],
    closures: &'a [Closure<P, D>],
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
        graph: &'a PoseGraph<P, D>,
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
        Ok(())
    }

    /// Closures in groups that are not believed.
    fn rivals(&self) -> usize {
        let groups = self.hypotheses.iter().filter(|hypothesis| hypothesis.members.len() >= GROUP);
        groups.flat_map(|group| &group.members).filter(|&&at| !self.believed[self.edges[at]]).count()
    }

    /// Believes the sharpest of what passes, solves, and looks again.
    fn grow(&mut self) -> Result<(), GraphError> {
        for _ in 0..self.settings.max_rounds {
            let candidates = self.candidates()?;
            let chosen = self.chosen(candidates);
            if chosen.is_empty() {
                break;
            }
            for hypothesis in chosen {
                self.set_state(hypothesis, State::Believed);
            }
            self.solve()?;
            self.drop_what_does_not_fit()?;
        }
        Ok(())
    }

    fn set_state(&mut self, hypothesis: usize, state: State) {
        self.hypotheses[hypothesis].state = state;
        for &member in &self.hypotheses[hypothesis].members {
            self.believed[self.edges[member]] = state == State::Believed;
        }
    }

    /// Open hypotheses that the graph so far allows, the sharpest first; others are refuted.
    fn candidates(&mut self) -> Result<Vec<Candidate>, GraphError> {
        let alone_allowed = self.hypotheses.len() <= ALONE;
        let open = |hypothesis: &Hypothesis| {
            hypothesis.state == State::Open && (hypothesis.members.len() > 1 || alone_allowed)
        };
        let open: Vec<usize> = (0..self.hypotheses.len()).filter(|&at| open(&self.hypotheses[at])).collect();
        let tested: Vec<(usize, Test)> = self.with_factor(|search, problem, normal| {
            let test = |&at: &usize| Some((at, search.tested(search.hypotheses[at].middle(), problem, normal)?));
            open.iter().filter_map(test).collect()
        })?;
        let mut candidates = Vec::new();
        for (hypothesis, Test { chi2, vagueness }) in tested {
            self.hypotheses[hypothesis].vagueness = vagueness;
            if chi2 <= quantile_99(D) {
                candidates.push(Candidate { hypothesis, vagueness });
            } else if vagueness < VAGUE {
                self.hypotheses[hypothesis].state = State::Refuted;
            }
        }
        candidates.sort_by(|a, b| a.vagueness.total_cmp(&b.vagueness));
        Ok(candidates)
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

    /// What is to be believed next.
    fn chosen(&self, candidates: Vec<Candidate>) -> Vec<usize> {
        let allowed = |candidate: &Candidate| match self.hypotheses[candidate.hypothesis].members.len() {
            1 => candidate.vagueness <= VAGUE_ALONE,
            2 => candidate.vagueness <= VAGUE,
            _ => true,
        };
        let mut candidates: Vec<Candidate> = candidates.into_iter().filter(allowed).collect();
        let Some(sharpest) = candidates.first().map(|candidate| candidate.vagueness) else { return Vec::new() };
        if sharpest > VAGUE {
            return self.best_supported(&candidates);
        }
        candidates.retain(|candidate| candidate.vagueness <= (2.0 * sharpest).max(0.25 * VAGUE));
        candidates.into_iter().map(|candidate| candidate.hypothesis).collect()
    }

    /// Where no test is sharp: the hypothesis with which most closures agree.
    fn best_supported(&self, candidates: &[Candidate]) -> Vec<usize> {
        let members = |at: usize| &self.hypotheses[at].members;
        let middle = |at: usize| &self.closures[self.hypotheses[at].middle()];
        let support = |a: &Candidate| -> usize {
            let agreeing = candidates.iter().filter(|b| {
                let cycle = cycle_of(middle(a.hypothesis), middle(b.hypothesis), |a, b| self.chain.leg(a, b));
                cycle.is_some_and(|cycle| cycle.chi2_of_cycle() <= self.threshold())
            });
            agreeing.map(|b| members(b.hypothesis).len()).sum()
        };
        let best = candidates.iter().max_by_key(|&c| (support(c), std::cmp::Reverse(c.hypothesis)));
        best.map(|candidate| candidate.hypothesis).into_iter().collect()
    }

    /// Odometry and what is believed.
    fn subgraph(&self) -> PoseGraph<P, D> {
        let mut graph =
            PoseGraph { vertices: self.graph.vertices.clone(), edges: Vec::new(), metric: self.graph.metric };
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
        Descent::new(1e-4).run(&problem, &mut Normal::new(&problem), &mut self.poses, &every, 12);
        Ok(())
    }

    /// Chi-square of a closure at the present poses.
    fn closure_chi2(&self, at: usize) -> f64 {
        let edge = &self.graph.edges[self.edges[at]];
        let [first, second] = [edge.from, edge.to].map(|v| self.poses[v]);
        let error = edge.from_from_to.inverse().error_between(first, second, self.graph.metric);
        error.dot(&(edge.information * error))
    }

    /// Doubts hypotheses again most of whose members were not met.
    fn drop_what_does_not_fit(&mut self) -> Result<(), GraphError> {
        let mut dropped = false;
        for at in 0..self.hypotheses.len() {
            if self.hypotheses[at].state != State::Believed {
                continue;
            }
            let members = &self.hypotheses[at].members;
            let missed = members.iter().filter(|&&m| self.closure_chi2(m) > self.threshold()).count();
            if 2 * missed > members.len() {
                self.set_state(at, State::Refuted);
                dropped = true;
            }
        }
        if dropped { self.solve() } else { Ok(()) }
    }

    /// Closure by closure: what the poses meet is believed, what they do not is not.
    fn take_in_what_fits(&mut self) -> Result<(), GraphError> {
        for _ in 0..8 {
            let believed = self.believed_closures();
            if believed == 0 {
                break;
            }
            let chi2: Vec<f64> = (0..self.closures.len()).map(|at| self.closure_chi2(at)).collect();
            let threshold = self.generous_threshold(&chi2, believed);
            let before = self.believed.clone();
            for (at, chi2) in chi2.into_iter().enumerate() {
                self.believed[self.edges[at]] = chi2 <= threshold && !self.accident[at];
            }
            if self.believed == before {
                break;
            }
            self.solve()?;
        }
        Ok(())
    }

    /// Single closures far from where the poses are, but as near as the poses are certain, where random closures would
    /// not have come so near.
    fn take_in_what_is_no_accident(&mut self) -> Result<(), GraphError> {
        // those that came and went do not come again
        let mut tried = self.accident.clone();
        for _ in 0..self.settings.max_rounds {
            let doubted: Vec<usize> = (0..self.closures.len()).filter(|&at| !self.believed[self.edges[at]]).collect();
            if doubted.is_empty() {
                break;
            }
            let alone = doubted.len() == self.closures.len();
            let tests: Vec<(usize, Test)> = self.with_factor(|search, problem, normal| {
                let tests = doubted.iter().filter_map(|&at| Some((at, search.tested(at, problem, normal)?)));
                tests.filter(|(_, test)| test.vagueness <= VAGUE_ALONE).collect()
            })?;
            let chance = Chance::counted(tests.iter().map(|(_, test)| test.chi2), D);
            let fits = |&&(at, test): &&(usize, Test)| {
                !tried[at]
                    && test.chi2 <= quantile_99(D) / TAILS
                    && chance.expected(test.chi2) <= LIKELY
                    && (!alone || doubted.len() as f64 * test.share(D) <= LIKELY_ALONE)
            };
            let found: Vec<usize> = tests.iter().filter(fits).map(|(at, _)| *at).collect();
            if found.is_empty() {
                break;
            }
            for at in found {
                self.believed[self.edges[at]] = true;
                tried[at] = true;
            }
            self.solve()?;
            self.take_in_what_fits()?;
        }
        Ok(())
    }

    /// Drops believed closures that lie as far from where the graph without them puts them as random ones can be expected
    /// to, the likeliest accidents first: what is wrong makes others look wrong.
    fn review(&mut self) -> Result<(), GraphError> {
        for _ in 0..MAX_REVIEWS {
            let doubted = (self.closures.len() - self.believed_closures()) as f64;
            let mut outliers = self.left_out()?;
            outliers.retain(|(_, test)| test.chi2 > quantile_99(D) && doubted * test.share(D) > LIKELY_OUTLIER);
            let likeliest = outliers.iter().map(|(_, test)| test.share(D)).fold(0.0, f64::max);
            outliers.retain(|(_, test)| test.share(D) >= 0.5 * likeliest);
            if outliers.is_empty() {
                break;
            }
            for (at, _) in outliers {
                self.believed[self.edges[at]] = false;
                self.accident[at] = true;
            }
            self.solve()?;
        }
        Ok(())
    }

    /// The test of each believed closure against the graph without it.
    ///
    /// With its covariance `C`, `P` of what the whole graph says of it, and its error `e` there, the graph without it says
    /// `C (C - P)^-1 e` with covariance `C (C - P)^-1 P`, the sum of that and `C` being `C (C - P)^-1 C`.
    fn left_out(&self) -> Result<Vec<(usize, Test)>, GraphError> {
        let believed: Vec<usize> = (0..self.closures.len()).filter(|&at| self.believed[self.edges[at]]).collect();
        self.with_factor(|search, problem, normal| {
            let test = |&at: &usize| {
                let edge = &search.graph.edges[search.edges[at]];
                let [from, to] = [edge.from, edge.to].map(|v| search.poses[v]);
                let own = covariance(&edge.information);
                let rest = own - relative_covariance(problem, normal, &search.poses, edge.from, edge.to);
                let error = Relative {
                    pose: edge.from_from_to.inverse() * (from.inverse() * to),
                    covariance: rest * search.scale,
                };
                let chi2 = error.chi2_of_cycle();
                let deviation = deviation(&(own * search.scale)).powi(2) / deviation(&error.covariance);
                // not where nothing but the closure says where the two are
                chi2.is_finite().then(|| (at, search.test(chi2, deviation)))
            };
            believed.iter().filter_map(test).collect()
        })
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

    /// The largest chi-square up to which hardly any false closure is met by accident, as those just beyond the quantile
    /// let expect.
    fn generous_threshold(&self, chi2: &[f64], believed: usize) -> f64 {
        let (quantile, half) = (quantile_99(D), D as f64 / 2.0);
        let beyond = chi2.iter().filter(|&&chi2| chi2 > quantile && chi2 <= 9.0 * quantile).count();
        let expected = beyond as f64 / (9.0_f64.powf(half) - 1.0);
        let allowed = (ACCIDENTS * believed as f64).max(0.5);
        let shrunk = if expected > allowed { (allowed / expected).powf(1.0 / half) } else { 1.0 };
        quantile * shrunk.max(self.scale)
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

/// Odometry as a chain.
struct Chain<P, const D: usize> {
    /// By how much its covariances are larger than stated.
    inflation: f64,
    /// Vertex of each place.
    vertices: Vec<usize>,
    /// From each place to the next.
    steps: Vec<Option<Relative<P, D>>>,
}

/// What neighbouring closures say of each other.
struct Neighbours<P, const D: usize> {
    chain: Chain<P, D>,
    pairs: Vec<Pair>,
    mixture: Mixture,
}

/// A graph as odometry and closures.
struct Odometry<'a, P, const D: usize> {
    graph: &'a PoseGraph<P, D>,
    is_odometry: Vec<bool>,
    /// Edges that are no odometry, and what they measure, forwards along odometry.
    closure_edges: Vec<usize>,
    closures: Vec<Closure<P, D>>,
}

impl<'a, P: PoseGroup<D>, const D: usize> Odometry<'a, P, D> {
    fn new(graph: &'a PoseGraph<P, D>) -> Self {
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
    fn inflated(&self, settings: &Consensus, inflation: f64) -> Neighbours<P, D> {
        let chain = Chain::new(self.graph, &self.is_odometry, inflation);
        let pairs = neighbouring_pairs(&self.closures, &chain, settings.neighbourhood);
        let mixture = Mixture::fitted(&pairs, D);
        Neighbours { chain, pairs, mixture }
    }

    /// The same with the least inflation beyond which hardly more of them agree; none where covariances are too large anyway.
    fn inflated_as_neighbours_say(&self, settings: &Consensus) -> Neighbours<P, D> {
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
fn inflations() -> impl Iterator<Item = f64> {
    (0..6).map(|step| 4.0_f64.powi(step))
}

fn poses_by_odometry<P: PoseGroup<D>, const D: usize>(graph: &PoseGraph<P, D>) -> Result<Vec<P>, GraphError> {
    let mut started = graph.clone();
    started.start_from_odometry()?;
    Ok(started.vertices.iter().map(|vertex| vertex.world_from_vertex).collect())
}

impl<P: PoseGroup<D>, const D: usize> Chain<P, D> {
    fn new(graph: &PoseGraph<P, D>, odometry: &[bool], inflation: f64) -> Self {
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
    fn leg(&self, a: usize, b: usize) -> Option<Relative<P, D>> {
        self.steps[a..b].iter().try_fold(Relative::identity(), |so_far, step| Some(so_far.then(step.as_ref()?)))
    }
}

/// Root of the determinant; infinite where the covariance is not positive definite.
fn deviation<const D: usize>(covariance: &SMatrix<f64, D, D>) -> f64 {
    covariance.cholesky().map_or(f64::INFINITY, |factor| factor.l().diagonal().product())
}

/// Inverse of an information; huge where there is none.
fn covariance<const D: usize>(information: &SMatrix<f64, D, D>) -> SMatrix<f64, D, D> {
    let (nearest, _) = nearest_information(information);
    let least = (1e-9 * nearest.amax()).max(1e-12);
    (nearest + SMatrix::from_diagonal_element(least))
        .try_inverse()
        .unwrap_or_else(|| SMatrix::from_diagonal_element(1e12))
}

/// Two closures and chi-square of their cycle.
struct Pair {
    first: usize,
    second: usize,
    chi2: f64,
}

/// All pairs of closures both ends of which are near.
fn neighbouring_pairs<P: PoseGroup<D>, const D: usize>(
    closures: &[Closure<P, D>],
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
struct Mixture {
    scale: f64,
    /// Pairs of true ones.
    agreeing: f64,
    /// Pairs of others up to [`WIDEST`].
    others: f64,
    freedom: usize,
}

/// Chi-square up to which pairs that do not agree fill space evenly.
const WIDEST: f64 = 100.0;

impl Mixture {
    /// By expectation and maximisation; covariances are never made larger, and never smaller than a hundredth.
    fn fitted(pairs: &[Pair], freedom: usize) -> Self {
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
    fn by_chance(&self, threshold: f64) -> f64 {
        self.others.max(0.0) * (threshold / WIDEST).powf(self.freedom as f64 / 2.0)
    }
}

/// Density of chi-square, three or six degrees of freedom.
fn density(t: f64, half: f64) -> f64 {
    let gamma = if half < 2.0 { 0.886_226_925_452_758 } else { 2.0 };
    (t / 2.0).max(1e-12).powf(half - 1.0) * (-t / 2.0).exp() / (2.0 * gamma)
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

/// How many random closures come as near as one, counted where they are not yet near: they fill space evenly.
struct Chance {
    /// Those within the wider ellipsoid.
    counted: usize,
    /// Its chi-square.
    wider: f64,
    freedom: usize,
}

impl Chance {
    fn counted(chi2: impl Iterator<Item = f64>, freedom: usize) -> Self {
        let wider = quantile_99(freedom) * WIDER.powf(2.0 / freedom as f64);
        Self { counted: chi2.filter(|chi2| *chi2 <= wider).count(), wider, freedom }
    }

    fn expected(&self, chi2: f64) -> f64 {
        self.counted as f64 * (chi2 / self.wider).powf(self.freedom as f64 / 2.0)
    }
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

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test may fail loudly")]
mod tests {
    use super::*;
    use crate::pose_graph::Vertex;
    use mapwright_geom::Pose2;
    use nalgebra::Matrix3;

    /// A circle driven three times, closed in six places.
    fn rounds() -> PoseGraph<Pose2, 3> {
        let mut graph = PoseGraph::default();
        let step = Pose2::exp([1.0, 0.0, std::f64::consts::TAU / 20.0]);
        let mut world_from_vertex = Pose2::IDENTITY;
        for id in 0..60 {
            graph.vertices.push(Vertex { id, world_from_vertex, fixed: false });
            world_from_vertex = world_from_vertex * step;
        }
        let noise =
            |k: usize| Pose2::new(0.01 * (k as f64).sin(), 0.01 * (2.0 * k as f64).cos(), 1e-3 * (k as f64).cos());
        let mut connect = |from: usize, to: usize, pose: Pose2| {
            let information = Matrix3::identity() * 1e4;
            graph.edges.push(Edge { from, to, from_from_to: pose * noise(from + to), information });
        };
        (1..60).for_each(|k| connect(k - 1, k, step));
        [3, 9, 14, 21, 28, 35].into_iter().for_each(|k| connect(k, k + 20, Pose2::IDENTITY));
        graph
    }

    #[test]
    fn a_closure_left_out_is_tested_as_by_the_graph_without_it() {
        let (graph, settings) = (rounds(), Consensus::default());
        let odometry = Odometry::new(&graph);
        let mut search = Search::new(&graph, &settings, &odometry, odometry.inflated(&settings, 1.0)).unwrap();
        search.believed.fill(true);
        search.solve().unwrap();
        for (at, left_out) in search.left_out().unwrap() {
            search.believed[search.edges[at]] = false;
            search.solve().unwrap();
            let without =
                search.with_factor(|search, problem, normal| search.tested(at, problem, normal)).unwrap().unwrap();
            assert!((left_out.chi2 / without.chi2 - 1.0).abs() < 0.02, "{left_out:?} {without:?}");
            assert!((left_out.vagueness / without.vagueness - 1.0).abs() < 0.02, "{left_out:?} {without:?}");
            search.believed[search.edges[at]] = true;
        }
    }
}
