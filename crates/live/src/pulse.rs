//! Whether what comes regularly still comes.

use std::time::Duration;

/// Weight of the newest in the running mean of the time between two messages.
const WEIGHT: f64 = 0.1;
/// What is not heard for so many of its usual periods, and so long at least, has fallen silent.
const PERIODS: f64 = 10.0;
const LEAST: Duration = Duration::from_secs(1);

/// When something was heard last, and how often it is.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Pulse {
    last: Option<Duration>,
    period_s: Option<f64>,
}

impl Pulse {
    /// It is heard now, in time since the start.
    pub(crate) fn beat(&mut self, now: Duration) {
        if let Some(last) = self.last {
            let elapsed_s = now.saturating_sub(last).as_secs_f64();
            let period_s = self.period_s.unwrap_or(elapsed_s);
            self.period_s = Some(period_s + WEIGHT * (elapsed_s - period_s));
        }
        self.last = Some(now);
    }

    /// For how long it has not been heard: since the start where it never was.
    pub(crate) fn silence(&self, now: Duration) -> Duration {
        now.saturating_sub(self.last.unwrap_or_default())
    }

    pub(crate) fn is_heard_of(&self) -> bool {
        self.last.is_some()
    }

    /// How it fell silent, in words; none while it comes as usual.
    pub(crate) fn fallen_silent(&self, now: Duration) -> Option<String> {
        let (silence, period_s) = (self.silence(now), self.period_s.filter(|_| self.is_heard_of())?);
        let is_silent = silence > LEAST && silence.as_secs_f64() > PERIODS * period_s;
        is_silent.then(|| {
            let hertz = 1.0 / period_s.max(1e-6);
            format!("silent for {:.1} s; before that it came {hertz:.1} times a second", silence.as_secs_f64())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_came_ten_times_a_second_is_missed_after_one() {
        let mut pulse = Pulse::default();
        let at = |ms: u64| Duration::from_millis(ms);
        assert!(pulse.fallen_silent(at(60_000)).is_none(), "never heard of");
        (0..50).for_each(|k| pulse.beat(at(100 * k)));
        assert!(pulse.fallen_silent(at(5_800)).is_none());
        let words = pulse.fallen_silent(at(6_000)).unwrap();
        assert_eq!(words, "silent for 1.1 s; before that it came 10.0 times a second");
        assert_eq!(pulse.silence(at(6_000)), at(1_100));
    }
}
