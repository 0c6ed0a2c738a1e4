//! Where a chain of edges has lied: the step at which what came after it can be moved against the least evidence.

use mapwright_geom::{Pose, Pose2, Tangent};
use mapwright_record::{Measurement, NodeId, Past};

/// A step of the chain that is wrong: all that was mapped from its end on lies elsewhere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lie<P: Pose = Pose2> {
    /// The keyframe that the step leads to.
    pub first: NodeId,
    /// What the step is off by: where the keyframe is, seen from where it was thought to be.
    pub off: P,
    /// What the edges across the step say against it, a chi-square.
    pub chi2: f64,
}

impl<P: Pose> Lie<P> {
    /// The step between `after` and `until` where the edges across it say least against moving all that follows by `new_from_old`, in
    /// the front end's frame. An edge says the same at each step that it crosses, so this is the least cut of a line.
    pub(super) fn between<M: Measurement<Pose = P>>(
        past: Past<'_, M>,
        [after, until]: [NodeId; 2],
        new_from_old: P,
    ) -> Option<Self> {
        let mut rises: Vec<f64> = vec![0.0; past.local_from_keyframe.len() + 1];
        for known in past.session.recorded_edges().iter().filter(|known| !known.withdrawn) {
            let [from, to] = known.ends.map(NodeId::new);
            let (first, last) = (from.min(to), from.max(to));
            let moved = |node: NodeId| if node == last { new_from_old * past.pose(node) } else { past.pose(node) };
            let edge = known.recorded.edge;
            let chi2 = edge.from_from_to.local(moved(from).between(moved(to))).squared_by(&edge.information);
            rises[first.index() + 1] += chi2;
            rises[last.index() + 1] -= chi2;
        }
        let sums = rises.iter().scan(0.0_f64, |sum, rise| {
            *sum += rise;
            Some(*sum)
        });
        let steps = sums.enumerate().take(until.index() + 1).skip(after.index() + 1);
        let (step, chi2) = steps.min_by(|a, b| a.1.total_cmp(&b.1))?;
        let first = NodeId::at(step);
        let off = past.pose(first).between(new_from_old * past.pose(first));
        Some(Self { first, off, chi2 })
    }
}
