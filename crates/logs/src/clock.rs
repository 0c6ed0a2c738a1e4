//! The clocks that topics were stamped by, which are set now and then, and may differ.

use mapwright_geom::Stamp;

/// Stamps may be off by so much without a clock having been set, seconds: those of a logger step back by up to 0.47 s in the log of the
/// Intel lab.
const JITTER_S: f64 = 1.0;
/// A time between two stamps is unusual from so many usual ones on.
const GAP_PERIODS: f64 = 8.0;
/// Weight of the newest time in the usual one.
const PERIOD_WEIGHT: f64 = 0.02;
/// A stamp that steps back by more is no message that was recorded late; by less it is one, unless the ones after it stay behind for so
/// long, seconds.
pub(crate) const LATE_MOST_S: f64 = 5.0;
/// So many messages at least stay behind when a clock was set back.
const LATE_MESSAGES: u32 = 5;
/// Clocks drift apart by at most so much, seconds in a second.
const DRIFT: f64 = 1e-3;
/// Two topics whose stamps lie so far apart at the time of their recording are stamped by different clocks, seconds: nothing is recorded
/// so late.
const APART_S: f64 = 60.0;

/// A clock that was set, or one that differs from that of the other topic.
#[derive(Debug, Clone, PartialEq)]
pub struct ClockStep {
    /// The topic, or the transforms.
    pub name: String,
    /// The message of the recording by which it shows, from 1.
    pub place: u64,
    /// By how much its stamp is later than it should be, seconds; negative where it is earlier.
    pub by_s: f64,
    /// Whether it was so from the topic's first message on.
    pub is_first: bool,
}

/// The clock of one topic.
#[derive(Debug, Clone, Default)]
pub(crate) struct Clock {
    /// The last stamp, and when it was recorded.
    last: Option<(Stamp, Stamp)>,
    period_s: f64,
    /// How much later than the first message the last was recorded, seconds after its stamp; and the least of all.
    delay_s: f64,
    least_delay_s: f64,
    behind: Option<Behind>,
    /// What makes its stamps go on as if it had never been set, nanoseconds.
    shift_ns: i64,
}

/// Messages after a step back that are still behind.
#[derive(Debug, Clone, Copy)]
struct Behind {
    messages: u32,
    for_s: f64,
    /// By at least so much, seconds.
    by_s: f64,
}

impl Clock {
    /// The stamp on a clock that is never set and agrees with that of the `other` topic; and by how much this one was set, seconds.
    pub(crate) fn follow(&mut self, stamp: Stamp, recorded: Stamp, other: &Self) -> (Stamp, Option<f64>) {
        let set_by_s = match self.last.replace((stamp, recorded)) {
            Some((last, last_recorded)) => self.step_s(stamp.secs_since(last), recorded.secs_since(last_recorded)),
            None => other.behind_s(stamp, recorded),
        };
        if let Some(by_s) = set_by_s {
            let shift_ns = self.shift_ns.saturating_sub(Stamp::from_secs_f64(by_s).0);
            let apart_s = Stamp(shift_ns).secs_since(Stamp(other.shift_ns));
            // who is set by as much as the other is set by the same hand
            self.shift_ns = if apart_s.abs() <= JITTER_S { other.shift_ns } else { shift_ns };
        }
        (self.at(stamp), set_by_s)
    }

    /// How many messages up to the last one step back, of which it is open whether they were recorded late or the clock was set.
    pub(crate) fn undecided(&self) -> usize {
        self.behind.map_or(0, |behind| behind.messages as usize)
    }

    /// A stamp on a clock that is never set.
    pub(crate) fn at(&self, stamp: Stamp) -> Stamp {
        Stamp(stamp.0.saturating_add(self.shift_ns))
    }

    /// By how much the clock was set between two stamps, if it was.
    fn step_s(&mut self, by_stamps_s: f64, by_recorder_s: f64) -> Option<f64> {
        let passed_s = if by_recorder_s >= 0.0 { by_recorder_s } else { self.period_s };
        self.delay_s += passed_s - by_stamps_s;
        let later_s = self.delay_s - self.least_delay_s;
        let was_set_ahead = by_recorder_s >= 0.0
            && later_s < -JITTER_S
            && by_stamps_s - by_recorder_s > JITTER_S
            && by_stamps_s > GAP_PERIODS * self.period_s
            && self.period_s > 0.0;
        let was_set_back = by_stamps_s < -LATE_MOST_S || (by_stamps_s < -JITTER_S && by_recorder_s < -JITTER_S);
        let set_by_s = if was_set_ahead || was_set_back {
            Some(by_stamps_s - passed_s)
        } else {
            self.stays_behind_s(by_stamps_s, passed_s, later_s).map(|behind_s| -behind_s)
        };
        if let Some(by_s) = set_by_s {
            self.behind = None;
            self.delay_s += by_s;
        }
        let drifted_s = if self.behind.is_none() { DRIFT * passed_s } else { 0.0 };
        self.least_delay_s = (self.least_delay_s + drifted_s).min(self.delay_s);
        let is_usual = self.period_s == 0.0 || by_stamps_s < GAP_PERIODS * self.period_s;
        if set_by_s.is_none() && by_stamps_s > 0.0 && is_usual {
            let weight = if self.period_s > 0.0 { PERIOD_WEIGHT } else { 1.0 };
            self.period_s += weight * (by_stamps_s - self.period_s);
        }
        set_by_s
    }

    /// By how much stamps have stayed behind since they stepped back, once that is no delay: one that is recorded late is followed by ones
    /// that are not.
    fn stays_behind_s(&mut self, by_stamps_s: f64, passed_s: f64, later_s: f64) -> Option<f64> {
        if self.behind.is_none() && by_stamps_s < -JITTER_S {
            self.behind = Some(Behind { messages: 0, for_s: -passed_s, by_s: later_s });
        }
        let behind = self.behind.as_mut()?;
        if later_s <= JITTER_S {
            self.behind = None;
            return None;
        }
        behind.messages += 1;
        behind.for_s += passed_s;
        behind.by_s = behind.by_s.min(later_s);
        (behind.messages >= LATE_MESSAGES && behind.for_s >= LATE_MOST_S).then_some(behind.by_s)
    }

    /// By how much another topic's first stamp lies ahead of this clock, where that is no delay.
    fn behind_s(&self, stamp: Stamp, recorded: Stamp) -> Option<f64> {
        let (last, last_recorded) = self.last?;
        let ahead_s = stamp.secs_since(self.at(last)) - recorded.secs_since(last_recorded);
        (ahead_s.abs() > APART_S).then_some(ahead_s)
    }
}

/// The times of recording, which go on where the recorder's clock was set back.
#[derive(Debug, Default)]
pub(crate) struct Arrival {
    last: Option<Stamp>,
    shift_ns: i64,
}

impl Arrival {
    /// The time that has passed, on a clock that is never set back.
    pub(crate) fn at(&mut self, recorded: Stamp) -> Stamp {
        let back_s = self.last.map_or(0.0, |last| last.secs_since(recorded));
        if back_s > JITTER_S {
            self.shift_ns = self.shift_ns.saturating_add(Stamp::from_secs_f64(back_s).0);
        }
        self.last = Some(recorded);
        Stamp(recorded.0.saturating_add(self.shift_ns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(s: f64) -> Stamp {
        Stamp::from_secs_f64(s)
    }

    /// Follows stamps that are recorded at these times; the stamps made of them, in seconds.
    fn followed(stamps: &[(f64, f64)]) -> Vec<f64> {
        let (mut clock, other) = (Clock::default(), Clock::default());
        stamps.iter().map(|&(stamp, recorded)| clock.follow(at(stamp), at(recorded), &other).0.as_secs_f64()).collect()
    }

    #[test]
    fn a_clock_that_was_set_goes_on() {
        let back = followed(&[(100.0, 50.0), (100.2, 50.2), (-3499.6, 50.4), (-3499.4, 50.6)]);
        assert_eq!(back.map_ms(), [100_000, 100_200, 100_400, 100_600]);
        let ahead = followed(&[(100.0, 50.0), (100.2, 50.2), (160.4, 50.4), (160.6, 50.6)]);
        assert_eq!(ahead.map_ms(), [100_000, 100_200, 100_400, 100_600]);
        let with_the_recorder = followed(&[(100.0, 100.0), (100.2, 100.2), (40.4, 40.4)]);
        assert_eq!(with_the_recorder.map_ms(), [100_000, 100_200, 100_400]);
    }

    #[test]
    fn pauses_late_messages_and_jitter_are_no_clock_that_was_set() {
        for stamps in [
            [(100.0, 50.0), (100.2, 50.2), (160.0, 110.0), (160.2, 110.2)],
            [(100.0, 50.0), (100.2, 50.2), (100.4, 57.0), (100.6, 57.01)],
            [(100.0, 50.0), (100.2, 50.2), (99.8, 50.4), (100.6, 50.6)],
        ] {
            assert!((followed(&stamps)[3] - stamps[3].0).abs() < 1e-6, "{stamps:?}");
        }
    }

    #[test]
    fn messages_that_are_recorded_late_at_random_set_no_clock() {
        let recorded = |k: u32| 50.0 + 0.2 * f64::from(k) + 1.9 * f64::from(k * k * 7919 % 101) / 101.0;
        let mut late: Vec<_> = (0..400).map(|k| (100.0 + 0.2 * f64::from(k), recorded(k))).collect();
        late.sort_by(|a, b| a.1.total_cmp(&b.1));
        assert!(late.windows(2).any(|pair| pair[1].0 - pair[0].0 < -JITTER_S));
        assert_eq!(followed(&late).map_ms(), late.iter().map(|pair| pair.0).collect::<Vec<_>>().map_ms());
    }

    #[test]
    fn a_clock_that_was_set_back_by_no_more_than_a_delay_shows_when_none_catches_up() {
        let stamps: Vec<_> =
            (0..100).map(|k| 0.2 * f64::from(k)).map(|s| (s - if s > 9.9 { 3.0 } else { 0.0 }, s)).collect();
        let repaired = followed(&stamps);
        assert!(
            (repaired[60] - stamps[60].0).abs() < 1e-6 && (repaired[99] - stamps[99].1).abs() < 1e-6,
            "{repaired:?}"
        );
    }

    #[test]
    fn two_topics_that_are_set_by_the_same_hand_stay_together() {
        let (mut scans, mut odometry) = (Clock::default(), Clock::default());
        for (k, back_s) in [(0, 0.0), (1, 0.0), (2, 3600.0), (3, 3600.0)] {
            let s = 100.0 + 0.2 * f64::from(k) - back_s;
            scans.follow(at(s), at(s), &odometry);
            odometry.follow(at(s + 0.13), at(s + 0.13), &scans);
        }
        assert_eq!(scans.shift_ns, odometry.shift_ns);
        assert!((Stamp(scans.shift_ns).as_secs_f64() - 3600.0).abs() < 0.3);
    }

    #[test]
    fn clocks_that_differ_from_the_beginning_are_brought_together_by_the_recorder() {
        let (mut scans, mut odometry) = (Clock::default(), Clock::default());
        scans.follow(at(1000.0), at(50.0), &odometry);
        let (stamp, by_s) = odometry.follow(at(11_800.1), at(50.1), &scans);
        assert!((stamp.as_secs_f64() - 1000.1).abs() < 1e-6 && by_s.is_some_and(|s| (s - 10_800.0).abs() < 1e-6));
        let (stamp, by_s) = Clock::default().follow(at(995.0), at(50.1), &scans);
        assert_eq!((stamp, by_s), (at(995.0), None), "late, but right");
    }

    #[test]
    fn the_recorders_clock_never_runs_back() {
        let mut arrival = Arrival::default();
        let passed = [10.0, 10.5, 10.3, -3600.0, -3599.0].map(|s| arrival.at(at(s)).as_secs_f64());
        assert_eq!(passed.to_vec().map_ms(), [10_000, 10_500, 10_300, 10_300, 11_300]);
    }

    trait MapMs {
        fn map_ms(&self) -> Vec<i64>;
    }

    impl MapMs for Vec<f64> {
        fn map_ms(&self) -> Vec<i64> {
            self.iter().map(|s| (s * 1e3).round() as i64).collect()
        }
    }
}
