//! How far a run was at what time and with how much memory, at a bounded number of scans.

use serde_json::{Value, json};

/// Scans at which it is noted, at most; from there on at every second of them, and so on. To ask the system for memory takes some 50 us: of
/// intel's 13,631 scans it is asked at some 300.
const SAMPLES: usize = 64;

/// Notes in the order of the scans.
#[derive(Debug, Clone)]
pub(crate) struct Pace {
    samples: Vec<Sample>,
    /// Scans from one note to the next,
    stride: u64,
    /// and those since the last one.
    passed: u64,
}

#[derive(Debug, Clone, Copy)]
struct Sample {
    scan: u64,
    elapsed_s: f64,
    memory_mib: Option<f64>,
}

impl Default for Pace {
    fn default() -> Self {
        Self { samples: Vec::with_capacity(SAMPLES), stride: 1, passed: 0 }
    }
}

impl Pace {
    /// Takes note of a scan, by its number, if it is time to; time and memory are asked for then alone.
    pub(crate) fn scan(&mut self, scan: u64, spent: impl FnOnce() -> (f64, Option<f64>)) {
        self.passed += 1;
        if self.passed < self.stride && !self.samples.is_empty() {
            return;
        }
        self.passed = 0;
        if self.samples.len() == SAMPLES {
            let mut is_kept = false;
            self.samples.retain(|_| {
                is_kept = !is_kept;
                is_kept
            });
            self.stride *= 2;
        }
        let (elapsed_s, memory_mib) = spent();
        self.samples.push(Sample { scan, elapsed_s, memory_mib });
    }

    /// For `timing.json`: number of the scan, seconds since the start, MiB.
    pub(crate) fn report(&self) -> Value {
        let column = |pick: fn(&Sample) -> Value| self.samples.iter().map(pick).collect::<Value>();
        json!({
            "scan": column(|sample| json!(sample.scan)),
            "elapsed_s": column(|sample| json!(sample.elapsed_s)),
            "memory_mib": column(|sample| json!(sample.memory_mib)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_are_few_in_order_and_evenly_spread() {
        let mut pace = Pace::default();
        let mut asked = 0;
        for scan in 0..100_000 {
            pace.scan(scan, || {
                asked += 1;
                (scan as f64, None)
            });
        }
        let scans: Vec<u64> = pace.samples.iter().map(|sample| sample.scan).collect();
        assert!((SAMPLES / 2..=SAMPLES).contains(&scans.len()) && asked < 1000, "{} {asked}", scans.len());
        assert!(scans[0] == 0 && scans[scans.len() - 1] > 98_000);
        let steps: Vec<u64> = scans.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let (least, most) = (steps.iter().min().unwrap_or(&0), steps.iter().max().unwrap_or(&0));
        assert!(*least > 0 && most <= &(2 * least), "{steps:?}");
    }
}
