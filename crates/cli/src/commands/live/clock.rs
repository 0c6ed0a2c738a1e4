//! What time it is.

use mapwright::Stamp;
use mapwright_live::Arrived;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// The time since the start, by a clock that is never set, and the time that stamps are of: the system's, or what a simulation says.
pub(super) struct Clock {
    started: Instant,
    /// What was said last, nanoseconds; zero before.
    said: Option<AtomicI64>,
}

impl Clock {
    pub(super) fn start(is_said: bool) -> Self {
        Self { started: Instant::now(), said: is_said.then(|| AtomicI64::new(0)) }
    }

    pub(super) fn since_start(&self) -> Duration {
        self.started.elapsed()
    }

    /// A simulation says what time it is.
    pub(super) fn say(&self, stamp: Stamp) {
        if let Some(said) = &self.said {
            said.store(stamp.0, Ordering::Relaxed);
        }
    }

    /// The time that stamps are of; none before a simulation has said any.
    pub(super) fn stamp(&self) -> Option<Stamp> {
        match &self.said {
            Some(said) => Some(Stamp(said.load(Ordering::Relaxed))).filter(|stamp| stamp.0 > 0),
            None => {
                let since = SystemTime::now().duration_since(UNIX_EPOCH).ok()?;
                Some(Stamp(i64::try_from(since.as_nanos()).ok()?))
            }
        }
    }

    /// What arrives now.
    pub(super) fn arrived(&self) -> Arrived {
        Arrived { since_start: self.since_start(), stamp: self.stamp().unwrap_or(Stamp(0)) }
    }
}
