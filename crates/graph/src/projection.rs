//! How certain nodes in space are relative to one of them, axis by axis: Dijkstra projection (Olson 2009, "Recognizing places using
//! spectrally clustered local matches", section 2) that adds up whole covariances along the way.
//!
//! A link errs by a translation `e` and a rotation vector `d`, in the map's axes, made at `x`. It displaces a point at `y` by
//! `e + cross(d, y - x)`, which is `t + cross(d, y)` with `t = e - cross(d, x)`: errors of all links of a way are added as such
//! `(t, d)` about the start's position, exact to first order, and read off anywhere. What robots without other sensors know best,
//! height or the vertical, stays apart from what they know least.

use crate::certainty::{Gate, Uncertainty};
use mapwright_geom::{Cov6, Pose3, Stored, is_covariance};
use nalgebra::{Matrix3, Matrix6, Vector3};
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// A node that was reached and how uncertain it is relative to the start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projected {
    /// The node.
    pub node: u32,
    /// Covariance of the error between both, as a perturbation at the start's position along the map's axes, translation first.
    pub at_start: Cov6,
    /// From there to the node along the same axes, metres.
    away_m: Vector3<f64>,
}

impl Projected {
    /// Of the node's pose, directions left aside.
    #[must_use]
    pub fn uncertainty(&self) -> Uncertainty {
        Uncertainty::of(&displaced(&self.at_start, self.away_m))
    }
}

#[derive(Debug, Clone, Copy)]
struct Link {
    to: u32,
    /// As a perturbation at the pivot, along the map's axes.
    covariance: Cov6,
    pivot: Vector3<f64>,
    /// Of it, directions left aside: what it adds to a way wherever that ends.
    adds: Uncertainty,
}

impl Link {
    fn new(to: u32, covariance: Cov6, pivot: Vector3<f64>) -> Self {
        Self { to, covariance, pivot, adds: Uncertainty::of(&covariance) }
    }
}

#[derive(Debug, Clone, Default)]
struct Node {
    at: Vector3<f64>,
    links: Vec<Link>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Visit {
    round: u32,
    done: bool,
    cost: f64,
}

#[derive(Debug, Clone, Copy)]
struct Label {
    cost: f64,
    node: u32,
    at_start: Cov6,
}

/// Smallest cost first, then smallest node.
impl Ord for Label {
    fn cmp(&self, other: &Self) -> Ordering {
        other.cost.total_cmp(&self.cost).then(other.node.cmp(&self.node))
    }
}
impl PartialOrd for Label {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl PartialEq for Label {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl Eq for Label {}

/// Nodes in space, and links between them whose covariances are known.
#[derive(Debug, Clone, Default)]
pub struct CovarianceGraph {
    nodes: Vec<Node>,
    visits: Vec<Visit>,
    round: u32,
    heap: BinaryHeap<Label>,
}

impl CovarianceGraph {
    /// Number of nodes.
    #[must_use]
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether there is no node.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Adds a node at a position.
    pub fn add_node(&mut self, at: Vector3<f64>) {
        self.nodes.push(Node { at, links: Vec::new() });
        self.visits.push(Visit::default());
    }

    /// Links `a` and `b`, which is at `map_from_b`, where their relative pose was measured with this covariance of its right
    /// perturbation; of several links between the same two the most certain one counts. Links to nodes that do not exist, to the node
    /// itself, or of variances that are no numbers or negative are left out.
    pub fn add_link(&mut self, [a, b]: [u32; 2], covariance: &Cov6, map_from_b: Pose3, lever_m: f64) {
        let count = self.nodes.len() as u32;
        if a >= count || b >= count || a == b || !covariance.diagonal().iter().all(|v| *v >= 0.0 && v.is_finite()) {
            return;
        }
        let covariance = turned(covariance, &map_from_b.rotation.to_rotation_matrix().into_inner());
        for (from, to) in [(a, b), (b, a)] {
            let link = Link::new(to, covariance, map_from_b.translation);
            let links = &mut self.nodes[from as usize].links;
            match links.iter_mut().find(|known| known.to == to) {
                Some(known) if known.adds.sigma_m(lever_m) <= link.adds.sigma_m(lever_m) => {}
                Some(known) => *known = link,
                None => links.push(link),
            }
        }
    }

    /// Takes away the link between two nodes, if there is one.
    pub fn remove_link(&mut self, a: u32, b: u32) {
        for (from, to) in [(a, b), (b, a)] {
            if let Some(node) = self.nodes.get_mut(from as usize) {
                node.links.retain(|link| link.to != to);
            }
        }
    }

    /// Moves every node, and the errors made near it, by its own motion of the map.
    pub fn carry(&mut self, moved: impl Fn(u32) -> Pose3) {
        for (number, node) in (0..).zip(&mut self.nodes) {
            let Pose3 { translation, rotation } = moved(number);
            let rotation = rotation.to_rotation_matrix().into_inner();
            node.at = rotation * node.at + translation;
            for link in &mut node.links {
                link.pivot = rotation * link.pivot + translation;
                link.covariance = turned(&link.covariance, &rotation);
            }
        }
    }

    /// The nodes that may be within the gate, the most certain first. Ways end where nothing within the gate's reach can be certain
    /// enough by way of them.
    pub fn project(&mut self, start: u32, gate: Gate) -> Vec<Projected> {
        let mut reached = Vec::new();
        let Some(origin) = self.nodes.get(start as usize).map(|node| node.at) else { return reached };
        self.round = self.round.wrapping_add(1);
        self.heap.clear();
        self.heap.push(Label { cost: 0.0, node: start, at_start: Cov6::zeros() });
        while let Some(label) = self.heap.pop() {
            let visit = &mut self.visits[label.node as usize];
            if visit.round == self.round && visit.done {
                continue;
            }
            *visit = Visit { round: self.round, done: true, cost: label.cost };
            let node = &self.nodes[label.node as usize];
            let away_m = node.at - origin;
            if away_m.norm() <= gate.reach_m {
                reached.push(Projected { node: label.node, at_start: label.at_start, away_m });
            }
            for link in &node.links {
                let Uncertainty { displacement_m2, rotation_rad2 } = link.adds;
                let cost = label.cost + displacement_m2 + gate.lever_m * gate.lever_m * rotation_rad2;
                let visit = self.visits[link.to as usize];
                let known = visit.round == self.round && (visit.done || cost >= visit.cost);
                if known || cost > gate.sigma_m * gate.sigma_m {
                    continue;
                }
                self.visits[link.to as usize] = Visit { round: self.round, done: false, cost };
                let at_start = label.at_start + displaced(&link.covariance, origin - link.pivot);
                self.heap.push(Label { cost, node: link.to, at_start });
            }
        }
        reached
    }
}

/// A link as bytes: to whom, its covariance and its pivot.
type StoredLink = (u32, Cov6, [f64; 3]);

/// Without a search, which is never left under way.
impl Stored for CovarianceGraph {
    fn put(&self, out: &mut Vec<u8>) {
        let link = |link: &Link| (link.to, link.covariance, <[f64; 3]>::from(link.pivot));
        let node = |node: &Node| (<[f64; 3]>::from(node.at), node.links.iter().map(link).collect::<Vec<_>>());
        self.nodes.iter().map(node).collect::<Vec<_>>().put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        let nodes: Vec<([f64; 3], Vec<StoredLink>)> = Stored::take(from)?;
        let count = nodes.len();
        let is_finite = |at: &[f64; 3]| at.iter().all(|v| v.is_finite());
        let is_link = |(to, covariance, pivot): &StoredLink| {
            (*to as usize) < count && is_covariance(covariance) && is_finite(pivot)
        };
        let is_sound = nodes.iter().all(|(at, links)| is_finite(at) && links.iter().all(is_link));
        let link = |(to, covariance, pivot): StoredLink| Link::new(to, covariance, pivot.into());
        let node =
            |(at, links): ([f64; 3], Vec<_>)| Node { at: at.into(), links: links.into_iter().map(link).collect() };
        is_sound.then(|| Self {
            nodes: nodes.into_iter().map(node).collect(),
            visits: vec![Visit::default(); count],
            ..Self::default()
        })
    }
}

/// A perturbation along other axes.
fn turned(covariance: &Cov6, rotation: &Matrix3<f64>) -> Cov6 {
    let mut both = Matrix6::zeros();
    both.fixed_view_mut::<3, 3>(0, 0).copy_from(rotation);
    both.fixed_view_mut::<3, 3>(3, 3).copy_from(rotation);
    both * covariance * both.transpose()
}

/// A perturbation as it moves what is so far away, along the same axes: `e + cross(d, away)`.
fn displaced(covariance: &Cov6, away: Vector3<f64>) -> Cov6 {
    let block = |row: usize, column: usize| -> Matrix3<f64> { covariance.fixed_view::<3, 3>(row, column).into_owned() };
    let (mixed, angular, arm) = (block(0, 3), block(3, 3), -away.cross_matrix());
    let swung = arm * mixed.transpose();
    let mut moved = *covariance;
    moved
        .fixed_view_mut::<3, 3>(0, 0)
        .copy_from(&(block(0, 0) + swung + swung.transpose() + arm * angular * arm.transpose()));
    let mixed = mixed + arm * angular;
    moved.fixed_view_mut::<3, 3>(0, 3).copy_from(&mixed);
    moved.fixed_view_mut::<3, 3>(3, 0).copy_from(&mixed.transpose());
    moved
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test may fail loudly")]
mod tests {
    use super::*;
    use mapwright_geom::compose_covariance;
    use nalgebra::Vector6;

    const EVERYWHERE: Gate = Gate { sigma_m: f64::INFINITY, lever_m: 5.0, reach_m: f64::INFINITY };

    /// A winding way with links of unlike axes.
    fn way(count: usize) -> (Vec<Pose3>, CovarianceGraph, Cov6) {
        let covariance = Cov6::from_diagonal(&Vector6::new(1e-4, 4e-4, 1e-6, 1e-6, 2e-6, 3e-5));
        let step = Pose3::exp(Vector6::new(1.0, 0.1, 0.05, 0.02, -0.04, 0.2));
        let mut poses = vec![Pose3::exp(Vector6::new(4.0, -3.0, 1.0, 0.3, 0.2, 1.0))];
        let mut graph = CovarianceGraph::default();
        graph.add_node(poses[0].translation);
        for k in 1..count {
            poses.push(poses[k - 1] * step);
            graph.add_node(poses[k].translation);
            graph.add_link([k as u32 - 1, k as u32], &covariance, poses[k], 5.0);
        }
        (poses, graph, covariance)
    }

    #[test]
    fn along_a_chain_it_is_what_composing_says() {
        let (poses, mut graph, link) = way(30);
        let reached = graph.project(29, EVERYWHERE);
        assert_eq!(reached.len(), 30);
        let step = poses[0].between(poses[1]);
        let mut composed = Cov6::zeros();
        for k in 1..30 {
            composed = compose_covariance(&composed, step, &link);
            let first = reached.iter().find(|reached| reached.node == 29 - k).unwrap();
            let rotation = poses[29].rotation.to_rotation_matrix().into_inner();
            let stated = turned(&first.at_start, &rotation.transpose());
            assert!((stated - composed).norm() < 1e-12 * f64::from(k), "{k}: {}", (stated - composed).norm());
        }
    }

    #[test]
    fn it_turns_with_the_map_and_short_cuts_count_until_they_are_taken_away() {
        let (poses, mut graph, link) = way(40);
        let before = graph.project(39, EVERYWHERE);
        let motion = Pose3::exp(Vector6::new(3.0, 1.0, -2.0, 0.5, -0.3, 1.2));
        graph.carry(|_| motion);
        let after = graph.project(39, EVERYWHERE);
        let rotation = motion.rotation.to_rotation_matrix().into_inner();
        for (before, after) in before.iter().zip(&after) {
            assert_eq!(before.node, after.node);
            assert!((turned(&before.at_start, &rotation) - after.at_start).norm() < 1e-12);
            assert!((before.uncertainty().displacement_m2 - after.uncertainty().displacement_m2).abs() < 1e-12);
        }
        let of_first = |reached: &[Projected]| reached.iter().find(|reached| reached.node == 0).unwrap().uncertainty();
        let far_m2 = of_first(&after).displacement_m2;
        graph.add_link([0, 39], &link, motion * poses[39], 5.0);
        let rotation = (motion * poses[39]).rotation.to_rotation_matrix().into_inner();
        let away = (motion * poses[0]).translation - (motion * poses[39]).translation;
        let by_link_m2 = Uncertainty::of(&displaced(&turned(&link, &rotation), away)).displacement_m2;
        let near_m2 = of_first(&graph.project(39, EVERYWHERE)).displacement_m2;
        assert!(near_m2 < far_m2 && (near_m2 / by_link_m2 - 1.0).abs() < 1e-9, "{near_m2}, {by_link_m2}, {far_m2}");
        graph.remove_link(39, 0);
        assert_eq!(graph.project(39, EVERYWHERE), after);
    }

    #[test]
    fn a_graph_that_was_read_says_the_same() {
        let (_, mut graph, _) = way(20);
        let mut bytes = Vec::new();
        graph.put(&mut bytes);
        let mut read = CovarianceGraph::take(&mut &bytes[..]).unwrap();
        assert_eq!(graph.project(19, EVERYWHERE), read.project(19, EVERYWHERE));
        assert!(CovarianceGraph::take(&mut &bytes[..bytes.len() - 1]).is_none());
    }

    #[test]
    fn ways_end_at_the_gate_and_bad_links_are_left_out() {
        let (poses, mut graph, _) = way(40);
        let near = graph.project(39, Gate { sigma_m: 0.05, ..EVERYWHERE });
        assert!((2..39).contains(&near.len()), "{}", near.len());
        assert!(near.iter().all(|reached| reached.node as usize >= 40 - near.len()));
        let before = graph.project(39, EVERYWHERE);
        for (ends, variance) in [([0, 40], 1e-9), ([3, 3], 1e-9), ([0, 39], -1.0), ([0, 39], f64::NAN)] {
            graph.add_link(ends, &(Cov6::identity() * variance), poses[39], 5.0);
        }
        assert_eq!(graph.project(39, EVERYWHERE), before);
        assert!(graph.project(40, EVERYWHERE).is_empty());
    }
}
