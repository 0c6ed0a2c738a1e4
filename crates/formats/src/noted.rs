//! What a report says of something that happens often.

use mapwright_sensor::OddHead;
use std::collections::BTreeMap;

/// Places kept of each kind of remark; further ones are only counted.
pub(crate) const PLACES_KEPT: usize = 20;

/// A count, and the first places (line or message numbers) where it happened.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Noted {
    /// How often.
    pub count: u64,
    /// Where first, at most 20 of them.
    pub first_places: Vec<u64>,
}

impl Noted {
    /// Counts one more, at `place`.
    pub fn note(&mut self, place: u64) {
        self.count += 1;
        if self.first_places.len() < PLACES_KEPT {
            self.first_places.push(place);
        }
    }
}

/// What is odd about heads of scans, each kind once. There are few kinds, so that memory is bounded.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct OddHeads(BTreeMap<&'static str, (String, Noted)>);

impl OddHeads {
    /// Counts one more, at `place`.
    pub fn note(&mut self, place: u64, odd: OddHead) {
        self.0.entry(odd.what).or_insert_with(|| (odd.words, Noted::default())).1.note(place);
    }

    /// What is wrong with the first scan of each kind, in words, and with how many scans.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Noted)> {
        self.0.values().map(|(words, noted)| (words.as_str(), noted))
    }
}

/// Whether a log's events arrived in the order of their stamps, and what was made of it; and of the times themselves.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct OrderReport {
    /// Events that arrived after others of a later stamp, by a moment.
    pub disordered: u64,
    /// Events that were put before others which had arrived before them.
    pub moved: u64,
    /// The robot's way over all such events as they arrived, and by their stamps, metres and radians; where there is no
    /// odometry, how far the ranges of successive scans differ, metres.
    pub ways: [f64; 2],
    /// By how much odometry was found to lag behind the scans, and the standard deviation of that, seconds; it was put right.
    pub lag_s: Option<[f64; 2]>,
    /// Undoing the motion during the sweeps made successive scans less alike: their beams count as taken at once.
    pub at_once: bool,
}

/// Scans whose ranges say nothing, or are not in metres.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RangeReport {
    /// Scans left out, for most of their ranges are beyond what a laser of the plane reaches.
    pub beyond_reach: Noted,
    /// The largest range of these, as it stands in the log.
    pub largest: f32,
    /// Scans without a single range that can be used: each is 0, negative, NaN or nearer than the least range.
    pub blank: Noted,
    /// What is odd about the ranges' limits, in words.
    pub limits: Option<String>,
    /// Readings that are taken for no return, in words.
    pub codes: Option<String>,
}
