//! The rule for stamps that do not run forward.

use crate::noted::Noted;
use mapwright_geom::Stamp;

/// How a stamp relates to the one before it in the same topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StampStep {
    /// The topic's first.
    First,
    /// Later than the one before.
    Forward,
    /// Equal to the one before.
    Repeated,
    /// Earlier than the one before.
    Backward,
}

/// Watches the stamps of one topic. A stamp that repeats or steps backwards is counted and its place
/// noted; the readers deliver what they read in the order in which it stands there. Whether that or the order of stamps is the better one depends
/// on the log: clocks are set, buses reorder.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct StampWatch {
    last: Option<Stamp>,
    /// Stamps earlier than the one before them.
    pub backward: Noted,
    /// Stamps equal to the one before them.
    pub repeated: Noted,
}

impl StampWatch {
    /// Takes the next stamp of the topic; `place` is its line or message number, for the report.
    pub fn observe(&mut self, place: u64, stamp: Stamp) -> StampStep {
        let step = match self.last {
            None => StampStep::First,
            Some(last) if stamp > last => StampStep::Forward,
            Some(last) if stamp == last => StampStep::Repeated,
            Some(_) => StampStep::Backward,
        };
        match step {
            StampStep::Repeated => self.repeated.note(place),
            StampStep::Backward => self.backward.note(place),
            StampStep::First | StampStep::Forward => {}
        }
        self.last = Some(stamp);
        step
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_told_by_the_stamp_before() {
        let mut watch = StampWatch::default();
        let steps = [5, 6, 6, 4, 5].map(|s| watch.observe(s as u64 * 10, Stamp(s)));
        use StampStep::{Backward, First, Forward, Repeated};
        assert_eq!(steps, [First, Forward, Repeated, Backward, Forward]);
        assert_eq!((watch.backward.count, watch.backward.first_places.as_slice()), (1, [40].as_slice()));
        assert_eq!(watch.repeated.count, 1);
    }
}
