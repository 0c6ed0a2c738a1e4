//! The lidar's clock, put on that of whoever receives.

use mapwright_geom::Stamp;

/// A lidar's quartz runs ahead of the host's by no more, nanoseconds a nanosecond: so fast the delay may grow again.
const DRIFT: f64 = 2e-4;
/// Where the lidar's clock falls behind by more, it has stood still or was set: it begins anew, nanoseconds.
const BEHIND_MOST_NS: i64 = 300_000_000;

/// Stamps by the lidar's clock, as late as the least delayed packet says: reads of a serial port come in bursts, the lidar's clock does not.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Clock {
    /// Host's time less the lidar's, and the lidar's time when it was last looked at, nanoseconds.
    last: Option<(i64, i64)>,
}

impl Clock {
    /// The stamp of something that the lidar says was at `lidar_ns`, and that had arrived at a time. Never later than that.
    pub(crate) fn read(&mut self, lidar_ns: i64, arrived: Stamp) -> Stamp {
        let now_ns = arrived.0.saturating_sub(lidar_ns);
        let offset_ns = match self.last {
            Some((offset_ns, then_ns)) => {
                let passed_ns = lidar_ns.saturating_sub(then_ns).max(0);
                let risen_ns = offset_ns.saturating_add((passed_ns as f64 * DRIFT) as i64);
                if now_ns.saturating_sub(risen_ns) > BEHIND_MOST_NS { now_ns } else { now_ns.min(risen_ns) }
            }
            None => now_ns,
        };
        self.last = Some((offset_ns, lidar_ns));
        Stamp(lidar_ns.saturating_add(offset_ns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bursts_do_not_shake_stamps() {
        let mut clock = Clock::default();
        let mut last = Stamp(0);
        for packet in 0..1000_i64 {
            let sent = packet * 2_667_000;
            // read every 16 ms, 1 ms of delay at least
            let arrived = Stamp(5_000_000_000 + (sent / 16_000_000 + 1) * 16_000_000 + 1_000_000);
            let stamp = clock.read(sent, arrived);
            assert!(stamp <= arrived);
            if packet > 20 {
                let step_ns = stamp.0 - last.0;
                assert!((2_600_000..2_700_000).contains(&step_ns), "{packet}: {step_ns}");
            }
            last = stamp;
        }
    }

    #[test]
    fn a_clock_that_stood_still_begins_anew() {
        let mut clock = Clock::default();
        assert_eq!(clock.read(0, Stamp(1_000_000_000)), Stamp(1_000_000_000));
        assert_eq!(clock.read(1_000_000, Stamp(3_000_000_000)), Stamp(3_000_000_000));
        assert!(clock.read(i64::MAX, Stamp(i64::MIN)) <= Stamp(0));
    }
}
