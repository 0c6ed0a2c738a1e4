//! Recordings with stretches of time missing.

use crate::drive::Event;
use crate::perturb::HasScan;
use mapwright_geom::Stamp;
use std::fmt;

/// A stretch of time in which nothing was recorded.
///
/// It begins with a scan, the first that is not stamped before a share of the time from a recording's first scan to its last.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gap {
    begins_at: f64,
    lasts_s: f64,
}

/// When something was recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EventTime {
    /// Its stamp.
    pub stamp: Stamp,
    /// A scan; else a reading of the wheels.
    pub is_scan: bool,
}

/// Why a recording cannot have a gap.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum GapError {
    /// It would begin before the recording or after it.
    NoShare {
        /// Where it was to begin.
        begins_at: f64,
    },
    /// It would last no time, or for ever.
    NoTime {
        /// How long it was to last, seconds.
        lasts_s: f64,
    },
    /// The recording has no two scans with time between them.
    NoSpan {
        /// Scans that there are.
        scans: usize,
    },
    /// It would not end with the last scan, so that nothing is left after it.
    NothingAfter {
        /// The gap.
        gap: Gap,
        /// Seconds from where it begins to the last scan.
        left_s: f64,
    },
}

impl fmt::Display for GapError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoShare { begins_at } => {
                write!(f, "expected a gap's begin as a share from 0 to 1, found {begins_at}")
            }
            Self::NoTime { lasts_s } => {
                write!(f, "expected a gap of more than 0 seconds, found {lasts_s}")
            }
            Self::NoSpan { scans } => {
                write!(
                    f,
                    "expected scans over some time to have a gap in, found {scans} without time from the first to the last"
                )
            }
            Self::NothingAfter { gap, left_s } => {
                write!(f, "gap {gap}: expected scans after it, found that the last comes {left_s:.3} s after it begins")
            }
        }
    }
}

impl std::error::Error for GapError {}

/// As `mapwright perturb --gap` takes it.
impl fmt::Display for Gap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.begins_at, self.lasts_s)
    }
}

impl Gap {
    /// A gap of `lasts_s` seconds that begins at a share, 0 to 1, of the time from the first scan to the last.
    ///
    /// # Errors
    /// [`GapError::NoShare`], [`GapError::NoTime`].
    pub fn new(begins_at: f64, lasts_s: f64) -> Result<Self, GapError> {
        if !(0.0..=1.0).contains(&begins_at) {
            return Err(GapError::NoShare { begins_at });
        }
        if !(lasts_s > 0.0 && lasts_s.is_finite()) {
            return Err(GapError::NoTime { lasts_s });
        }
        Ok(Self { begins_at, lasts_s })
    }

    /// Where it begins, a share of the time from the first scan to the last.
    #[must_use]
    pub fn begins_at(&self) -> f64 {
        self.begins_at
    }

    /// How long it lasts, seconds.
    #[must_use]
    pub fn lasts_s(&self) -> f64 {
        self.lasts_s
    }

    /// Marks what lies in it.
    ///
    /// The order of the recording is the order of events, whatever its stamps: all scans from the one that begins the gap
    /// up to, not including, the next with a stamp `lasts_s` later or more; and of the readings between them those that are
    /// not stamped later either.
    fn mark(&self, times: &[EventTime], missing: &mut [bool]) -> Result<(), GapError> {
        let scans = || times.iter().enumerate().filter(|(_, time)| time.is_scan);
        let (Some((_, first)), Some((_, last))) = (scans().next(), scans().next_back()) else {
            return Err(GapError::NoSpan { scans: 0 });
        };
        let span_s = last.stamp.secs_since(first.stamp);
        if span_s <= 0.0 {
            return Err(GapError::NoSpan { scans: scans().count() });
        }
        let begins_s = self.begins_at * span_s;
        let since_first_s = |time: &EventTime| time.stamp.secs_since(first.stamp);
        let begin = scans().find(|(_, scan)| since_first_s(scan) >= begins_s);
        let (begin, ends_s) = begin.map_or((0, self.lasts_s), |(at, scan)| (at, since_first_s(scan) + self.lasts_s));
        let end = scans().find(|(at, scan)| *at > begin && since_first_s(scan) >= ends_s);
        let Some((end, _)) = end else {
            return Err(GapError::NothingAfter { gap: *self, left_s: span_s + self.lasts_s - ends_s });
        };
        for (time, missing) in times.iter().zip(missing).take(end).skip(begin) {
            *missing |= time.is_scan || since_first_s(time) < ends_s;
        }
        Ok(())
    }
}

/// Which of a recording's events, in its order, lie in one of the gaps; each gap is that of the whole recording.
///
/// # Errors
/// [`GapError::NoSpan`], [`GapError::NothingAfter`].
pub fn in_gaps(times: &[EventTime], gaps: &[Gap]) -> Result<Vec<bool>, GapError> {
    let mut missing = vec![false; times.len()];
    gaps.iter().try_for_each(|gap| gap.mark(times, &mut missing))?;
    Ok(missing)
}

impl<S: HasScan> Event<S> {
    /// When it was recorded.
    #[must_use]
    pub fn event_time(&self) -> EventTime {
        match self {
            Self::Odometry(odometry) => EventTime { stamp: odometry.stamp, is_scan: false },
            Self::Scan(scan) => EventTime { stamp: scan.scan().stamp, is_scan: true },
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;

    const SCAN: bool = true;
    const WHEELS: bool = false;

    fn at(tenths: i64, is_scan: bool) -> EventTime {
        EventTime { stamp: Stamp(tenths * 100_000_000), is_scan }
    }

    /// Eleven scans a second apart, the wheels read half a second after each; the stamps begin late.
    fn ten_seconds() -> Vec<EventTime> {
        let mut times: Vec<_> = (0..10).flat_map(|k| [at(5000 + 10 * k, SCAN), at(5005 + 10 * k, WHEELS)]).collect();
        times.push(at(5100, SCAN));
        times
    }

    /// The tenths of seconds that are left, from 500 s on.
    fn left(times: &[EventTime], gaps: &[(f64, f64)]) -> Vec<i64> {
        let gaps: Vec<_> = gaps.iter().map(|&(begins_at, lasts_s)| Gap::new(begins_at, lasts_s).unwrap()).collect();
        let missing = in_gaps(times, &gaps).unwrap();
        let kept = times.iter().zip(missing).filter(|(_, missing)| !missing);
        kept.map(|(time, _)| time.stamp.0 / 100_000_000 - 5000).collect()
    }

    #[test]
    fn a_gap_begins_with_a_scan_and_ends_with_one() {
        let times = ten_seconds();
        let expected = |taken: std::ops::Range<i64>| -> Vec<_> {
            times.iter().map(|m| m.stamp.0 / 100_000_000 - 5000).filter(|t| !taken.contains(t)).collect()
        };
        assert_eq!(left(&times, &[(0.3, 2.0)]), expected(30..50));
        assert_eq!(left(&times, &[(0.21, 2.0)]), expected(30..50), "the next scan begins it");
        assert_eq!(left(&times, &[(0.0, 10.0)]), [100]);
        assert_eq!(left(&times, &[(0.3, 1.0), (0.4, 1.0), (0.3, 1.5)]), expected(30..50), "gaps add up");
    }

    #[test]
    fn readings_after_the_time_stay() {
        assert_eq!(left(&ten_seconds(), &[(0.5, 0.2)]), {
            let mut all = left(&ten_seconds(), &[]);
            all.retain(|&t| t != 50);
            all
        });
    }

    #[test]
    fn the_order_of_the_recording_counts() {
        // the scan at 30 steps back before the gap's begin, reading 55 and scan 50 into it once it is over
        let times =
            [(0, SCAN), (40, SCAN), (30, SCAN), (45, WHEELS), (60, SCAN), (55, WHEELS), (50, SCAN), (100, SCAN)];
        let times = times.map(|(tenths, is_scan)| at(5000 + tenths, is_scan));
        assert_eq!(left(&times, &[(0.4, 2.0)]), [0, 60, 55, 50, 100]);
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let refused = |begins_at, lasts_s| Gap::new(begins_at, lasts_s).unwrap_err().to_string();
        for begins_at in [-0.1, 1.1, f64::NAN] {
            assert!(refused(begins_at, 1.0).contains("share from 0 to 1"));
        }
        for lasts_s in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(refused(0.5, lasts_s).contains("more than 0"));
        }
        let error = |times: &[EventTime], begins_at, lasts_s| {
            in_gaps(times, &[Gap::new(begins_at, lasts_s).unwrap()]).unwrap_err()
        };
        assert_eq!(error(&[], 0.5, 1.0), GapError::NoSpan { scans: 0 });
        assert_eq!(error(&[at(1, SCAN), at(90, WHEELS)], 0.5, 1.0), GapError::NoSpan { scans: 1 });
        assert_eq!(error(&[at(1, SCAN), at(1, SCAN)], 0.5, 1.0), GapError::NoSpan { scans: 2 });
        let late = error(&ten_seconds(), 0.8, 2.5).to_string();
        assert!(late.contains("gap 0.8:2.5") && late.contains("2.000 s"), "{late}");
        assert!(matches!(error(&ten_seconds(), 1.0, 0.1), GapError::NothingAfter { .. }));
        let extremes =
            [EventTime { stamp: Stamp(i64::MIN), is_scan: true }, EventTime { stamp: Stamp(i64::MAX), is_scan: true }];
        assert_eq!(in_gaps(&extremes, &[Gap::new(0.0, 1.0).unwrap()]), Ok(vec![true, false]));
    }
}
