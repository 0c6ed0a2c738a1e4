//! Old places that matches are supported by: what was found out of each, and the matches that wait for it.

use super::{AGREE_M, AGREE_RAD, LEFT_M, TOGETHER_M};
use mapwright_geom::{Pose, Stored, is_in_place};
use mapwright_record::{Edge, EdgeKind, Measurement, NodeId, Past};

/// A place that was not found is looked at again after so much way, metres.
const ASK_AGAIN_M: f64 = 4.0;

/// What is known of the old places that matches are supported by or that closures led to.
#[derive(Debug, Clone)]
pub(super) struct Supports<P: Pose> {
    /// The latest last. Each holds on so much way to either side of both ends: [`TOGETHER_M`].
    known: Vec<Support>,
    /// Matches with old places that are not found yet, and their ends.
    waiting: Vec<([NodeId; 2], Edge<P>)>,
}

impl<P: Pose> Default for Supports<P> {
    fn default() -> Self {
        Self { known: Vec::new(), waiting: Vec::new() }
    }
}

#[derive(Debug, Clone, Copy)]
struct Support {
    from: NodeId,
    to: NodeId,
    verdict: Option<Found>,
}

/// Whether the cascade has found the robot at an old place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Found {
    Here,
    Not,
}

impl<P: Pose> Supports<P> {
    /// A place is being looked at.
    pub(super) fn ask(&mut self, from: NodeId, to: NodeId) {
        self.known.push(Support { from, to, verdict: None });
    }

    /// What came of it, or of another search that led there.
    pub(super) fn learn(&mut self, from: NodeId, to: NodeId, found: Found) {
        match self.known.iter_mut().find(|support| (support.from, support.to) == (from, to)) {
            Some(support) => support.verdict = Some(found),
            None => self.known.push(Support { from, to, verdict: Some(found) }),
        }
    }

    /// A closure was none; what was found by others stays.
    pub(super) fn unlearn(&mut self, from: NodeId, to: NodeId) {
        let ends = |support: &&mut Support| (support.from, support.to) == (from, to);
        self.known.iter_mut().filter(ends).for_each(|support| support.verdict = Some(Found::Not));
    }

    /// What was found out long ago says nothing of what the robot is matched against now; `path_m` is the length of way up to
    /// each keyframe.
    pub(super) fn forget(&mut self, path_m: &[f64]) {
        let now_m = path_m.last().copied().unwrap_or(0.0);
        let is_recent = |to: NodeId| now_m - path_m[to.index()] < TOGETHER_M;
        self.known.retain(|support| is_recent(support.to));
        self.waiting.retain(|&([_, to], _)| is_recent(to));
    }

    /// Whether anybody has looked at that place lately.
    pub(super) fn is_asked(&self, path_m: &[f64], from: NodeId) -> bool {
        self.last(path_m, from).is_some()
    }

    /// What was found out last of that place; none while nobody knows.
    pub(super) fn verdict(&self, path_m: &[f64], from: NodeId) -> Option<Found> {
        self.last(path_m, from)?.verdict
    }

    fn last(&self, path_m: &[f64], from: NodeId) -> Option<Support> {
        let near = |support: &&Support| way_m(path_m, support.from, from) < TOGETHER_M;
        let support = self.known.iter().rev().find(near)?;
        let since_m = path_m.last().copied().unwrap_or(0.0) - path_m[support.to.index()];
        let holds_m = if support.verdict == Some(Found::Not) { ASK_AGAIN_M } else { TOGETHER_M };
        (since_m < holds_m).then_some(*support)
    }

    /// The keyframes from `node` on were moved: what waits for them says what is no longer so.
    pub(super) fn forget_since(&mut self, node: NodeId) {
        self.waiting.retain(|&([_, to], _)| to < node);
    }

    /// A match of the keyframe that comes next, no edge until its place is found.
    pub(super) fn wait<M: Measurement<Pose = P>>(&mut self, past: Past<'_, M>, edge: Edge<P>) {
        self.forget(past.way_m);
        self.waiting.extend(past.nodes([edge.from, edge.to]).map(|ends| (ends, edge)));
    }

    /// The matches that have waited for `closures`: those that say the same. Others with that place are none; what waits for other
    /// places stays.
    pub(super) fn settle<M: Measurement<Pose = P>>(&mut self, past: Past<'_, M>, closures: &[Edge<P>]) -> Vec<Edge<P>> {
        let mut settled = Vec::new();
        for (ends, edge) in std::mem::take(&mut self.waiting) {
            let [from, to] = ends;
            let says_the_same = |closure: &Edge<P>| {
                past.nodes([closure.from, closure.to]).is_some_and(|[a, b]| {
                    past.way_between_m(a, from) < TOGETHER_M
                        && past.way_between_m(b, to) < TOGETHER_M
                        && agree(past, (a, b, closure.from_from_to), (from, to, edge.from_from_to))
                })
            };
            if self.verdict(past.way_m, from) != Some(Found::Here) {
                self.waiting.push((ends, edge));
            } else if closures.iter().any(says_the_same) {
                settled.push(edge);
            }
        }
        settled
    }
}

/// Whether two relative poses of keyframes, from and to, say the same by the short ways between their ends.
pub(super) fn agree<M: Measurement>(
    past: Past<'_, M>,
    a: (NodeId, NodeId, M::Pose),
    b: (NodeId, NodeId, M::Pose),
) -> bool {
    let via_a = past.pose(b.0).between(past.pose(a.0)) * a.2 * past.pose(a.1).between(past.pose(b.1));
    let error = via_a.between(b.2);
    error.length() <= AGREE_M && error.angle() <= AGREE_RAD
}

/// Whether a keyframe lies so far back along the way that the newest one has left it.
pub(super) fn is_left(path_m: &[f64], from: NodeId) -> bool {
    path_m.len().checked_sub(1).is_some_and(|newest| way_m(path_m, NodeId::at(newest), from) >= LEFT_M)
}

fn way_m(path_m: &[f64], a: NodeId, b: NodeId) -> f64 {
    (path_m[a.index()] - path_m[b.index()]).abs()
}

/// A match that waits: between whom, what it measured, and its information.
type Waiting<P> = ([NodeId; 2], P, <P as Pose>::Matrix);

/// As bytes, for a run that is continued.
impl<P: Pose> Supports<P> {
    pub(super) fn put(&self, out: &mut Vec<u8>) {
        let is_here = |found: Found| found == Found::Here;
        let known = self.known.iter().map(|support| (support.from, support.to, support.verdict.map(is_here)));
        known.collect::<Vec<_>>().put(out);
        let waiting = self.waiting.iter().map(|&(ends, edge)| (ends, edge.from_from_to, edge.information));
        waiting.collect::<Vec<Waiting<P>>>().put(out);
    }

    /// Goes on as it was; `past` is all of the session.
    pub(super) fn restore<M: Measurement<Pose = P>>(past: Past<'_, M>, from: &mut &[u8]) -> Option<Self> {
        let known: Vec<(NodeId, NodeId, Option<bool>)> = Stored::take(from)?;
        let waiting: Vec<Waiting<P>> = Stored::take(from)?;
        let ends = known.iter().map(|&(from, to, _)| [from, to]).chain(waiting.iter().map(|(ends, ..)| *ends));
        ends.flatten().all(|node| past.has(node)).then_some(())?;
        let found = |is_here: bool| if is_here { Found::Here } else { Found::Not };
        let known = known.into_iter().map(|(from, to, verdict)| Support { from, to, verdict: verdict.map(found) });
        let edge = |([from, to], from_from_to, information): Waiting<P>| {
            let [a, b] = [from, to].map(|node| past.session.keyframes()[node.index()].id);
            ([from, to], Edge { from: a, to: b, kind: EdgeKind::Match, from_from_to, information })
        };
        let is_sound = |(ends, from_from_to, _): &Waiting<P>| ends[0] != ends[1] && is_in_place(*from_from_to);
        let are_sound = waiting.iter().all(is_sound);
        are_sound.then(|| Self { known: known.collect(), waiting: waiting.into_iter().map(edge).collect() })
    }
}
