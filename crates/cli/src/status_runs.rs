//! Scans in a row with the same status.

use mapwright::{Stamp, Status};
use serde_json::{Value, json};

/// Runs of equal status that are listed; further ones are only counted.
const RUNS_KEPT: usize = 1000;

/// Scans in a row with the same status.
#[derive(Debug, Clone, Copy)]
struct Run {
    status: Status,
    first_scan: u64,
    scans: u64,
    from: Stamp,
    to: Stamp,
}

/// All of them; memory is bounded.
#[derive(Debug, Clone, Default)]
pub(crate) struct StatusRuns {
    runs: Vec<Run>,
    in_all: u64,
    open: Option<Run>,
}

impl StatusRuns {
    /// Takes note of the next scan.
    pub(crate) fn add(&mut self, status: Status, scan: u64, stamp: Stamp) {
        match &mut self.open {
            Some(run) if run.status == status => {
                run.scans += 1;
                run.to = stamp;
            }
            _ => {
                self.close();
                self.open = Some(Run { status, first_scan: scan, scans: 1, from: stamp, to: stamp });
            }
        }
    }

    fn close(&mut self) {
        if let Some(run) = self.open.take() {
            self.in_all += 1;
            if self.runs.len() < RUNS_KEPT {
                self.runs.push(run);
            }
        }
    }

    /// How many there are, and the first of them.
    pub(crate) fn report(&self) -> (u64, Vec<Value>) {
        let mut all = self.clone();
        all.close();
        (all.in_all, all.runs.iter().map(Run::report).collect())
    }
}

impl Run {
    fn report(&self) -> Value {
        json!({
            "status": self.status.name(),
            "first_scan": self.first_scan,
            "scans": self.scans,
            "from_s": self.from.as_secs_f64(),
            "to_s": self.to.as_secs_f64(),
        })
    }
}
