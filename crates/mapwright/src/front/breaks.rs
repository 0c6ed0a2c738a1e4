//! Breaks: where the robot may be so far from where it is predicted that nothing of what it knows can be matched against. A match
//! always finds something, and after a break it is soon the wrong corridor. So a fragment begins there, mapped at full quality, and
//! detection looks for a join ([`mapwright_loops::Closing`]).

use super::insert::Intruders;
use super::predict::{BLIND_S, BLIND_SCANS, Predictor};
use super::prepare::Preparation;
use super::slip::SlipWatch;
use super::track::{Scene, Tracker};
use super::{FrontEnd, Matched, Prepared};
use crate::local_map::Frames;
use crate::settings::LivePolicy;
use crate::store::{NewKeyframe, Written};
use mapwright_geom::{Cov3, Stamp, TangentMatrix, compose_covariance};
use mapwright_record::{FragmentStart, Past};
use mapwright_sensor::LaserScan;

/// Nothing is matched against from such a standard deviation of the position on, metres: places that look alike lie as near as
/// three of them. Gaps in logs of two buildings ask for 0.3 to 1.1 (docs/decisions/0024-fragments.md).
const BREAK_SIGMA_M: f64 = 1.0;
/// After so many scans in a row that fit nowhere it is not where it is thought to be.
const LOST_SCANS: u32 = 10;
/// Variances of where it is then, m^2 and rad^2.
const ANYWHERE: [f64; 2] = [1e4, 10.0];

/// Covariance of where a robot is of which nothing is known.
pub(crate) fn anywhere() -> Cov3 {
    let [m2, rad2] = ANYWHERE;
    Cov3::from_variances(m2, rad2)
}

impl FrontEnd {
    /// Why a fragment begins with this scan, if it does; `switched_on` where it does as soon as something is seen.
    pub(crate) fn find_break(
        &mut self,
        past: Past<'_>,
        stamp: Stamp,
        prepared: &Prepared,
        switched_on: Option<FragmentStart>,
    ) -> Option<FragmentStart> {
        let keeps_everything = self.settings.live.policy == LivePolicy::Everything;
        if past.newest().is_none() || self.preparation.match_points().is_empty() {
            return None;
        }
        if switched_on.is_some() || keeps_everything {
            return switched_on;
        }
        let (blank, blind_s) = self.tracker.blind(stamp);
        let silence_s = self.tracker.silence_s(stamp);
        // Without hits it may have been carried, whatever the wheels say; and where they said nothing either, or that it stands: while they say
        // that it drives they are believed, for there are logs with a scan every metre, and a quarter of a minute between two.
        let stood = !self.settings.keyframes.is_far(prepared.step.last_from_robot);
        let is_blind = blank >= BLIND_SCANS && blind_s > BLIND_S
            || self.predictor.is_blind(silence_s)
            || stood && self.predictor.is_blind(blind_s);
        let may_have_strayed = prepared.step.after_gap || self.tracker.misfits() > 0;
        if self.tracker.misfits() >= LOST_SCANS {
            Some(FragmentStart::Lost)
        } else if is_blind {
            (!self.is_where_wheels_say(past, prepared)).then_some(FragmentStart::Blind)
        } else if may_have_strayed && self.sigma_m(prepared) > BREAK_SIGMA_M {
            Some(FragmentStart::Uncertain)
        } else {
            None
        }
    }

    /// Whether a robot that was blind is where its wheels say all the same: had it been carried, the scan would not fit just there.
    fn is_where_wheels_say(&mut self, past: Past<'_>, prepared: &Prepared) -> bool {
        let Prepared { step, predicted, .. } = *prepared;
        self.local_map.meet(&self.settings, Frames::of(past), self.preparation.match_points(), predicted);
        let scene =
            Scene::new(&self.settings, &self.local_map, &self.preparation, &self.predictor, (past, &self.pose), step);
        self.tracker.is_where_wheels_say(&scene, predicted)
    }

    /// Standard deviation of the predicted position relative to the newest keyframe, metres.
    fn sigma_m(&self, prepared: &Prepared) -> f64 {
        let step = prepared.step;
        let noise = Cov3::from_diagonal(&step.variances.into());
        compose_covariance(&self.pose.fused(), step.last_from_robot, &noise).position_variance_m2().sqrt()
    }

    /// A robot is switched on: of how it moves, what it saw last and what is wrong with its odometry nothing is known.
    pub(crate) fn switch_on(&mut self) {
        self.preparation = Preparation::default();
        self.predictor = Predictor::default();
        self.tracker = Tracker::new(&self.settings);
        self.intruders = Intruders::default();
        self.slips = SlipWatch::default();
        self.pose.switch_on();
        self.local_map.leave_all();
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
        let is_anywhere = matches!(start, FragmentStart::Lost | FragmentStart::SwitchedOn);
        Some(NewKeyframe { odometry: if is_anywhere { anywhere() } else { new.odometry }, ..new })
    }

    /// It was written: the robot goes on from there.
    pub(crate) fn began_fragment(&mut self, past: Past<'_>, stamp: Stamp, new: &NewKeyframe, written: &Written) {
        self.wrote(past, new, written);
        self.pose.begin_fragment(written.node);
        self.tracker.begin_anew(stamp);
    }
}
