//! Old places looked at: what goes out, and what comes of it.

use crate::cascade::Finding;
use crate::submaps::{PoseOf, Submaps, Window};
use crate::views::View;
use mapwright_geom::{Pose, Pose2};
use mapwright_record::{Detection, Evidence, NodeId, Verdict};

/// After so many poses and blocks of poses, some 0.1 s, what is left is a job of its own: a window of 8 m may take two or three times as many,
/// and several of them half a second. Those of narrow windows stay together, for each result may come some scans late.
const SCORED_AT_ONCE: u64 = 150_000;

/// An old place and where the robot may be, seen from there.
#[derive(Debug, Clone, Copy)]
pub struct Target<P: Pose = Pose2> {
    /// The keyframe there.
    pub from: NodeId,
    /// How it was found.
    pub detection: Detection,
    /// Where the robot may be.
    pub window: Window<P>,
    /// Covariance of that, a right perturbation of the robot's pose.
    pub covariance: P::Matrix,
}

/// A finding as a candidate that has no number yet.
#[derive(Debug, Clone, Copy)]
pub struct Judged<P: Pose = Pose2> {
    /// The old keyframe.
    pub from: NodeId,
    /// The present one.
    pub to: NodeId,
    /// How it was found.
    pub detection: Detection,
    /// What was measured.
    pub evidence: Evidence,
    /// What was decided.
    pub verdict: Verdict,
    /// The best pose of `to` in the frame of `from`, if one was found.
    pub from_from_to: Option<P>,
    /// Covariance of its right perturbation.
    pub covariance: P::Matrix,
}

impl<P: Pose> Target<P> {
    /// What was found there, and nothing speaks against yet, as a candidate.
    #[must_use]
    pub fn judged(&self, to: NodeId, finding: &Finding<P>) -> Judged<P> {
        Judged {
            from: self.from,
            to,
            detection: self.detection,
            evidence: finding.evidence,
            verdict: Verdict::Accepted,
            from_from_to: finding.target_from_query,
            covariance: finding.covariance,
        }
    }
}

/// An old place and what was seen there.
pub(crate) type Place<S> = (Target<PoseOf<S>>, Vec<View<<S as Submaps>::Measurement>>);

/// The present submap is looked for in old ones.
#[derive(Debug, Clone)]
pub struct Verification<S: Submaps> {
    /// What the present one is drawn from, and the old places that are left.
    pub(crate) query: Vec<View<S::Measurement>>,
    pub(crate) targets: std::vec::IntoIter<Place<S>>,
    submaps: S,
    drawn: Option<S::Submap>,
    verified: Verified<PoseOf<S>>,
}

/// What was found.
#[derive(Debug, Clone)]
pub struct Verified<P: Pose = Pose2> {
    /// The keyframe that was the newest.
    pub to: NodeId,
    /// Every target with what was found there.
    pub findings: Vec<(Target<P>, Finding<P>)>,
    /// The work done: views drawn, and poses and blocks of poses scored.
    pub work: (usize, u64),
}

impl<S: Submaps> Verification<S> {
    /// The newest keyframe `to`, in whose frame the query is, at these places.
    pub(crate) fn new(to: NodeId, query: Vec<View<S::Measurement>>, targets: Vec<Place<S>>, submaps: S) -> Self {
        let verified = Verified { to, findings: Vec::with_capacity(targets.len()), work: (query.len(), 0) };
        Self { query, targets: targets.into_iter(), submaps, drawn: None, verified }
    }

    /// Does the work.
    #[must_use]
    pub fn run(mut self) -> Verified<PoseOf<S>> {
        while self.advance() {}
        self.verified
    }

    /// Looks at places until `SCORED_AT_ONCE`; whether others are left.
    pub fn advance(&mut self) -> bool {
        let query = self.drawn.get_or_insert_with(|| self.submaps.draw(&self.query));
        let before = self.verified.work.1;
        let mut drawn: Option<(NodeId, S::Submap)> = None;
        for (target, views) in self.targets.by_ref() {
            let finding = self.submaps.rule_out(query, &views, &target.window).unwrap_or_else(|| {
                // A place that may be seen either way around is drawn once.
                let known = drawn.take().filter(|(from, _)| *from == target.from);
                self.verified.work.0 += if known.is_some() { 0 } else { views.len() };
                let (_, submap) = drawn.insert(known.unwrap_or_else(|| (target.from, self.submaps.draw(&views))));
                self.submaps.look_for(query, submap, &target.window)
            });
            self.verified.findings.push((target, finding));
            self.verified.work.1 += self.submaps.scored();
            if self.verified.work.1 - before > SCORED_AT_ONCE {
                break;
            }
        }
        self.targets.len() > 0
    }
}
