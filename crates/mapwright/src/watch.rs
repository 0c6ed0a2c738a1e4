//! Since when nothing was seen, and how many scans in a row fitted nowhere: what tells that the robot may be elsewhere.

use mapwright_geom::{Stamp, stored};

/// Misfits in a row that are counted.
const MISFITS_AT_MOST: u32 = 1000;

/// What is remembered for that.
#[derive(Debug, Clone, Copy, Default)]
pub struct Watch {
    /// Scans in a row that were not believed.
    pub(crate) misfits: u32,
    /// The last scan that saw something, and how many have seen nothing since.
    pub(crate) seen: Option<Stamp>,
    pub(crate) blank: u32,
    /// The last reading of the wheels or scan, and the longest time without either that no scan has ended yet: readings may be told
    /// before scans that are older.
    pub(crate) heard: Option<Stamp>,
    pub(crate) silence: Option<(Stamp, Stamp)>,
}

stored!(Watch { misfits, seen, blank, heard, silence });

impl Watch {
    /// Whether it may have come about.
    pub(crate) fn is_sound(&self) -> bool {
        self.misfits <= MISFITS_AT_MOST
    }

    /// A reading of the wheels, or a scan.
    pub(crate) fn hear(&mut self, stamp: Stamp) {
        let longest_s = self.silence.map_or(0.0, |(from, to)| to.secs_since(from));
        if let Some(heard) = self.heard.filter(|heard| stamp.secs_since(*heard) > longest_s) {
            self.silence = Some((heard, stamp));
        }
        self.heard = self.heard.max(Some(stamp));
    }

    /// The longest time up to now in which neither the wheels nor the sensor said anything, since a scan saw something, seconds.
    pub(crate) fn silence_s(&self, stamp: Stamp) -> f64 {
        let until_now = self.heard.map(|heard| (heard, stamp));
        let seconds =
            |(from, to): (Stamp, Stamp)| to.min(stamp).secs_since(self.seen.map_or(from, |seen| from.max(seen)));
        self.silence.into_iter().chain(until_now).map(seconds).fold(0.0, f64::max)
    }

    /// Scans in a row before this one that saw nothing, and the time since one did, seconds.
    pub(crate) fn blind(&self, stamp: Stamp) -> (u32, f64) {
        (self.blank, self.seen.map_or(0.0, |seen| stamp.secs_since(seen)))
    }

    /// A scan was matched: whether that is believed.
    pub(crate) fn note(&mut self, is_misfit: bool) {
        self.misfits = if is_misfit { (self.misfits + 1).min(MISFITS_AT_MOST) } else { 0 };
    }

    /// A scan sees something,
    pub(crate) fn see(&mut self, stamp: Stamp) {
        (self.seen, self.blank, self.heard) = (Some(stamp), 0, self.heard.max(Some(stamp)));
        self.silence = self.silence.filter(|(_, to)| *to > stamp);
    }

    /// or nothing.
    pub(crate) fn see_nothing(&mut self, stamp: Stamp) {
        self.blank = self.blank.saturating_add(1);
        self.hear(stamp);
    }

    /// Something new is mapped from this scan on.
    pub(crate) fn begin_anew(&mut self, stamp: Stamp) {
        self.misfits = 0;
        self.see(stamp);
    }
}
