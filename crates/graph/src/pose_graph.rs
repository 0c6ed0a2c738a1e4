//! Poses and what was measured between them.

use crate::error::GraphError;
use crate::gravity::{Gravity, tilt};
use crate::group::{PoseGroup, RotationError};
use mapwright_geom::{Apart, Pose, Pose2, Pose3, TangentMatrix};
use nalgebra::{DMatrix, SMatrix};
use std::collections::VecDeque;

/// Entries of an information matrix beyond this are refused.
pub const LARGEST_INFORMATION: f64 = 1e15;

/// A pose that is looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vertex<P> {
    /// Its name; odometry leads from each vertex to that with the next larger id.
    pub id: u64,
    /// Where it is believed to be.
    pub world_from_vertex: P,
    /// Whether it stays where it is.
    pub fixed: bool,
}

/// A measured relative pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge<P: Pose> {
    /// Place of the first vertex in [`PoseGraph::vertices`].
    pub from: usize,
    /// Place of the second.
    pub to: usize,
    /// The second vertex, seen from the first.
    pub from_from_to: P,
    /// Inverse covariance of its right perturbation, translation first.
    pub information: P::Matrix,
}

/// Vertices and edges.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseGraph<P: Pose> {
    /// The poses.
    pub vertices: Vec<Vertex<P>>,
    /// The measurements.
    pub edges: Vec<Edge<P>>,
    /// Where down is at some vertices, of a graph of space; the world's z axis is up. A part that has any, and no vertex that is
    /// fixed, keeps position and heading of its first vertex and not its roll and pitch. The plane has no use for it.
    pub gravity: Vec<Gravity>,
    /// How rotations of errors are measured.
    pub metric: RotationError,
}

/// A pose graph of the plane.
pub type PoseGraph2 = PoseGraph<Pose2>;
/// A pose graph of space.
pub type PoseGraph3 = PoseGraph<Pose3>;

impl<P: Pose> Default for PoseGraph<P> {
    fn default() -> Self {
        Self { vertices: Vec::new(), edges: Vec::new(), gravity: Vec::new(), metric: RotationError::default() }
    }
}

impl<P: Pose> PoseGraph<P> {
    /// Weighted squared errors of all edges, and of gravity, as [`PoseGraph::metric`] says.
    ///
    /// # Errors
    /// See [`PoseGraph::check`].
    pub fn chi2(&self) -> Result<f64, GraphError> {
        self.check()?;
        Ok(P::apart::<Chi2>(self))
    }

    /// Weighted squared error of one of the edges, of a graph that [`PoseGraph::check`] accepts.
    #[must_use]
    pub fn edge_chi2(&self, at: usize) -> f64 {
        P::apart::<EdgeChi2>((self, at))
    }

    /// Refuses what cannot be solved.
    ///
    /// # Errors
    /// Edges between vertices that are not there or from a vertex to itself; poses and information that are not finite
    /// or too large; gravity that is at no vertex, no direction or without deviation.
    pub fn check(&self) -> Result<(), GraphError> {
        let vertices = self.vertices.len();
        for vertex in &self.vertices {
            if !vertex.world_from_vertex.is_within_bounds() {
                return Err(GraphError::Pose { id: vertex.id, found: format!("{:?}", vertex.world_from_vertex) });
            }
        }
        for (at, &Edge { from, to, from_from_to, information }) in self.edges.iter().enumerate() {
            if from >= vertices || to >= vertices || from == to {
                return Err(GraphError::Vertices { edge: at, from, to, vertices });
            }
            // not `>`: NaN must fail
            if !from_from_to.is_within_bounds() || !entries(&information).all(|v| v.abs() <= LARGEST_INFORMATION) {
                return Err(GraphError::Measurement { edge: at });
            }
        }
        match self.gravity.iter().position(|gravity| gravity.vertex >= vertices || !gravity.is_sound()) {
            Some(at) => Err(GraphError::Gravity { at, found: format!("{:?}", self.gravity[at]), vertices }),
            None => Ok(()),
        }
    }

    /// For every edge whether it is odometry: from a vertex to that with the next larger id.
    #[must_use]
    pub fn odometry(&self) -> Vec<bool> {
        let (rank, _) = self.ranks();
        let is_next = |edge: &Edge<P>| rank.get(edge.from).zip(rank.get(edge.to)).is_some_and(|(a, b)| a + 1 == *b);
        self.edges.iter().map(is_next).collect()
    }

    /// Place of each vertex when they are sorted by id, and the vertices so sorted.
    pub(crate) fn ranks(&self) -> (Vec<usize>, Vec<usize>) {
        let mut order: Vec<usize> = (0..self.vertices.len()).collect();
        order.sort_by_key(|&v| self.vertices[v].id);
        let mut rank = vec![0; order.len()];
        order.iter().enumerate().for_each(|(place, &v)| rank[v] = place);
        (rank, order)
    }

    /// Sets the poses that only odometry would give, starting from fixed vertices and else from the first of each
    /// connected part; other edges, the first come first, lead where odometry does not.
    ///
    /// # Errors
    /// See [`PoseGraph::check`].
    pub fn start_from_odometry(&mut self) -> Result<(), GraphError> {
        self.check()?;
        let tree = self.spanning_tree();
        let known = self.anchors();
        self.spread_poses(&tree, known);
        Ok(())
    }

    /// Sets the poses of the vertices that have none from those that have, along the edges; where none of a connected
    /// part has one, its first stays where it is.
    pub(crate) fn fill_poses(&mut self, known: &[bool]) {
        let tree: Vec<usize> = (0..self.edges.len()).collect();
        let mut seeds: Vec<usize> = (0..known.len()).filter(|&v| known[v]).collect();
        let mut parts = Parts::new(known.len());
        self.edges.iter().for_each(|edge| {
            parts.join(edge.from, edge.to);
        });
        let mut seen = vec![false; known.len()];
        seeds.iter().for_each(|&v| seen[parts.root(v)] = true);
        for v in 0..known.len() {
            let root = parts.root(v);
            if !seen[root] {
                seen[root] = true;
                seeds.push(v);
            }
        }
        self.spread_poses(&tree, seeds);
    }

    /// The vertices that stay: the fixed ones, and the first of each connected part that has none.
    pub(crate) fn anchors(&self) -> Vec<usize> {
        let mut parts = self.parts();
        let mut anchored = vec![false; self.vertices.len()];
        let mut anchors: Vec<usize> = (0..self.vertices.len()).filter(|&v| self.vertices[v].fixed).collect();
        anchors.iter().for_each(|&v| anchored[parts.root(v)] = true);
        for v in 0..self.vertices.len() {
            let root = parts.root(v);
            if !anchored[root] {
                anchored[root] = true;
                anchors.push(v);
            }
        }
        anchors
    }

    /// How many parts of the graph no information connects.
    #[must_use]
    pub fn connected_parts(&self) -> usize {
        let mut parts = self.parts();
        (0..self.vertices.len()).filter(|&v| parts.root(v) == v).count()
    }

    pub(crate) fn parts(&self) -> Parts {
        let mut parts = Parts::new(self.vertices.len());
        for edge in self.edges.iter().filter(|edge| binds(edge)) {
            parts.join(edge.from, edge.to);
        }
        parts
    }

    /// Edges that connect everything there is to connect, odometry first.
    fn spanning_tree(&self) -> Vec<usize> {
        let odometry = self.odometry();
        let mut parts = Parts::new(self.vertices.len());
        let mut tree = Vec::new();
        for wanted in [true, false] {
            for at in (0..self.edges.len()).filter(|&at| odometry[at] == wanted) {
                let edge = &self.edges[at];
                if binds(edge) && parts.join(edge.from, edge.to) {
                    tree.push(at);
                }
            }
        }
        tree
    }

    /// Breadth first from the seeds along some edges.
    fn spread_poses(&mut self, edges: &[usize], seeds: Vec<usize>) {
        let mut neighbours = vec![Vec::new(); self.vertices.len()];
        for &at in edges {
            neighbours[self.edges[at].from].push(at);
            neighbours[self.edges[at].to].push(at);
        }
        let mut done = vec![false; self.vertices.len()];
        seeds.iter().for_each(|&v| done[v] = true);
        let mut queue = VecDeque::from(seeds);
        while let Some(v) = queue.pop_front() {
            for &at in &neighbours[v] {
                let edge = &self.edges[at];
                let forwards = edge.from == v;
                let (next, step) =
                    if forwards { (edge.to, edge.from_from_to) } else { (edge.from, edge.from_from_to.inverse()) };
                if !done[next] {
                    done[next] = true;
                    self.vertices[next].world_from_vertex = self.vertices[v].world_from_vertex * step;
                    queue.push_back(next);
                }
            }
        }
    }
}

/// Whether an edge says anything.
fn binds<P: Pose>(edge: &Edge<P>) -> bool {
    entries(&edge.information).any(|v| v != 0.0)
}

fn entries<M: TangentMatrix>(matrix: &M) -> impl Iterator<Item = f64> {
    (0..M::SIZE).flat_map(move |row| (0..M::SIZE).map(move |column| matrix[(row, column)]))
}

/// Chi-square of a graph that has been checked.
struct Chi2;

impl Apart for Chi2 {
    type Of<'a, P: Pose> = &'a PoseGraph<P>;
    type Output<P: Pose> = f64;

    fn plane(graph: &PoseGraph2) -> f64 {
        graph.edges.iter().map(|edge| edge_chi2(graph, edge)).sum()
    }

    fn space(graph: &PoseGraph3) -> f64 {
        let of_gravity = graph.gravity.iter().map(|gravity| {
            let pose = graph.vertices[gravity.vertex].world_from_vertex;
            tilt(pose, &gravity.down_in_vertex).0.norm_squared() / (gravity.sigma_rad * gravity.sigma_rad)
        });
        graph.edges.iter().map(|edge| edge_chi2(graph, edge)).sum::<f64>() + of_gravity.sum::<f64>()
    }
}

/// That of one edge.
struct EdgeChi2;

impl Apart for EdgeChi2 {
    type Of<'a, P: Pose> = (&'a PoseGraph<P>, usize);
    type Output<P: Pose> = f64;

    fn plane((graph, at): Self::Of<'_, Pose2>) -> f64 {
        edge_chi2(graph, &graph.edges[at])
    }

    fn space((graph, at): Self::Of<'_, Pose3>) -> f64 {
        edge_chi2(graph, &graph.edges[at])
    }
}

/// Weighted squared error of one edge of a graph.
fn edge_chi2<P: PoseGroup<D>, const D: usize>(graph: &PoseGraph<P>, edge: &Edge<P>) -> f64 {
    let [first, second] = [edge.from, edge.to].map(|v| graph.vertices[v].world_from_vertex);
    let error = (edge.from_from_to.inverse() * (first.inverse() * second)).coordinates(graph.metric);
    error.dot(&(nearest_information(&edge.information).0 * error))
}

/// The nearest positive semidefinite matrix in the Frobenius norm (Higham 1988), and whether that is another one.
#[must_use]
pub fn nearest_information<const D: usize>(information: &SMatrix<f64, D, D>) -> (SMatrix<f64, D, D>, bool) {
    let symmetric = (information + information.transpose()) * 0.5;
    let largest = symmetric.amax();
    let rounding = 1e-9 * largest;
    if (symmetric - information).amax() <= rounding && is_semidefinite(&symmetric, rounding) {
        return (symmetric, false);
    }
    if is_semidefinite(&symmetric, rounding) {
        return (symmetric, true);
    }
    let dynamic = DMatrix::from_iterator(D, D, symmetric.iter().copied());
    let Some(eigen) = dynamic.try_symmetric_eigen(1e-15, 1000) else { return (SMatrix::zeros(), true) };
    let clipped = eigen.eigenvalues.map(|v| v.max(0.0));
    let nearest = &eigen.eigenvectors * DMatrix::from_diagonal(&clipped) * eigen.eigenvectors.transpose();
    let nearest: SMatrix<f64, D, D> = SMatrix::from_iterator(nearest.iter().copied());
    ((nearest + nearest.transpose()) * 0.5, true)
}

/// Whether no eigenvalue lies below `-rounding`, by Cholesky's pivots.
fn is_semidefinite<const D: usize>(matrix: &SMatrix<f64, D, D>, rounding: f64) -> bool {
    let mut rest = *matrix + SMatrix::from_diagonal_element(rounding);
    for k in 0..D {
        let pivot = rest[(k, k)];
        if pivot <= 0.0 {
            return rounding == 0.0; // the zero matrix
        }
        for c in k + 1..D {
            for r in c..D {
                rest[(r, c)] -= rest[(r, k)] * rest[(c, k)] / pivot;
            }
        }
    }
    true
}

/// Disjoint sets.
pub(crate) struct Parts(Vec<usize>);

impl Parts {
    pub(crate) fn new(count: usize) -> Self {
        Self((0..count).collect())
    }

    /// The first member found by following, shortening the way.
    pub(crate) fn root(&mut self, mut v: usize) -> usize {
        while self.0[v] != v {
            self.0[v] = self.0[self.0[v]];
            v = self.0[v];
        }
        v
    }

    /// Whether the two were apart.
    pub(crate) fn join(&mut self, a: usize, b: usize) -> bool {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b)] = a.min(b);
        a != b
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};

    #[test]
    fn information_is_projected_only_where_it_must_be() {
        let good = Matrix3::new(2.0, 1.0, 0.0, 1.0, 2.0, 0.0, 0.0, 0.0, 5.0);
        assert_eq!(nearest_information(&good), (good, false));
        assert_eq!(nearest_information(&Matrix3::zeros()), (Matrix3::zeros(), false));
        let flat = Matrix3::from_diagonal(&Vector3::new(1.0, 0.0, 3.0));
        assert!(!nearest_information(&flat).1);
        let (nearest, repaired) = nearest_information(&Matrix3::from_diagonal(&Vector3::new(1.0, -4.0, 3.0)));
        assert!(repaired && (nearest - flat).norm() < 1e-12);
        let skewed = Matrix3::new(2.0, 1.5, 0.0, 0.5, 2.0, 0.0, 0.0, 0.0, 5.0);
        let (nearest, repaired) = nearest_information(&skewed);
        assert!(repaired && (nearest - good).norm() < 1e-12);
    }
}
