//! The sensor's clock, put on that of the recording.

use mapwright_geom::Stamp;

/// The sensor's clock is not believed where it differs by more from that of the recording, nanoseconds.
const CLOCKS_APART_NS: i64 = 1_000_000_000;

/// A sensor's clock: its first time is that of the recording, further ones go on from there as it says.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Clock {
    last: Option<Last>,
    /// After so long it begins anew, nanoseconds; zero where it does not.
    period_ns: i64,
}

#[derive(Debug, Clone, Copy)]
struct Last {
    stamp: Stamp,
    sensor_ns: i64,
    captured: Stamp,
}

/// What the clock did since it was last read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Tick {
    First,
    /// Nanoseconds went by.
    Passed(i64),
    /// By the recording and by itself nanoseconds went by that have nothing to do with each other: the former are believed.
    Jumped {
        captured_ns: i64,
        sensor_ns: i64,
    },
}

impl Clock {
    pub(super) fn of_period(period_ns: i64) -> Self {
        Self { last: None, period_ns }
    }

    /// The stamp of a time of the sensor's that was captured at another.
    pub(super) fn read(&mut self, sensor_ns: i64, captured: Stamp) -> (Stamp, Tick) {
        let (stamp, tick) = match self.last {
            // a clock that is set by GPS or PTP says when better than the time of arrival does
            None if self.period_ns == 0 && sensor_ns.saturating_sub(captured.0).saturating_abs() <= CLOCKS_APART_NS => {
                (Stamp(sensor_ns), Tick::First)
            }
            None => (captured, Tick::First),
            Some(last) => {
                let step_ns = sensor_ns.saturating_sub(last.sensor_ns);
                let passed_ns = if self.period_ns > 0 { step_ns.rem_euclid(self.period_ns) } else { step_ns };
                let captured_ns = captured.0.saturating_sub(last.captured.0);
                if passed_ns.saturating_sub(captured_ns).saturating_abs() > CLOCKS_APART_NS {
                    let stamp = Stamp(last.stamp.0.saturating_add(captured_ns));
                    (stamp, Tick::Jumped { captured_ns, sensor_ns: passed_ns })
                } else {
                    (Stamp(last.stamp.0.saturating_add(passed_ns)), Tick::Passed(passed_ns))
                }
            }
        };
        self.last = Some(Last { stamp, sensor_ns, captured });
        (stamp, tick)
    }

    /// The stamp of a time that is not far from the last that was read; none before the first.
    pub(super) fn near(&self, sensor_ns: i64) -> Option<Stamp> {
        let last = self.last?;
        let apart_ns = sensor_ns.saturating_sub(last.sensor_ns);
        (apart_ns.saturating_abs() <= CLOCKS_APART_NS).then(|| Stamp(last.stamp.0.saturating_add(apart_ns)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sensors_clock_goes_on_from_the_first_stamp() {
        let mut clock = Clock::default();
        assert_eq!(clock.read(5_000_000_000, Stamp(100)), (Stamp(100), Tick::First));
        assert_eq!(clock.read(5_000_000_070, Stamp(900)), (Stamp(170), Tick::Passed(70)));
        assert_eq!(clock.near(5_000_000_000), Some(Stamp(100)));
        assert_eq!(clock.near(0), None);
        let jump = Tick::Jumped { captured_ns: 100, sensor_ns: -5_000_000_070 };
        assert_eq!(clock.read(0, Stamp(1000)), (Stamp(270), jump));
    }

    #[test]
    fn a_clock_that_is_set_right_is_believed() {
        assert_eq!(Clock::default().read(7_000, Stamp(9_000)), (Stamp(7_000), Tick::First));
        let mut hour = Clock::of_period(3_600_000_000_000);
        hour.read(3_599_999_999_000, Stamp(0));
        assert_eq!(hour.read(500, Stamp(1500)), (Stamp(1500), Tick::Passed(1500)));
    }
}
