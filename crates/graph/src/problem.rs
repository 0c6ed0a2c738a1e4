//! The least-squares problem that a pose graph poses.

use crate::error::GraphError;
use crate::gravity::Gravity;
use crate::group::{PoseGroup, RotationError};
use crate::linear::{BlockSystem, Pattern, Slot, elimination_order};
use crate::pose_graph::{PoseGraph, nearest_information};
use nalgebra::{ArrayStorage, SMatrix, SVector};

/// A graph made ready: information positive semidefinite, measurements inverted, variables ordered.
pub(crate) struct Problem<P, const D: usize> {
    pub(crate) terms: Vec<Term<P, D>>,
    /// Where down is; nothing in the plane.
    pub(crate) gravity: Vec<Gravity>,
    /// Vertices that keep position and heading alone, and where: each first of a part that gravity levels.
    held: Vec<(usize, P)>,
    /// Place of each vertex among the variables; none for those that stay.
    pub(crate) places: Vec<Option<usize>>,
    pub(crate) variables: usize,
    pub(crate) projected: usize,
    pub(crate) metric: RotationError,
    pub(crate) pattern: Pattern,
    /// Where the mixed block of each term lies.
    pub(crate) slots: Vec<Option<Slot>>,
}

/// One edge.
pub(crate) struct Term<P, const D: usize> {
    pub(crate) from: usize,
    pub(crate) to: usize,
    to_from_from: P,
    pub(crate) information: SMatrix<f64, D, D>,
}

impl<P: PoseGroup<D>, const D: usize> Problem<P, D> {
    pub(crate) fn new(graph: &PoseGraph<P>) -> Result<Self, GraphError> {
        graph.check()?;
        let mut projected = 0;
        let terms = graph.edges.iter().map(|edge| {
            let (information, repaired) = nearest_information(&edge.information);
            projected += usize::from(repaired);
            Term { from: edge.from, to: edge.to, to_from_from: edge.from_from_to.inverse(), information }
        });
        let terms: Vec<Term<P, D>> = terms.collect();
        let mut places = vec![Some(0); graph.vertices.len()];
        let gravity = if P::TRANSLATION == 2 { Vec::new() } else { graph.gravity.clone() };
        let held = levelled(graph, &gravity);
        graph.anchors().into_iter().filter(|v| !held.contains(v)).for_each(|v| places[v] = None);
        let held = held.into_iter().map(|v| (v, graph.vertices[v].world_from_vertex)).collect();
        let mut variables = 0;
        for place in places.iter_mut().flatten() {
            *place = variables;
            variables += 1;
        }
        let coupled = pairs(&terms, &places);
        let order = elimination_order(variables, &coupled)?;
        places.iter_mut().flatten().for_each(|place| *place = order[*place]);
        let coupled: Vec<_> = coupled.iter().map(|&(a, b)| (order[a], order[b])).collect();
        let pattern = Pattern::new(variables, &coupled)?;
        let both = |term: &Term<P, D>| places[term.from].zip(places[term.to]);
        let slots = terms.iter().map(|term| both(term).map(|(from, to)| pattern.slot(from, to))).collect();
        Ok(Self { terms, gravity, held, places, variables, projected, metric: graph.metric, pattern, slots })
    }

    /// Weighted squared error of one edge.
    pub(crate) fn term_chi2(&self, at: usize, poses: &[P]) -> f64 {
        let term = &self.terms[at];
        let error = term.to_from_from.error_between(poses[term.from], poses[term.to], self.metric);
        error.dot(&(term.information * error))
    }

    /// The largest rotation by which an edge is wrong, radians.
    pub(crate) fn largest_turn(&self, poses: &[P]) -> f64 {
        let turn = |term: &Term<P, D>| {
            let error = term.to_from_from.error_between(poses[term.from], poses[term.to], self.metric);
            error.iter().skip(P::TRANSLATION).map(|v| v * v).sum::<f64>()
        };
        self.terms.iter().map(turn).fold(0.0, f64::max).sqrt()
    }

    /// Whether a part has no vertex that stays altogether.
    pub(crate) fn floats(&self) -> bool {
        !self.held.is_empty()
    }

    /// Sum over all edges, each with its weight, and over what holds of single vertices.
    pub(crate) fn chi2(&self, poses: &[P], weights: &[f64]) -> f64 {
        let weighted =
            |(at, &weight): (usize, &f64)| if weight > 0.0 { weight * self.term_chi2(at, poses) } else { 0.0 };
        weights.iter().enumerate().map(weighted).sum::<f64>() + self.unary_chi2(poses)
    }

    /// Of gravity, and of the vertices that are held.
    fn unary_chi2(&self, poses: &[P]) -> f64 {
        let tilts = self.gravity.iter().filter_map(|gravity| {
            let (error, _) = poses[gravity.vertex].tilt(&gravity.down_in_vertex)?;
            Some(error.norm_squared() / (gravity.sigma_rad * gravity.sigma_rad))
        });
        let held = self.held.iter().filter_map(|&(v, at)| Some(poses[v].held(at)?.0.norm_squared()));
        tilts.sum::<f64>() + held.sum::<f64>()
    }
}

/// The first of each part that gravity levels, unless one of the part is fixed.
fn levelled<P: PoseGroup<D>, const D: usize>(graph: &PoseGraph<P>, gravity: &[Gravity]) -> Vec<usize> {
    if gravity.is_empty() {
        return Vec::new();
    }
    let mut parts = graph.parts();
    let mut has_gravity = vec![false; graph.vertices.len()];
    gravity.iter().for_each(|gravity| has_gravity[parts.root(gravity.vertex)] = true);
    let anchors = graph.anchors().into_iter();
    anchors.filter(|&v| !graph.vertices[v].fixed && has_gravity[parts.root(v)]).collect()
}

/// The variables that edges couple.
fn pairs<P, const D: usize>(terms: &[Term<P, D>], places: &[Option<usize>]) -> Vec<(usize, usize)> {
    terms.iter().filter_map(|term| places[term.from].zip(places[term.to])).collect()
}

impl<P: PoseGroup<D>, const D: usize> Term<P, D> {
    pub(crate) fn measurement(&self) -> P {
        self.to_from_from.inverse()
    }
}

/// Normal equations of a problem, `H dx = -g`, filled anew at every linearisation.
pub(crate) struct Normal<'a, const D: usize> {
    pub(crate) system: BlockSystem<'a, D>,
    pub(crate) gradient: Vec<f64>,
}

impl<'a, const D: usize> Normal<'a, D> {
    pub(crate) fn new<P: PoseGroup<D>>(problem: &'a Problem<P, D>) -> Self {
        Self { system: BlockSystem::new(&problem.pattern), gradient: vec![0.0; problem.variables * D] }
    }

    /// Linearises at the poses.
    pub(crate) fn linearise<P: PoseGroup<D>>(&mut self, problem: &Problem<P, D>, poses: &[P], weights: &[f64]) {
        pulp::Arch::new().dispatch(Linearisation { normal: self, problem, poses, weights });
        for gravity in &problem.gravity {
            let weight = 1.0 / (gravity.sigma_rad * gravity.sigma_rad);
            self.add_unary(problem, gravity.vertex, weight, poses[gravity.vertex].tilt(&gravity.down_in_vertex));
        }
        for &(vertex, at) in &problem.held {
            self.add_unary(problem, vertex, 1.0, poses[vertex].held(at));
        }
    }

    /// What an error of one vertex alone, with its derivative and one weight for all components, says of that.
    fn add_unary<P: PoseGroup<D>, const E: usize>(
        &mut self,
        problem: &Problem<P, D>,
        vertex: usize,
        weight: f64,
        error: Option<(SVector<f64, E>, SMatrix<f64, E, D>)>,
    ) {
        let Some((place, (error, jacobian))) = problem.places[vertex].zip(error) else { return };
        let weighted = jacobian.transpose() * weight;
        self.system.add_diagonal(place, &(weighted * jacobian));
        add(&mut self.gradient, place, &(weighted * error));
    }
}

/// With error `e = z^-1 x_i^-1 x_j` and `J` the derivative of its coordinates by a perturbation of `x_j`, that by one of
/// `x_i` is `-J Ad(x_j^-1 x_i)`, so that `J^T W J` is all that has to be multiplied out.
struct Linearisation<'a, 'b, P, const D: usize> {
    normal: &'a mut Normal<'b, D>,
    problem: &'a Problem<P, D>,
    poses: &'a [P],
    weights: &'a [f64],
}

impl<P: PoseGroup<D>, const D: usize> pulp::WithSimd for Linearisation<'_, '_, P, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { normal: Normal { system, gradient }, problem, poses, weights } = self;
        system.clear();
        gradient.fill(0.0);
        for ((term, slot), &weight) in problem.terms.iter().zip(&problem.slots).zip(weights) {
            if weight <= 0.0 {
                continue;
            }
            let (error, jacobian, adjoint) =
                term.to_from_from.linear_error_between(poses[term.from], poses[term.to], problem.metric);
            let weighted = transposed_product(&jacobian, &(term.information * weight));
            let (curvature, slope) = (product(&weighted, &jacobian), weighted * error);
            let mixed = transposed_product(&adjoint, &curvature);
            if let Some(to) = problem.places[term.to] {
                system.add_diagonal(to, &curvature);
                add(gradient, to, &slope);
            }
            if let Some(from) = problem.places[term.from] {
                system.add_diagonal(from, &product(&mixed, &adjoint));
                add(gradient, from, &-adjoint.tr_mul(&slope));
            }
            if let Some(slot) = *slot {
                system.add(slot, &-mixed);
            }
        }
    }
}

/// `a b`, always compiled where it is used.
#[inline(always)]
fn product<const D: usize>(a: &SMatrix<f64, D, D>, b: &SMatrix<f64, D, D>) -> SMatrix<f64, D, D> {
    if D <= 4 { padded_product::<D, 4>(a, b) } else { padded_product::<D, 8>(a, b) }
}

/// The same with columns as long as registers.
#[inline(always)]
fn padded_product<const D: usize, const P: usize>(
    a: &SMatrix<f64, D, D>,
    b: &SMatrix<f64, D, D>,
) -> SMatrix<f64, D, D> {
    // loops, as closures would be compiled without the wide registers
    let mut left = [[0.0; P]; D];
    for k in 0..D {
        left[k][..D].copy_from_slice(&a.data.0[k]);
    }
    let mut columns = [[0.0; D]; D];
    for c in 0..D {
        let mut sums = [0.0; P];
        for k in 0..D {
            for r in 0..P {
                sums[r] = left[k][r].mul_add(b.data.0[c][k], sums[r]);
            }
        }
        columns[c].copy_from_slice(&sums[..D]);
    }
    SMatrix::from_data(ArrayStorage(columns))
}

/// `a^T b`, always compiled where it is used.
#[inline(always)]
fn transposed_product<const D: usize>(a: &SMatrix<f64, D, D>, b: &SMatrix<f64, D, D>) -> SMatrix<f64, D, D> {
    product(&a.transpose(), b)
}

fn add<const D: usize>(target: &mut [f64], place: usize, addend: &SVector<f64, D>) {
    target[place * D..(place + 1) * D].iter_mut().zip(addend.iter()).for_each(|(t, a)| *t += a);
}
