//! A robot that does not know where it is: it maps aside, writes nothing, and asks every place it knows.

use super::{Mapper, Matched};
use crate::closing::{Found, Past};
use crate::live::Frames;
use crate::motion::Step;
use crate::settings::LivePolicy;
use mapwright_geom::{Cov3, Pose2, Stamp};
use mapwright_record::{Status, Update};
use mapwright_sensor::{BeamCounts, LaserScan};
use nalgebra::Vector3;

/// What lies between two keyframes that no measurement joins counts as so much way, metres.
pub(super) const BROKEN_WAY_M: f64 = 1000.0;
/// After a time without a look at the world, so much way has to fit before the robot is believed where it was, metres.
const SUSPECT_WAY_M: f64 = 1.5;
/// From so many usual periods without returns on, and so many seconds.
const BLIND_PERIODS: f64 = 8.0;
const BLIND_S: f64 = 2.0;
/// Such a share of the known beams has to fit then.
const SUSPECT_SHARE: f64 = 0.8;
/// After so many scans in a row that fit nowhere the robot is lost, and so much travel.
const LOST_SCANS: u32 = 10;
/// Places are asked after so much way, metres.
const ASK_EVERY_M: f64 = 0.4;

/// A robot that does not know where it is.
#[derive(Debug, Clone)]
pub(super) struct Lost {
    /// What it has seen since, in a frame of its own.
    aside: Mapper,
    way_m: f64,
    asked_m: f64,
    findings: Vec<Found>,
}

/// The keyframe on which the next one hangs, for odometry does not lead there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Broken {
    pub(super) from: u32,
    pub(super) covariance: Cov3,
}

impl Mapper {
    /// After a time without a look at the world the robot may be anywhere: unless what it sees fits very well, it is lost.
    pub(super) fn suspicion(&mut self, stamp: Stamp, matched: Option<Matched>, step: Step) -> Option<Matched> {
        let mut matched = matched?;
        let blind_s = self.seen.map_or(0.0, |seen| stamp.secs_since(seen));
        self.seen = Some(stamp);
        if self.settings.loops.relocate && blind_s > BLIND_S && blind_s > BLIND_PERIODS * self.predictor.period_s() {
            self.suspect_m = SUSPECT_WAY_M;
        }
        if self.suspect_m > 0.0 {
            self.suspect_m -= step.last_from_robot.x.hypot(step.last_from_robot.y);
            let fits = matched.agreement.inlier_share() >= SUSPECT_SHARE && matched.status != Status::Lost;
            if !fits {
                matched.status = Status::Lost;
                self.get_lost();
            }
        } else if matched.status == Status::Lost && self.lost_scans >= LOST_SCANS {
            self.get_lost();
        }
        Some(matched)
    }

    fn get_lost(&mut self) {
        if !self.settings.loops.relocate || self.keyframes.is_empty() {
            return;
        }
        let mut settings = self.settings;
        settings.live.policy = LivePolicy::Everything;
        (settings.loops.by_pose, settings.loops.by_place, settings.loops.relocate) = (false, false, false);
        let Ok(mut aside) = Self::new(settings) else { return };
        aside.predictor = self.predictor.clone();
        self.suspect_m = 0.0;
        self.lost = Some(Box::new(Lost { aside, way_m: 0.0, asked_m: f64::NEG_INFINITY, findings: Vec::new() }));
    }

    /// One scan of a robot that does not know where it is.
    pub(super) fn add_scan_while_lost(
        &mut self,
        scan: &LaserScan,
        beams: BeamCounts,
        step: Step,
        predicted: Pose2,
        odom: Option<Pose2>,
        refused: Option<&'static str>,
    ) -> Update {
        self.settle(scan, odom, step, predicted, None);
        let mut report = None;
        if let Some(mut lost) = self.lost.take() {
            let update = lost.aside.add_scan(scan);
            report = update.matched;
            lost.way_m += step.last_from_robot.x.hypot(step.last_from_robot.y);
            let found = (lost.way_m - lost.asked_m >= ASK_EVERY_M && update.keyframe.is_some())
                .then(|| self.ask_places(&mut lost))
                .flatten();
            match found {
                Some(found) => self.arrive(scan, &lost, &found),
                None => self.lost = Some(lost),
            }
        }
        let newest = self.keyframes.len() as u32 - 1;
        let keyframe_from_robot = self.local_from_keyframe[newest as usize].between(self.local_from_robot);
        self.scans.push((scan.stamp, Some(newest), keyframe_from_robot));
        let status = if self.lost.is_some() { Status::Lost } else { Status::Tracking };
        let keyframe = self.lost.is_none().then_some(newest);
        Update { status, matched: report, ..self.update(scan, beams, None, keyframe, refused) }
    }

    /// Whether a known place fits what was seen since.
    fn ask_places(&mut self, lost: &mut Lost) -> Option<Found> {
        lost.asked_m = lost.way_m;
        let sought = Past { keyframes: &lost.aside.keyframes, local_from_keyframe: &lost.aside.local_from_keyframe };
        let past = Past { keyframes: &self.keyframes, local_from_keyframe: &self.local_from_keyframe };
        let expected = self.local_from_keyframe.last()?.between(self.local_from_robot);
        self.closing.relocate(&self.settings, past, sought, expected, &mut lost.findings, self.matcher.settings)
    }

    /// The robot is found: it goes on from there.
    fn arrive(&mut self, scan: &LaserScan, lost: &Lost, found: &Found) {
        let Found { from, to, from_from_to, covariance } = *found;
        let keyframe_from_robot = lost.aside.local_from_keyframe[to as usize].between(lost.aside.local_from_robot);
        self.local_from_robot = self.local_from_keyframe[from as usize] * from_from_to * keyframe_from_robot;
        self.anchor = Some(from);
        self.keyframe_from_anchor = Cov3::from_diagonal(&Vector3::new(1e4, 1e4, 10.0));
        self.odometry_since_keyframe = Cov3::zeros();
        self.lost_scans = 0;
        self.doubted_from = None;
        self.broken = Some(Broken { from, covariance });
        if self.insert(scan, None).is_some() {
            let frames = Frames { keyframes: &self.keyframes, world_from_robot: &self.local_from_keyframe };
            self.live.arrive(&self.settings, frames);
        }
    }
}
