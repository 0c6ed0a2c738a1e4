//! Messages out of a ROS 1 bag.

use super::MAGIC;
use super::connections::{Ids, take_connection};
use super::index::Index;
use super::record::{Found, OP_CHUNK, OP_CONNECTION, OP_INDEX, OP_MESSAGE, Record};
use super::record::{behind_damaged, follows, record_at};
use crate::catalog::Catalog;
use crate::decode::{Codec, Decoder, Problem};
use crate::error::BagError;
use crate::message::{Connection, RawMessage};
use crate::place::{Place, Step};
use crate::report::{Container, DamageKind, ReadReport};
use crate::window::{Bytes, Memory, Window, excerpt};
use std::io::{self, Read, Seek};

/// Enough of the next record to tell that it is one.
const NEXT_BYTES: usize = 256;

/// Reads a ROS 1 bag from its first record to its last, in the order of the file.
#[derive(Debug)]
pub struct Bag1Reader<R> {
    window: Window<R>,
    /// Where the next record is.
    at: u64,
    /// The end of the uncompressed chunk that is being read, or last was.
    plain_chunk_end: u64,
    chunk: Option<OpenChunk>,
    memory: Memory,
    decoder: Decoder,
    place: Option<Place>,
    index: Index,
    chunks_seen: u32,
    ids: Ids,
    catalog: Catalog,
}

/// A decompressed chunk that is being read.
#[derive(Debug, Clone, Copy)]
struct OpenChunk {
    /// Where it lies in the file.
    at: u64,
    /// The next record within it.
    inside: u64,
    /// Whether it was cut short, so that its last record may be too.
    torn: bool,
}

impl<R: Read + Seek> Bag1Reader<R> {
    /// Opens a bag, and looks at its index where it has one.
    ///
    /// # Errors
    ///
    /// [`BagError::Io`], [`BagError::UnknownContainer`] and [`BagError::Version`].
    pub fn open(reader: R) -> Result<Self, BagError> {
        Self::open_part(reader, Catalog::default()).map_err(|(error, _)| error)
    }

    pub(crate) fn open_part(reader: R, catalog: Catalog) -> Result<Self, (BagError, Box<Catalog>)> {
        match Window::new(reader).map_err(BagError::from).and_then(|window| check_magic(window)) {
            Ok(window) => {
                let mut reader = Self::new(window, catalog);
                let found = Index::find(&mut reader.window, reader.at, &mut reader.ids, &mut reader.catalog);
                match found {
                    Ok(index) => Ok(Self { index, ..reader }),
                    Err(error) => Err((error.into(), Box::new(reader.catalog))),
                }
            }
            Err(error) => Err((error, Box::new(catalog))),
        }
    }

    fn new(window: Window<R>, mut catalog: Catalog) -> Self {
        catalog.report.container = Some(Container::Bag1);
        catalog.report.file_bytes += window.end();
        Self {
            window,
            at: MAGIC.len() as u64,
            plain_chunk_end: 0,
            chunk: None,
            memory: Memory::default(),
            decoder: Decoder::default(),
            place: None,
            index: Index::default(),
            chunks_seen: 0,
            ids: Ids::default(),
            catalog,
        }
    }

    /// The connections known so far: all of them from the beginning where the bag has an index.
    #[must_use]
    pub fn connections(&self) -> &[Connection] {
        &self.catalog.connections
    }

    /// What was read so far, and what was lost.
    #[must_use]
    pub fn report(&self) -> &ReadReport {
        &self.catalog.report
    }

    /// Bytes of memory that buffers hold.
    pub(crate) fn held_bytes(&self) -> usize {
        self.window.held_bytes() + self.memory.buffer.capacity()
    }

    pub(crate) fn catalog_mut(&mut self) -> &mut Catalog {
        &mut self.catalog
    }

    pub(crate) fn into_catalog(self) -> Catalog {
        self.catalog
    }

    /// The next message in the order of the file, or none at its end or where the way is lost.
    ///
    /// # Errors
    ///
    /// [`BagError::Io`] where the stream fails. Damage is no error: it is in the [`report`](Self::report).
    pub fn next_message(&mut self) -> Result<Option<RawMessage<'_>>, BagError> {
        if self.advance()? { self.lend() } else { Ok(None) }
    }

    /// Goes on to the next message, if there is one.
    pub(crate) fn advance(&mut self) -> Result<bool, BagError> {
        self.place = loop {
            let step = match self.chunk {
                Some(chunk) => self.step_in_chunk(chunk)?,
                None => self.step_in_file()?,
            };
            match step {
                Step::Message(place) => break Some(place),
                Step::GoOn => {}
                Step::End => break None,
            }
        };
        if let Some(place) = self.place {
            self.catalog.report.count(place.id, place.log_stamp, place.data_bytes);
        }
        Ok(self.place.is_some())
    }

    /// The message gone to last.
    pub(crate) fn lend(&mut self) -> Result<Option<RawMessage<'_>>, BagError> {
        let Some(place) = self.place else { return Ok(None) };
        Ok(Some(place.lend(&self.catalog.connections, &mut self.memory, &mut self.window)?))
    }

    fn step_in_file(&mut self) -> io::Result<Step> {
        let end = self.window.end();
        if self.at >= end {
            self.at_end();
            return Ok(Step::End);
        }
        let record = match record_at(&mut self.window, self.at)? {
            Found::Record(record) => record,
            Found::Torn => return Ok(self.torn("a whole record")),
            Found::Other(found) => return self.lost("a record", &found),
        };
        if record.header.op == OP_CHUNK {
            return self.enter_chunk(record);
        }
        if record.header.op == OP_INDEX {
            return self.pass_index(record);
        }
        if record.end() > end && self.plain_chunk_end <= self.at {
            return Ok(self.torn("a whole record"));
        }
        if record.header.op == OP_MESSAGE && record.end() <= end {
            // in one go with what follows, or the window would go there and back
            self.window.get(record.at, (record.end() - record.at) as usize + NEXT_BYTES)?;
        }
        if record.end() > end || !follows(&mut self.window, record.end())? {
            if record.end() > end && self.plain_chunk_end >= end {
                return Ok(self.torn("a whole record"));
            }
            return self.lost("a record behind the one here", &format!("a length of {}", record.data_bytes));
        }
        self.at = record.end();
        Ok(match record.header.op {
            OP_MESSAGE => message(&record, record.at, false, &self.ids, &mut self.catalog),
            OP_CONNECTION => {
                take_connection(&mut self.window, &record, record.at, &mut self.ids, &mut self.catalog)?;
                Step::GoOn
            }
            _ => Step::GoOn,
        })
    }

    /// Index records are passed over. Some recorders wrote a length as of another version; the count is right then.
    fn pass_index(&mut self, record: Record) -> io::Result<Step> {
        let entries = u64::from(record.header.count.unwrap_or(0)) * 12;
        let by_count = record.data_at().saturating_add(entries);
        let by_length = record.end() == by_count || follows(&mut self.window, record.end())?;
        if by_length || !follows(&mut self.window, by_count)? {
            if record.end() > self.window.end() {
                return Ok(self.torn("a whole index record"));
            }
            if !by_length {
                return self.lost("a record behind the index here", &format!("a length of {}", record.data_bytes));
            }
            self.at = record.end();
            return Ok(Step::GoOn);
        }
        let found = format!("a length of {}", record.data_bytes);
        self.catalog.damage(DamageKind::Irregular, self.at, format!("an index of {entries} bytes"), found, 0);
        self.at = by_count;
        Ok(Step::GoOn)
    }

    fn enter_chunk(&mut self, record: Record) -> io::Result<Step> {
        self.chunks_seen = self.chunks_seen.saturating_add(1);
        let Some(codec) = record.header.codec else {
            return self.pass_bad_chunk(&record, DamageKind::UnknownCompression, "none, lz4 or bz2", "another".into());
        };
        *self.catalog.report.chunks.entry(codec.name()).or_default() += 1;
        let size = record.header.size.unwrap_or(0);
        if codec == Codec::None {
            if size != record.data_bytes {
                let found = format!("a length of {}", record.data_bytes);
                self.catalog.damage(DamageKind::Irregular, self.at, format!("a chunk of {size} bytes"), found, 0);
            }
            self.at = record.data_at();
            self.plain_chunk_end = record.end();
            return Ok(Step::GoOn);
        }
        let compressed = self.window.get(record.data_at(), record.data_bytes as usize)?;
        let torn = compressed.len() < record.data_bytes as usize;
        match self.decoder.decode(codec, compressed, u64::from(size), &mut self.memory) {
            Ok(()) => {}
            Err(Problem::Broken { .. }) if torn => {}
            Err(Problem::Broken { reason }) => {
                let expected = format!("{size} bytes after decompression");
                return self.pass_bad_chunk(&record, DamageKind::BadChunk, &expected, reason);
            }
            Err(Problem::TooLarge { limit_bytes }) => {
                let expected = format!("at most {limit_bytes} bytes after decompression");
                return self.pass_bad_chunk(&record, DamageKind::TooLarge, &expected, size.to_string());
            }
        }
        if torn {
            let (expected, found) = (format!("a chunk of {} bytes", record.data_bytes), self.window.end() - self.at);
            self.catalog.damage(DamageKind::Truncated, self.at, expected, format!("{found} bytes"), 0);
        }
        self.chunk = Some(OpenChunk { at: record.at, inside: 0, torn });
        self.at = record.end();
        Ok(Step::GoOn)
    }

    /// A chunk that cannot be used is passed over where a record follows it.
    fn pass_bad_chunk(&mut self, record: &Record, kind: DamageKind, expected: &str, found: String) -> io::Result<Step> {
        let next = if follows(&mut self.window, record.end())? {
            Some(record.end())
        } else {
            self.index.next_chunk(&mut self.window, self.at)?
        };
        let next = next.unwrap_or(self.window.end());
        self.catalog.damage(kind, self.at, expected, found, next - self.at);
        self.at = next;
        Ok(Step::GoOn)
    }

    fn step_in_chunk(&mut self, chunk: OpenChunk) -> io::Result<Step> {
        let end = self.memory.end();
        let rest = end - chunk.inside;
        let record = match record_at(&mut self.memory, chunk.inside)? {
            _ if rest == 0 => None,
            Found::Record(record) if record.end() <= end && follows(&mut self.memory, record.end())? => Some(record),
            _ => None,
        };
        let Some(record) = record else {
            return self.lost_in_chunk(chunk);
        };
        self.chunk = Some(OpenChunk { inside: record.end(), ..chunk });
        if record.header.op == OP_CONNECTION {
            take_connection(&mut self.memory, &record, chunk.at, &mut self.ids, &mut self.catalog)?;
        }
        Ok(match record.header.op {
            OP_MESSAGE => message(&record, chunk.at, true, &self.ids, &mut self.catalog),
            _ => Step::GoOn,
        })
    }

    fn lost_in_chunk(&mut self, chunk: OpenChunk) -> io::Result<Step> {
        let rest = self.memory.end() - chunk.inside;
        let next = if rest == 0 { None } else { behind_damaged(&mut self.memory, chunk.inside)? };
        self.chunk = next.map(|inside| OpenChunk { inside, ..chunk });
        if rest > 0 && !chunk.torn {
            let found = excerpt(self.memory.get(chunk.inside, 25)?);
            let expected = format!("a record at byte {} of the chunk here", chunk.inside);
            self.catalog.damage(DamageKind::BadRecord, chunk.at, expected, found, 0);
        }
        Ok(Step::GoOn)
    }

    /// The file ends within a record: no more comes.
    fn torn(&mut self, expected: &str) -> Step {
        let rest = self.window.end() - self.at;
        self.catalog.damage(DamageKind::Truncated, self.at, expected, format!("{rest} bytes"), rest);
        self.at = self.window.end();
        self.index = Index::default();
        Step::End
    }

    /// No record, or one that leads nowhere: on to where its lengths lead if that is a record, to the end of this chunk,
    /// or to the next chunk that the index names.
    fn lost(&mut self, expected: &str, found: &str) -> io::Result<Step> {
        let chunk_end = self.plain_chunk_end;
        let to_chunk_end =
            chunk_end > self.at && chunk_end < self.window.end() && follows(&mut self.window, chunk_end)?;
        let next = match behind_damaged(&mut self.window, self.at)? {
            Some(next) => Some(next),
            None if to_chunk_end => Some(chunk_end),
            None => self.index.next_chunk(&mut self.window, self.at)?,
        };
        let next = next.unwrap_or(self.window.end());
        self.catalog.damage(DamageKind::BadRecord, self.at, expected, found, next - self.at);
        self.at = next;
        Ok(Step::GoOn)
    }

    /// A file can also end between records.
    fn at_end(&mut self) {
        let index = std::mem::take(&mut self.index);
        let end = self.window.end();
        if index.at > end {
            let expected = format!("an index at byte {}", index.at);
            self.catalog.damage(DamageKind::Truncated, end, expected, "the end", 0);
        } else if index.at > 0 && self.chunks_seen < index.chunk_count {
            let (expected, found) = (format!("{} chunks", index.chunk_count), format!("{}", self.chunks_seen));
            self.catalog.damage(DamageKind::Truncated, end, expected, found, 0);
        }
    }
}

fn check_magic<R: Read + Seek>(mut window: Window<R>) -> Result<Window<R>, BagError> {
    let first = window.get(0, MAGIC.len())?;
    if first == MAGIC {
        return Ok(window);
    }
    let found = excerpt(first);
    Err(if first.starts_with(b"#ROSBAG V") || first.starts_with(b"#ROSRECORD V") {
        BagError::Version {
            offset_bytes: 0,
            expected: "a ROS 1 bag of version 2.0 (tools of ROS 1 rewrite older ones)",
            found,
        }
    } else {
        BagError::UnknownContainer { found }
    })
}

fn message(record: &Record, offset_bytes: u64, in_memory: bool, ids: &Ids, catalog: &mut Catalog) -> Step {
    let (Some(conn), Some(stamp)) = (record.header.conn, record.header.stamp) else {
        return Step::GoOn;
    };
    let Some(id) = ids.by_conn.get(&conn) else {
        let found = format!("connection {conn}");
        let skipped = record.end() - record.at;
        catalog.damage(DamageKind::UnknownConnection, offset_bytes, "a connection that is described", found, skipped);
        return Step::GoOn;
    };
    let (data_at, data_bytes) = (record.data_at(), record.data_bytes as usize);
    Step::Message(Place {
        id: *id,
        log_stamp: stamp,
        publish_stamp: None,
        offset_bytes,
        data_at,
        data_bytes,
        in_memory,
    })
}
