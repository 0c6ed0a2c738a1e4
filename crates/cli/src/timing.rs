//! Where the time goes: the only clock in the house.

use crate::pace::Pace;
use mapwright::{Probe, Stage};
use serde_json::{Value, json};
use std::fs;
use std::time::{Duration, Instant};

const STAGES: [(Stage, &str); 5] = [
    (Stage::Prepare, "prepare"),
    (Stage::Predict, "predict"),
    (Stage::Match, "match"),
    (Stage::Insert, "insert"),
    (Stage::Close, "close"),
];

/// Times the stages of the pipeline, and the whole around them.
#[derive(Debug, Clone)]
pub(crate) struct StageClock {
    started: Instant,
    last: Instant,
    stages: [Duration; STAGES.len()],
    scanning: Duration,
    pace: Pace,
}

impl StageClock {
    pub(crate) fn start() -> Self {
        let now = Instant::now();
        let stages = [Duration::ZERO; STAGES.len()];
        Self { started: now, last: now, stages, scanning: Duration::ZERO, pace: Pace::default() }
    }

    /// A scan is through, by its number.
    pub(crate) fn scan(&mut self, scan: u64) {
        let started = self.started;
        self.pace.scan(scan, || (started.elapsed().as_secs_f64(), memory_mib("VmRSS:")));
    }

    /// All scans are through; what comes is writing.
    pub(crate) fn end_of_scans(&mut self) {
        self.scanning = self.started.elapsed();
    }

    /// Seconds since the start.
    pub(crate) fn elapsed_s(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    /// Everything for `timing.json`; reading is what the scanning took beyond the pipeline.
    pub(crate) fn report(&self, scans: u64, log_s: f64) -> Value {
        let total_s = self.elapsed_s();
        let pipeline: Duration = self.stages.iter().sum();
        let mut stages = serde_json::Map::new();
        stages.insert("read".into(), json!(self.scanning.saturating_sub(pipeline).as_secs_f64()));
        for ((_, name), spent) in STAGES.iter().zip(&self.stages) {
            stages.insert((*name).into(), json!(spent.as_secs_f64()));
        }
        stages.insert("write".into(), json!(total_s - self.scanning.as_secs_f64()));
        json!({
            "total_s": total_s,
            "stages_s": stages,
            "scans_per_second": scans as f64 / total_s,
            "times_real_time": log_s / total_s,
            "peak_memory_mib": peak_memory_mib(),
            "over_the_run": self.pace.report(),
        })
    }
}

impl Probe for StageClock {
    fn begin(&mut self) {
        self.last = Instant::now();
    }

    fn end(&mut self, stage: Stage) {
        let now = Instant::now();
        if let Some(at) = STAGES.iter().position(|&(s, _)| s == stage) {
            self.stages[at] += now - self.last;
        }
        self.last = now;
    }
}

/// What a thread's work takes: CPU time where the system says (Linux), else the time that passes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ThreadClock {
    cpu_ns: Option<u64>,
    wall: Instant,
}

impl ThreadClock {
    pub(crate) fn start() -> Self {
        Self { cpu_ns: thread_cpu_ns(), wall: Instant::now() }
    }

    /// Seconds since the start, asked in the same thread.
    pub(crate) fn spent_s(&self) -> f64 {
        match self.cpu_ns.zip(thread_cpu_ns()) {
            Some((before, now)) => 1e-9 * now.saturating_sub(before) as f64,
            None => self.wall.elapsed().as_secs_f64(),
        }
    }
}

/// The first number of `schedstat`: nanoseconds on a CPU.
fn thread_cpu_ns() -> Option<u64> {
    fs::read_to_string("/proc/thread-self/schedstat").ok()?.split(' ').next()?.parse().ok()
}

/// Most memory the process ever had, where the system says so.
pub(crate) fn peak_memory_mib() -> Option<f64> {
    memory_mib("VmHWM:")
}

/// What the system says under a name.
fn memory_mib(name: &str) -> Option<f64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(name))?;
    let kib: f64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(kib / 1024.0)
}
