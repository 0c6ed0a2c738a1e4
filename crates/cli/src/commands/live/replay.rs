//! A run, replayed from a recording of what it heard.
//!
//! Scans that were dropped then are left out, and each result of loop closing is taken in before the same scan: the same bytes.

use crate::failure::Failure;
use crate::terminal::count;
use mapwright::{Maps, Session, Settings, Stamp};
use mapwright_live::Results;
use std::collections::HashMap;
use std::path::Path;

/// What a run did, as its session has it.
#[derive(Debug, Clone)]
pub(super) struct Replay {
    /// Its scans that have not come yet, by their stamps, of which lasers that sweep at once share one.
    stamps: HashMap<Stamp, u32>,
    /// Before which scans results are still to be taken in, by the number of scans there are.
    results: std::vec::IntoIter<u64>,
    /// How many should have been taken in by now, and were.
    due: usize,
    taken: usize,
    /// One that should have been was not there.
    is_another: bool,
}

impl Replay {
    /// What the session of a run says of what came after the first scans, of another run that it went on with.
    pub(super) fn of<M: Maps>(
        path: &Path,
        session: &Session<M>,
        first: u64,
        settings: &Settings,
    ) -> Result<Self, Failure> {
        let refused = |cause: &str| Failure::Session { path: path.to_owned(), cause: cause.to_owned() };
        let scans = session.scans().get(usize::try_from(first).unwrap_or(usize::MAX)..).unwrap_or_default();
        if scans.is_empty() {
            return Err(refused("expected the scans of a run, found none"));
        }
        if session.runs().last().is_none_or(|run| run.settings != settings.to_text()) {
            return Err(refused("expected a run with the settings that are asked for now, found one with others"));
        }
        let results: Vec<u64> = session.results_taken_in().iter().copied().filter(|scan| *scan > first).collect();
        if results.is_empty() && !session.candidates().is_empty() {
            return Err(refused(
                "expected a run that says when it took in what came of loop closing, found one that waited for it: \
                 `--set loops.jobs=inline` instead of --replay",
            ));
        }
        let mut stamps = HashMap::new();
        scans.iter().for_each(|scan| *stamps.entry(scan.stamp).or_default() += 1);
        Ok(Self { stamps, results: results.into_iter(), due: 0, taken: 0, is_another: false })
    }

    /// Whether the run has mapped a scan that comes now.
    pub(super) fn take(&mut self, stamp: Stamp) -> bool {
        let left = self.stamps.get_mut(&stamp).filter(|left| **left > 0);
        left.map(|left| *left -= 1).is_some()
    }

    /// What is to be taken in where so many scans were mapped.
    pub(super) fn due(&mut self, scans: u64) -> Results {
        self.is_another |= self.taken < self.due;
        let count = self.results.as_slice().partition_point(|before| *before <= scans);
        self.results.by_ref().take(count).for_each(drop);
        self.due += count;
        Results::These(count)
    }

    /// A result was taken in.
    pub(super) fn taken(&mut self) {
        self.taken += 1;
    }

    /// Why it is not the same run again, if it is not.
    pub(super) fn losses(&self) -> Vec<String> {
        let missing: u64 = self.stamps.values().map(|left| u64::from(*left)).sum();
        let missing = (missing > 0).then(|| format!("not the same run: {} of it did not come", count(missing, "scan")));
        let another = "not the same run: what came of loop closing then was not asked for now".to_owned();
        missing.into_iter().chain(self.is_another.then_some(another)).collect()
    }
}
