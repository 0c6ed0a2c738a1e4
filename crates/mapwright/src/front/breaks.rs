//! Breaks: where the robot may be so far from where it is predicted that nothing of what it knows can be matched against. A match
//! always finds something, and after a break it is soon the wrong corridor. So a fragment begins there, mapped at full quality, and
//! detection looks for a join ([`mapwright_loops::Closing`]).

use super::{FrontEnd, Matched, Prepared};
use crate::settings::LivePolicy;
use crate::store::{NewKeyframe, Written};
use mapwright_geom::{Cov3, Stamp, TangentMatrix, compose_covariance};
use mapwright_record::{FragmentStart, Past};
use mapwright_sensor::LaserScan;

/// Nothing is matched against from such a standard deviation of the position on, metres: places that look alike lie as near as
/// three of them. Gaps in logs of two buildings ask for 0.3 to 1.1 (docs/decisions/0024-fragments.md).
const BREAK_SIGMA_M: f64 = 1.0;
/// From so many usual periods without hits on, and so many seconds, a robot may have been carried away, whatever its wheels say.
const BLIND_PERIODS: f64 = 20.0;
const BLIND_S: f64 = 4.0;
/// After so many scans in a row that fit nowhere it is not where it is thought to be.
const LOST_SCANS: u32 = 10;
/// Variances of where it is then, m^2 and rad^2.
const ANYWHERE: [f64; 2] = [1e4, 10.0];

impl FrontEnd {
    /// Why a fragment begins with this scan, if it does.
    pub(crate) fn find_break(&self, past: Past<'_>, stamp: Stamp, prepared: &Prepared) -> Option<FragmentStart> {
        let keeps_everything = self.settings.live.policy == LivePolicy::Everything;
        if keeps_everything || past.newest().is_none() || self.preparation.match_points().is_empty() {
            return None;
        }
        let is_blind = self.tracker.blind_s(stamp) > BLIND_S.max(BLIND_PERIODS * self.predictor.period_s());
        let may_have_strayed = prepared.step.after_gap || self.tracker.misfits() > 0;
        if self.tracker.misfits() >= LOST_SCANS {
            Some(FragmentStart::Lost)
        } else if is_blind {
            Some(FragmentStart::Blind)
        } else if may_have_strayed && self.sigma_m(prepared) > BREAK_SIGMA_M {
            Some(FragmentStart::Uncertain)
        } else {
            None
        }
    }

    /// Standard deviation of the predicted position relative to the newest keyframe, metres.
    fn sigma_m(&self, prepared: &Prepared) -> f64 {
        let step = prepared.step;
        let noise = Cov3::from_diagonal(&step.variances.into());
        compose_covariance(&self.pose.fused(), step.last_from_robot, &noise).position_variance_m2().sqrt()
    }

    /// What is known is not matched against any more.
    pub(crate) fn leave(&mut self) -> Option<Matched> {
        self.local_map.leave_all();
        None
    }

    /// The keyframe that a fragment begins with, at its predicted place; its covariance is that of the break.
    pub(crate) fn first_of_fragment(
        &self,
        past: Past<'_>,
        scan: &LaserScan,
        start: FragmentStart,
    ) -> Option<NewKeyframe> {
        let new = self.keyframe_here(past, scan, None, None)?;
        let [m2, rad2] = ANYWHERE;
        let is_lost = start == FragmentStart::Lost;
        Some(NewKeyframe { odometry: if is_lost { Cov3::from_variances(m2, rad2) } else { new.odometry }, ..new })
    }

    /// It was written: the robot goes on from there.
    pub(crate) fn began_fragment(&mut self, past: Past<'_>, stamp: Stamp, new: &NewKeyframe, written: &Written) {
        self.wrote(past, new, written);
        self.pose.begin_fragment(written.node);
        self.tracker.begin_anew(stamp);
    }
}
