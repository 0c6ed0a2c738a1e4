//! A robot that does not know where it is: it maps provisionally, writes nothing, and asks every place it knows.

use super::provisional::{Provisional, Seen};
use crate::front::{FrontEnd, KNOWN_SHARE};
use crate::relocation::{Chance, Found, Ground, Heard, Seeking, Sought, follow, hopes, seek, weigh};
use mapwright_loops::Judged;
use mapwright_record::{MatchReport, Past};
use mapwright_sensor::{LaserScan, Odometry, TurnRate};
use std::sync::Arc;

/// Places are asked at every keyframe for so much way, metres, where a robot that never left known ground is found, and after
/// so much way from there on,
const ASK_OFTEN_M: f64 = 8.0;
const ASK_LATER_EVERY_M: f64 = 0.4;
/// once it has seen so much of it, metres: one room is like another.
const ASK_FROM_M: f64 = 1.6;
/// Below this share of fitting beams even the provisional map is wrong.
const PROVISIONAL_SHARE: f64 = 0.5;

/// A robot that does not know where it is.
#[derive(Debug, Clone)]
pub(crate) struct Lost {
    /// What it has seen since, in a frame of its own.
    provisional: Provisional,
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
    pub(crate) fn new(front: &FrontEnd) -> Self {
        Self {
            provisional: Provisional::new(front),
            way_m: 0.0,
            asked_m: f64::NEG_INFINITY,
            asking: None,
            chances: Vec::new(),
            heard: Vec::new(),
            found: None,
            ground: None,
        }
    }

    /// What was mapped provisionally is of no use any more.
    pub(super) fn begin_again(&mut self, front: &FrontEnd) {
        *self = Self { ground: self.ground.take(), ..Self::new(front) };
    }

    /// One scan of it, mapped provisionally; `front` is the mapper's.
    pub(crate) fn see(&mut self, front: &FrontEnd, scan: &LaserScan) -> Seen {
        let seen = self.provisional.add_scan(scan);
        if seen.matched.as_ref().is_some_and(is_apart) {
            self.begin_again(front);
            let _ = self.provisional.add_scan(scan);
        }
        seen
    }

    /// So much way farther, metres.
    pub(crate) fn go(&mut self, way_m: f64) {
        self.way_m += way_m;
    }

    pub(crate) fn provisional(&self) -> &Provisional {
        &self.provisional
    }

    /// The provisional keyframes.
    pub(super) fn past(&self) -> Past<'_> {
        self.provisional.past()
    }

    /// Where it was found it is not; what spoke for that has to be seen anew.
    pub(super) fn give_up(&mut self) {
        (self.chances, self.heard, self.asking) = (Vec::new(), Vec::new(), None);
    }

    /// What is known was moved: it is to be drawn anew, and what is still asked was asked of the old one.
    pub(crate) fn redraw_ground(&mut self) {
        (self.ground, self.asking) = (None, None);
    }

    pub(crate) fn add_odometry(&mut self, odometry: &Odometry) {
        self.provisional.front.add_odometry(odometry);
    }

    pub(crate) fn add_turn_rate(&mut self, rate: &TurnRate) {
        self.provisional.front.add_turn_rate(rate);
    }

    /// Whether it is time to ask where the robot is; while it is nowhere for long that may be asked after so much way, metres.
    pub(crate) fn is_to_ask(&self, affordable_every_m: f64) -> bool {
        // Where it may be known, it asks at every keyframe.
        let nowhere = self.chances.is_empty() && self.heard.last().is_none_or(Heard::is_nowhere);
        let is_late = nowhere && self.way_m > ASK_OFTEN_M;
        let every_m = if is_late { affordable_every_m.max(ASK_LATER_EVERY_M) } else { 0.0 };
        self.asking.is_none() && self.way_m >= ASK_FROM_M && self.way_m - self.asked_m >= every_m
    }

    /// Asking was put off.
    pub(crate) fn asked(&mut self) {
        self.asked_m = self.way_m;
    }

    /// Asks where in all that is known the robot is; the question has this number and may cost so much.
    pub(crate) fn ask(&mut self, front: &FrontEnd, past: Past<'_>, (question, effort): (u64, u64)) -> Option<Seeking> {
        let sought = self.past();
        let hopes = hopes(sought, &self.heard);
        let ground = (self.ground.as_ref(), hopes, self.heard.last().map(Heard::to));
        let seeking = seek(front.settings(), past, sought, ground, (question, effort, front.matcher()))?;
        self.asking = Some(question);
        Some(seeking)
    }

    /// An answer, if the robot still waits for it: what was found, as candidates in the order they were judged.
    pub(crate) fn hear(&mut self, past: Past<'_>, answer: &Sought) -> Vec<Judged> {
        if self.asking != Some(answer.question) {
            return Vec::new();
        }
        self.asking = None;
        let Self { provisional, chances, heard, .. } = self;
        let sought = provisional.past();
        if !sought.has(answer.to) || answer.best.as_ref().is_some_and(|best| !past.has(best.from)) {
            return Vec::new();
        }
        self.ground = Some(Arc::clone(&answer.ground));
        let mut candidates = Vec::new();
        if let Some((judged, found)) = weigh(past, sought, answer, chances) {
            candidates.push(judged);
            self.found = found;
        }
        if self.found.is_none()
            && let Some((judged, found)) = follow(past, sought, answer, heard)
        {
            candidates.push(judged);
            self.found = Some(found);
        }
        candidates
    }

    /// Where the robot is, once that is known.
    pub(crate) fn take_found(&mut self) -> Option<Found> {
        self.found.take()
    }

    #[cfg(test)]
    pub(crate) fn is_found(&mut self, found: Found) {
        self.found = Some(found);
    }

    #[cfg(test)]
    pub(crate) fn newest(&self) -> Option<mapwright_record::NodeId> {
        self.past().newest()
    }
}

/// Whether a scan has nothing to do with what was mapped provisionally: that was wrong, or something else is seen all at once, as
/// by a laser that was covered while the robot was carried.
fn is_apart(matched: &MatchReport) -> bool {
    matched.known_share < KNOWN_SHARE || (matched.inlier_share < PROVISIONAL_SHARE && matched.known_share > 0.5)
}
