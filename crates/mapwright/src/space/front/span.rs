//! When the points of a sweep were taken.

use mapwright_geom::Stamp;
use mapwright_sensor::Cloud;

/// Times beyond this after the stamp are none, seconds.
const LONGEST_SWEEP_S: f32 = 2.0;

/// When the points of a sweep were taken, after its stamp, seconds.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Span {
    pub(super) first_s: f64,
    pub(super) last_s: f64,
}

impl Span {
    /// Of times that can be; nothing where there are none.
    pub(super) fn of(cloud: &Cloud) -> Self {
        let times = cloud.times_s.iter().copied().filter(is_time);
        let (first_s, last_s) = times.fold((f32::MAX, f32::MIN), |(least, most), s| (least.min(s), most.max(s)));
        if first_s > last_s {
            return Self::default();
        }
        Self { first_s: f64::from(first_s), last_s: f64::from(last_s) }
    }

    /// The middle of the sweep after the cloud's stamp, seconds.
    pub(super) fn middle_s(self) -> f64 {
        0.5 * (self.first_s + self.last_s)
    }

    pub(super) fn length_s(self) -> f64 {
        self.last_s - self.first_s
    }

    /// The stamp so many seconds after that of the cloud.
    pub(super) fn stamp_after(self, stamp: Stamp, after_s: f64) -> Stamp {
        Stamp(stamp.0.saturating_add(Stamp::from_secs_f64(after_s).0))
    }
}

/// Whether a time after the stamp can be one.
pub(super) fn is_time(s: &f32) -> bool {
    s.is_finite() && s.abs() <= LONGEST_SWEEP_S
}
