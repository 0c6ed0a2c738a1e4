//! How certain nodes are relative to one of them, in the plane and in space: Dijkstra projection (Olson 2009, "Recognizing
//! places using spectrally clustered local matches", section 2), stopped at a gate, a few links at a time.
//!
//! A link's heading error `q_i`, made at `x_i`, displaces a node at `x` by its distance from there, however the path winds
//! in between. So a path to `x` has the variance `sum p_i + q_i |x - x_i|^2`, exactly, from the sums of `p`, `q`, `q x`
//! and `q |x|^2`; adding the distances travelled instead would forbid a short loop for being a loop.
//!
//! *In space* a link errs by a rotation vector `d_i` with covariance `Q_i`, and `q_i` is the largest eigenvalue of that, the
//! variance about the axis about which it is least certain. To first order it displaces `x`, with
//! `r = x - x_i`, by `cross(d_i, r)`, and along a unit vector `u` by `u . cross(d_i, r) = d_i . c` with `c = cross(r, u)`,
//! whose variance is `c^T Q_i c <= q_i |c|^2 <= q_i |r|^2`. The largest eigenvalue of a sum of covariances is at most the sum
//! of theirs (Weyl), so the variance of a path is at most as above in every direction, and just that where errors are alike
//! about all axes and some `u` is square to all `r`, such as on a straight way. (Summed over three directions it would be
//! `r^T (tr Q I - Q) r`; what is gated and reported here is one direction's.) Whichever axes a covariance is written along,
//! its largest eigenvalue is the same, so links add up as numbers. Errors of position and rotation are taken as independent
//! where the link's heading errs.

use mapwright_geom::{Point, Pose, Pose2, TangentMatrix};
use std::cmp::Ordering;
use std::collections::BinaryHeap;

mod stored;

/// How uncertain a pose is relative to another, directions left aside.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Uncertainty {
    /// Variance of the relative position in the direction in which it is largest, m^2.
    pub displacement_m2: f64,
    /// Variance of the relative heading, in space about the axis about which it is largest, rad^2.
    pub rotation_rad2: f64,
}

impl Uncertainty {
    /// Of what has a covariance.
    #[must_use]
    pub fn of<M: TangentMatrix>(covariance: &M) -> Self {
        Self { displacement_m2: covariance.position_variance_m2(), rotation_rad2: covariance.rotation_variance_rad2() }
    }

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
struct Link<X> {
    to: u32,
    uncertainty: Uncertainty,
    /// Where the heading's error is made.
    pivot: X,
}

#[derive(Debug, Clone, Default)]
struct Node<X> {
    at: X,
    links: Vec<Link<X>>,
}

/// Nodes at positions, links between them, and one search that goes on when told to.
///
/// Positions are those of poses `P`: two coordinates or three, metres.
#[derive(Debug, Clone, Default)]
pub struct CertaintyGraph<P: Pose = Pose2> {
    nodes: Vec<Node<P::Point>>,
    visits: Vec<Visit>,
    round: u32,
    heap: BinaryHeap<Label<P::Point>>,
    origin: P::Point,
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
struct Label<X> {
    /// `sum p + L^2 sum q`: what is the same wherever the path ends.
    cost: f64,
    node: u32,
    p: f64,
    q: f64,
    qx: X,
    qxx: f64,
}

impl<X: Point> Label<X> {
    fn uncertainty_at(&self, at: X) -> Uncertainty {
        let turned = self.q * at.dot(at) - 2.0 * self.qx.dot(at) + self.qxx;
        Uncertainty { displacement_m2: self.p + turned.max(0.0), rotation_rad2: self.q }
    }

    fn extended(&self, node: u32, link: Uncertainty, pivot: X, lever_m2: f64) -> Self {
        let q = link.rotation_rad2;
        Self {
            cost: self.cost + link.displacement_m2 + lever_m2 * q,
            node,
            p: self.p + link.displacement_m2,
            q: self.q + q,
            qx: self.qx.plus(q, pivot),
            qxx: self.qxx + q * pivot.dot(pivot),
        }
    }

    /// The least variance that a path over here can have up to `reach_m` from the start; it never shrinks along a path.
    fn at_least(&self, reach_m: f64) -> f64 {
        if self.q <= 0.0 {
            return self.cost;
        }
        let centroid = X::from_fn(|axis| self.qx[axis] / self.q);
        let about_centroid = self.qxx - self.q * centroid.dot(centroid);
        let beyond_m = (centroid.dot(centroid).sqrt() - reach_m).max(0.0);
        self.cost + about_centroid.max(0.0) + self.q * beyond_m * beyond_m
    }
}

impl<X> PartialEq for Label<X> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl<X> Eq for Label<X> {}
impl<X> PartialOrd for Label<X> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl<X> Ord for Label<X> {
    /// Smallest cost first, then smallest node.
    fn cmp(&self, other: &Self) -> Ordering {
        other.cost.total_cmp(&self.cost).then(other.node.cmp(&self.node))
    }
}

impl<P: Pose> CertaintyGraph<P> {
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
    pub fn add_node(&mut self, at: P::Point) -> u32 {
        self.nodes.push(Node { at, links: Vec::new() });
        self.visits.push(Visit::default());
        self.nodes.len() as u32 - 1
    }

    /// Links two nodes; of several links between the same two the most certain one counts.
    ///
    /// `pivot` is where the heading's error is made, as a rule where the newer end was measured. Links to nodes that do
    /// not exist, to the node itself, or of negative variances are left out.
    pub fn add_link(&mut self, a: u32, b: u32, uncertainty: Uncertainty, pivot: P::Point, lever_m: f64) {
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
    pub fn carry(&mut self, moved: impl Fn(u32) -> P) {
        self.heap.clear();
        self.reached.clear();
        for (number, node) in (0..).zip(&mut self.nodes) {
            let map_from_map = moved(number);
            node.at = map_from_map.transform_point(node.at);
            node.links.iter_mut().for_each(|link| link.pivot = map_from_map.transform_point(link.pivot));
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
            let label = Label::default().extended(start, uncertainty, P::Point::default(), gate.lever_m * gate.lever_m);
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
            let uncertainty = label.uncertainty_at(self.nodes[label.node as usize].at.minus(self.origin));
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

    fn relax(&mut self, label: &Label<P::Point>) -> usize {
        let Gate { sigma_m, lever_m, reach_m } = self.gate;
        let links = &self.nodes[label.node as usize].links;
        for link in links {
            let further = label.extended(link.to, link.uncertainty, link.pivot.minus(self.origin), lever_m * lever_m);
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

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test may fail loudly")]
mod tests {
    use super::*;
    use mapwright_geom::{Cov6, Pose3, compose_covariance};
    use nalgebra::{DMatrix, SMatrix, Vector6};

    const STEP: Uncertainty = Uncertainty { displacement_m2: 1e-4, rotation_rad2: 0.0 };

    fn chain(n: u32) -> CertaintyGraph {
        let mut graph = CertaintyGraph::<Pose2>::default();
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
            let mut graph = CertaintyGraph::<Pose2>::default();
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
        let mut graph = CertaintyGraph::<Pose2>::default();
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

    /// Numbers in (-1, 1) that are the same everywhere.
    struct Dice(u64);

    impl Dice {
        fn next(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        }

        /// Nearly normal, with variance one.
        fn normal(&mut self) -> f64 {
            0.5 * (0..12).map(|_| self.next()).sum::<f64>()
        }
    }

    /// Steps of a way in space and their covariances, the last leading back to where it began.
    struct Loop3 {
        world_from_node: Vec<Pose3>,
        steps: Vec<(Pose3, Cov6)>,
    }

    impl Loop3 {
        /// Errors differ by axis, those of position and rotation are independent.
        fn winding(nodes: usize, dice: &mut Dice) -> Self {
            let mut world_from_node = vec![Pose3::identity()];
            for k in 1..nodes {
                let twist = Vector6::from_fn(|axis, _| [1.0, 0.3, 0.3, 0.2, 0.2, 0.4][axis] * dice.next());
                let forwards = Pose3::exp(Vector6::new(0.8, 0.0, 0.0, 0.0, 0.1, 0.3));
                world_from_node.push(world_from_node[k - 1] * forwards * Pose3::exp(twist));
            }
            let step = |k: usize| {
                let variance = |scale: f64, dice: &mut Dice| scale * (1.2 + dice.next()).powi(2);
                let deviations = Vector6::from_fn(|axis, _| variance(if axis < 3 { 1e-4 } else { 1e-5 }, dice));
                (world_from_node[k].between(world_from_node[(k + 1) % nodes]), Cov6::from_diagonal(&deviations))
            };
            let steps = (0..nodes).map(step).collect();
            Self { world_from_node, steps }
        }

        /// All nodes and as many of the steps, as seen from the first node.
        fn reached(&self, steps: usize) -> Vec<Uncertainty> {
            let mut graph = CertaintyGraph::<Pose3>::default();
            self.world_from_node.iter().for_each(|node| {
                graph.add_node(node.position());
            });
            for (k, (_, covariance)) in self.steps.iter().enumerate().take(steps) {
                let next = (k + 1) % self.steps.len();
                let pivot = self.world_from_node[next].position();
                graph.add_link(k as u32, next as u32, Uncertainty::of(covariance), pivot, 2.0);
            }
            graph.begin(0, Uncertainty::default(), Gate { sigma_m: 1e9, lever_m: 2.0, reach_m: 1e9 });
            while !graph.advance(7, usize::MAX) {}
            let mut reached = graph.reached().to_vec();
            reached.sort_by_key(|reached| reached.node);
            reached.into_iter().map(|reached| reached.uncertainty).collect()
        }

        /// Marginal covariance of each node but the first, which is known: the blocks of the inverse of all information.
        fn marginals(&self, steps: usize) -> Vec<Cov6> {
            let nodes = self.steps.len();
            let mut information = DMatrix::<f64>::zeros(6 * nodes, 6 * nodes);
            for (k, (step, covariance)) in self.steps.iter().enumerate().take(steps) {
                let mut jacobian = SMatrix::<f64, 6, 12>::zeros();
                jacobian.fixed_view_mut::<6, 6>(0, 0).copy_from(&-step.inverse().adjoint());
                jacobian.fixed_view_mut::<6, 6>(0, 6).copy_from(&Cov6::identity());
                let of_edge = jacobian.transpose() * covariance.inverted().unwrap() * jacobian;
                let places = [6 * k, 6 * ((k + 1) % nodes)];
                for (row, column) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                    let mut block = information.view_mut((places[row], places[column]), (6, 6));
                    block += of_edge.fixed_view::<6, 6>(6 * row, 6 * column);
                }
            }
            let known = information.view((6, 6), (6 * nodes - 6, 6 * nodes - 6)).into_owned();
            let covariance = known.try_inverse().unwrap();
            (0..nodes - 1).map(|k| covariance.fixed_view::<6, 6>(6 * k, 6 * k).into_owned()).collect()
        }
    }

    fn assert_bounds(reached: &[Uncertainty], marginals: &[Cov6], at_most: f64) {
        assert_eq!(reached.len(), marginals.len() + 1);
        for (bound, exact) in reached[1..].iter().zip(marginals) {
            let exact = Uncertainty::of(exact);
            let displacement = bound.displacement_m2 / exact.displacement_m2;
            let rotation = bound.rotation_rad2 / exact.rotation_rad2;
            assert!(displacement > 1.0 - 1e-9 && displacement < at_most, "{displacement}");
            assert!(rotation > 1.0 - 1e-9 && rotation < at_most, "{rotation}");
        }
    }

    #[test]
    fn in_space_a_chain_is_as_uncertain_as_its_covariance_says_at_most() {
        for seed in 1..20 {
            let way = Loop3::winding(30, &mut Dice(seed));
            let marginals = way.marginals(29);
            let mut composed = Cov6::zeros();
            for (node, (step, covariance)) in marginals.iter().zip(&way.steps) {
                composed = compose_covariance(&composed, *step, covariance);
                assert!((node - composed).norm() < 1e-9 * composed.norm(), "the dense inverse is what propagates");
            }
            assert_bounds(&way.reached(29), &marginals, 4.0);
        }
    }

    #[test]
    fn in_space_a_loop_is_as_uncertain_as_its_marginals_at_most() {
        for seed in 1..20 {
            let way = Loop3::winding(30, &mut Dice(seed));
            let (open, closed) = (way.reached(29), way.reached(30));
            assert_bounds(&closed, &way.marginals(30), 8.0);
            assert!(closed[29].displacement_m2 < 0.2 * open[29].displacement_m2, "over the closure");
        }
    }

    #[test]
    fn in_space_a_straight_way_with_errors_alike_about_all_axes_is_exact() {
        let step = Pose3::exp(Vector6::new(1.0, 0.0, 0.0, 0.7, 0.0, 0.0));
        let mut way =
            Loop3 { world_from_node: vec![Pose3::exp([5.0, -2.0, 1.0, 0.3, 0.2, 0.1].into())], steps: vec![] };
        for k in 0..20 {
            way.world_from_node.push(way.world_from_node[k] * step);
        }
        way.steps = vec![(step, Cov6::from_variances(1e-4, 1e-5)); 21];
        assert_bounds(&way.reached(20), &way.marginals(20), 1.0 + 1e-9);
    }

    /// What is first order here is compared with poses that really went wrong.
    #[test]
    fn in_space_the_bound_holds_for_sampled_ways() {
        let dice = &mut Dice(5);
        let way = Loop3::winding(20, dice);
        let (end, samples) = (way.world_from_node[19], 4000);
        let mut covariance = Cov6::zeros();
        for _ in 0..samples {
            let sampled = way.steps[..19].iter().fold(Pose3::identity(), |pose, (step, covariance)| {
                pose * *step * Pose3::exp(Vector6::from_fn(|k, _| covariance[(k, k)].sqrt() * dice.normal()))
            });
            let error = end.local(sampled);
            covariance += error * error.transpose() / f64::from(samples);
        }
        let (bound, sampled) = (way.reached(19)[19], Uncertainty::of(&covariance));
        let exact = Uncertainty::of(&way.marginals(19)[18]);
        assert!((sampled.displacement_m2 / exact.displacement_m2 - 1.0).abs() < 0.1, "{sampled:?} {exact:?}");
        assert!(sampled.displacement_m2 < bound.displacement_m2 && sampled.rotation_rad2 < bound.rotation_rad2);
    }

    #[test]
    fn a_way_in_the_plane_is_as_certain_in_space() {
        let (mut plane, mut space) = (CertaintyGraph::<Pose2>::default(), CertaintyGraph::<Pose3>::default());
        let link = Uncertainty { displacement_m2: 1e-4, rotation_rad2: 1e-6 };
        for k in 0..60 {
            let (x, y) = (f64::from(k), (f64::from(k) * 0.2).sin());
            plane.add_node([x, y]);
            space.add_node([x, y, 0.0]);
            if k > 0 {
                plane.add_link(k - 1, k, link, [x, y], 5.0);
                space.add_link(k - 1, k, link, [x, y, 0.0], 5.0);
            }
        }
        // carried about, certainty stays
        space.carry(|_| Pose3::exp([3.0, -1.0, 2.0, 0.4, 0.5, -0.6].into()));
        let gate = Gate { sigma_m: 0.07, lever_m: 5.0, reach_m: 100.0 };
        plane.begin(30, Uncertainty::default(), gate);
        space.begin(30, Uncertainty::default(), gate);
        while !plane.advance(7, usize::MAX) {}
        while !space.advance(7, usize::MAX) {}
        assert!(plane.reached().len() > 30);
        assert_eq!(plane.reached().len(), space.reached().len());
        for (in_plane, in_space) in plane.reached().iter().zip(space.reached()) {
            assert_eq!(in_plane.node, in_space.node);
            let difference = in_plane.uncertainty.displacement_m2 - in_space.uncertainty.displacement_m2;
            assert!(difference.abs() < 1e-12);
        }
    }
}
