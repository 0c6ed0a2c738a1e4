//! Stamps.

/// A point in time: nanoseconds since an epoch that the log chooses. Neither unique nor ordered within a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Stamp(pub i64);

impl Stamp {
    /// The stamp nearest to `seconds`; saturates at the ends of the range, and NaN becomes zero.
    #[must_use]
    pub fn from_secs_f64(seconds: f64) -> Self {
        Self((seconds * 1e9).round() as i64)
    }

    /// Seconds as a double, good to about 1e-7 s for stamps of the Unix epoch.
    #[must_use]
    pub fn as_secs_f64(self) -> f64 {
        self.0 as f64 * 1e-9
    }

    /// Seconds from `earlier` to `self`; negative where `self` came first.
    #[must_use]
    pub fn secs_since(self, earlier: Self) -> f64 {
        (i128::from(self.0) - i128::from(earlier.0)) as f64 * 1e-9
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extreme_stamps_do_not_overflow() {
        assert!(Stamp(i64::MAX).secs_since(Stamp(i64::MIN)) > 1e10);
        assert_eq!(Stamp::from_secs_f64(f64::NAN), Stamp(0));
        assert_eq!(Stamp::from_secs_f64(1e300), Stamp(i64::MAX));
    }
}
