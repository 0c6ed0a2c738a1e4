//! Where one run came to a place of another: the closures between them.

use super::runs::runs;
use mapwright::{EdgeKind, Session};
use mapwright_geom::{Pose, Stamp};
use mapwright_record::Measurement;
use std::collections::BTreeMap;

/// A closure between two runs that stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Meeting {
    /// The numbers of both runs, the lower one first.
    pub(crate) runs: [usize; 2],
    /// The places of their keyframes, in the same order.
    pub(crate) keyframes: [usize; 2],
    /// How long each had been under way, seconds.
    pub(crate) after_s: [f64; 2],
}

impl Meeting {
    /// When the later one was there, seconds since it began.
    pub(crate) fn at_s(&self) -> f64 {
        self.after_s[0].max(self.after_s[1])
    }

    /// The keyframe of the later one.
    pub(crate) fn later(&self) -> usize {
        self.keyframes[usize::from(self.after_s[1] >= self.after_s[0])]
    }

    /// Where the later one was, metres.
    pub(crate) fn place<M: Measurement>(&self, session: &Session<M>) -> [f64; 2] {
        let place = session.map_from_keyframe()[self.later()].in_space().translation;
        [place.x, place.y]
    }
}

/// All meetings of a session, in the order of time.
pub(crate) fn meetings<M: Measurement>(session: &Session<M>) -> Vec<Meeting> {
    let numbers = runs(session);
    let mut begins: BTreeMap<usize, Stamp> = BTreeMap::new();
    for (number, keyframe) in numbers.iter().zip(session.keyframes()) {
        let begin = begins.entry(*number).or_insert(keyframe.stamp);
        *begin = keyframe.stamp.min(*begin);
    }
    let after_s = |place: usize| {
        let begin = begins.get(&numbers[place]);
        begin.map_or(0.0, |begin| session.keyframes()[place].stamp.secs_since(*begin))
    };
    let standing = session.recorded_edges().iter().filter(|known| !known.withdrawn);
    let closures = standing.filter(|known| known.recorded.edge.kind == EdgeKind::Closure);
    let met = closures.filter_map(|known| {
        let mut ends = known.ends.map(|end| end as usize);
        ends.sort_by_key(|end| numbers[*end]);
        let runs = ends.map(|end| numbers[end]);
        (runs[0] != runs[1]).then(|| Meeting { runs, keyframes: ends, after_s: ends.map(after_s) })
    });
    let mut met: Vec<Meeting> = met.collect();
    met.sort_by(|a, b| a.at_s().total_cmp(&b.at_s()).then(a.keyframes.cmp(&b.keyframes)));
    met
}
