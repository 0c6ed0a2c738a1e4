//! A graph as bytes, with the search that is under way: it goes on to the same nodes in the same order. What a search that has
//! ended has reached is not kept.

use super::{CertaintyGraph, Gate, Label, Link, Node, Reached, Uncertainty, Visit};
use mapwright_geom::{Pose, Stored, stored};
use std::collections::BinaryHeap;

stored!(Reached { node, uncertainty });
stored!(Gate { sigma_m, lever_m, reach_m });
stored!(Link<X> { to, uncertainty, pivot });
stored!(Node<X> { at, links });
stored!(Label<X> { cost, node, p, q, qx, qxx });

/// Finite and not negative.
impl Stored for Uncertainty {
    fn put(&self, out: &mut Vec<u8>) {
        [self.displacement_m2, self.rotation_rad2].put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        let variances: [f64; 2] = Stored::take(from)?;
        let [displacement_m2, rotation_rad2] = variances;
        let is_sound = variances.iter().all(|variance| *variance >= 0.0 && variance.is_finite());
        is_sound.then_some(Self { displacement_m2, rotation_rad2 })
    }
}

/// A search under way.
struct Search<X> {
    /// As they lie in the heap.
    open: Vec<Label<X>>,
    origin: X,
    gate: Gate,
    reached: Vec<Reached>,
    /// Nodes that it has come across, whether their way is settled, and what that costs.
    visited: Vec<(u32, bool, f64)>,
}
stored!(Search<X> { open, origin, gate, reached, visited });

impl<P: Pose<Point: Stored>> Stored for CertaintyGraph<P> {
    fn put(&self, out: &mut Vec<u8>) {
        self.nodes.put(out);
        let is_under_way = !self.heap.is_empty();
        is_under_way.then(|| self.search()).put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        let nodes: Vec<Node<P::Point>> = Stored::take(from)?;
        let count = nodes.len();
        if nodes.iter().flat_map(|node| &node.links).any(|link| link.to as usize >= count) {
            return None;
        }
        let graph = Self { visits: vec![Visit::default(); count], nodes, ..Self::default() };
        match Stored::take(from)? {
            Some(search) => graph.searching(search),
            None => Some(graph),
        }
    }
}

impl<P: Pose<Point: Stored>> CertaintyGraph<P> {
    fn search(&self) -> Search<P::Point> {
        let visits = (0..).zip(&self.visits).filter(|(_, visit)| visit.round == self.round);
        Search {
            open: self.heap.as_slice().to_vec(),
            origin: self.origin,
            gate: self.gate,
            reached: self.reached.clone(),
            visited: visits.map(|(node, visit)| (node, visit.done, visit.cost)).collect(),
        }
    }

    /// The same with a search under way, if that is one of this graph.
    fn searching(mut self, search: Search<P::Point>) -> Option<Self> {
        let Search { open, origin, gate, reached, visited } = search;
        let exists = |node: u32| (node as usize) < self.nodes.len();
        if !open.iter().all(|label| exists(label.node)) || !reached.iter().all(|reached| exists(reached.node)) {
            return None;
        }
        self.round = 1;
        for (node, done, cost) in visited {
            *self.visits.get_mut(node as usize)? = Visit { round: self.round, done, cost };
        }
        // What is a heap already stays as it is.
        self.heap = BinaryHeap::from(open);
        (self.origin, self.gate, self.reached) = (origin, gate, reached);
        Some(self)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test may fail loudly")]
mod tests {
    use super::*;
    use mapwright_geom::Pose2;

    #[test]
    fn a_search_goes_on_where_it_was_interrupted() {
        let link = Uncertainty { displacement_m2: 1e-4, rotation_rad2: 1e-6 };
        let mut graph = CertaintyGraph::<Pose2>::default();
        for k in 0..300_u32 {
            graph.add_node([f64::from(k % 20), f64::from(k / 20)]);
            for to in [k.saturating_sub(1), k.saturating_sub(20), k * 7 % (k + 1)] {
                graph.add_link(k, to, link, [f64::from(k % 20), f64::from(k / 20)], 5.0);
            }
        }
        for steps in [0, 1, 5, 40] {
            let mut whole = graph.clone();
            whole.begin(150, Uncertainty::default(), Gate { sigma_m: 0.2, lever_m: 5.0, reach_m: 10.0 });
            (0..steps).for_each(|_| assert!(!whole.advance(7, 1000)));
            let mut bytes = Vec::new();
            whole.put(&mut bytes);
            let mut resumed = CertaintyGraph::<Pose2>::take(&mut &bytes[..]).unwrap();
            while !whole.advance(7, 1000) {}
            while !resumed.advance(7, 1000) {}
            assert!(whole.reached().len() > 50);
            assert_eq!(whole.reached(), resumed.reached());
        }
    }
}
