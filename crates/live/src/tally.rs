//! What became of the messages of a topic.

use std::collections::BTreeMap;
use std::fmt;

/// Why a message was not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Reason {
    /// Newer ones came faster than they could be used.
    Overtaken,
    /// Its bytes are no such message.
    Unreadable,
    /// Its numbers cannot be mapped with.
    Unusable,
    /// No transform says where its sensor sits on the robot.
    NoMount,
    /// It was used already, or one of its topic that is later by more than ten seconds.
    Late,
    /// Its topic is none that was announced.
    UnknownTopic,
    /// Somebody has asked that none be taken in for a while, or the node is not active.
    Paused,
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Overtaken => "overtaken by newer ones",
            Self::Unreadable => "unreadable",
            Self::Unusable => "geometry that cannot be mapped with",
            Self::NoMount => "no transform from the sensor to the robot",
            Self::Late => "they or much later ones were used already",
            Self::UnknownTopic => "of a topic that was not announced",
            Self::Paused => "paused",
        })
    }
}

/// Messages of a topic: how many have arrived, were used, and were dropped for what reason. The rest waits.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Tally {
    arrived: u64,
    used: u64,
    dropped: BTreeMap<Reason, u64>,
}

impl Tally {
    /// How many have arrived.
    #[must_use]
    pub fn arrived(&self) -> u64 {
        self.arrived
    }

    /// How many were used.
    #[must_use]
    pub fn used(&self) -> u64 {
        self.used
    }

    /// How many were dropped, by their reasons.
    pub fn dropped(&self) -> impl Iterator<Item = (Reason, u64)> + '_ {
        self.dropped.iter().map(|(reason, count)| (*reason, *count))
    }

    /// How many were dropped for one reason.
    #[must_use]
    pub fn dropped_for(&self, reason: Reason) -> u64 {
        self.dropped.get(&reason).copied().unwrap_or(0)
    }

    /// How many wait.
    #[must_use]
    pub fn waiting(&self) -> u64 {
        self.arrived.saturating_sub(self.used + self.dropped.values().sum::<u64>())
    }

    pub(crate) fn arrive(&mut self, count: u64) {
        self.arrived += count;
    }

    pub(crate) fn drop_one(&mut self, reason: Reason) {
        self.drop_many(reason, 1);
    }

    pub(crate) fn drop_many(&mut self, reason: Reason, count: u64) {
        if count > 0 {
            *self.dropped.entry(reason).or_default() += count;
        }
    }

    pub(crate) fn use_one(&mut self) {
        self.used += 1;
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} arrived, {} used", self.arrived, self.used)?;
        self.dropped().try_for_each(|(reason, count)| write!(f, ", {count} dropped ({reason})"))?;
        if self.waiting() > 0 { write!(f, ", {} waiting", self.waiting()) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_has_arrived_is_told_in_words() {
        let mut tally = Tally::default();
        tally.arrive(5);
        tally.use_one();
        tally.drop_many(Reason::Overtaken, 2);
        tally.drop_one(Reason::NoMount);
        assert_eq!(
            tally.to_string(),
            "5 arrived, 1 used, 2 dropped (overtaken by newer ones), 1 dropped (no transform from the sensor to the robot), \
             1 waiting"
        );
        assert_eq!((tally.waiting(), tally.dropped_for(Reason::Late)), (1, 0));
    }
}
