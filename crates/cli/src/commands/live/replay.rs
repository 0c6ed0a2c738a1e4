//! A run, replayed from a recording of what it heard.
//!
//! Scans that were dropped then are left out, and each result of loop closing is taken in before the same scan: the same bytes.

use crate::failure::Failure;
use mapwright::{Maps, Session, Stamp};
use mapwright_live::Results;
use std::collections::HashSet;
use std::path::Path;

/// What a run did, as its session has it.
#[derive(Debug, Clone)]
pub(super) struct Replay {
    /// Those of its scans.
    stamps: HashSet<Stamp>,
    /// Before which scans results are still to be taken in, by the number of scans there are.
    results: std::vec::IntoIter<u64>,
}

impl Replay {
    /// What the session of a run says of what came after the first scans, of another run that it went on with.
    pub(super) fn of<M: Maps>(path: &Path, session: &Session<M>, first: u64) -> Result<Self, Failure> {
        let refused = |cause: &str| Failure::Session { path: path.to_owned(), cause: cause.to_owned() };
        let scans = session.scans().get(usize::try_from(first).unwrap_or(usize::MAX)..).unwrap_or_default();
        if scans.is_empty() {
            return Err(refused("expected the scans of a run, found none"));
        }
        let results: Vec<u64> = session.results_taken_in().iter().copied().filter(|scan| *scan > first).collect();
        if results.is_empty() && !session.candidates().is_empty() {
            return Err(refused(
                "expected a run that says when it took in what came of loop closing, found one that waited for it: \
                 `--set loops.jobs=inline` instead of --replay",
            ));
        }
        Ok(Self { stamps: scans.iter().map(|scan| scan.stamp).collect(), results: results.into_iter() })
    }

    /// Whether the run has mapped a scan.
    pub(super) fn has(&self, stamp: Stamp) -> bool {
        self.stamps.contains(&stamp)
    }

    /// What is to be taken in where so many scans were mapped.
    pub(super) fn due(&mut self, scans: u64) -> Results {
        let count = self.results.as_slice().partition_point(|before| *before <= scans);
        self.results.by_ref().take(count).for_each(drop);
        Results::These(count)
    }
}
