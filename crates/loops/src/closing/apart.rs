//! Fragments that nothing joins with what was mapped before them. What links them to it is what odometry says over a break: a claim,
//! of a robot that may have been carried.

use mapwright_geom::Stored;
use mapwright_record::{EdgeKind, FragmentStart, Measurement, NodeId, Past};

/// The fragments that are apart.
#[derive(Debug, Clone, Default)]
pub(super) struct Apart {
    /// The keyframes that they begin with.
    firsts: Vec<NodeId>,
    /// Of those that were joined, the ones that odometry has led to wrongly.
    misled: Vec<NodeId>,
}

impl Apart {
    /// Of a session: those that no closure leads across.
    pub(super) fn of<M: Measurement>(past: Past<'_, M>) -> Self {
        let session = past.session;
        let over_breaks = session.fragments().iter().filter(|fragment| is_over_break(fragment.start));
        let mut firsts: Vec<NodeId> =
            over_breaks.filter_map(|fragment| session.place(fragment.first).map(NodeId::at)).collect();
        for known in session.recorded_edges().iter().filter(|known| !known.withdrawn) {
            let [from, to] = known.ends.map(NodeId::new);
            if known.recorded.edge.kind == EdgeKind::Closure {
                firsts.retain(|first| !is_across(*first, from, to));
            }
        }
        Self { firsts, misled: Vec::new() }
    }

    pub(super) fn begin(&mut self, first: NodeId) {
        self.firsts.push(first);
    }

    pub(super) fn is_any(&self) -> bool {
        !self.firsts.is_empty()
    }

    /// Whether a way between two keyframes leads into a fragment that is apart.
    pub(super) fn is_crossed(&self, from: NodeId, to: NodeId) -> bool {
        self.firsts.iter().any(|first| is_across(*first, from, to))
    }

    /// A closure leads there, to where odometry does not (`misled`) or does.
    pub(super) fn join(&mut self, from: NodeId, to: NodeId, misled: bool) {
        let crossed = self.firsts.extract_if(.., |first| is_across(*first, from, to));
        if misled { self.misled.extend(crossed) } else { drop(crossed) }
    }

    /// The fragments whose links are wrong, once.
    pub(super) fn take_misled(&mut self) -> Vec<NodeId> {
        std::mem::take(&mut self.misled)
    }

    pub(super) fn put(&self, out: &mut Vec<u8>) {
        self.firsts.put(out);
    }

    /// Goes on as it was; `past` is all of the session.
    pub(super) fn restore<M: Measurement>(past: Past<'_, M>, from: &mut &[u8]) -> Option<Self> {
        let firsts: Vec<NodeId> = Stored::take(from)?;
        firsts.iter().all(|&first| past.has(first)).then(|| Self { firsts, misled: Vec::new() })
    }
}

fn is_across(first: NodeId, from: NodeId, to: NodeId) -> bool {
    from.min(to) < first && first <= from.max(to)
}

fn is_over_break(start: FragmentStart) -> bool {
    matches!(start, FragmentStart::Uncertain | FragmentStart::Blind | FragmentStart::Lost)
}
