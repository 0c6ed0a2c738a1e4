//! Fragments that nothing joins with what was mapped before them. What links them to it is what odometry says over a break: a claim,
//! of a robot that may have been carried.

use mapwright_geom::Stored;
use mapwright_record::{Measurement, NodeId, Past};

/// The fragments that are apart.
#[derive(Debug, Clone, Default)]
pub(super) struct Apart {
    /// The keyframes that they begin with.
    firsts: Vec<NodeId>,
    /// Of those that were joined, the ones that odometry has led to wrongly.
    misled: Vec<NodeId>,
}

impl Apart {
    /// Those of a session.
    pub(super) fn of<M: Measurement>(past: Past<'_, M>) -> Self {
        let pieces = past.session.pieces();
        let apart = pieces.iter().skip(1).filter_map(|piece| piece.fragments.first());
        let firsts = apart.filter_map(|fragment| past.session.place(fragment.first).map(NodeId::at)).collect();
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
