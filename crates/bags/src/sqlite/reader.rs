//! Messages out of a ROS 2 sqlite bag.

use super::head::{DatabaseHead, database_head};
use super::{HEADER_BYTES, schema};
use crate::catalog::Catalog;
use crate::error::BagError;
use crate::message::{Connection, RawMessage};
use crate::report::{Container, DamageKind, Place, ReadReport};
use mapwright_geom::Stamp;
use rusqlite::limits::Limit;
use rusqlite::types::ValueRef;
use rusqlite::{Connection as Database, OpenFlags, OptionalExtension, Result as SqlResult, Row, params};
use std::collections::{BTreeMap, VecDeque};
use std::path::Path;

/// Keys fetched in one go.
const BATCH: usize = 256;
/// Rows looked for in vain, one after the other, before the rest of a damaged database is given up.
const MISSES_MAX: u32 = 20_000;
/// SQLite's page cache.
const CACHE_KIB: i64 = 2048;

/// Reads a ROS 2 sqlite bag in the order in which it would be played: by timestamp, then by row.
#[derive(Debug)]
pub struct SqliteReader {
    database: Database,
    order: Order,
    pending: VecDeque<Key>,
    last: Option<Key>,
    /// Row, stamp and connection of the message whose data are in `data`.
    current: Option<(i64, Stamp, u32)>,
    /// Connections by the topic's id in the database.
    topics: BTreeMap<i64, u32>,
    data: Vec<u8>,
    /// The last bytes of a file that ends within a page.
    torn_tail: Option<Vec<u8>>,
    catalog: Catalog,
}

/// Timestamp and row.
type Key = (i64, i64);

/// What tells the next row.
#[derive(Debug, Clone, Copy)]
enum Order {
    /// The index on timestamps, or the temporary table in its place.
    ByTime {
        table: &'static str,
    },
    /// Rows one after the other, as what orders them is damaged.
    ByRow {
        next: i64,
        misses: u32,
    },
    End,
}

/// A row's message, its data left in the reader.
#[derive(Debug, Clone, Copy)]
struct Found {
    topic: i64,
    timestamp: i64,
}

impl SqliteReader {
    /// Opens a database by its path, for reading only.
    ///
    /// # Errors
    ///
    /// [`BagError::Path`] and [`BagError::Database`], where it is no database or not one of a ROS 2 bag.
    pub fn open(path: &Path) -> Result<Self, BagError> {
        Self::open_part(path, Catalog::default()).map_err(|(error, _)| error)
    }

    pub(crate) fn open_part(path: &Path, mut catalog: Catalog) -> Result<Self, (BagError, Box<Catalog>)> {
        let opened = database_head(path).and_then(|head| {
            let database =
                open_database(path, &head).map_err(|error| format!("{error}, reading the header from byte 0 on"));
            let checked = database.and_then(|database| schema::check(&database).map(|()| database));
            match checked {
                Ok(database) => Ok((head, database)),
                Err(found) => {
                    let found = found + &damage_of(&head);
                    Err(BagError::Database { path: path.display().to_string(), found })
                }
            }
        });
        let (head, database) = match opened {
            Ok(opened) => opened,
            Err(error) => return Err((error, Box::new(catalog))),
        };
        catalog.report.container = Some(Container::Sqlite);
        catalog.report.file_bytes += head.file_bytes;
        if head.expected_bytes > head.file_bytes {
            let (expected, found) = (format!("{} bytes", head.expected_bytes), "the end");
            catalog.damage(DamageKind::Truncated, head.file_bytes, expected, found, 0);
        }
        let topics = schema::read_topics(&database, &mut catalog);
        let order = find_order(&database).unwrap_or_else(|error| {
            let (expected, found) = ("rows in the order of their timestamps", error.to_string());
            catalog.damage(DamageKind::Database, 0, expected, found, 0);
            by_row(&database)
        });
        let (pending, data) = (VecDeque::new(), Vec::new());
        Ok(Self {
            database,
            order,
            pending,
            last: None,
            current: None,
            topics,
            data,
            torn_tail: head.torn_tail,
            catalog,
        })
    }

    /// All connections.
    #[must_use]
    pub fn connections(&self) -> &[Connection] {
        &self.catalog.connections
    }

    /// What was read so far, and what was lost.
    #[must_use]
    pub fn report(&self) -> &ReadReport {
        &self.catalog.report
    }

    /// Bytes of memory that the message holds.
    pub(crate) fn held_bytes(&self) -> usize {
        self.data.capacity()
    }

    pub(crate) fn catalog_mut(&mut self) -> &mut Catalog {
        &mut self.catalog
    }

    pub(crate) fn into_catalog(self) -> Catalog {
        self.catalog
    }

    /// The next message by timestamp and row, or none at the end.
    ///
    /// # Errors
    ///
    /// None today. Damage is no error: it is in the [`report`](Self::report).
    pub fn next_message(&mut self) -> Result<Option<RawMessage<'_>>, BagError> {
        Ok(if self.advance() { self.lend() } else { None })
    }

    /// Goes on to the next message, if there is one.
    pub(crate) fn advance(&mut self) -> bool {
        self.current = loop {
            let Some((row, found)) = self.next_row() else { break None };
            if self.is_torn() {
                let expected = "a row before the end of the file";
                self.catalog.damage_at(DamageKind::Truncated, Place::Row(row), expected, "one across it", 0);
                continue;
            }
            if let Some(id) = self.topics.get(&found.topic) {
                break Some((row, Stamp(found.timestamp), *id));
            }
            let (expected, found) = ("a topic that is described", format!("topic {}", found.topic));
            let bytes = self.data.len() as u64;
            self.catalog.damage_at(DamageKind::UnknownConnection, Place::Row(row), expected, found, bytes);
        };
        if let Some((_, log_stamp, id)) = self.current {
            self.catalog.report.count(id, log_stamp, self.data.len());
        }
        self.current.is_some()
    }

    /// The message gone to last.
    pub(crate) fn lend(&self) -> Option<RawMessage<'_>> {
        let (row, log_stamp, id) = self.current?;
        let connection = self.catalog.connections.get(id as usize)?;
        let offset_bytes = row.max(0) as u64;
        Some(RawMessage { connection, log_stamp, publish_stamp: None, offset_bytes, data: &self.data })
    }

    /// Whether the message is the one across the end of a torn file: SQLite has it go on with zeros.
    fn is_torn(&self) -> bool {
        let Some(tail) = &self.torn_tail else { return false };
        let end = self.data.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
        let compared = end.min(tail.len());
        end < self.data.len() && self.data[end - compared..end] == tail[tail.len() - compared..]
    }

    /// The next row that can be read.
    fn next_row(&mut self) -> Option<(i64, Found)> {
        loop {
            match self.order {
                Order::End => return None,
                Order::ByTime { table } => {
                    let Some(key) = self.next_key(table) else { continue };
                    self.last = Some(key);
                    if let Some(found) = self.row_of_key(key) {
                        return Some((key.1, found));
                    }
                }
                Order::ByRow { next, misses } => {
                    if let Some(found) = self.row_by_number(next, misses) {
                        return Some((next, found));
                    }
                }
            }
        }
    }

    /// The next key; none where there is no more, or the order must be another.
    fn next_key(&mut self, table: &'static str) -> Option<Key> {
        if self.pending.is_empty() {
            match next_keys(&self.database, table, self.last, &mut self.pending) {
                Ok(()) if self.pending.is_empty() => self.order = Order::End,
                Ok(()) => {}
                Err(error) => self.lose_order(error.to_string()),
            }
        }
        let key = self.pending.pop_front()?;
        if self.last.is_some_and(|last| key <= last) {
            self.lose_order("keys that do not ascend".into());
            return None;
        }
        Some(key)
    }

    fn lose_order(&mut self, found: String) {
        self.pending.clear();
        let place = Place::Row(self.last.map_or(0, |(_, row)| row));
        self.catalog.damage_at(DamageKind::Database, place, "an index on timestamps behind this row", found, 0);
        self.order = by_row(&self.database);
    }

    /// The row of a key; none where it is damaged or does not agree with its key.
    fn row_of_key(&mut self, key: Key) -> Option<Found> {
        let found = match fetch(&self.database, key.1, &mut self.data) {
            Ok(Some(found)) if found.timestamp == key.0 => return Some(found),
            Ok(Some(found)) => format!("timestamp {}", found.timestamp),
            Ok(None) => "none".to_owned(),
            Err(error) => error.to_string(),
        };
        let expected = format!("a row of timestamp {}", key.0);
        self.catalog.damage_at(DamageKind::Database, Place::Row(key.1), expected, found, 0);
        None
    }

    /// The row of a number, unless it was delivered before the order was lost.
    fn row_by_number(&mut self, row: i64, misses: u32) -> Option<Found> {
        let fetched = fetch(&self.database, row, &mut self.data);
        let misses = if matches!(fetched, Ok(Some(_))) { 0 } else { misses + 1 };
        self.order = match row.checked_add(1) {
            Some(next) if misses < MISSES_MAX => Order::ByRow { next, misses },
            _ => Order::End,
        };
        match fetched {
            Ok(found) => found.filter(|found| self.last.is_none_or(|last| (found.timestamp, row) > last)),
            Err(error) => {
                let (place, expected) = (Place::Row(row), "a readable row");
                self.catalog.damage_at(DamageKind::Database, place, expected, error.to_string(), 0);
                None
            }
        }
    }
}

fn open_database(path: &Path, head: &DatabaseHead) -> SqlResult<Database> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    // without a log of changes nothing may be locked or written, so that read-only folders will do
    let database = if cfg!(unix) && !head.has_log {
        Database::open_with_flags(uri(path), flags | OpenFlags::SQLITE_OPEN_URI)?
    } else {
        Database::open_with_flags(path, flags)?
    };
    // a message is never larger than its file
    let limit = head.file_bytes.clamp(1 << 20, 1 << 30) as i32;
    database.set_limit(Limit::SQLITE_LIMIT_LENGTH, limit)?;
    // first of all: only so are databases opened that were cut short
    database.pragma_update(None, "writable_schema", true)?;
    database.pragma_update(None, "cache_size", -CACHE_KIB)?;
    database.pragma_update(None, "mmap_size", 0)?;
    database.pragma_update(None, "temp_store", 1)?;
    database.pragma_update(None, "trusted_schema", false)?;
    Ok(database)
}

/// Where a file ends that was cut short, or is no database.
fn damage_of(head: &DatabaseHead) -> String {
    match (head.strange_byte, head.file_bytes, head.expected_bytes) {
        (Some(at), ..) => format!("; not `SQLite format 3` from byte {at} on"),
        (_, 0..HEADER_BYTES, _) => format!("; the file ends within the header, at byte {}", head.file_bytes),
        (_, end, expected) if end < expected => format!("; the file ends at byte {end} of {expected}"),
        _ => String::new(),
    }
}

fn uri(path: &Path) -> String {
    let mut uri = "file:".to_owned();
    for byte in path.as_os_str().as_encoded_bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'/' | b'.' | b'_' | b'-' => uri.push(*byte as char),
            other => uri.push_str(&format!("%{other:02X}")),
        }
    }
    uri + "?immutable=1"
}

/// Uses an index on timestamps where there is one, and sorts otherwise.
fn find_order(database: &Database) -> SqlResult<Order> {
    let plan = |row: &Row<'_>| row.get::<_, String>(3);
    let mut statement = database.prepare("EXPLAIN QUERY PLAN SELECT timestamp, id FROM messages ORDER BY 1, 2")?;
    let steps: Vec<String> = statement.query_map([], plan)?.collect::<SqlResult<_>>()?;
    if !steps.iter().any(|step| step.contains("TEMP B-TREE")) {
        return Ok(Order::ByTime { table: "messages" });
    }
    database.execute_batch(
        "CREATE TEMP TABLE arrival (timestamp INTEGER, id INTEGER, PRIMARY KEY (timestamp, id)) WITHOUT ROWID;
         INSERT OR IGNORE INTO arrival SELECT timestamp, id FROM messages WHERE typeof(timestamp) = 'integer'",
    )?;
    Ok(Order::ByTime { table: "temp.arrival" })
}

fn by_row(database: &Database) -> Order {
    let first = database.query_row("SELECT min(id) FROM messages", [], |row| row.get::<_, i64>(0));
    Order::ByRow { next: first.unwrap_or(0), misses: 0 }
}

/// The keys behind the last one.
fn next_keys(database: &Database, table: &str, last: Option<Key>, keys: &mut VecDeque<Key>) -> SqlResult<()> {
    let (timestamp, row) = last.unwrap_or((i64::MIN, i64::MIN));
    let same = format!(
        "SELECT timestamp, id FROM {table} WHERE timestamp = ?1 AND id > ?2 AND typeof(timestamp) = 'integer' \
         ORDER BY id LIMIT {BATCH}"
    );
    let later = format!(
        "SELECT timestamp, id FROM {table} WHERE timestamp > ?1 AND typeof(timestamp) = 'integer' \
         ORDER BY timestamp, id LIMIT {BATCH}"
    );
    append(database, &same, params![timestamp, row], keys)?;
    if keys.len() < BATCH { append(database, &later, params![timestamp], keys) } else { Ok(()) }
}

/// All keys up to an error are kept; the error comes again for the next batch.
fn append(database: &Database, sql: &str, of: impl rusqlite::Params, keys: &mut VecDeque<Key>) -> SqlResult<()> {
    let mut statement = database.prepare_cached(sql)?;
    for key in statement.query_map(of, |row| Ok((row.get(0)?, row.get(1)?)))? {
        match key {
            Ok(key) => keys.push_back(key),
            Err(error) => return if keys.is_empty() { Err(error) } else { Ok(()) },
        }
    }
    Ok(())
}

fn fetch(database: &Database, row: i64, data: &mut Vec<u8>) -> SqlResult<Option<Found>> {
    let mut statement = database.prepare_cached("SELECT topic_id, timestamp, data FROM messages WHERE id = ?1")?;
    let read = |row: &Row<'_>| {
        let found = Found { topic: row.get(0)?, timestamp: row.get(1)? };
        let bytes = match row.get_ref(2)? {
            ValueRef::Blob(bytes) | ValueRef::Text(bytes) => bytes,
            _ => &[],
        };
        data.clear();
        data.reserve_exact(bytes.len());
        data.extend_from_slice(bytes);
        Ok(found)
    };
    statement.query_row([row], read).optional()
}
