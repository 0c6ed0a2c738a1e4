//! Stamps as they are written.

use crate::args::StampPolicy;
use mapwright::Stamp;

/// Stamps as the log has them, or made to increase: one that does not follows a microsecond after the one before.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stamper {
    policy: StampPolicy,
    last: Option<Stamp>,
}

impl Stamper {
    pub(crate) fn new(policy: StampPolicy) -> Self {
        Self { policy, last: None }
    }

    /// The stamp to be written for `stamp`.
    pub(crate) fn next(&mut self, stamp: Stamp) -> Stamp {
        if self.policy == StampPolicy::Log {
            return stamp;
        }
        let earliest = self.last.map_or(stamp, |last| Stamp(last.0.saturating_add(1000)));
        let repaired = stamp.max(earliest);
        self.last = Some(repaired);
        repaired
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repaired_stamps_increase_and_good_ones_stay() {
        let mut stamper = Stamper::new(StampPolicy::Repaired);
        let written = [5_000, 9_000, 9_000, 2_000, 20_000].map(|ns| stamper.next(Stamp(ns)).0);
        assert_eq!(written, [5_000, 9_000, 10_000, 11_000, 20_000]);
        let mut stamper = Stamper::new(StampPolicy::Log);
        assert_eq!([7, 3].map(|ns| stamper.next(Stamp(ns)).0), [7, 3]);
    }
}
