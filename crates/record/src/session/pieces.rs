//! Which fragments are held together by more than odometry over a break.

use super::Session;
use crate::entry::Fragment;
use crate::keyframe::{EdgeKind, Measurement};

/// Fragments that matches and closures hold together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Piece {
    /// In the order of the way.
    pub fragments: Vec<Fragment>,
    /// Keyframes of all of them.
    pub keyframes: usize,
}

impl<M: Measurement> Session<M> {
    /// The pieces that the map consists of, in the order of the way. Only odometry over a break says where another than the first lies.
    #[must_use]
    pub fn pieces(&self) -> Vec<Piece> {
        let place = |fragment: &Fragment| Some((self.place(fragment.first)?, *fragment));
        let mut firsts: Vec<(usize, Fragment)> = self.fragments.iter().filter_map(place).collect();
        firsts.sort_by_key(|(first, _)| *first);
        let fragment_of = |place: usize| firsts.partition_point(|(first, _)| *first <= place).saturating_sub(1);
        // Each fragment names an earlier one of its piece, the first one itself.
        let mut earlier: Vec<usize> = (0..firsts.len()).collect();
        for known in self.edges.iter().filter(|known| !known.withdrawn && !firsts.is_empty()) {
            let [a, b] = known.ends.map(|end| fragment_of(end as usize));
            let (first, fragment) = firsts[b];
            let is_link = known.recorded.edge.kind == EdgeKind::Odometry && known.ends[1] as usize == first;
            if !(is_link && fragment.start.is_break()) {
                let [a, b] = [a, b].map(|at| root(&earlier, at));
                earlier[a.max(b)] = a.min(b);
            }
        }
        let mut pieces: Vec<(usize, Piece)> = Vec::new();
        for (at, (first, fragment)) in firsts.iter().enumerate() {
            let end = firsts.get(at + 1).map_or(self.keyframes.len(), |(next, _)| *next);
            let keyframes = end.saturating_sub(*first);
            let root = root(&earlier, at);
            match pieces.iter_mut().find(|(of, _)| *of == root) {
                Some((_, piece)) => {
                    piece.fragments.push(*fragment);
                    piece.keyframes += keyframes;
                }
                None => pieces.push((root, Piece { fragments: vec![*fragment], keyframes })),
            }
        }
        pieces.into_iter().map(|(_, piece)| piece).collect()
    }
}

fn root(earlier: &[usize], mut at: usize) -> usize {
    while earlier[at] < at {
        at = earlier[at];
    }
    at
}
