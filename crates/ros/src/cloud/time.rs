//! When each point of a cloud was taken.

use super::access::Access;
use crate::schema::Primitive;
use mapwright_geom::Stamp;

/// Unit of a cloud's times.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)] // the names say it
pub enum TimeUnit {
    Seconds,
    Milliseconds,
    Microseconds,
    Nanoseconds,
}

impl TimeUnit {
    const ALL: [Self; 4] = [Self::Seconds, Self::Milliseconds, Self::Microseconds, Self::Nanoseconds];

    /// One of it in seconds.
    #[must_use]
    pub fn seconds(self) -> f64 {
        match self {
            Self::Seconds => 1.0,
            Self::Milliseconds => 1e-3,
            Self::Microseconds => 1e-6,
            Self::Nanoseconds => 1e-9,
        }
    }
}

/// How a cloud says when its points were taken. Nothing in a message tells the unit; it is found so:
///
/// 1. Integers named `t` or `offset_time` are nanoseconds after the stamp, as Ouster and Livox have it.
/// 2. Doubles that, in some unit, lie within 2 s of the stamp and are not small themselves are times of the same clock.
/// 3. Numbers that are all within 1.5 s of the stamp in some unit are after (or before) it, in the largest such unit;
///    integers cannot be seconds.
/// 4. Doubles and integers that span 1 ms to 1.5 s in some unit are times of another clock: after the first of them.
///
/// Where no unit fits, the points have no times.
#[derive(Debug, Clone, PartialEq)]
pub struct PointTime {
    /// Name of the field.
    pub field: String,
    /// Its unit.
    pub unit: TimeUnit,
    /// Whether times are of the stamp's clock; otherwise they are relative to the stamp, or to the first of the cloud.
    pub absolute: bool,
    /// From the first to the last of the points that were looked at, seconds.
    pub span_s: f64,
    /// What the times count from, by their own clock.
    origin_s: f64,
}

/// A sweep is not longer, seconds.
pub(crate) const SWEEP_S: f64 = 1.5;
/// Times of another clock that span less say nothing, seconds.
const SPAN_LEAST_S: f64 = 1e-3;

impl PointTime {
    pub(super) fn of(field: &str, access: Access, points: &[&[u8]], stamp: Stamp) -> Option<Self> {
        let times = points.iter().map(|point| access.read(point)).filter(|time| time.is_finite());
        let (first, last) = times.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(t), b.max(t)));
        if first > last {
            return None;
        }
        let ends = [first, last];
        let by_stamp = decide(field, access.primitive, ends, stamp.as_secs_f64());
        let (unit, absolute, origin_s) = match by_stamp {
            Some((unit, absolute)) => (unit, absolute, if absolute { stamp.as_secs_f64() } else { 0.0 }),
            None => other_clock(access.primitive, ends).map(|unit| (unit, false, first * unit.seconds()))?,
        };
        let span_s = (last - first) * unit.seconds();
        Some(Self { field: field.to_owned(), unit, absolute, span_s, origin_s })
    }

    /// Seconds after the stamp.
    #[inline]
    pub(super) fn seconds(&self, time: f64) -> f64 {
        time * self.unit.seconds() - self.origin_s
    }
}

fn other_clock(primitive: Primitive, ends: [f64; 2]) -> Option<TimeUnit> {
    let spans = |unit: &TimeUnit| (SPAN_LEAST_S..=SWEEP_S).contains(&((ends[1] - ends[0]) * unit.seconds()));
    let is_fine_enough = primitive != Primitive::F32;
    TimeUnit::ALL.into_iter().find(spans).filter(|_| is_fine_enough)
}

fn decide(field: &str, primitive: Primitive, ends: [f64; 2], stamp_s: f64) -> Option<(TimeUnit, bool)> {
    let is_float = matches!(primitive, Primitive::F32 | Primitive::F64);
    if !is_float && matches!(field, "t" | "offset_time") {
        return Some((TimeUnit::Nanoseconds, false));
    }
    let near_stamp = |unit: &TimeUnit| {
        let seconds = ends.map(|time| time * unit.seconds());
        seconds.iter().all(|time| (time - stamp_s).abs() <= 2.0 && time.abs() > 2.0)
    };
    if primitive == Primitive::F64
        && let Some(unit) = TimeUnit::ALL.into_iter().find(near_stamp)
    {
        return Some((unit, true));
    }
    let in_sweep = |unit: &TimeUnit| ends.iter().all(|time| (time * unit.seconds()).abs() <= SWEEP_S);
    let units = if is_float { &TimeUnit::ALL[..] } else { &TimeUnit::ALL[1..] };
    units.iter().copied().find(in_sweep).map(|unit| (unit, false))
}

#[cfg(test)]
mod tests {
    use super::*;
    use Primitive::{F32, F64, U32};
    use TimeUnit::{Microseconds, Milliseconds, Nanoseconds, Seconds};

    #[test]
    fn times_of_another_clock_count_from_the_first() {
        let [spun, spun_ns] = [[3_000_000_000.0, 3_000_099_900.0], [3e12, 3.0001e12]];
        assert_eq!((decide("timestamp", U32, spun, 1.7e9), decide("timestamp", F64, spun_ns, 1.7e9)), (None, None));
        assert_eq!((other_clock(U32, spun), other_clock(F64, spun_ns)), (Some(Microseconds), Some(Nanoseconds)));
        for (primitive, ends) in [(F32, spun), (U32, [7.0, 7.0]), (F64, [0.0, 1e30])] {
            assert_eq!(other_clock(primitive, ends), None);
        }
    }

    #[test]
    fn units_are_those_of_the_usual_drivers() {
        let now = 1_700_000_000.0;
        for (driver, field, primitive, ends, expected) in [
            ("Ouster", "t", U32, [0.0, 99_990_000.0], Some((Nanoseconds, false))),
            ("Livox", "offset_time", U32, [0.0, 1.0], Some((Nanoseconds, false))),
            ("Velodyne", "time", F32, [-0.1, 0.0], Some((Seconds, false))),
            ("Hesai", "timestamp", F64, [now, now + 0.1], Some((Seconds, true))),
            ("nanoseconds of the epoch", "timestamp", F64, [now * 1e9, (now + 0.1) * 1e9], Some((Nanoseconds, true))),
            ("milliseconds after the stamp", "time", F32, [0.0, 99.9], Some((Milliseconds, false))),
            ("microseconds after the stamp", "time", U32, [0.0, 99_900.0], Some((Microseconds, false))),
            ("nonsense", "time", F32, [0.0, 1e30], None),
        ] {
            assert_eq!(decide(field, primitive, ends, now), expected, "{driver}");
        }
        assert_eq!(decide("timestamp", F64, [12.3, 12.4], 12.3), Some((Seconds, true)), "simulated time");
    }
}
