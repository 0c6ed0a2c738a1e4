//! Robots that saw each other: a relative pose of their keyframes as a closure of its own kind.

use super::Mapper;
use crate::cycles;
use crate::jobs::Task;
use crate::told::Told;
use mapwright_geom::{Cov3, Pose2, inverse_covariance};
use mapwright_loops::Judged;
use mapwright_record::{Detection, Evidence, KeyframeId, Update, Verdict};

/// Where a keyframe of one robot lies in the frame of another one's, by what the two robots saw of each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighted {
    /// The keyframe of one robot,
    pub a: KeyframeId,
    /// and that of the other.
    pub b: KeyframeId,
    /// The pose of `b` in the frame of `a`.
    pub a_from_b: Pose2,
    /// Covariance of its right perturbation.
    pub covariance: Cov3,
}

impl Mapper {
    /// Takes down that two robots saw each other. It joins their maps as any closure does, and is withdrawn where the others contradict it. Nothing
    /// where a keyframe is not in the map, both are of one run, the two are linked by a sighting already, or the map is finished.
    pub fn sighted(&mut self, sighted: &Sighted) -> Update {
        let Sighted { a, b, a_from_b, covariance } = *sighted;
        let is_known = self.session().candidates().iter().any(|known| {
            known.detection == Detection::Sighting
                && ([known.from, known.to] == [a, b] || [known.from, known.to] == [b, a])
        });
        let is_sound = a_from_b.is_finite() && covariance.iter().all(|number| number.is_finite());
        let nodes = self.store.past().nodes([a, b]);
        let Some([at_a, at_b]) =
            nodes.filter(|_| is_sound && !is_known && a.run() != b.run() && !self.store.is_fixed())
        else {
            return self.report(Told::default());
        };
        let (from, to, from_from_to, covariance) = if at_a < at_b {
            (at_a, at_b, a_from_b, covariance)
        } else {
            (at_b, at_a, a_from_b.inverse(), inverse_covariance(a_from_b, &covariance))
        };
        let judged = Judged {
            from,
            to,
            detection: Detection::Sighting,
            evidence: Evidence::default(),
            verdict: Verdict::Accepted,
            from_from_to: Some(from_from_to),
            covariance,
        };
        let correction = self.settings().loops.correction;
        let followed = cycles::sighted(&mut self.back.closing, &mut self.store, &mut self.front, &judged, correction);
        followed.solving.into_iter().for_each(|solving| self.back.push(Task::Solve(solving)));
        self.work_all();
        self.report(Told::default())
    }
}
