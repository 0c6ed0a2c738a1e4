//! How certain nodes are relative to one of them: Dijkstra projection (Olson 2009, "Recognizing places using spectrally
//! clustered local matches", section 2), stopped at a gate, a few links at a time.
//!
//! A link's heading error `q_i`, made at `x_i`, displaces a node at `x` by its distance from there, however the path winds
//! in between. So a path to `x` has the variance `sum p_i + q_i |x - x_i|^2`, exactly, from the sums of `p`, `q`, `q x`
//! and `q |x|^2`; adding the distances travelled instead would forbid a short loop for being a loop.

use mapwright_geom::Pose2;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// How uncertain a pose is relative to another, directions left aside.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Uncertainty {
    /// Larger variance of the relative position, m^2.
    pub displacement_m2: f64,
    /// Variance of the relative heading, rad^2.
    pub rotation_rad2: f64,
}

impl Uncertainty {
    /// `sqrt(s_xy^2 + L^2 s_theta^2)` with lever `L` (the rms range of the sensor), metres.
    #[must_use]
    pub fn sigma_m(self, lever_m: f64) -> f64 {
        (self.displacement_m2 + lever_m * lever_m * self.rotation_rad2).sqrt()
    }

    /// Of a pose `step_m` away that is known as well as `next` from here.
    #[must_use]
    pub fn then(self, next: Self, step_m: f64) -> Self {
        Self {
            displacement_m2: self.displacement_m2 + self.rotation_rad2 * step_m * step_m + next.displacement_m2,
            rotation_rad2: self.rotation_rad2 + next.rotation_rad2,
        }
    }
}

/// A node that was reached and how uncertain it is relative to the start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reached {
    /// The node.
    pub node: u32,
    /// Of the node's pose.
    pub uncertainty: Uncertainty,
}

#[derive(Debug, Clone, Copy)]
struct Link {
    to: u32,
    uncertainty: Uncertainty,
    /// Where the heading's error is made.
    pivot: [f64; 2],
}

#[derive(Debug, Clone, Default)]
struct Node {
    at: [f64; 2],
    links: Vec<Link>,
}

/// Nodes at positions, links between them, and one search that goes on when told to.
#[derive(Debug, Clone, Default)]
pub struct CertaintyGraph {
    nodes: Vec<Node>,
    visits: Vec<Visit>,
    round: u32,
    heap: BinaryHeap<Label>,
    origin: [f64; 2],
    gate: Gate,
    reached: Vec<Reached>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Visit {
    round: u32,
    done: bool,
    cost: f64,
}

/// Where searches end.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Gate {
    /// The most uncertain a node may be, metres.
    pub sigma_m: f64,
    /// What makes metres of radians, metres.
    pub lever_m: f64,
    /// Nodes up to here from the start are asked for, metres; paths may lead farther.
    pub reach_m: f64,
}

/// The sums of a path; positions are relative to the start.
#[derive(Debug, Clone, Copy, Default)]
struct Label {
    /// `sum p + L^2 sum q`: what is the same wherever the path ends.
    cost: f64,
    node: u32,
    p: f64,
    q: f64,
    qx: [f64; 2],
    qxx: f64,
}

impl Label {
    fn uncertainty_at(&self, [x, y]: [f64; 2]) -> Uncertainty {
        let turned = self.q * (x * x + y * y) - 2.0 * (self.qx[0] * x + self.qx[1] * y) + self.qxx;
        Uncertainty { displacement_m2: self.p + turned.max(0.0), rotation_rad2: self.q }
    }

    fn extended(&self, node: u32, link: Uncertainty, [x, y]: [f64; 2], lever_m2: f64) -> Self {
        let q = link.rotation_rad2;
        Self {
            cost: self.cost + link.displacement_m2 + lever_m2 * q,
            node,
            p: self.p + link.displacement_m2,
            q: self.q + q,
            qx: [self.qx[0] + q * x, self.qx[1] + q * y],
            qxx: self.qxx + q * (x * x + y * y),
        }
    }

    /// The least variance that a path over here can have up to `reach_m` from the start; it never shrinks along a path.
    fn at_least(&self, reach_m: f64) -> f64 {
        if self.q <= 0.0 {
            return self.cost;
        }
        let [x, y] = self.qx.map(|qx| qx / self.q);
        let about_centroid = self.qxx - self.q * (x * x + y * y);
        let beyond_m = ((x * x + y * y).sqrt() - reach_m).max(0.0);
        self.cost + about_centroid.max(0.0) + self.q * beyond_m * beyond_m
    }
}

impl PartialEq for Label {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl Eq for Label {}
impl PartialOrd for Label {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Label {
    /// Smallest cost first, then smallest node.
    fn cmp(&self, other: &Self) -> Ordering {
        other.cost.total_cmp(&self.cost).then(other.node.cmp(&self.node))
    }
}

impl CertaintyGraph {
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

    /// Adds a node at a position and returns its index.
    pub fn add_node(&mut self, at: [f64; 2]) -> u32 {
        self.nodes.push(Node { at, links: Vec::new() });
        self.visits.push(Visit::default());
        self.nodes.len() as u32 - 1
    }

    /// Links two nodes; of several links between the same two the most certain one counts.
    ///
    /// `pivot` is where the heading's error is made, as a rule where the newer end was measured. Links to nodes that do
    /// not exist, to the node itself, or of negative variances are left out.
    pub fn add_link(&mut self, a: u32, b: u32, uncertainty: Uncertainty, pivot: [f64; 2], lever_m: f64) {
        let count = self.nodes.len() as u32;
        let Uncertainty { displacement_m2, rotation_rad2 } = uncertainty;
        if a >= count || b >= count || a == b || !(displacement_m2 >= 0.0 && rotation_rad2 >= 0.0) {
            return;
        }
        for (from, to) in [(a, b), (b, a)] {
            let links = &mut self.nodes[from as usize].links;
            let link = Link { to, uncertainty, pivot };
            match links.iter_mut().find(|known| known.to == to) {
                Some(known) if known.uncertainty.sigma_m(lever_m) <= uncertainty.sigma_m(lever_m) => {}
                Some(known) => *known = link,
                None => links.push(link),
            }
        }
    }

    /// Moves every node, and the headings' errors made near it, by its own motion of the map; an unfinished search is
    /// forgotten.
    pub fn carry(&mut self, moved: impl Fn(u32) -> Pose2) {
        self.heap.clear();
        self.reached.clear();
        for (number, node) in (0..).zip(&mut self.nodes) {
            let map_from_map = moved(number);
            node.at = map_from_map.transform(node.at);
            node.links.iter_mut().for_each(|link| link.pivot = map_from_map.transform(link.pivot));
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

    /// Takes away all links of a node.
    pub fn isolate(&mut self, node: u32) {
        let Some(links) = self.nodes.get_mut(node as usize).map(|node| std::mem::take(&mut node.links)) else { return };
        for link in links {
            self.nodes[link.to as usize].links.retain(|back| back.to != node);
        }
    }

    /// Starts a search at a node, itself as uncertain as `uncertainty`; [`CertaintyGraph::advance`] carries it out.
    ///
    /// Paths end where nothing within the gate's reach can be certain enough by way of them.
    pub fn begin(&mut self, start: u32, uncertainty: Uncertainty, gate: Gate) {
        self.round = self.round.wrapping_add(1);
        self.heap.clear();
        self.reached.clear();
        self.gate = gate;
        if let Some(node) = self.nodes.get(start as usize) {
            self.origin = node.at;
            let label = Label::default().extended(start, uncertainty, [0.0; 2], gate.lever_m * gate.lever_m);
            self.visits[start as usize] = Visit { round: self.round, done: false, cost: label.cost };
            self.heap.push(label);
        }
    }

    /// Goes on with the search for about `links` links, and until `at_most` nodes are reached; whether it has ended.
    pub fn advance(&mut self, links: usize, at_most: usize) -> bool {
        let mut seen = 0;
        while seen < links {
            if self.reached.len() >= at_most {
                self.heap.clear();
            }
            let Some(label) = self.heap.pop() else { return true };
            seen += 1;
            let visit = &mut self.visits[label.node as usize];
            if visit.done && visit.round == self.round {
                continue;
            }
            visit.done = true;
            let uncertainty = label.uncertainty_at(minus(self.nodes[label.node as usize].at, self.origin));
            self.reached.push(Reached { node: label.node, uncertainty });
            seen += self.relax(&label);
        }
        self.heap.is_empty()
    }

    /// The nodes reached by the search so far.
    #[must_use]
    pub fn reached(&self) -> &[Reached] {
        &self.reached
    }

    fn relax(&mut self, label: &Label) -> usize {
        let Gate { sigma_m, lever_m, reach_m } = self.gate;
        let links = &self.nodes[label.node as usize].links;
        for link in links {
            let further = label.extended(link.to, link.uncertainty, minus(link.pivot, self.origin), lever_m * lever_m);
            let visit = &mut self.visits[link.to as usize];
            let known = visit.round == self.round && (visit.done || further.cost >= visit.cost);
            if known || further.at_least(reach_m) > sigma_m * sigma_m {
                continue;
            }
            *visit = Visit { round: self.round, done: false, cost: further.cost };
            self.heap.push(further);
        }
        links.len()
    }
}

fn minus(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: Uncertainty = Uncertainty { displacement_m2: 1e-4, rotation_rad2: 0.0 };

    fn chain(n: u32) -> CertaintyGraph {
        let mut graph = CertaintyGraph::default();
        for k in 0..n {
            graph.add_node([f64::from(k), 0.0]);
            if k > 0 {
                graph.add_link(k - 1, k, STEP, [f64::from(k), 0.0], 5.0);
            }
        }
        graph
    }

    fn reach(graph: &mut CertaintyGraph, start: u32, gate_m: f64, links: usize) -> Vec<Reached> {
        graph.begin(start, Uncertainty::default(), Gate { sigma_m: gate_m, lever_m: 5.0, reach_m: 100.0 });
        while !graph.advance(links, usize::MAX) {}
        graph.reached().to_vec()
    }

    fn nodes(reached: &[Reached]) -> Vec<u32> {
        let mut nodes: Vec<u32> = reached.iter().map(|r| r.node).collect();
        nodes.sort_unstable();
        nodes
    }

    #[test]
    fn uncertainty_grows_along_a_chain_and_the_gate_stops_it() {
        let reached = reach(&mut chain(200), 100, 0.05, usize::MAX);
        assert_eq!(nodes(&reached), (75..=125).collect::<Vec<_>>(), "25 links of 1 cm make 5 cm");
    }

    #[test]
    fn a_short_cut_makes_a_far_node_certain_until_it_is_taken_away() {
        let mut graph = chain(200);
        graph.add_link(199, 0, STEP, [0.0; 2], 5.0);
        assert!(nodes(&reach(&mut graph, 199, 0.05, usize::MAX)).contains(&10), "over the closure");
        graph.isolate(0);
        assert!(!nodes(&reach(&mut graph, 199, 0.05, usize::MAX)).contains(&10));
    }

    #[test]
    fn of_two_links_the_more_certain_one_counts_in_either_order() {
        let bad = Uncertainty { displacement_m2: 1.0, rotation_rad2: 0.0 };
        for links in [[bad, STEP], [STEP, bad]] {
            let mut graph = CertaintyGraph::default();
            let (a, b) = (graph.add_node([0.0; 2]), graph.add_node([1.0, 0.0]));
            links.into_iter().for_each(|link| graph.add_link(b, a, link, [1.0, 0.0], 5.0));
            let reached = reach(&mut graph, a, 2.0, usize::MAX);
            assert_eq!(reached.last(), Some(&Reached { node: b, uncertainty: STEP }));
        }
    }

    #[test]
    fn a_turn_costs_by_the_distance_from_where_it_was_made_and_not_by_the_way_travelled() {
        // Once around a square of 10 m, back to the start; headings err at every corner.
        let corners = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0], [0.0, 0.0]];
        let mut graph = CertaintyGraph::default();
        for (k, at) in (0..).zip(corners) {
            graph.add_node(at);
            if k > 0 {
                let link = Uncertainty { displacement_m2: 0.0, rotation_rad2: 1e-6 };
                graph.add_link(k - 1, k, link, at, 5.0);
            }
        }
        let reached = reach(&mut graph, 0, 1.0, usize::MAX);
        let back = reached[4].uncertainty;
        assert!((back.displacement_m2 - 1e-6 * (100.0 + 200.0 + 100.0)).abs() < 1e-15, "{back:?}");
        assert!((back.rotation_rad2 - 4e-6).abs() < 1e-15);
        assert!((back.sigma_m(5.0) - (4e-4_f64 + 1e-4).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn a_search_in_small_steps_reaches_what_one_in_a_single_step_does() {
        let mut graph = chain(300);
        for k in 0..40 {
            graph.add_link(k * 7, (k * 31 + 5) % 300, STEP, [f64::from(k), 1.0], 5.0);
        }
        let whole = reach(&mut graph, 150, 0.04, usize::MAX);
        assert!(whole.len() > 50);
        for links in [1, 2, 7, 64] {
            assert_eq!(reach(&mut graph, 150, 0.04, links), whole);
        }
    }
}
