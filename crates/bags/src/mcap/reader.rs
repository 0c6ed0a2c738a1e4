//! Messages out of an MCAP file.

use super::record::{self, Found, Record, behind_damaged, follows, record_at};
use super::record::{OP_ATTACHMENT, OP_CHUNK, OP_DATA_END, OP_FOOTER, OP_MESSAGE};
use super::records::{OpenChunk, message, record_in_chunk};
use super::{MAGIC, summary};
use crate::catalog::Catalog;
use crate::decode::{Codec, Decoder, Problem};
use crate::error::BagError;
use crate::mcap::channels::Channels;
use crate::message::{Connection, RawMessage};
use crate::place::{Place, Step};
use crate::report::{Container, DamageKind, ReadReport};
use crate::window::{Bytes, Memory, Window, excerpt};
use std::io::{self, Read, Seek};

/// The fixed part of a chunk before the name of its compression, and that name at its longest.
const CHUNK_HEAD_BYTES: usize = 128;

/// Where the way is lost, records are looked for in blocks of so many bytes,
const RESYNC_BYTES: usize = 1 << 16;
/// at so many places that may be one,
const RESYNC_TRIES: u32 = 1 << 16;
/// and found where so many follow one another.
const RESYNC_ROW: usize = 3;

/// Reads an MCAP file from its first record to its last, in the order of the file.
#[derive(Debug)]
pub struct McapReader<R> {
    window: Window<R>,
    /// Where the next record is.
    at: u64,
    chunk: Option<OpenChunk>,
    memory: Memory,
    decoder: Decoder,
    place: Option<Place>,
    channels: Channels,
    /// Where chunks begin according to the summary, ascending.
    chunks_at: Vec<u64>,
    catalog: Catalog,
}

impl<R: Read + Seek> McapReader<R> {
    /// Opens a file, and looks at its summary where it has one.
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
                match summary::look(&mut reader.window, &mut reader.channels, &mut reader.catalog) {
                    Ok(chunks_at) => Ok(Self { chunks_at, ..reader }),
                    Err(error) => Err((error.into(), Box::new(reader.catalog))),
                }
            }
            Err(error) => Err((error, Box::new(catalog))),
        }
    }

    fn new(window: Window<R>, mut catalog: Catalog) -> Self {
        catalog.report.container = Some(Container::Mcap);
        catalog.report.file_bytes += window.end();
        Self {
            window,
            at: MAGIC.len() as u64,
            chunk: None,
            memory: Memory::default(),
            decoder: Decoder::default(),
            place: None,
            channels: Channels::default(),
            chunks_at: Vec::new(),
            catalog,
        }
    }

    /// The connections known so far: all of them from the beginning where the file has a summary.
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
        if self.at > end {
            return Ok(Step::End);
        }
        let record = match record_at(&mut self.window, self.at)? {
            Found::Record(record) => record,
            Found::Torn => return Ok(self.torn("a record, or the end of the data")),
            Found::Other(found) => return self.lost("a record", &found),
        };
        if record.op == OP_CHUNK {
            return self.enter_chunk(record);
        }
        if self.chunks_at.binary_search(&record.at).is_ok() {
            // the summary knows better, and the chunk's checksum will tell
            let found = format!("a record of kind {}", record.op);
            self.catalog.damage(DamageKind::BadRecord, self.at, "a chunk", found, 0);
            return self.enter_chunk(record);
        }
        if matches!(record.op, OP_DATA_END | OP_FOOTER) {
            return match self.next_file(record)? {
                Some(at) => Ok(self.begin_next_file(at)),
                None => self.finish(),
            };
        }
        if record.end() > end {
            // what an attachment holds may look like records
            let next = if record.op == OP_ATTACHMENT { None } else { self.resync()? };
            let found = || format!("a length of {}", record.length);
            return Ok(match next {
                Some(_) => self.go_on_at(next, DamageKind::BadRecord, "a record that ends within the file", &found()),
                None => self.torn("a whole record"),
            });
        }
        // in one go with the head of what follows, or the window would go there and back
        if record.op == OP_MESSAGE {
            self.window.get(record.at, (record.end() - record.at + record::HEAD_BYTES) as usize)?;
        }
        if !follows(&mut self.window, record.end())? {
            return self.lost("a record behind the one here", &format!("a length of {}", record.length));
        }
        self.at = record.end();
        let whole = (record.at, false);
        self.channels.take(&mut self.window, record, whole.0, &mut self.catalog)?;
        message(&mut self.window, record, whole, &self.channels, &mut self.catalog)
    }

    fn enter_chunk(&mut self, record: Record) -> io::Result<Step> {
        let end = self.window.end();
        let body = self.window.get(record.body_at(), CHUNK_HEAD_BYTES.min(record.length as usize))?;
        // with a summary the file was not cut: the length must be wrong
        let torn = record.end() > end && self.chunks_at.is_empty();
        let Some(head) = record::chunk_head(body) else {
            return if torn { Ok(self.torn("a whole chunk")) } else { self.lost("a chunk", "no head of one") };
        };
        let Some(codec) = Codec::from_name(&head.compression) else {
            let found = excerpt(&head.compression);
            return self.pass_bad_chunk(&record, DamageKind::UnknownCompression, "none, lz4 or zstd", &found);
        };
        *self.catalog.report.chunks.entry(codec.name()).or_default() += 1;
        let stored = head.stored.min(record.length - head.records_at);
        let records_at = record.body_at() + head.records_at;
        let found = self.open_chunk(codec, &head, (records_at, stored))?;
        match found {
            Err((kind, expected, found)) if !torn || kind == DamageKind::TooLarge => {
                return self.pass_bad_chunk(&record, kind, &expected, &found);
            }
            _ => {}
        }
        if torn {
            let found = format!("{} bytes", end - self.at);
            self.catalog.damage(DamageKind::Truncated, self.at, format!("{} bytes", record.length), found, 0);
        }
        let (inside, chunk_end) = match codec {
            Codec::None => (records_at, (records_at + stored).min(end)),
            _ => (0, self.memory.end()),
        };
        self.chunk = Some(OpenChunk { at: record.at, in_memory: codec != Codec::None, inside, end: chunk_end, torn });
        self.at = if record.end() > end && !torn { self.next_chunk()?.unwrap_or(u64::MAX) } else { record.end() };
        Ok(Step::GoOn)
    }

    /// Brings a chunk's records into memory and compares their checksum; else what is wrong, expected and found.
    fn open_chunk(
        &mut self,
        codec: Codec,
        head: &record::ChunkHead,
        (records_at, stored): (u64, u64),
    ) -> io::Result<Result<(), (DamageKind, String, String)>> {
        let stored_bytes = self.window.get(records_at, stored as usize)?;
        let is_whole = stored_bytes.len() as u64 == head.stored;
        let records = if codec == Codec::None {
            stored_bytes
        } else {
            match self.decoder.decode(codec, stored_bytes, head.size, &mut self.memory) {
                Ok(()) => &self.memory.buffer[..self.memory.filled],
                Err(Problem::TooLarge { limit_bytes }) => {
                    let expected = format!("at most {limit_bytes} bytes after decompression");
                    return Ok(Err((DamageKind::TooLarge, expected, head.size.to_string())));
                }
                Err(Problem::Broken { reason }) => {
                    let expected = format!("{} bytes after decompression", head.size);
                    return Ok(Err((DamageKind::BadChunk, expected, reason)));
                }
            }
        };
        if !is_whole {
            return Ok(Err((DamageKind::BadChunk, format!("{} bytes", head.stored), format!("{stored} bytes"))));
        }
        let crc = if head.crc == 0 { 0 } else { crc32fast::hash(records) };
        Ok(if crc == head.crc {
            Ok(())
        } else {
            Err((DamageKind::BadChecksum, format!("checksum {:08x}", head.crc), format!("{crc:08x}")))
        })
    }

    /// A chunk that cannot be used is passed over where a record follows it.
    fn pass_bad_chunk(&mut self, record: &Record, kind: DamageKind, expected: &str, found: &str) -> io::Result<Step> {
        let next = if follows(&mut self.window, record.end())? { Some(record.end()) } else { self.next_chunk()? };
        Ok(self.go_on_at(next, kind, expected, found))
    }

    fn step_in_chunk(&mut self, chunk: OpenChunk) -> io::Result<Step> {
        let (step, next) = if chunk.in_memory {
            record_in_chunk(&mut self.memory, chunk, &mut self.channels, &mut self.catalog)?
        } else {
            record_in_chunk(&mut self.window, chunk, &mut self.channels, &mut self.catalog)?
        };
        self.chunk = next;
        Ok(step)
    }

    /// The file ends within a record: no more comes.
    fn torn(&mut self, expected: &str) -> Step {
        let rest = self.window.end().saturating_sub(self.at);
        if self.at <= self.window.end() {
            self.catalog.damage(DamageKind::Truncated, self.at, expected, format!("{rest} bytes"), rest);
        }
        self.at = u64::MAX;
        Step::End
    }

    /// No record, or one that leads nowhere: on to where its length leads if that is a record, else to the next chunk that
    /// the summary names, else to where records follow one another again.
    fn lost(&mut self, expected: &str, found: &str) -> io::Result<Step> {
        let next = match behind_damaged(&mut self.window, self.at)? {
            Some(next) => Some(next),
            None => match self.next_chunk()? {
                Some(next) => Some(next),
                None => self.resync()?,
            },
        };
        Ok(self.go_on_at(next, DamageKind::BadRecord, expected, found))
    }

    fn go_on_at(&mut self, next: Option<u64>, kind: DamageKind, expected: &str, found: &str) -> Step {
        let end = self.window.end();
        self.catalog.damage(kind, self.at, expected, found, next.unwrap_or(end) - self.at);
        self.at = next.unwrap_or(u64::MAX);
        Step::GoOn
    }

    /// The next chunk that the summary names and that is there.
    fn next_chunk(&mut self) -> io::Result<Option<u64>> {
        let from = self.chunks_at.partition_point(|at| *at <= self.at);
        for place in from..self.chunks_at.len() {
            let at = self.chunks_at[place];
            if matches!(record_at(&mut self.window, at)?, Found::Record(r) if r.op == OP_CHUNK) {
                return Ok(Some(at));
            }
        }
        Ok(None)
    }

    /// The first place behind this one from which on a few records follow one another.
    fn resync(&mut self) -> io::Result<Option<u64>> {
        let (mut from, mut tries) = (self.at + 1, 0);
        while from < self.window.end() {
            let block = self.window.get(from, RESYNC_BYTES)?;
            let beyond = block.len();
            let heads = block.windows(record::HEAD_BYTES as usize);
            let likely = |head: &[u8]| (OP_FOOTER..=OP_DATA_END).contains(&head[0]) && head[5..] == [0; 4];
            let places: Vec<u64> = (from..).zip(heads).filter(|(_, head)| likely(head)).map(|(at, _)| at).collect();
            for at in places {
                tries += 1;
                if tries > RESYNC_TRIES {
                    return Ok(None);
                }
                if self.is_row(at)? {
                    return Ok(Some(at));
                }
            }
            from += (beyond as u64).saturating_sub(record::HEAD_BYTES - 1).max(1);
        }
        Ok(None)
    }

    /// Whether a few records follow one another from here on, or all up to the end; messages only of known channels.
    fn is_row(&mut self, mut at: u64) -> io::Result<bool> {
        for _ in 0..RESYNC_ROW {
            let record = match record_at(&mut self.window, at)? {
                Found::Record(record) if record.op <= OP_DATA_END && record.end() <= self.window.end() => record,
                _ => return Ok(false),
            };
            if record.op == OP_MESSAGE {
                let head = self.window.get(record.body_at(), record::MESSAGE_HEAD_BYTES as usize)?;
                let is_known =
                    record::message_head(head).is_some_and(|head| self.channels.connection(head.channel).is_some());
                if record.length < record::MESSAGE_HEAD_BYTES || !is_known {
                    return Ok(false);
                }
            }
            if record.op == OP_FOOTER {
                return Ok(record.end() + MAGIC.len() as u64 == self.window.end());
            }
            at = record.end();
        }
        Ok(true)
    }

    /// Where the records of another file begin that was put behind this one, whose data end here.
    fn next_file(&mut self, mut record: Record) -> io::Result<Option<u64>> {
        let magic = MAGIC.len() as u64;
        while record.op != OP_FOOTER {
            record = match record_at(&mut self.window, record.end())? {
                Found::Record(next) if next.end() <= self.window.end() => next,
                _ => return Ok(None),
            };
        }
        let both = self.window.get(record.end(), 2 * MAGIC.len())?;
        Ok((both.len() == 2 * MAGIC.len() && both.chunks(MAGIC.len()).all(|part| part == MAGIC))
            .then_some(record.end() + 2 * magic))
    }

    /// Its channels are described anew.
    fn begin_next_file(&mut self, at: u64) -> Step {
        let begin = at - MAGIC.len() as u64;
        self.catalog.damage(DamageKind::Irregular, begin, "the end of the file", "another MCAP file, read as well", 0);
        self.channels = Channels::default();
        self.chunks_at.clear();
        self.at = at;
        Step::GoOn
    }

    /// The end of the data; what comes behind is summary, and the magic last.
    fn finish(&mut self) -> io::Result<Step> {
        let end = self.window.end();
        let last = self.window.get(end.saturating_sub(MAGIC.len() as u64), MAGIC.len())?;
        if last != MAGIC {
            let found = excerpt(last);
            self.catalog.damage(DamageKind::BadIndex, end, "the magic bytes at the end", found, 0);
        }
        self.at = u64::MAX;
        Ok(Step::End)
    }
}

fn check_magic<R: Read + Seek>(mut window: Window<R>) -> Result<Window<R>, BagError> {
    let first = window.get(0, MAGIC.len())?;
    if first == MAGIC {
        return Ok(window);
    }
    let found = excerpt(first);
    Err(if first.starts_with(&MAGIC[..5]) {
        BagError::Version { offset_bytes: 5, expected: "an MCAP file of version 0", found }
    } else {
        BagError::UnknownContainer { found }
    })
}
