//! Steps 6 and 7, detect and correct, as far as they write: what was found at old places is judged, taken down and followed. Written
//! once for the plane and for space.

use crate::settings::Correction;
use crate::store::Store;
use mapwright_geom::{Pose, TangentMatrix};
use mapwright_graph::spread;
use mapwright_loops::{Closing, Finding, Judged as FoundClosure, PoseOf, Solved, Solving, Submaps, Target, Verified};
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
pub(crate) struct Judged<P: Pose> {
    /// The graph to be solved, if that is due.
    pub(crate) solving: Option<Solving<P>>,
    /// The past was moved at once.
    pub(crate) is_moved: bool,
}

/// Judges what was found at old places.
pub(crate) fn judge<S: Submaps>(
    closing: &mut Closing<S>,
    store: &mut Store<S::Measurement>,
    front: &mut impl Follows<S::Measurement>,
    verified: &Verified<PoseOf<S>>,
    correction: Correction,
) -> Judged<PoseOf<S>> {
    closing.looked(verified);
    let (mut closures, mut is_moved) = (Vec::new(), false);
    for (target, finding) in verified.findings.iter().filter(|(target, _)| target.from < verified.to) {
        for edge in judge_finding(closing, store, front, verified.to, (target, finding)) {
            closures.push(edge);
            if correction == Correction::Spread {
                is_moved |= spread_error(closing, store, front, &edge);
            }
        }
    }
    let settled = closing.settle_matches(store.past(), &closures);
    settled.into_iter().for_each(|edge| store.add_edge(edge, None));
    let is_due = correction == Correction::Graph && closing.take_solving_due(|| store.closures().len());
    let solving = is_due.then(|| Solving::of::<S>(store.graph(), store.closures()));
    Judged { solving, is_moved }
}

/// What robots saw of each other is taken down as a closure; the graph to be solved, if that is due.
pub(crate) fn sighted<S: Submaps>(
    closing: &mut Closing<S>,
    store: &mut Store<S::Measurement>,
    front: &mut impl Follows<S::Measurement>,
    judged: &FoundClosure<PoseOf<S>>,
    correction: Correction,
) -> Option<Solving<PoseOf<S>>> {
    let number = store.add_candidate(judged)?;
    accept(closing, store, front, std::iter::once(number));
    let is_due = closing.take_solving_due(|| store.closures().len()) && correction == Correction::Graph;
    is_due.then(|| Solving::of::<S>(store.graph(), store.closures()))
}

/// The closures that a finding makes.
fn judge_finding<S: Submaps>(
    closing: &mut Closing<S>,
    store: &mut Store<S::Measurement>,
    front: &mut impl Follows<S::Measurement>,
    to: NodeId,
    found: (&Target<PoseOf<S>>, &Finding<PoseOf<S>>),
) -> Vec<Edge<PoseOf<S>>> {
    let judgement = closing.judge(store.past(), store.session().candidates(), to, found);
    let number = store.add_candidate(&judgement.judged);
    let Some(number) = number.filter(|_| judgement.judged.verdict == Verdict::Accepted) else { return Vec::new() };
    if let Some(edge) = judgement.misled.and_then(|first| store.odometry_to(first)) {
        let ends = store.withdraw(edge, Verdict::Withdrawn(Objection::Outvoted));
        ends.into_iter().for_each(|[from, to]| front.open(from, to));
    }
    accept(closing, store, front, judgement.agreeing.into_iter().chain([number]))
}

/// The edges of candidates that have become closures.
fn accept<S: Submaps>(
    closing: &mut Closing<S>,
    store: &mut Store<S::Measurement>,
    front: &mut impl Follows<S::Measurement>,
    numbers: impl Iterator<Item = u32>,
) -> Vec<Edge<PoseOf<S>>> {
    let mut edges = Vec::new();
    for number in numbers {
        let Some(edge) = store.accept(number) else { continue };
        let Some(ends) = store.past().nodes([edge.from, edge.to]) else { continue };
        closing.accepted(store.past(), ends, &edge);
        let unknown = || TangentMatrix::from_variances(UNKNOWN_VARIANCE, UNKNOWN_VARIANCE);
        let covariance = edge.information.inverted().unwrap_or_else(unknown);
        front.close(store.past(), ends[0], ends[1], &covariance);
        edges.push(edge);
    }
    edges
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
        let Some(ends) = store.withdraw(edge, Verdict::Withdrawn(Objection::Outvoted)) else { continue };
        front.open(ends[0], ends[1]);
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
