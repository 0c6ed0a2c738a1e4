//! Old places looked at: what goes out, and what comes of it.

use crate::store::{Judged, NodeId};
use mapwright_geom::Pose2;
use mapwright_grid::{Matcher, MatcherSettings, SearchWindow};
use mapwright_loops::{Finding, Submap, SubmapSettings, Verifier, VerifySettings, View};
use mapwright_record::{Detection, Verdict};

/// An old place and where the robot may be, seen from there.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Target {
    pub(crate) from: NodeId,
    pub(crate) detection: Detection,
    /// The middle of the window.
    pub(crate) middle: Pose2,
    /// Standard deviations of that, metres and radians.
    pub(crate) sigma_m: f64,
    pub(crate) sigma_rad: f64,
    pub(crate) half_width_m: f64,
    pub(crate) half_width_rad: f64,
}

impl Target {
    /// What was found there, and nothing speaks against yet, as a candidate.
    pub(super) fn judged(&self, to: NodeId, finding: &Finding) -> Judged {
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

/// The present submap is looked for in old ones.
#[derive(Debug, Clone)]
pub(crate) struct Verification {
    /// The newest keyframe, whose frame is that of the query.
    pub(crate) to: NodeId,
    pub(crate) query: Vec<View>,
    pub(crate) targets: Vec<(Target, Vec<View>)>,
    pub(crate) submaps: SubmapSettings,
    pub(crate) verify: VerifySettings,
    pub(crate) matcher: MatcherSettings,
}

/// What was found.
#[derive(Debug, Clone)]
pub(crate) struct Verified {
    pub(crate) to: NodeId,
    /// Every target with what was found there.
    pub(crate) findings: Vec<(Target, Finding)>,
    /// The work done: views drawn, and poses and blocks of poses scored.
    pub(crate) work: (usize, u64),
}

impl Verification {
    pub(crate) fn run(self) -> Verified {
        let mut verifier = Verifier::new(self.verify, Matcher { settings: self.matcher });
        let query = Submap::new(&self.query, &self.submaps);
        let mut work = (self.query.len(), 0);
        let look = |(target, views): &(Target, Vec<View>)| {
            let submap = Submap::new(views, &self.submaps);
            let window = SearchWindow {
                world_from_robot: target.middle,
                half_width_m: target.half_width_m,
                half_width_rad: target.half_width_rad,
            };
            let finding = verifier.look_for(&query, &submap, &window);
            work = (work.0 + views.len(), work.1 + verifier.scored());
            (*target, finding)
        };
        let findings = self.targets.iter().map(look).collect();
        Verified { to: self.to, findings, work }
    }
}
