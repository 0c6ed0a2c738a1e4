//! Solutions that are read as their records come, and looked at.

use crate::inbox::Inbox;
use crate::record::ChainId;
use crate::solution::Replay;
use mapwright::{Audit, Settings, Stamp, WaysSeen, audit};

/// When it has said nothing new for so long, others look at what the robot that solves has found, seconds.
const AUDITED_S: f64 = 8.0;
/// and keyframes may lie so far from where they have them, metres: as far as two findings that agree.
const MOVED_AT_MOST_M: f64 = 0.2;
/// Of so many keyframes one may be called contradicted by mistake: where a robot's readings and its ways disagree a little the map as it is now
/// bears out what it did not when the keyframe was taken in.
const CONTRADICTED_OF: usize = 100;

/// A solution that is read as its records come.
pub(super) struct Followed {
    pub(super) replay: Replay,
    /// When its map has changed last, how many sightings there were then, and whether it was looked at since.
    pub(super) changed: Stamp,
    pub(super) sightings: usize,
    pub(super) is_audited: bool,
}

impl Followed {
    pub(super) fn new(replay: Replay, now: Stamp, inbox: &Inbox) -> Self {
        Self { replay, changed: now, sightings: inbox.sightings(), is_audited: true }
    }

    /// Whether nothing new has come for a while, and it was not looked at since.
    pub(super) fn is_due(&self, now: Stamp) -> bool {
        !self.is_audited && (self.replay.is_settled || now.secs_since(self.changed) >= AUDITED_S)
    }

    /// Whether readings bear out what it says.
    pub(super) fn is_true(&mut self, settings: &Settings, ways: &mut WaysSeen) -> bool {
        self.is_audited = true;
        let Audit { closures, contradictions, moved_m } = audit(settings, self.replay.session(), ways);
        let are_most = |[all, wrong]: [usize; 2]| 2 * wrong > all;
        let are_many = CONTRADICTED_OF * contradictions[1] > self.replay.session().keyframes().len();
        let is_moved = moved_m.is_none_or(|moved_m| moved_m > MOVED_AT_MOST_M);
        !(are_most(closures) || is_moved || are_many && are_most(contradictions))
    }

    /// Whether there is nothing to add to it.
    pub(super) fn is_complete(&self, inbox: &Inbox) -> bool {
        let has_all = |(chain, groups): (ChainId, usize)| self.replay.taken.get(&chain).copied().unwrap_or(0) == groups;
        self.replay.is_settled && self.sightings == inbox.sightings() && inbox.groups().all(has_all)
    }
}
