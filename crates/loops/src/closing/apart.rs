//! Pieces of the map that nothing joins. What links one to what was mapped before it is what odometry says over a break: a claim, of a
//! robot that may have been carried.

use mapwright_record::{Measurement, NodeId, Past};

/// Which fragments are held together ([`mapwright_record::Session::pieces`]).
#[derive(Debug, Clone, Default)]
pub(super) struct Apart {
    /// The keyframe that each fragment begins with, and the piece that it is of; none where there is but one piece.
    fragments: Vec<(NodeId, usize)>,
}

impl Apart {
    /// As a session says.
    pub(super) fn of<M: Measurement>(past: Past<'_, M>) -> Self {
        let session = past.session;
        if !session.fragments().iter().any(|fragment| session.is_break(fragment)) {
            return Self::default();
        }
        let pieces = session.pieces();
        let mut fragments = Vec::new();
        for (piece, of) in pieces.iter().enumerate().filter(|_| pieces.len() > 1) {
            let places = of.fragments.iter().filter_map(|fragment| session.place(fragment.first));
            fragments.extend(places.map(|place| (NodeId::at(place), piece)));
        }
        fragments.sort_unstable();
        Self { fragments }
    }

    #[cfg(test)]
    pub(super) fn of_fragments(fragments: &[(NodeId, usize)]) -> Self {
        Self { fragments: fragments.to_vec() }
    }

    /// Whether the newest fragment is of another piece than the first.
    pub(super) fn is_newest(&self) -> bool {
        self.fragments.last().is_some_and(|(_, piece)| *piece != 0)
    }

    /// Whether two keyframes are of different pieces.
    pub(super) fn is_between(&self, from: NodeId, to: NodeId) -> bool {
        self.piece(from) != self.piece(to)
    }

    /// Whether all of a keyframe's piece lies within so much way of it, metres.
    pub(super) fn is_within<M: Measurement>(&self, past: Past<'_, M>, node: NodeId, reach_m: f64) -> bool {
        let end = self.end(node);
        let Some((first, piece)) = self.fragments[..end].last() else { return false };
        let next = self.fragments.get(end).map_or(past.way_m.len(), |(next, _)| next.index());
        let is_alone = self.fragments.iter().filter(|(_, of)| of == piece).count() == 1;
        let reaches = |other: NodeId| past.way_between_m(node, other) <= reach_m;
        is_alone && reaches(*first) && next.checked_sub(1).is_some_and(|last| reaches(NodeId::at(last)))
    }

    /// The keyframe that odometry has led to wrongly where `to` is elsewhere: the first one of its piece, on the way back.
    pub(super) fn misled(&self, to: NodeId) -> Option<NodeId> {
        let piece = self.piece(to)?;
        let before = self.fragments[..self.end(to)].iter().rev();
        before.take_while(|(_, of)| *of == piece).last().map(|(first, _)| *first)
    }

    fn piece(&self, node: NodeId) -> Option<usize> {
        self.fragments[..self.end(node)].last().map(|(_, piece)| *piece)
    }

    /// How many fragments have begun up to a keyframe.
    fn end(&self, node: NodeId) -> usize {
        self.fragments.partition_point(|(first, _)| *first <= node)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_told_apart_and_which_link_is_wrong() {
        let node = NodeId::new;
        let apart = Apart { fragments: vec![(node(0), 0), (node(10), 1), (node(20), 2), (node(30), 2), (node(40), 0)] };
        assert!(apart.is_between(node(9), node(10)) && apart.is_between(node(25), node(12)));
        assert!(!apart.is_between(node(20), node(39)) && !apart.is_between(node(5), node(99)));
        assert!(!apart.is_newest() && Apart { fragments: apart.fragments[..4].to_vec() }.is_newest());
        // What links the fragments of one piece is not what has misled.
        assert_eq!([12, 25, 35].map(|to| apart.misled(node(to))), [Some(node(10)), Some(node(20)), Some(node(20))]);
        let whole = Apart::default();
        assert!(!whole.is_newest() && !whole.is_between(node(0), node(9)) && whole.misled(node(9)).is_none());
    }
}
