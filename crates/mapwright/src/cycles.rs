//! Steps 6 and 7, detect and correct, as far as they write: what was found at old places is judged, taken down and followed. Written
//! once for the plane and for space.

use crate::settings::Correction;
use crate::store::Store;
use mapwright_geom::{Pose, TangentMatrix};
use mapwright_graph::spread;
use mapwright_loops::{Closing, Decision, Judged, Ledger, PoseOf, Solved, Solving, Submaps, Verified};
use mapwright_record::{Edge, Measurement, NodeId, Objection, Past, Verdict};

/// A closure's covariance where its information has no inverse, m^2 and rad^2.
const UNKNOWN_VARIANCE: f64 = 100.0;

/// A front end that follows what becomes of the past.
pub trait Follows<M: Measurement> {
    /// A closure links two keyframes, this surely.
    fn close(&mut self, past: Past<'_, M>, from: NodeId, to: NodeId, covariance: &<M::Pose as Pose>::Matrix);

    /// A closure was none.
    fn open(&mut self, from: NodeId, to: NodeId);

    /// Matches that have made parts of the past certain were none: what is certain is told anew by the edges that stand.
    fn begin_anew(&mut self, past: Past<'_, M>);

    /// The past was moved from where it was `before`.
    fn carry(&mut self, past: Past<'_, M>, before: &[M::Pose]);
}

/// What came of a verification.
#[derive(Debug)]
pub(crate) struct Followed<P: Pose> {
    /// The graph to be solved, if that is due.
    pub(crate) solving: Option<Solving<P>>,
    /// The past was moved at once.
    pub(crate) is_moved: bool,
}

/// What is written down, and the front end that follows it.
struct Book<'a, M: Measurement, F> {
    store: &'a mut Store<M>,
    front: &'a mut F,
}

impl<M: Measurement, F: Follows<M>> Book<'_, M, F> {
    fn withdraw(&mut self, edge: usize) -> Option<[NodeId; 2]> {
        let ends = self.store.withdraw(edge, Verdict::Withdrawn(Objection::Outvoted))?;
        self.front.open(ends[0], ends[1]);
        Some(ends)
    }
}

impl<M: Measurement, F: Follows<M>> Ledger<M> for Book<'_, M, F> {
    fn past(&self) -> Past<'_, M> {
        self.store.past()
    }

    fn add_candidate(&mut self, judged: &Judged<M::Pose>) -> Option<u32> {
        self.store.add_candidate(judged)
    }

    fn accept(&mut self, number: u32) -> Option<([NodeId; 2], Edge<M::Pose>)> {
        let edge = self.store.accept(number)?;
        let ends = self.store.past().nodes([edge.from, edge.to])?;
        let unknown = || TangentMatrix::from_variances(UNKNOWN_VARIANCE, UNKNOWN_VARIANCE);
        let covariance = edge.information.inverted().unwrap_or_else(unknown);
        self.front.close(self.store.past(), ends[0], ends[1], &covariance);
        Some((ends, edge))
    }

    fn add_match(&mut self, edge: Edge<M::Pose>) {
        self.store.add_edge(edge, None);
    }

    fn withdraw_odometry(&mut self, to: NodeId) {
        if let Some(edge) = self.store.odometry_to(to) {
            self.withdraw(edge);
        }
    }

    fn closures(&self) -> usize {
        self.store.closures().len()
    }
}

/// Judges what was found at old places.
pub(crate) fn judge<S: Submaps>(
    closing: &mut Closing<S>,
    store: &mut Store<S::Measurement>,
    front: &mut impl Follows<S::Measurement>,
    verified: &Verified<PoseOf<S>>,
    correction: Correction,
) -> Followed<PoseOf<S>> {
    let decision = closing.decide(&mut Book { store: &mut *store, front: &mut *front }, verified);
    follow(closing, store, front, &decision, correction)
}

/// What robots saw of each other is taken down as a closure.
pub(crate) fn sighted<S: Submaps>(
    closing: &mut Closing<S>,
    store: &mut Store<S::Measurement>,
    front: &mut impl Follows<S::Measurement>,
    judged: &Judged<PoseOf<S>>,
    correction: Correction,
) -> Followed<PoseOf<S>> {
    let decision = closing.take_down(&mut Book { store: &mut *store, front: &mut *front }, judged);
    follow(closing, store, front, &decision, correction)
}

/// The poses follow what was decided: at once, or when the graph is solved.
fn follow<S: Submaps>(
    closing: &mut Closing<S>,
    store: &mut Store<S::Measurement>,
    front: &mut impl Follows<S::Measurement>,
    decision: &Decision<PoseOf<S>>,
    correction: Correction,
) -> Followed<PoseOf<S>> {
    let solving = (decision.is_solving_due && correction == Correction::Graph)
        .then(|| Solving::of::<S>(store.graph(), store.closures()));
    let mut is_moved = false;
    for edge in decision.closures.iter().filter(|_| correction == Correction::Spread) {
        is_moved |= spread_error(closing, store, front, edge);
    }
    Followed { solving, is_moved }
}

/// The chapter's backwards correction: the closure's error is shared among the steps of the loop.
fn spread_error<S: Submaps>(
    closing: &mut Closing<S>,
    store: &mut Store<S::Measurement>,
    front: &mut impl Follows<S::Measurement>,
    closure: &Edge<PoseOf<S>>,
) -> bool {
    let Some([first, last]) = store.past().nodes([closure.from, closure.to]) else { return false };
    let (first, last) = (first.index(), last.index());
    let mut map_from_keyframe = store.session().map_from_keyframe().to_vec();
    let Some(steps) = map_from_keyframe.get(first..=last) else { return false };
    let shares = spread::shares_by_motion(steps);
    let is_spread = spread::spread(&mut map_from_keyframe, first, last, closure.from_from_to, &shares).is_ok();
    is_spread && correct(closing, store, front, &Solved { map_from_keyframe, taken_back: Vec::new() })
}

/// Moves the past; the newest keyframe of the solution stays where it is in the front end's frame. Whether it was of use.
pub(crate) fn correct<S: Submaps>(
    closing: &mut Closing<S>,
    store: &mut Store<S::Measurement>,
    front: &mut impl Follows<S::Measurement>,
    solved: &Solved<PoseOf<S>>,
) -> bool {
    let taken_back: Vec<usize> = store.closures().into_iter().filter(|edge| solved.taken_back.contains(edge)).collect();
    for &edge in &taken_back {
        let Some(ends) = (Book { store: &mut *store, front: &mut *front }).withdraw(edge) else { continue };
        closing.withdrawn(store.past(), ends);
    }
    if !taken_back.is_empty() {
        // What was matched over a join that is none leads astray as well.
        let mut astray = store.matches();
        astray.retain(|(_, [from, to])| closing.is_between(*from, *to));
        for (edge, _) in &astray {
            store.withdraw(*edge, Verdict::Withdrawn(Objection::Outvoted));
        }
        if !astray.is_empty() {
            front.begin_anew(store.past());
        }
    }
    let before = store.correct(&solved.map_from_keyframe);
    before.is_some_and(|before| {
        front.carry(store.past(), &before);
        true
    })
}
