//! Whether times of points are those of a sweep, by how often sweeps come.

use mapwright_geom::Stamp;

/// Sweeps that come so many times faster than one lasts are none: neighbours overlap a little, and some drivers publish the last two
/// together.
const OVERLAP_MOST: f64 = 2.5;
/// Of times that end where shares of a sweep would.
const OVERLAP_OF_SHARES: f64 = 1.2;
/// Times that count from 0 to 1 have a sweep's last point within this of 1.
const SHARES: std::ops::RangeInclusive<f64> = 0.9..=1.001;
/// Lidars turn five times a second or faster, seconds; what comes more seldom is every so many sweeps only, and says nothing of one.
const SWEEP_MOST_S: f64 = 0.25;
/// Between sweeps of an even rate the mean time is the usual one, up to this share.
const EVEN_SHARE: f64 = 0.2;

/// What times of points are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SweepTimes {
    /// What they say they are.
    Seconds,
    /// Shares of a sweep, which lasts so long: from one cloud to the next, seconds.
    Shares {
        /// One of it.
        sweep_s: f64,
    },
    /// Of no sweep: clouds come so much faster.
    Refused {
        /// From one cloud to the next, seconds.
        interval_s: f64,
    },
}

impl SweepTimes {
    /// Of clouds with these stamps whose points span so many seconds at most, as their times are understood.
    #[must_use]
    pub fn of(span_s: f64, stamps: &[Stamp]) -> Self {
        let Some([usual_s, mean_s]) = intervals_s(stamps) else { return Self::Seconds };
        let are_like_shares = SHARES.contains(&span_s);
        let overlap_most = if are_like_shares { OVERLAP_OF_SHARES } else { OVERLAP_MOST };
        if span_s <= overlap_most * usual_s.max(mean_s) {
            return Self::Seconds;
        }
        let is_even = (mean_s - usual_s).abs() <= EVEN_SHARE * usual_s;
        if is_even && are_like_shares && usual_s <= SWEEP_MOST_S {
            return Self::Shares { sweep_s: usual_s };
        }
        Self::Refused { interval_s: usual_s }
    }

    /// How long a unit of the times lasts, seconds; none where they are to be left out.
    #[must_use]
    pub fn unit_s(self) -> Option<f64> {
        match self {
            Self::Seconds => Some(1.0),
            Self::Shares { sweep_s } => Some(sweep_s),
            Self::Refused { .. } => None,
        }
    }
}

/// The median and the mean of the times between stamps; of one or two clouds nothing is known.
fn intervals_s(stamps: &[Stamp]) -> Option<[f64; 2]> {
    let mut intervals: Vec<f64> = stamps.windows(2).map(|pair| pair[1].secs_since(pair[0])).collect();
    intervals.retain(|interval_s| *interval_s > 0.0);
    if intervals.len() < 2 {
        return None;
    }
    let mean_s = intervals.iter().sum::<f64>() / intervals.len() as f64;
    let middle = intervals.len() / 2;
    Some([*intervals.select_nth_unstable_by(middle, f64::total_cmp).1, mean_s])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn each(ms: &[i64]) -> Vec<Stamp> {
        let mut at = 0;
        let stamps = ms.iter().map(|step| {
            at += step * 1_000_000;
            Stamp(at)
        });
        std::iter::once(Stamp(0)).chain(stamps).collect()
    }

    #[test]
    fn times_are_compared_with_the_time_between_clouds() {
        let of = |span_s: f64, ms: &[i64]| SweepTimes::of(span_s, &each(ms));
        for (span_s, ms) in [
            (0.1, [100; 9]),
            (0.13, [100; 9]),                         // reaches into the next sweep
            (0.2, [100; 9]),                          // two sweeps in each cloud
            (0.1, [300; 9]),                          // every third sweep
            (0.1, [1, 1, 298, 1, 1, 298, 1, 1, 298]), // stamped in bursts
            (0.1, [100, 100, 5000, 100, 100, 100, 100, 100, 100]),
            (1.0, [1000; 9]),
        ] {
            assert_eq!(of(span_s, &ms), SweepTimes::Seconds, "{span_s} {ms:?}");
        }
        assert_eq!(of(0.9997, &[125; 9]), SweepTimes::Shares { sweep_s: 0.125 });
        assert_eq!(of(1.0, &[375; 9]), SweepTimes::Refused { interval_s: 0.375 });
        assert_eq!(of(1.0, &[500; 9]), SweepTimes::Refused { interval_s: 0.5 });
        assert_eq!(of(0.5, &[125; 9]), SweepTimes::Refused { interval_s: 0.125 });
        assert_eq!([of(1.0, &[]), of(1.0, &[100])], [SweepTimes::Seconds; 2]);
        assert_eq!(SweepTimes::Refused { interval_s: 0.1 }.unit_s(), None);
    }
}
