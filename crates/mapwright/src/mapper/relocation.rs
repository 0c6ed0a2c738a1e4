//! A robot that does not know where it is: it maps aside, writes nothing, and asks every place it knows.

use super::Mapper;
use super::arrival::Arrival;
use super::guard::KNOWN_SHARE;
use super::suspicion::Suspicion;
use crate::closing::{Chance, Found, Ground, Heard, Past, Sought, hopes};
use crate::jobs::{Job, Task};
use crate::live::Frames;
use crate::motion::Step;
use crate::settings::LivePolicy;
use mapwright_geom::{Cov3, Pose2};
use mapwright_record::{MatchReport, Status, Update};
use mapwright_sensor::{BeamCounts, LaserScan, Odometry, Sweep, TurnRate};
use nalgebra::Vector3;
use std::sync::Arc;

/// What lies between two keyframes that no measurement joins counts as so much way, metres.
pub(super) const BROKEN_WAY_M: f64 = 1000.0;
/// Places are asked at every keyframe for so much way, metres, where a robot that never left known ground is found, and after
/// so much way from there on.
const ASK_OFTEN_M: f64 = 8.0;
const ASK_EVERY_M: f64 = 0.4;
/// once it has seen so much of it, metres: one room is like another.
const ASK_FROM_M: f64 = 1.6;
/// Below this share of fitting beams even the map made aside is wrong.
const ASIDE_SHARE: f64 = 0.5;

/// A robot that does not know where it is.
#[derive(Debug, Clone)]
pub(super) struct Lost {
    /// What it has seen since, in a frame of its own.
    aside: Mapper,
    way_m: f64,
    asked_m: f64,
    /// Number of the question that was not answered yet.
    asking: Option<u64>,
    chances: Vec<Chance>,
    heard: Vec<Heard>,
    /// Where it is, from the next scan on.
    found: Option<Found>,
    /// All that is known, once it was drawn.
    ground: Option<Arc<Ground>>,
}

impl Lost {
    pub(super) fn new(mapper: &Mapper) -> Self {
        let mut settings = mapper.settings;
        settings.live.policy = LivePolicy::Everything;
        (settings.loops.by_pose, settings.loops.by_place, settings.loops.relocate) = (false, false, false);
        let mut aside = Mapper::with(settings, Pose2::IDENTITY);
        aside.predictor = mapper.predictor.clone();
        aside.recent_odometry = mapper.recent_odometry.clone();
        aside.turn_rates = mapper.turn_rates.clone();
        let asked_m = f64::NEG_INFINITY;
        Self {
            aside,
            way_m: 0.0,
            asked_m,
            asking: None,
            chances: Vec::new(),
            heard: Vec::new(),
            found: None,
            ground: None,
        }
    }

    /// What was mapped aside is of no use any more.
    pub(super) fn begin_again(&mut self, mapper: &Mapper) {
        *self = Self { ground: self.ground.take(), ..Self::new(mapper) };
    }

    /// One scan of it, mapped aside.
    pub(super) fn see(&mut self, mapper: &Mapper, scan: &LaserScan) -> Update {
        let update = self.aside.add_scan(scan);
        if update.matched.as_ref().is_some_and(is_apart) {
            self.begin_again(mapper);
            let _ = self.aside.add_scan(scan);
        }
        update
    }

    /// The keyframes that were made aside, and where the robot is relative to the newest.
    pub(super) fn aside(&self) -> (Past<'_>, Pose2) {
        let Mapper { keyframes, local_from_keyframe, local_from_robot, .. } = &self.aside;
        let newest = local_from_keyframe.last().copied().unwrap_or_default();
        (Past { keyframes, local_from_keyframe }, newest.between(*local_from_robot))
    }

    /// Where it was found it is not; what spoke for that has to be seen anew.
    pub(super) fn give_up(&mut self) {
        (self.chances, self.heard, self.asking) = (Vec::new(), Vec::new(), None);
    }

    fn redraw_ground(&mut self) {
        (self.ground, self.asking) = (None, None);
    }

    pub(super) fn add_odometry(&mut self, odometry: &Odometry) {
        self.aside.add_odometry(odometry);
    }

    pub(super) fn add_turn_rate(&mut self, rate: &TurnRate) {
        self.aside.add_turn_rate(rate);
    }

    fn is_to_ask(&self) -> bool {
        // Where it may be home, it asks at every keyframe as well.
        let nowhere = self.chances.is_empty() && self.heard.last().is_none_or(Heard::is_nowhere);
        let every_m = if nowhere && self.way_m > ASK_OFTEN_M { ASK_EVERY_M } else { 0.0 };
        self.asking.is_none() && self.way_m >= ASK_FROM_M && self.way_m - self.asked_m >= every_m
    }
}

/// Whether a scan has nothing to do with what was mapped aside: that was wrong, or something else is seen all at once, as
/// by a laser that was covered while the robot was carried.
fn is_apart(matched: &MatchReport) -> bool {
    matched.known_share < KNOWN_SHARE || (matched.inlier_share < ASIDE_SHARE && matched.known_share > 0.5)
}

/// The keyframe on which the next one hangs, for odometry does not lead there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Broken {
    pub(super) from: u32,
    pub(super) covariance: Cov3,
}

impl Mapper {
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
            let update = lost.see(self, scan);
            report = update.matched;
            report.iter().for_each(|m| self.budget.earn_match(m.evaluations, m.beams));
            lost.way_m += step.last_from_robot.x.hypot(step.last_from_robot.y);
            if update.keyframe.is_some() {
                self.budget.earn_keyframe();
            }
            if update.keyframe.is_some() && lost.is_to_ask() {
                self.ask_everywhere(&mut lost);
            }
            self.lost = Some(lost);
        }
        self.work_inline();
        if let Some(found) = self.lost.as_mut().and_then(|lost| lost.found.take()) {
            self.arrive(scan, &found);
        }
        let newest = self.keyframes.len() as u32 - 1;
        let keyframe_from_robot = self.local_from_keyframe[newest as usize].between(self.local_from_robot);
        self.scans.push((scan.stamp, Some(newest), keyframe_from_robot));
        let status = if self.lost.is_some() { Status::Lost } else { Status::Tracking };
        Update { status, matched: report, ..self.update(scan, beams, None, None, refused) }
    }

    /// Asks where in all that is known the robot is.
    fn ask_everywhere(&mut self, lost: &mut Lost) {
        lost.asked_m = lost.way_m;
        let Some(effort) = self.budget.for_question() else { return };
        self.questions += 1;
        let question = (self.questions, effort, self.matcher.settings);
        let sought = Past { keyframes: &lost.aside.keyframes, local_from_keyframe: &lost.aside.local_from_keyframe };
        let past = Past { keyframes: &self.keyframes, local_from_keyframe: &self.local_from_keyframe };
        let hopes = hopes(sought, &lost.heard, |a, b| lost.aside.closing.way_m(a, b));
        let ground = (lost.ground.as_ref(), hopes, lost.heard.last().map(Heard::to));
        if let Some(seeking) = self.closing.seek(&self.settings, past, &self.dropped, sought, ground, question) {
            lost.asking = Some(self.questions);
            self.jobs.push_back(Job(Task::Seek(seeking)));
        }
    }

    /// An answer, for a robot that still waits for it.
    pub(super) fn hear(&mut self, answer: &Sought) {
        self.budget.spend(answer.given, answer.spent);
        let Some(lost) = self.lost.as_mut().filter(|lost| lost.asking == Some(answer.question)) else { return };
        lost.asking = None;
        let known = (answer.to as usize) < lost.aside.keyframes.len();
        if !known || answer.best.as_ref().is_some_and(|best| best.from as usize >= self.keyframes.len()) {
            return;
        }
        lost.ground = Some(Arc::clone(&answer.ground));
        let sought = Past { keyframes: &lost.aside.keyframes, local_from_keyframe: &lost.aside.local_from_keyframe };
        let past = Past { keyframes: &self.keyframes, local_from_keyframe: &self.local_from_keyframe };
        let way_m = |a: u32, b: u32| lost.aside.closing.way_m(a, b);
        lost.found = self.closing.weigh(past, sought, answer, &mut lost.chances, way_m);
        if lost.found.is_none() {
            lost.found = self.closing.follow(past, sought, answer, &mut lost.heard, way_m);
        }
    }

    /// A robot that does not know where it is, or may not know.
    pub(super) fn lost_or_arrived(&mut self) -> Option<&mut Lost> {
        self.lost.as_deref_mut().or_else(|| self.suspicion.lost())
    }

    /// The past was corrected: what is known is to be drawn anew, and what is still asked was asked of the old one.
    pub(super) fn redraw_ground(&mut self) {
        self.lost_or_arrived().into_iter().for_each(Lost::redraw_ground);
    }

    /// The robot is found: it goes on from there. Until that is believed nothing is written: the keyframe of the arrival, which
    /// the next ones hang on, is one without beams, and none that anybody is told of.
    fn arrive(&mut self, scan: &LaserScan, found: &Found) {
        let Some(lost) = self.lost.take() else { return };
        let Found { from, to, from_from_to, covariance } = *found;
        let keyframe_from_robot = lost.aside.local_from_keyframe[to as usize].between(lost.aside.local_from_robot);
        self.local_from_robot = self.local_from_keyframe[from as usize] * from_from_to * keyframe_from_robot;
        self.anchor = Some(from);
        self.keyframe_from_anchor = Cov3::from_diagonal(&Vector3::new(1e4, 1e4, 10.0));
        self.odometry_since_keyframe = Cov3::zeros();
        self.lost_scans = 0;
        self.doubted_from = None;
        self.broken = Some(Broken { from, covariance });
        let arrived = self.sweep.as_ref().map(Sweep::blanked).map(|blank| self.insert_sweep(scan, None, blank));
        // It has seen where it is until now, though not here.
        self.seen = Some(scan.stamp);
        if let Some(node) = arrived {
            self.dropped.insert(node);
            self.suspicion = Suspicion::of_arrival(Arrival::new(node, from, lost));
            let frames = Frames { keyframes: &self.keyframes, world_from_robot: &self.local_from_keyframe };
            self.live.arrive(&self.settings, frames, &self.points.hits, self.local_from_robot);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;
    use mapwright_sim::kidnapping;

    /// Where all that a robot has seen on the way from where it was put down, 14 s ago, fits as well as where it is, on a floor
    /// that is nearly the same turned by half a turn.
    const WRONG: Pose2 = Pose2 { x: 19.676, y: -0.007, theta: -0.003 };

    #[test]
    fn who_is_found_where_less_and_less_fits_is_lost_again_and_has_left_nothing() {
        let case = kidnapping(28_017);
        let mut mapper = Mapper::with(Settings::default(), Pose2::IDENTITY);
        let since_s = |scan: &LaserScan| scan.stamp.secs_since(case.put_down);
        let (mut arrived, mut tracked, mut written, mut way_m) = (None, 0, 0, 0.0);
        for scan in case.drive().scans().map(|scan| scan.scan).take_while(|scan| since_s(scan) < 60.0) {
            let before = mapper.local_from_robot;
            if arrived.is_none() && since_s(&scan) > 14.0 {
                let lost = mapper.lost.as_mut().expect("it was carried away");
                let to = lost.aside.keyframes.len() as u32 - 1;
                let keyframe_from_robot =
                    lost.aside.local_from_keyframe[to as usize].between(lost.aside.local_from_robot);
                let local_from_to = WRONG * keyframe_from_robot.inverse();
                let away_m = |&k: &usize| mapper.local_from_keyframe[k].distance(local_from_to);
                let from =
                    (0..mapper.keyframes.len()).min_by(|a, b| away_m(a).total_cmp(&away_m(b))).expect("it mapped");
                let from_from_to = mapper.local_from_keyframe[from].between(local_from_to);
                let covariance = Cov3::from_diagonal(&Vector3::new(4e-4, 4e-4, 2e-5));
                lost.found = Some(Found { from: from as u32, to, from_from_to, covariance });
                arrived = Some(mapper.keyframes.len() as u32);
            }
            let update = mapper.add_scan(&scan);
            if arrived.is_some() && update.status != Status::Lost {
                way_m += if tracked > 0 { before.distance(mapper.local_from_robot) } else { 0.0 };
                tracked += 1;
                written += usize::from(update.keyframe.is_some());
            }
        }
        println!("{tracked} scans on {way_m:.1} m, {written} keyframes");
        let node = arrived.expect("it did");
        assert!(
            tracked > 10 && (0.5..8.0).contains(&way_m) && mapper.lost.is_some(),
            "it has gone on there for {way_m} m"
        );
        assert!(written == 0 && mapper.dropped.contains(&node), "the keyframe of the arrival is none");
        assert!(mapper.keyframes[node as usize].sweep.is_blank(), "and has seen nothing");
        let arrival = mapper.id(node);
        assert!(mapper.edges.iter().all(|edge| edge.to != arrival && edge.from != arrival), "no edge leads there");
        assert!(mapper.render_poses()[node as usize].is_none(), "nor is it drawn");
    }

    /// What was seen lately of a new corridor lies closely enough on the walls of a known one, seven answers long; not all three
    /// of it, what was seen on the way, and the known one seen from there do.
    #[test]
    fn who_drives_along_a_corridor_like_a_known_one_is_not_found_there() {
        let case = kidnapping(41_031);
        let mut mapper = Mapper::with(Settings::default(), Pose2::IDENTITY);
        let since_s = |scan: &LaserScan| scan.stamp.secs_since(case.put_down);
        let mut asked = 0;
        for scan in case.drive().scans().map(|scan| scan.scan).take_while(|scan| since_s(scan) < 16.0) {
            let update = mapper.add_scan(&scan);
            if since_s(&scan) > 5.0 {
                assert_eq!(update.status, Status::Lost, "{} s", since_s(&scan));
                asked = mapper.questions;
            }
        }
        assert!(asked > 20, "it has asked {asked} times");
    }
}
