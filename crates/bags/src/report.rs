//! What a reader has seen, and what was lost on the way.

use mapwright_geom::Stamp;
use std::collections::BTreeMap;
use std::fmt;

/// Places kept of each kind of damage; further ones are only counted.
const PLACES_KEPT: usize = 20;

/// A container of messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Container {
    /// A ROS 1 bag, version 2.0.
    Bag1,
    /// MCAP.
    Mcap,
    /// A ROS 2 bag as an SQLite database.
    Sqlite,
}

impl fmt::Display for Container {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Bag1 => "ROS 1 bag",
            Self::Mcap => "MCAP",
            Self::Sqlite => "ROS 2 sqlite3 bag",
        })
    }
}

/// What is wrong at some place of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum DamageKind {
    /// The file ends too early.
    Truncated,
    /// A record is none, or does not end where it says.
    BadRecord,
    /// A chunk does not decompress to what it says.
    BadChunk,
    /// A checksum does not agree.
    BadChecksum,
    /// A length beyond what is believed: a decompression bomb, or a damaged length.
    TooLarge,
    /// A message of a connection that was nowhere described.
    UnknownConnection,
    /// A compression that is not known.
    UnknownCompression,
    /// A message's own compression is damaged.
    BadMessage,
    /// The database refuses some rows.
    Database,
    /// A file of a split recording cannot be read.
    BadPart,
    /// One connection described in two ways; the later description counts.
    ConflictingConnection,
    /// A length that disagrees with the content in a known and harmless way.
    Irregular,
    /// The index or summary cannot be used; messages are read without it.
    BadIndex,
    /// `metadata.yaml` cannot be used; files are read without it.
    BadMetadata,
}

impl DamageKind {
    /// Whether messages may be missing or wrong for it.
    #[must_use]
    pub fn loses_messages(self) -> bool {
        !matches!(self, Self::ConflictingConnection | Self::Irregular | Self::BadIndex | Self::BadMetadata)
    }
}

impl fmt::Display for DamageKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Truncated => "truncated",
            Self::BadRecord => "bad record",
            Self::BadChunk => "bad chunk",
            Self::BadChecksum => "checksum disagrees",
            Self::TooLarge => "too large",
            Self::UnknownConnection => "unknown connection",
            Self::UnknownCompression => "unknown compression",
            Self::BadMessage => "bad message",
            Self::Database => "database damaged",
            Self::BadPart => "unreadable file",
            Self::ConflictingConnection => "conflicting connections",
            Self::Irregular => "irregular",
            Self::BadIndex => "bad index",
            Self::BadMetadata => "bad metadata.yaml",
        })
    }
}

/// Where in a file something stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Place {
    /// At this byte.
    Byte(u64),
    /// In this row of a database's messages.
    Row(i64),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Byte(offset) => write!(f, "byte {offset}"),
            Self::Row(id) => write!(f, "row {id}"),
        }
    }
}

/// One place where a recording is damaged.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Damage {
    /// Which file of a split recording, from 0.
    pub part: usize,
    /// Where it is.
    pub place: Place,
    /// What should have stood there.
    pub expected: String,
    /// What stood there.
    pub found: String,
    /// Bytes of the file not used for it.
    pub skipped_bytes: u64,
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: expected {}, found {}", self.place, self.expected, self.found)?;
        if self.skipped_bytes > 0 {
            write!(f, "; {} bytes skipped", self.skipped_bytes)?;
        }
        Ok(())
    }
}

/// The places damaged in one way.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Damages {
    /// How many.
    pub count: u64,
    /// Bytes of the file not used for them.
    pub skipped_bytes: u64,
    /// The first 20 of them.
    pub first: Vec<Damage>,
}

/// What was delivered of one connection.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ConnectionReport {
    /// Messages.
    pub messages: u64,
    /// Their bytes.
    pub bytes: u64,
    /// The earliest log stamp.
    pub earliest: Option<Stamp>,
    /// The latest log stamp.
    pub latest: Option<Stamp>,
}

/// What a reader has seen so far. Memory is bounded, however long or broken the recording.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ReadReport {
    /// The container of the file that is being read; none for a recording of which no file could be opened.
    pub container: Option<Container>,
    /// Names of the files of a split recording that were opened so far; empty for a stream.
    pub parts: Vec<String>,
    /// Bytes of all files opened so far.
    pub file_bytes: u64,
    /// Messages delivered.
    pub messages: u64,
    /// Bytes of the messages delivered.
    pub message_bytes: u64,
    /// What was delivered by connection, at the place of its id.
    pub connections: Vec<ConnectionReport>,
    /// Chunks by their compression (`none`, `lz4`, `bz2`, `zstd`), damaged ones included.
    pub chunks: BTreeMap<&'static str, u64>,
    /// Whether each file so far had an index (a summary in MCAP); none where the container needs none.
    pub indexed: Option<bool>,
    /// All that is wrong.
    pub damages: BTreeMap<DamageKind, Damages>,
}

impl ReadReport {
    /// Whether messages may be missing or wrong.
    #[must_use]
    pub fn has_losses(&self) -> bool {
        self.damages.keys().any(|kind| kind.loses_messages())
    }

    /// Bytes of the files that were not used because of damage.
    #[must_use]
    pub fn skipped_bytes(&self) -> u64 {
        self.damages.values().map(|damages| damages.skipped_bytes).sum()
    }

    pub(crate) fn damage(&mut self, kind: DamageKind, damage: impl FnOnce() -> Damage, skipped_bytes: u64) {
        let part = self.parts.len().saturating_sub(1);
        let damages = self.damages.entry(kind).or_default();
        damages.count += 1;
        damages.skipped_bytes += skipped_bytes;
        if damages.first.len() < PLACES_KEPT {
            damages.first.push(Damage { part, skipped_bytes, ..damage() });
        }
    }

    pub(crate) fn count(&mut self, connection: u32, stamp: Stamp, bytes: usize) {
        self.messages += 1;
        self.message_bytes += bytes as u64;
        if let Some(report) = self.connections.get_mut(connection as usize) {
            report.messages += 1;
            report.bytes += bytes as u64;
            report.earliest = Some(report.earliest.map_or(stamp, |earliest| earliest.min(stamp)));
            report.latest = Some(report.latest.map_or(stamp, |latest| latest.max(stamp)));
        }
    }

    pub(crate) fn note_index(&mut self, present: bool) {
        self.indexed = Some(present && self.indexed.unwrap_or(true));
    }
}
