//! How a node is, for the topic `/diagnostics`.

use super::{NodeName, bytes_of};
use crate::tally::Tally;
use mapwright_geom::Stamp;
use mapwright_ros::messages::{DiagnosticArray, DiagnosticStatus, Header, KeyValue};
use std::collections::BTreeMap;

/// The topic, of `diagnostic_msgs/msg/DiagnosticArray`.
pub const TOPIC: &str = "/diagnostics";

/// How something is, with its number in `diagnostic_msgs/DiagnosticStatus`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Level {
    /// As it should be.
    Ok = 0,
    /// Something is dropped or missing.
    Warn = 1,
    /// Nothing goes on.
    Error = 2,
}

#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    arrived: u64,
    used: u64,
    dropped: u64,
}

/// Compares what became of messages with what had become of them when this was asked last.
#[derive(Debug, Clone, Default)]
pub struct Diagnostics {
    before: BTreeMap<String, Counts>,
}

impl Diagnostics {
    /// A `diagnostic_msgs/DiagnosticArray`: how the node is, and each topic with what became of its messages. `missing` is what the robot lacks, in
    /// words. A topic warns where messages were dropped since last time, and is an error where none of those that arrived were used; the node
    /// is an error where something is missing and nothing at all was used.
    pub fn report<'t>(
        &mut self,
        node: &NodeName,
        stamp: Stamp,
        tallies: impl Iterator<Item = (&'t str, &'t Tally)>,
        missing: &[String],
    ) -> Vec<u8> {
        let mut topics = Vec::new();
        let mut after = BTreeMap::new();
        let mut used = 0;
        for (topic, tally) in tallies {
            let now = counts(tally);
            let since = now.since(self.before.get(topic).copied().unwrap_or_default());
            used += since.used;
            topics.push(of_topic(node, topic, tally, since));
            after.insert(topic.to_owned(), now);
        }
        // of topics that are gone nothing is kept
        self.before = after;
        let mut status = vec![of_node(node, missing, used)];
        status.append(&mut topics);
        bytes_of(&DiagnosticArray { header: Header::new(stamp, ""), status })
    }
}

fn counts(tally: &Tally) -> Counts {
    let dropped = tally.dropped().map(|(_, count)| count).sum();
    Counts { arrived: tally.arrived(), used: tally.used(), dropped }
}

impl Counts {
    fn since(self, before: Self) -> Self {
        Self {
            arrived: self.arrived.saturating_sub(before.arrived),
            used: self.used.saturating_sub(before.used),
            dropped: self.dropped.saturating_sub(before.dropped),
        }
    }
}

fn of_node(node: &NodeName, missing: &[String], used: u64) -> DiagnosticStatus<'static> {
    let level = match (missing.is_empty(), used) {
        (true, _) => Level::Ok,
        (false, 0) => Level::Error,
        (false, _) => Level::Warn,
    };
    let message = if missing.is_empty() { "nothing is missing".to_owned() } else { missing.join("; ") };
    status(node.name().to_owned(), level, message, Vec::new())
}

fn of_topic(node: &NodeName, topic: &str, tally: &Tally, since: Counts) -> DiagnosticStatus<'static> {
    let level = match since {
        Counts { dropped: 0, .. } => Level::Ok,
        Counts { used: 0, .. } => Level::Error,
        _ => Level::Warn,
    };
    let message = format!("{} arrived since last time, {} used, {} dropped", since.arrived, since.used, since.dropped);
    let numbers = [("arrived", tally.arrived()), ("used", tally.used()), ("waiting", tally.waiting())];
    let reasons = tally.dropped().map(|(reason, count)| (format!("dropped: {reason}"), count));
    let values = numbers.map(|(key, count)| (key.to_owned(), count)).into_iter().chain(reasons);
    let values = values.map(|(key, count)| KeyValue { key: key.into(), value: count.to_string().into() }).collect();
    status(format!("{}: {topic}", node.name()), level, message, values)
}

fn status(name: String, level: Level, message: String, values: Vec<KeyValue<'static>>) -> DiagnosticStatus<'static> {
    let hardware_id = "".into();
    DiagnosticStatus { level: level as u8, name: name.into(), message: message.into(), hardware_id, values }
}
