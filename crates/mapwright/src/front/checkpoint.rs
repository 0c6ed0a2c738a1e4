//! The front end as bytes, each stage its own; one that goes on as it was.

use super::PlaneFrontEnd;
use super::predict::Predictor;
use super::slip::SlipWatch;
use super::track::Tracker;
use crate::local_map::{Frames, LocalMapping};
use crate::pose::RobotPose;
use crate::settings::Settings;
use mapwright_geom::Stored;
use mapwright_record::Past;

impl PlaneFrontEnd {
    /// Between two scans.
    pub(super) fn put_stages(&self, out: &mut Vec<u8>) {
        self.preparation.put(out);
        self.predictor.put(out);
        self.tracker.put(out);
        self.pose.put(out);
        self.local_map.put(out);
        self.intruders.put(out);
        self.slips.put(out);
    }

    /// Goes on as it was; `past` is all of the session.
    pub(super) fn take_stages(settings: Settings, past: Past<'_>, from: &mut &[u8]) -> Option<Self> {
        let keyframes = past.local_from_keyframe.len();
        Some(Self {
            preparation: Stored::take(from)?,
            predictor: Predictor::restore(from)?,
            tracker: Tracker::restore(&settings, from, keyframes)?,
            pose: RobotPose::restore(past, from)?,
            local_map: LocalMapping::restore(&settings, Frames::of(past), from)?,
            intruders: Stored::take(from)?,
            slips: SlipWatch::restore(from, keyframes)?,
            settings,
        })
    }
}
