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
        // Collected, for what is not drawn out of the iterator stays.
        let crossed: Vec<NodeId> = self.firsts.extract_if(.., |first| is_across(*first, from, to)).collect();
        if misled {
            self.misled.extend(crossed);
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    fn apart() -> Apart {
        let mut apart = Apart::default();
        [10, 20, 30].into_iter().for_each(|first| apart.begin(NodeId::new(first)));
        apart
    }

    fn join(apart: &mut Apart, from: u32, to: u32, misled: bool) {
        apart.join(NodeId::new(from), NodeId::new(to), misled);
    }

    #[test]
    fn who_is_joined_is_apart_no_more_wherever_odometry_has_led() {
        for misled in [false, true] {
            let mut apart = apart();
            join(&mut apart, 12, 19, misled);
            assert!(apart.is_crossed(NodeId::new(9), NodeId::new(10)), "a closure within it joins nothing");
            join(&mut apart, 9, 20, misled);
            assert!(!apart.is_crossed(NodeId::new(9), NodeId::new(29)) && apart.is_any());
            assert_eq!(apart.take_misled(), if misled { [10, 20].map(NodeId::new).to_vec() } else { Vec::new() });
            join(&mut apart, 35, 12, misled);
            assert!(!apart.is_any());
        }
    }
}
