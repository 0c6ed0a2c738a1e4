//! What all files of one recording share: connections and the report.

use crate::message::Connection;
use crate::report::{Damage, DamageKind, Place, ReadReport};
use std::collections::BTreeMap;

/// More connections than any recording has: what goes beyond is damage, so that it cannot fill the memory.
const CONNECTIONS_MAX: usize = 1 << 16;

/// Connections and report, handed on from one file of a recording to the next.
#[derive(Debug, Default)]
pub(crate) struct Catalog {
    pub(crate) connections: Vec<Connection>,
    by_topic: BTreeMap<String, Vec<u32>>,
    pub(crate) report: ReadReport,
}

impl Catalog {
    /// The id of a connection: a new one, or that of one that is the same in all it says.
    pub(crate) fn add(&mut self, connection: Connection) -> Option<u32> {
        let ids = self.by_topic.entry(connection.topic.clone()).or_default();
        if let Some(id) = ids.iter().find(|id| self.connections[**id as usize].is_same_stream(&connection)) {
            return Some(*id);
        }
        if self.connections.len() >= CONNECTIONS_MAX {
            return None;
        }
        let id = self.connections.len() as u32;
        ids.push(id);
        self.connections.push(Connection { id, ..connection });
        self.report.connections.resize(self.connections.len(), Default::default());
        Some(id)
    }

    /// Notes damage, described by what was expected and found.
    pub(crate) fn damage(
        &mut self,
        kind: DamageKind,
        offset_bytes: u64,
        expected: impl Into<String>,
        found: impl Into<String>,
        skipped_bytes: u64,
    ) {
        self.damage_at(kind, Place::Byte(offset_bytes), expected, found, skipped_bytes);
    }

    /// The same, at any place.
    pub(crate) fn damage_at(
        &mut self,
        kind: DamageKind,
        place: Place,
        expected: impl Into<String>,
        found: impl Into<String>,
        skipped_bytes: u64,
    ) {
        let describe = || Damage { part: 0, place, expected: expected.into(), found: found.into(), skipped_bytes };
        self.report.damage(kind, describe, skipped_bytes);
    }
}
