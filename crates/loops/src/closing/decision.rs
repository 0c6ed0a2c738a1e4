//! What is decided of a look at old places, and written down in one go.

use super::Closing;
use crate::submaps::{PoseOf, Submaps};
use crate::verification::{Judged, Verified};
use mapwright_geom::Pose;
use mapwright_record::{Edge, Measurement, NodeId, Past, Verdict};

/// Where it is written down what becomes of candidates.
pub trait Ledger<M: Measurement> {
    /// All that was written down.
    fn past(&self) -> Past<'_, M>;

    /// Takes a candidate down and returns its number; none where no session can hold it.
    fn add_candidate(&mut self, judged: &Judged<M::Pose>) -> Option<u32>;

    /// A candidate is a closure: its ends and its edge, if it says where it leads and how surely.
    fn accept(&mut self, number: u32) -> Option<([NodeId; 2], Edge<M::Pose>)>;

    /// A match that has waited is an edge.
    fn add_match(&mut self, edge: Edge<M::Pose>);

    /// Odometry has led to a keyframe wrongly: what links it to the one before is none.
    fn withdraw_odometry(&mut self, to: NodeId);

    /// How many closures stand.
    fn closures(&self) -> usize;
}

/// What came of a look.
#[derive(Debug, Clone)]
#[must_use]
pub struct Decision<P: Pose> {
    /// The closures that it has made.
    pub closures: Vec<Edge<P>>,
    /// The graph is to be solved now; then the poses follow the closures.
    pub is_solving_due: bool,
}

impl<S: Submaps> Closing<S> {
    /// Judges what was found at old places, and what has waited for it.
    pub fn decide(
        &mut self,
        ledger: &mut impl Ledger<S::Measurement>,
        verified: &Verified<PoseOf<S>>,
    ) -> Decision<PoseOf<S>> {
        self.looked(verified);
        let mut closures = Vec::new();
        for (target, finding) in verified.findings.iter().filter(|(target, _)| target.from < verified.to) {
            let past = ledger.past();
            let judgement = self.judge(past, past.session.candidates(), verified.to, (target, finding));
            let number = ledger.add_candidate(&judgement.judged);
            let Some(number) = number.filter(|_| judgement.judged.verdict == Verdict::Accepted) else { continue };
            judgement.misled.into_iter().for_each(|first| ledger.withdraw_odometry(first));
            closures.extend(self.accept(ledger, judgement.agreeing.into_iter().chain([number])));
        }
        for edge in self.settle_matches(ledger.past(), &closures) {
            ledger.add_match(edge);
        }
        Decision { closures, is_solving_due: self.take_solving_due(|| ledger.closures()) }
    }

    /// Takes down what was told for certain and is not judged, as that robots have seen each other.
    pub fn take_down(
        &mut self,
        ledger: &mut impl Ledger<S::Measurement>,
        told: &Judged<PoseOf<S>>,
    ) -> Decision<PoseOf<S>> {
        let number = ledger.add_candidate(told);
        let closures = self.accept(ledger, number.into_iter());
        Decision { closures, is_solving_due: self.take_solving_due(|| ledger.closures()) }
    }

    /// The edges of candidates that have become closures.
    fn accept(
        &mut self,
        ledger: &mut impl Ledger<S::Measurement>,
        numbers: impl Iterator<Item = u32>,
    ) -> Vec<Edge<PoseOf<S>>> {
        let mut edges = Vec::new();
        for number in numbers {
            if let Some((ends, edge)) = ledger.accept(number) {
                self.accepted(ledger.past(), ends, &edge);
                edges.push(edge);
            }
        }
        edges
    }
}
