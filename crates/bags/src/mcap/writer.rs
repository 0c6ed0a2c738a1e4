//! MCAP out.

use super::MAGIC;
use super::record::{
    OP_CHANNEL, OP_CHUNK, OP_CHUNK_INDEX, OP_DATA_END, OP_FOOTER, OP_HEADER, OP_MESSAGE, OP_MESSAGE_INDEX, OP_SCHEMA,
    OP_STATISTICS, OP_SUMMARY_OFFSET,
};
use crate::error::BagError;
use crate::message::{Connection, DefinitionFormat};
use mapwright_geom::Stamp;
use std::collections::BTreeMap;
use std::io::{self, Write};

/// A chunk is closed when it has grown to this.
const CHUNK_BYTES: u64 = 1 << 20;
/// zstd's own default.
const ZSTD_LEVEL: i32 = 3;

/// How the chunks of an MCAP file are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum McapCompression {
    /// Not at all.
    None,
    /// zstd.
    #[default]
    Zstd,
}

/// Writes an MCAP file as `ros2 bag` and Foxglove read it: profile `ros2`, chunks with checksums, index and summary.
///
/// ```
/// use mapwright_bags::{Connection, Encoding, McapCompression, McapReader, McapWriter};
/// use mapwright_geom::Stamp;
/// use std::io::Cursor;
///
/// let mut content = Cursor::new(Vec::new());
/// let mut writer = McapWriter::new(&mut content, McapCompression::Zstd)?;
/// let id = writer.add_connection(&Connection::new("/text", "std_msgs/msg/String", Encoding::Cdr))?;
/// writer.write(id, Stamp(7), Stamp(5), b"\0\x01\0\0\x03\0\0\0hi\0")?;
/// writer.finish()?;
/// let mut reader = McapReader::open(content)?;
/// assert_eq!(reader.next_message()?.unwrap().log_stamp, Stamp(7));
/// # Ok::<(), mapwright_bags::BagError>(())
/// ```
#[derive(Debug)]
pub struct McapWriter<W> {
    out: Counted<W>,
    compression: McapCompression,
    chunk_bytes: u64,
    /// Bodies of the schemas, without their ids, which are their places from 1 on.
    schemas: Vec<Vec<u8>>,
    /// The same of the channels.
    channels: Vec<Vec<u8>>,
    /// Messages of each channel.
    counts: Vec<u64>,
    chunk: OpenChunk,
    /// Bodies of the chunks' indices.
    chunk_indices: Vec<Vec<u8>>,
    times: Option<(u64, u64)>,
}

/// A chunk before it is written.
#[derive(Debug, Default)]
struct OpenChunk {
    content: Vec<u8>,
    /// By channel, log times and places of messages.
    entries: BTreeMap<u16, Vec<(u64, u64)>>,
    times: Option<(u64, u64)>,
}

/// What was written, counted and summed.
#[derive(Debug)]
struct Counted<W> {
    writer: W,
    at: u64,
    crc: crc32fast::Hasher,
}

impl<W: Write> Counted<W> {
    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.writer.write_all(bytes)?;
        self.at += bytes.len() as u64;
        self.crc.update(bytes);
        Ok(())
    }
}

impl<W: Write> McapWriter<W> {
    /// A file from the start of `writer`.
    ///
    /// # Errors
    ///
    /// [`BagError::Io`].
    pub fn new(writer: W, compression: McapCompression) -> Result<Self, BagError> {
        Self::with_chunk_bytes(writer, compression, CHUNK_BYTES)
    }

    /// The same, with chunks closed when they have grown to so many bytes, instead of 1 MiB.
    ///
    /// # Errors
    ///
    /// [`BagError::Io`].
    pub fn with_chunk_bytes(writer: W, compression: McapCompression, chunk_bytes: u64) -> Result<Self, BagError> {
        let mut out = Counted { writer, at: 0, crc: crc32fast::Hasher::new() };
        out.put(MAGIC)?;
        let library = concat!("mapwright ", env!("CARGO_PKG_VERSION"));
        out.put(&record(OP_HEADER, &[&text("ros2"), &text(library)]))?;
        Ok(Self {
            out,
            compression,
            chunk_bytes,
            schemas: Vec::new(),
            channels: Vec::new(),
            counts: Vec::new(),
            chunk: OpenChunk::default(),
            chunk_indices: Vec::new(),
            times: None,
        })
    }

    /// A connection and its id, the same for the same connection. Its definition becomes the schema, an empty `ros2msg` where
    /// it has none.
    ///
    /// # Errors
    ///
    /// [`BagError::Mcap`] for more than 65,535 connections.
    pub fn add_connection(&mut self, connection: &Connection) -> Result<u32, BagError> {
        let (format, definition) = match &connection.definition {
            Some(definition) => (definition.format.name(), &*definition.text),
            None => (DefinitionFormat::Ros2Msg.name(), ""),
        };
        let schema = [text(&connection.type_name), text(format), text(definition)].concat();
        let schema = add(OP_SCHEMA, &mut self.schemas, schema, &mut self.chunk)?;
        let mut metadata = connection.metadata.clone();
        metadata.entry("offered_qos_profiles".to_owned()).or_default(); // rosbag2 looks for it
        let metadata: Vec<u8> = metadata.iter().flat_map(|(key, value)| [text(key), text(value)].concat()).collect();
        let (topic, encoding) = (text(&connection.topic), text(connection.encoding.name()));
        let channel = [&schema.to_le_bytes()[..], &topic, &encoding, &sized(&metadata)].concat();
        let id = add(OP_CHANNEL, &mut self.channels, channel, &mut self.chunk)?;
        self.counts.resize(self.channels.len(), 0);
        Ok(u32::from(id))
    }

    /// Appends a message, received at `log_stamp` and published at `publish_stamp`.
    ///
    /// # Errors
    ///
    /// [`BagError::NotRepresentable`] for stamps before their epoch or a connection that was not added; [`BagError::Io`].
    pub fn write(
        &mut self,
        connection: u32,
        log_stamp: Stamp,
        publish_stamp: Stamp,
        data: &[u8],
    ) -> Result<(), BagError> {
        let channel = u16::try_from(connection).ok().filter(|id| (1..=self.channels.len()).contains(&usize::from(*id)));
        let Some(channel) = channel else {
            return Err(not_representable("a message", "a connection that was added", connection.to_string()));
        };
        let (log_time, publish_time) = (nanoseconds(log_stamp)?, nanoseconds(publish_stamp)?);
        let count = &mut self.counts[usize::from(channel) - 1];
        let sequence = *count as u32; // begins anew after 2^32
        *count += 1;
        let place = self.chunk.content.len() as u64;
        self.chunk.entries.entry(channel).or_default().push((log_time, place));
        self.chunk.times = Some(widened(self.chunk.times, log_time));
        let (channel, sequence) = (channel.to_le_bytes(), sequence.to_le_bytes());
        let (log_time, publish_time) = (log_time.to_le_bytes(), publish_time.to_le_bytes());
        put_record(&mut self.chunk.content, OP_MESSAGE, &[&channel, &sequence, &log_time, &publish_time, data]);
        if self.chunk.content.len() as u64 >= self.chunk_bytes { self.close_chunk() } else { Ok(()) }
    }

    fn close_chunk(&mut self) -> Result<(), BagError> {
        let OpenChunk { content, entries, times } = std::mem::take(&mut self.chunk);
        let (first, last) = times.unwrap_or_default();
        for time in times.into_iter().flat_map(|(first, last)| [first, last]) {
            self.times = Some(widened(self.times, time));
        }
        let (name, stored) = match self.compression {
            McapCompression::None => ("", None),
            McapCompression::Zstd => ("zstd", Some(zstd::bulk::compress(&content, ZSTD_LEVEL)?)),
        };
        let stored = stored.as_ref().unwrap_or(&content);
        let (size, stored_size) = (content.len() as u64, stored.len() as u64);
        let times = [first.to_le_bytes(), last.to_le_bytes()].concat();
        let crc = crc32fast::hash(&content).to_le_bytes();
        let chunk_at = self.out.at;
        let sizes = [size.to_le_bytes(), stored_size.to_le_bytes()];
        self.out.put(&record(OP_CHUNK, &[&times, &sizes[0], &crc, &text(name), &sizes[1], stored]))?;
        let chunk_length = self.out.at - chunk_at;
        let mut places = Vec::new();
        for (channel, entries) in &entries {
            let channel = channel.to_le_bytes();
            places.extend([&channel[..], &self.out.at.to_le_bytes()].concat());
            let entries: Vec<u8> =
                entries.iter().flat_map(|(time, at)| [time.to_le_bytes(), at.to_le_bytes()].concat()).collect();
            self.out.put(&record(OP_MESSAGE_INDEX, &[&channel, &sized(&entries)]))?;
        }
        let index_length = self.out.at - chunk_at - chunk_length;
        let chunk = [chunk_at.to_le_bytes(), chunk_length.to_le_bytes()].concat();
        let sizes = [stored_size.to_le_bytes(), size.to_le_bytes()].concat();
        let index = [&times[..], &chunk, &sized(&places), &index_length.to_le_bytes(), &text(name), &sizes].concat();
        self.chunk_indices.push(index);
        Ok(())
    }

    /// Closes the last chunk and writes the summary.
    ///
    /// # Errors
    ///
    /// [`BagError::Io`].
    pub fn finish(mut self) -> Result<W, BagError> {
        if !self.chunk.content.is_empty() {
            self.close_chunk()?;
        }
        let crc = self.out.crc.clone().finalize();
        self.out.put(&record(OP_DATA_END, &[&crc.to_le_bytes()]))?;
        let summary = self.summary();
        self.out.put(&summary)?;
        self.out.put(MAGIC)?;
        self.out.writer.flush()?;
        Ok(self.out.writer)
    }

    /// The summary with its footer, from where the file stands.
    fn summary(&self) -> Vec<u8> {
        let start = self.out.at;
        let (mut summary, mut offsets) = (Vec::new(), Vec::new());
        let groups = [
            (OP_SCHEMA, numbered(&self.schemas)),
            (OP_CHANNEL, numbered(&self.channels)),
            (OP_STATISTICS, vec![self.statistics()]),
            (OP_CHUNK_INDEX, self.chunk_indices.clone()),
        ];
        for (op, bodies) in groups.iter().filter(|(_, bodies)| !bodies.is_empty()) {
            let at = start + summary.len() as u64;
            bodies.iter().for_each(|body| put_record(&mut summary, *op, &[body]));
            let length = start + summary.len() as u64 - at;
            put_record(&mut offsets, OP_SUMMARY_OFFSET, &[&[*op], &at.to_le_bytes(), &length.to_le_bytes()]);
        }
        let offsets_at = start + summary.len() as u64;
        summary.extend(offsets);
        let places = [start.to_le_bytes(), offsets_at.to_le_bytes()].concat();
        put_record(&mut summary, OP_FOOTER, &[&places, &[0; 4]]);
        // the footer's checksum is of all from the summary's start up to itself
        let crc_at = summary.len() - 4;
        let crc = crc32fast::hash(&summary[..crc_at]);
        summary.truncate(crc_at);
        summary.extend(crc.to_le_bytes());
        summary
    }

    fn statistics(&self) -> Vec<u8> {
        let (first, last) = self.times.unwrap_or_default();
        let all: u64 = self.counts.iter().sum();
        let used = self.counts.iter().zip(1_u16..).filter(|(count, _)| **count > 0);
        let counts: Vec<u8> =
            used.flat_map(|(count, id)| [&id.to_le_bytes()[..], &count.to_le_bytes()].concat()).collect();
        let [channels, chunks] = [self.channels.len(), self.chunk_indices.len()].map(|n| (n as u32).to_le_bytes());
        let schemas = (self.schemas.len() as u16).to_le_bytes();
        let (attachments, metadata) = ([0; 4], [0; 4]);
        let times = [first.to_le_bytes(), last.to_le_bytes()].concat();
        let numbers = [&schemas[..], &channels, &attachments, &metadata, &chunks].concat();
        [&all.to_le_bytes()[..], &numbers, &times, &sized(&counts)].concat()
    }
}

/// The id of a schema or channel among those known, which from now on has it; a new one is described in the chunk.
fn add(op: u8, known: &mut Vec<Vec<u8>>, body: Vec<u8>, chunk: &mut OpenChunk) -> Result<u16, BagError> {
    let place = known.iter().position(|other| *other == body).unwrap_or(known.len());
    let Ok(id) = u16::try_from(place + 1) else {
        return Err(BagError::Mcap(format!("expected at most {} schemas and channels, found more", u16::MAX)));
    };
    if place == known.len() {
        put_record(&mut chunk.content, op, &[&id.to_le_bytes(), &body]);
        known.push(body);
    }
    Ok(id)
}

/// Bodies behind their ids.
fn numbered(bodies: &[Vec<u8>]) -> Vec<Vec<u8>> {
    bodies.iter().zip(1_u16..).map(|(body, id)| [&id.to_le_bytes()[..], body].concat()).collect()
}

fn widened(times: Option<(u64, u64)>, time: u64) -> (u64, u64) {
    times.map_or((time, time), |(first, last)| (first.min(time), last.max(time)))
}

fn record(op: u8, parts: &[&[u8]]) -> Vec<u8> {
    let mut record = Vec::new();
    put_record(&mut record, op, parts);
    record
}

fn put_record(out: &mut Vec<u8>, op: u8, parts: &[&[u8]]) {
    let length: usize = parts.iter().map(|part| part.len()).sum();
    out.push(op);
    out.extend((length as u64).to_le_bytes());
    parts.iter().for_each(|part| out.extend_from_slice(part));
}

fn text(text: &str) -> Vec<u8> {
    sized(text.as_bytes())
}

/// Bytes behind their number.
fn sized(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes()[..], bytes].concat()
}

fn not_representable(what: &'static str, expected: &'static str, found: String) -> BagError {
    BagError::NotRepresentable { container: "MCAP", what, expected, found }
}

fn nanoseconds(stamp: Stamp) -> Result<u64, BagError> {
    u64::try_from(stamp.0).map_err(|_| not_representable("a stamp", "none before its epoch", format!("{} ns", stamp.0)))
}
