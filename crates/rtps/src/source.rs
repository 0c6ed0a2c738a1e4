//! A reliable writer of another participant as one of our readers knows it (8.4.12): what has come of it, and what is missing.

use crate::ids::{EntityId, Guid};
use crate::message::{Missing, SET_MOST};
use crate::packets::Packets;
use std::collections::BTreeSet;
use std::net::SocketAddrV4;
use std::time::Duration;

/// A writer that has said nothing yet is asked what it has, each time twice as late, and so often at most: what it told while we did not know it
/// is told again then, and not only when it asks by itself (with Fast DDS after three seconds).
const ASKED_AFTER: Duration = Duration::from_millis(50);
const ASKED_MOST: u32 = 8;

#[derive(Debug)]
pub(crate) struct Source {
    writer: Guid,
    reader: EntityId,
    pub(crate) to: Vec<SocketAddrV4>,
    /// All before have come, or will not.
    base: i64,
    /// Those from there on that have come.
    beyond: BTreeSet<i64>,
    acknacks: u32,
    ask_at: Option<Duration>,
    asked: u32,
}

impl Source {
    /// One that was just found, which is asked at once what it has.
    pub(crate) fn new(writer: Guid, reader: EntityId, to: Vec<SocketAddrV4>, now: Duration) -> Self {
        Self { writer, reader, to, base: 1, beyond: BTreeSet::new(), acknacks: 0, ask_at: Some(now), asked: 0 }
    }

    /// Whether a sample is new; it is known from then on.
    pub(crate) fn take(&mut self, number: i64) -> bool {
        let is_new = number >= self.base && number - self.base < i64::from(SET_MOST) && self.beyond.insert(number);
        self.go_on();
        is_new
    }

    fn go_on(&mut self) {
        while self.beyond.remove(&self.base) {
            self.base += 1;
        }
    }

    /// What comes before a number will not come.
    fn skip(&mut self, to: i64) {
        if to > self.base {
            self.base = to;
            self.beyond = self.beyond.split_off(&to);
            self.go_on();
        }
    }

    /// Samples will not come.
    pub(crate) fn gap(&mut self, first: i64, set: Missing) {
        if first <= self.base {
            self.skip(set.base);
        } else {
            let until = set.base.min(self.base.saturating_add(i64::from(SET_MOST)));
            self.beyond.extend(first..until);
        }
        set.numbers().for_each(|number| {
            self.take(number);
        });
    }

    /// The writer says what it has, and is told what is missing of it.
    pub(crate) fn heartbeat(&mut self, [first, last]: [i64; 2], is_final: bool, from: Guid, out: &mut Packets) {
        if first < 1 || last < first - 1 || last == i64::MAX {
            return;
        }
        self.ask_at = None;
        self.skip(first);
        let end = (last + 1).min(self.base.saturating_add(i64::from(SET_MOST)));
        let missing = Missing::of(self.base, (self.base..end).filter(|number| !self.beyond.contains(number)));
        if !is_final || missing.numbers().next().is_some() {
            self.acknack(missing, true, from, out);
        }
    }

    fn acknack(&mut self, missing: Missing, is_final: bool, from: Guid, out: &mut Packets) {
        self.acknacks = self.acknacks.wrapping_add(1);
        let (names, count) = ([self.reader, self.writer.entity], self.acknacks);
        out.send(&self.to, from.prefix, self.writer.prefix, |message| message.acknack(names, missing, is_final, count));
    }

    /// Asks a writer that has said nothing yet, and says when it is asked next.
    pub(crate) fn turn(&mut self, now: Duration, from: Guid, out: &mut Packets) -> Option<Duration> {
        let at = self.ask_at?;
        if at > now {
            return Some(at);
        }
        self.ask_at = (self.asked < ASKED_MOST).then(|| now + ASKED_AFTER * 2_u32.saturating_pow(self.asked));
        self.asked += 1;
        self.acknack(Missing::none(self.base), false, from, out);
        self.ask_at
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source() -> Source {
        let writer = Guid { prefix: [1; 12], entity: [0, 0, 1, 3] };
        Source::new(writer, [0, 0, 1, 4], Vec::new(), Duration::ZERO)
    }

    #[test]
    fn each_sample_is_new_once() {
        let mut source = source();
        assert!(source.take(2) && !source.take(2) && source.take(1) && !source.take(1) && source.take(3));
        assert_eq!((source.base, source.beyond.len()), (4, 0));
        assert!(!source.take(4 + i64::from(SET_MOST)), "too far ahead: it is asked for again");
    }

    #[test]
    fn what_will_not_come_is_not_waited_for() {
        let mut source = source();
        assert!(source.take(9));
        source.gap(3, Missing::of(5, [6]));
        assert_eq!(source.base, 1);
        source.gap(1, Missing::none(3));
        assert_eq!(source.base, 5, "3 and 4 were said before");
        assert!(source.take(5));
        assert_eq!(source.base, 7);
        source.gap(i64::MIN, Missing::none(i64::MAX));
        assert_eq!(source.base, i64::MAX);
        assert!(!source.take(1));
    }
}
