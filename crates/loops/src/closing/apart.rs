//! Pieces of the map that nothing joins. What links one to what was mapped before it is what odometry says over a break: a claim, of a
//! robot that may have been carried.

use mapwright_record::{Measurement, NodeId, Past};

/// Which fragments are held together ([`mapwright_record::Session::pieces`]).
#[derive(Debug, Clone, Default)]
pub(super) struct Apart {
    /// Keyframes that follow each other within a fragment; none where there is but one piece.
    stretches: Vec<Stretch>,
}

#[derive(Debug, Clone, Copy)]
struct Stretch {
    first: NodeId,
    piece: usize,
    /// Which of the stretches comes before it on the robot's way.
    before: Option<usize>,
}

impl Apart {
    /// As a session says.
    pub(super) fn of<M: Measurement>(past: Past<'_, M>) -> Self {
        let session = past.session;
        if !session.fragments().iter().any(|fragment| session.is_break(fragment)) {
            return Self::default();
        }
        let mut apart = Self { stretches: Vec::new() };
        let known = session.stretches();
        if known.iter().all(|(_, piece)| *piece == 0) {
            return apart;
        }
        for (range, piece) in known {
            let before = session.before(range.start).and_then(|before| apart.of_node(NodeId::at(before)));
            apart.stretches.push(Stretch { first: NodeId::at(range.start), piece, before });
        }
        apart
    }

    /// The newest keyframe comes after this one on its robot's way: where others were taken in between, a stretch of that one's piece begins.
    pub(super) fn go_on(&mut self, newest: NodeId, before: NodeId) {
        let is_known = self.stretches.last().is_none_or(|last| last.first >= newest);
        if let Some(at) = self.of_node(before).filter(|_| !is_known && before.next() != newest) {
            self.stretches.push(Stretch { first: newest, piece: self.stretches[at].piece, before: Some(at) });
        }
    }

    #[cfg(test)]
    pub(super) fn of_fragments(fragments: &[(NodeId, usize)]) -> Self {
        let stretch =
            |(at, &(first, piece)): (usize, &(NodeId, usize))| Stretch { first, piece, before: at.checked_sub(1) };
        Self { stretches: fragments.iter().enumerate().map(stretch).collect() }
    }

    /// Whether the newest fragment is of another piece than the first.
    pub(super) fn is_newest(&self) -> bool {
        self.stretches.last().is_some_and(|newest| newest.piece != 0)
    }

    /// Whether there is more than one piece.
    pub(super) fn are_several(&self) -> bool {
        !self.stretches.is_empty()
    }

    /// Whether two keyframes are of different pieces.
    pub(super) fn is_between(&self, from: NodeId, to: NodeId) -> bool {
        self.piece(from) != self.piece(to)
    }

    /// Whether all of a keyframe's piece lies within so much way of it, metres.
    pub(super) fn is_within<M: Measurement>(&self, past: Past<'_, M>, node: NodeId, reach_m: f64) -> bool {
        let Some(piece) = self.piece(node) else { return false };
        let reaches = |other: NodeId| past.way_between_m(node, other) <= reach_m;
        let ends = self.stretches.iter().skip(1).map(|next| next.first.index()).chain([past.way_m.len()]);
        let mut of_piece = self.stretches.iter().zip(ends).filter(|(known, _)| known.piece == piece);
        of_piece.all(|(known, end)| {
            reaches(known.first) && end.checked_sub(1).is_some_and(|last| reaches(NodeId::at(last)))
        })
    }

    /// The keyframe that odometry has led to wrongly where `to` is elsewhere: the first one of its piece, on the way back.
    pub(super) fn misled(&self, to: NodeId) -> Option<NodeId> {
        let at = self.of_node(to)?;
        let piece = self.stretches[at].piece;
        let back = std::iter::successors(Some(at), |&at| self.stretches[at].before);
        back.map(|at| self.stretches[at]).take_while(|known| known.piece == piece).last().map(|known| known.first)
    }

    fn piece(&self, node: NodeId) -> Option<usize> {
        self.of_node(node).map(|at| self.stretches[at].piece)
    }

    fn of_node(&self, node: NodeId) -> Option<usize> {
        self.stretches.partition_point(|known| known.first <= node).checked_sub(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_told_apart_and_which_link_is_wrong() {
        let node = NodeId::new;
        let fragments = [(node(0), 0), (node(10), 1), (node(20), 2), (node(30), 2), (node(40), 0)];
        let apart = Apart::of_fragments(&fragments);
        assert!(apart.is_between(node(9), node(10)) && apart.is_between(node(25), node(12)));
        assert!(!apart.is_between(node(20), node(39)) && !apart.is_between(node(5), node(99)));
        assert!(!apart.is_newest() && Apart::of_fragments(&fragments[..4]).is_newest());
        // What links the fragments of one piece is not what has misled.
        assert_eq!([12, 25, 35].map(|to| apart.misled(node(to))), [Some(node(10)), Some(node(20)), Some(node(20))]);
        let whole = Apart::default();
        assert!(!whole.is_newest() && !whole.is_between(node(0), node(9)) && whole.misled(node(9)).is_none());
    }

    #[test]
    fn robots_that_take_turns_stay_in_their_pieces() {
        let node = NodeId::new;
        let mut apart = Apart::of_fragments(&[(node(0), 0), (node(10), 1)]);
        apart.go_on(node(11), node(10));
        assert!(apart.is_between(node(0), node(11)) && apart.is_newest());
        // The first robot's turn, and the second one's again.
        apart.go_on(node(12), node(9));
        assert!(!apart.is_between(node(0), node(13)) && apart.is_between(node(11), node(12)) && !apart.is_newest());
        apart.go_on(node(20), node(11));
        assert!(apart.is_between(node(0), node(20)) && !apart.is_between(node(10), node(25)));
        assert_eq!(apart.misled(node(25)), Some(node(10)));
        let mut whole = Apart::default();
        whole.go_on(node(12), node(9));
        assert!(!whole.are_several());
    }
}
