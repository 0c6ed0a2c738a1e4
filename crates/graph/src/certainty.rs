//! How certain keyframes are relative to one of them: Dijkstra projection (Olson 2009, "Recognizing places using
//! spectrally clustered local matches", section 2), stopped at a gate.
//!
//! Along a path the covariance is kept as three numbers, the variance of displacement, of rotation and their
//! covariance: a step of length `d` turns `(a, b, c)` into `(a + 2 b d + c d^2, b + c d, c)` before the link's own
//! variances are added. That is the exact propagation for a straight path across its direction, and an upper bound
//! along it.

use mapwright_geom::Pose2;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// One link of the graph seen from one of its ends.
#[derive(Debug, Clone, Copy)]
pub struct Link {
    /// The node at the other end.
    pub to: u32,
    /// Larger variance of the relative position, m^2.
    pub displacement_m2: f64,
    /// Variance of the relative heading, rad^2.
    pub rotation_rad2: f64,
}

/// A node that was reached and how uncertain it is relative to the start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reached {
    /// The node.
    pub node: u32,
    /// `sqrt(s_xy^2 + L^2 s_theta^2)`, metres.
    pub sigma_m: f64,
}

/// Nodes by dense index with links in both directions, and the buffers of the search.
#[derive(Debug, Clone, Default)]
pub struct CertaintyGraph {
    links: Vec<Vec<Link>>,
    best: Vec<Visit>,
    round: u32,
    heap: BinaryHeap<Entry>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Visit {
    round: u32,
    done: bool,
    cost: f64,
}

#[derive(Debug, Clone, Copy)]
struct Entry {
    cost: f64,
    node: u32,
    displacement: f64,
    cross: f64,
    rotation: f64,
}

impl PartialEq for Entry {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl Eq for Entry {}
impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Entry {
    /// Smallest cost first, then smallest node.
    fn cmp(&self, other: &Self) -> Ordering {
        other.cost.total_cmp(&self.cost).then(other.node.cmp(&self.node))
    }
}

impl CertaintyGraph {
    /// Number of nodes.
    #[must_use]
    pub fn len(&self) -> usize {
        self.links.len()
    }

    /// Whether there is no node.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.links.is_empty()
    }

    /// Adds a node and returns its index.
    pub fn add_node(&mut self) -> u32 {
        self.links.push(Vec::new());
        self.best.push(Visit::default());
        self.links.len() as u32 - 1
    }

    /// Adds a link in both directions; links to nodes that do not exist are left out.
    pub fn add_link(&mut self, from: u32, link: Link) {
        let count = self.links.len() as u32;
        if from >= count || link.to >= count || !(link.displacement_m2 >= 0.0 && link.rotation_rad2 >= 0.0) {
            return;
        }
        self.links[from as usize].push(link);
        self.links[link.to as usize].push(Link { to: from, ..link });
    }

    /// Nodes within `gate_m` of `start` by the most certain path, most certain first.
    ///
    /// `lever_m` turns rotations into metres (the rms range of the sensor). Only nodes for which `within` holds are
    /// entered, and at most `at_most` are returned, so the cost does not depend on the size of the graph.
    pub fn reach(
        &mut self,
        start: u32,
        world_from_node: &[Pose2],
        gate_m: f64,
        lever_m: f64,
        at_most: usize,
        within: impl Fn(u32) -> bool,
    ) -> Vec<Reached> {
        let mut reached = Vec::new();
        if start as usize >= self.links.len() {
            return reached;
        }
        self.round = self.round.wrapping_add(1);
        self.heap.clear();
        self.heap.push(Entry { cost: 0.0, node: start, displacement: 0.0, cross: 0.0, rotation: 0.0 });
        self.best[start as usize] = Visit { round: self.round, done: false, cost: 0.0 };
        while let Some(entry) = self.heap.pop() {
            let visit = &mut self.best[entry.node as usize];
            if visit.done {
                continue;
            }
            visit.done = true;
            reached.push(Reached { node: entry.node, sigma_m: entry.cost.sqrt() });
            if reached.len() >= at_most {
                break;
            }
            self.relax(entry, world_from_node, gate_m * gate_m, lever_m * lever_m, &within);
        }
        reached
    }

    fn relax(&mut self, from: Entry, poses: &[Pose2], gate2: f64, lever2: f64, within: &impl Fn(u32) -> bool) {
        for link in &self.links[from.node as usize] {
            let visit = self.best[link.to as usize];
            let known = visit.round == self.round;
            if (known && visit.done) || !within(link.to) {
                continue;
            }
            let (a, b) = (poses[from.node as usize], poses[link.to as usize]);
            let d = ((a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y)).sqrt();
            let displacement = from.displacement + 2.0 * from.cross * d + from.rotation * d * d + link.displacement_m2;
            let cross = from.cross + from.rotation * d;
            let rotation = from.rotation + link.rotation_rad2;
            let cost = displacement + lever2 * rotation;
            if cost > gate2 || (known && cost >= visit.cost) {
                continue;
            }
            self.best[link.to as usize] = Visit { round: self.round, done: false, cost };
            self.heap.push(Entry { cost, node: link.to, displacement, cross, rotation });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chain(n: usize) -> (CertaintyGraph, Vec<Pose2>) {
        let mut graph = CertaintyGraph::default();
        let poses: Vec<Pose2> = (0..n).map(|k| Pose2::new(k as f64, 0.0, 0.0)).collect();
        for k in 0..n as u32 {
            graph.add_node();
            if k > 0 {
                graph.add_link(k - 1, Link { to: k, displacement_m2: 1e-4, rotation_rad2: 0.0 });
            }
        }
        (graph, poses)
    }

    #[test]
    fn uncertainty_grows_along_a_chain_and_the_gate_stops_it() {
        let (mut graph, poses) = chain(200);
        let reached = graph.reach(100, &poses, 0.05, 5.0, usize::MAX, |_| true);
        let mut nodes: Vec<u32> = reached.iter().map(|r| r.node).collect();
        nodes.sort_unstable();
        assert_eq!(nodes, (75..=125).collect::<Vec<_>>(), "25 links of 1 cm make 5 cm");
    }

    #[test]
    fn a_short_cut_makes_a_far_node_certain() {
        let (mut graph, poses) = chain(200);
        graph.add_link(199, Link { to: 0, displacement_m2: 1e-4, rotation_rad2: 0.0 });
        let reached = graph.reach(199, &poses, 0.05, 5.0, usize::MAX, |_| true);
        assert!(reached.iter().any(|r| r.node == 10), "the way over the closure is the certain one");
    }

    #[test]
    fn rotation_costs_with_the_distance_travelled() {
        let mut graph = CertaintyGraph::default();
        let poses: Vec<Pose2> = (0..3).map(|k| Pose2::new(10.0 * f64::from(k), 0.0, 0.0)).collect();
        for _ in 0..3 {
            graph.add_node();
        }
        graph.add_link(0, Link { to: 1, displacement_m2: 0.0, rotation_rad2: 1e-4 });
        graph.add_link(1, Link { to: 2, displacement_m2: 0.0, rotation_rad2: 0.0 });
        let reached = graph.reach(0, &poses, 10.0, 0.0, usize::MAX, |_| true);
        let far = reached.iter().find(|r| r.node == 2).map(|r| r.sigma_m);
        assert!((far.unwrap_or(0.0) - 0.1).abs() < 1e-12, "0.01 rad over 10 m");
    }
}
