//! The front end as bytes, each stage its own; one that goes on as it was.

use super::PlaneFrontEnd;
use super::predict::Predictor;
use super::slip::SlipWatch;
use super::track::Tracker;
use crate::front_end::Resumes;
use crate::local_map::{Frames, LocalMapping};
use crate::pose::RobotPose;
use crate::settings::Settings;
use mapwright_geom::Stored;
use mapwright_record::Past;
use mapwright_sensor::Sweep;

impl Resumes<Sweep> for PlaneFrontEnd {
    const VERSION: u8 = 6;

    fn put(&self, out: &mut Vec<u8>) {
        self.preparation.put(out);
        self.predictor.put(out);
        self.tracker.put(out);
        self.pose.put(out);
        self.local_map.put(out);
        self.intruders.put(out);
        self.slips.put(out);
    }

    fn restore(settings: Settings, past: Past<'_>, from: &mut &[u8]) -> Option<Self> {
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

    fn resume(settings: Settings, past: Past<'_>) -> Self {
        Self::made_again(settings, past)
    }
}
