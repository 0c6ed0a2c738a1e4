//! ROS 1 bags out.

use super::MAGIC;
use super::record::{OP_BAG, OP_CHUNK, OP_CHUNK_INFO, OP_CONNECTION, OP_INDEX, OP_MESSAGE};
use crate::error::BagError;
use crate::message::Connection;
use lz4_flex::frame::{BlockMode, BlockSize, FrameEncoder, FrameInfo};
use mapwright_geom::Stamp;
use std::collections::BTreeMap;
use std::io::{self, Seek, SeekFrom, Write};

/// A chunk is closed when it has grown to this, as `rosbag record` does it.
const CHUNK_BYTES: usize = 768 << 10;
/// The bag's header with its padding, so that it can be written anew at the end.
const BAG_HEADER_BYTES: usize = 4096;

/// How the chunks of a ROS 1 bag are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Bag1Compression {
    /// Not at all.
    #[default]
    None,
    /// lz4, readable by roslz4.
    Lz4,
    /// bzip2: smaller and slower.
    Bz2,
}

/// Seconds and nanoseconds.
type RosTime = (u32, u32);

/// Writes a ROS 1 bag 2.0 with chunks and an index.
///
/// ```
/// use mapwright_bags::{Bag1Compression, Bag1Writer, Bag1Reader, Connection, DefinitionFormat, Encoding};
/// use mapwright_geom::Stamp;
/// use std::io::Cursor;
///
/// let text = Connection::new("/text", "std_msgs/String", Encoding::Ros1)
///     .with_definition(DefinitionFormat::Ros1Msg, "string data\n")
///     .with_metadata("md5sum", "992ce8a1687cec8c8bd883ec73ca41d1");
/// let mut writer = Bag1Writer::new(Cursor::new(Vec::new()), Bag1Compression::Lz4)?;
/// let id = writer.add_connection(&text)?;
/// writer.write(id, Stamp(1_500_000_000), b"\x02\0\0\0hi")?;
/// let mut reader = Bag1Reader::open(writer.finish()?)?;
/// assert_eq!(reader.next_message()?.unwrap().data, b"\x02\0\0\0hi");
/// # Ok::<(), mapwright_bags::BagError>(())
/// ```
#[derive(Debug)]
pub struct Bag1Writer<W> {
    writer: W,
    compression: Bag1Compression,
    chunk_bytes: usize,
    /// Where the bag begins.
    start: u64,
    /// Written so far.
    at: u64,
    connections: Vec<Vec<u8>>,
    chunk: OpenChunk,
    chunks: Vec<ChunkInfo>,
}

#[derive(Debug, Default)]
struct OpenChunk {
    content: Vec<u8>,
    /// By connection, stamps and places of messages.
    entries: BTreeMap<u32, Vec<(RosTime, u32)>>,
    /// Connections described in this bag so far.
    described: Vec<bool>,
    times: Option<(RosTime, RosTime)>,
}

#[derive(Debug)]
struct ChunkInfo {
    at: u64,
    times: (RosTime, RosTime),
    counts: Vec<(u32, u32)>,
}

impl<W: Write + Seek> Bag1Writer<W> {
    /// A bag from where `writer` stands.
    ///
    /// # Errors
    ///
    /// [`BagError::Io`].
    pub fn new(mut writer: W, compression: Bag1Compression) -> Result<Self, BagError> {
        let start = writer.stream_position()?;
        writer.write_all(MAGIC)?;
        writer.write_all(&bag_header(0, 0, 0))?;
        let at = (MAGIC.len() + BAG_HEADER_BYTES) as u64;
        let (connections, chunk, chunks) = (Vec::new(), OpenChunk::default(), Vec::new());
        Ok(Self { writer, compression, chunk_bytes: CHUNK_BYTES, start, at, connections, chunk, chunks })
    }

    /// Has chunks closed when they have grown to so many bytes, instead of 768 KiB.
    #[must_use]
    pub fn with_chunk_bytes(self, chunk_bytes: usize) -> Self {
        Self { chunk_bytes, ..self }
    }

    /// A further connection and the id it gets. Its metadata must have `md5sum`; without a definition an empty one is
    /// written.
    ///
    /// # Errors
    ///
    /// [`BagError::NotRepresentable`] where `md5sum` is missing.
    pub fn add_connection(&mut self, connection: &Connection) -> Result<u32, BagError> {
        if !connection.metadata.contains_key("md5sum") {
            let found = format!("none for {} on {}", connection.type_name, connection.topic);
            return Err(not_representable("a connection", "its type's md5sum", found));
        }
        let id = self.connections.len() as u32;
        self.connections.push(connection_record(id, connection));
        self.chunk.described.push(false);
        Ok(id)
    }

    /// Appends a message; `log_stamp` is when it was received.
    ///
    /// # Errors
    ///
    /// [`BagError::NotRepresentable`] for a stamp before 1970 or after 2106, a message of 4 GiB or a connection that was
    /// not added; [`BagError::Io`].
    pub fn write(&mut self, connection: u32, log_stamp: Stamp, data: &[u8]) -> Result<(), BagError> {
        let time = ros_time(log_stamp)?;
        let Some(record) = self.connections.get(connection as usize) else {
            return Err(not_representable("a message", "a connection that was added", connection.to_string()));
        };
        if data.len() > (u32::MAX / 2) as usize {
            return Err(not_representable("a message", "less than 2 GiB", format!("{} bytes", data.len())));
        }
        if !std::mem::replace(&mut self.chunk.described[connection as usize], true) {
            self.chunk.content.extend_from_slice(record);
        }
        let place = self.chunk.content.len() as u32;
        put_record(
            &mut self.chunk.content,
            &[("op", &[OP_MESSAGE]), ("conn", &connection.to_le_bytes()), ("time", &time_bytes(time))],
            data,
        );
        self.chunk.entries.entry(connection).or_default().push((time, place));
        self.chunk.times = Some(self.chunk.times.map_or((time, time), |(a, b)| (a.min(time), b.max(time))));
        if self.chunk.content.len() >= self.chunk_bytes { self.close_chunk() } else { Ok(()) }
    }

    fn close_chunk(&mut self) -> Result<(), BagError> {
        let Some(times) = self.chunk.times.take() else { return Ok(()) };
        let content = std::mem::take(&mut self.chunk.content);
        let entries = std::mem::take(&mut self.chunk.entries);
        let (name, compressed) = match self.compression {
            Bag1Compression::None => ("none", None),
            Bag1Compression::Lz4 => ("lz4", Some(lz4(&content)?)),
            Bag1Compression::Bz2 => ("bz2", Some(bz2(&content)?)),
        };
        let size = (content.len() as u32).to_le_bytes();
        let mut head = Vec::new();
        let fields = [("op", &[OP_CHUNK][..]), ("compression", name.as_bytes()), ("size", &size)];
        put_head(&mut head, &fields, compressed.as_ref().unwrap_or(&content).len());
        let mut index = Vec::new();
        let mut counts = Vec::new();
        for (connection, entries) in entries {
            put_index(&mut index, connection, &entries);
            counts.push((connection, entries.len() as u32));
        }
        self.chunks.push(ChunkInfo { at: self.at, times, counts });
        for bytes in [&head, compressed.as_ref().unwrap_or(&content), &index] {
            self.put(bytes)?;
        }
        self.chunk.content = content;
        self.chunk.content.clear();
        Ok(())
    }

    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.writer.write_all(bytes)?;
        self.at += bytes.len() as u64;
        Ok(())
    }

    /// Closes the last chunk, writes the index and returns the writer, flushed and at the bag's end.
    ///
    /// # Errors
    ///
    /// [`BagError::Io`].
    pub fn finish(mut self) -> Result<W, BagError> {
        self.close_chunk()?;
        let index_at = self.at;
        for record in std::mem::take(&mut self.connections) {
            self.put(&record)?;
        }
        let connections = self.chunk.described.len() as u32;
        let chunks = std::mem::take(&mut self.chunks);
        for chunk in &chunks {
            let mut record = Vec::new();
            put_chunk_info(&mut record, chunk);
            self.put(&record)?;
        }
        self.writer.seek(SeekFrom::Start(self.start + MAGIC.len() as u64))?;
        self.writer.write_all(&bag_header(index_at, connections, chunks.len() as u32))?;
        self.writer.seek(SeekFrom::Start(self.start + self.at))?;
        self.writer.flush()?;
        Ok(self.writer)
    }
}

fn not_representable(what: &'static str, expected: &'static str, found: String) -> BagError {
    BagError::NotRepresentable { container: "a ROS 1 bag", what, expected, found }
}

fn ros_time(stamp: Stamp) -> Result<RosTime, BagError> {
    let seconds = u32::try_from(stamp.0.div_euclid(1_000_000_000));
    let seconds = seconds.map_err(|_| not_representable("a stamp", "1970 to 2106", format!("{} ns", stamp.0)))?;
    Ok((seconds, stamp.0.rem_euclid(1_000_000_000) as u32))
}

fn time_bytes((seconds, nanoseconds): RosTime) -> [u8; 8] {
    (u64::from(nanoseconds) << 32 | u64::from(seconds)).to_le_bytes()
}

fn put_fields<V: AsRef<[u8]>>(out: &mut Vec<u8>, fields: &[(&str, V)]) {
    for (name, value) in fields {
        let value = value.as_ref();
        out.extend_from_slice(&((name.len() + 1 + value.len()) as u32).to_le_bytes());
        out.extend_from_slice(name.as_bytes());
        out.push(b'=');
        out.extend_from_slice(value);
    }
}

/// A record up to its data.
fn put_head(out: &mut Vec<u8>, fields: &[(&str, &[u8])], data_bytes: usize) {
    let length: usize = fields.iter().map(|(name, value)| 4 + name.len() + 1 + value.len()).sum();
    out.extend_from_slice(&(length as u32).to_le_bytes());
    put_fields(out, fields);
    out.extend_from_slice(&(data_bytes as u32).to_le_bytes());
}

fn put_record(out: &mut Vec<u8>, fields: &[(&str, &[u8])], data: &[u8]) {
    put_head(out, fields, data.len());
    out.extend_from_slice(data);
}

fn bag_header(index_at: u64, connections: u32, chunks: u32) -> Vec<u8> {
    let (index_at, connections, chunks) = (index_at.to_le_bytes(), connections.to_le_bytes(), chunks.to_le_bytes());
    let fields =
        [("op", &[OP_BAG][..]), ("index_pos", &index_at), ("conn_count", &connections), ("chunk_count", &chunks)];
    let mut record = Vec::new();
    put_head(&mut record, &fields, 0);
    let padding = BAG_HEADER_BYTES - record.len();
    record.truncate(record.len() - 4);
    record.extend_from_slice(&(padding as u32).to_le_bytes());
    record.resize(BAG_HEADER_BYTES, b' ');
    record
}

fn connection_record(id: u32, connection: &Connection) -> Vec<u8> {
    let definition = connection.definition.as_ref().map_or("", |definition| &*definition.text);
    let mut data = Vec::new();
    put_fields(&mut data, &[("topic", &*connection.topic), ("type", &*connection.type_name)]);
    put_fields(&mut data, &[("message_definition", definition)]);
    for (name, value) in &connection.metadata {
        put_fields(&mut data, &[(name, value)]);
    }
    let mut record = Vec::new();
    let fields = [("op", &[OP_CONNECTION][..]), ("conn", &id.to_le_bytes()), ("topic", connection.topic.as_bytes())];
    put_record(&mut record, &fields, &data);
    record
}

fn put_index(out: &mut Vec<u8>, connection: u32, entries: &[(RosTime, u32)]) {
    let count = (entries.len() as u32).to_le_bytes();
    let conn = connection.to_le_bytes();
    let fields = [("op", &[OP_INDEX][..]), ("ver", &[1, 0, 0, 0]), ("conn", &conn), ("count", &count)];
    put_head(out, &fields, entries.len() * 12);
    for (time, place) in entries {
        out.extend_from_slice(&time_bytes(*time));
        out.extend_from_slice(&place.to_le_bytes());
    }
}

fn put_chunk_info(out: &mut Vec<u8>, chunk: &ChunkInfo) {
    let (start, end) = (time_bytes(chunk.times.0), time_bytes(chunk.times.1));
    let (at, count) = (chunk.at.to_le_bytes(), (chunk.counts.len() as u32).to_le_bytes());
    let fields = [
        ("op", &[OP_CHUNK_INFO][..]),
        ("ver", &[1, 0, 0, 0]),
        ("chunk_pos", &at),
        ("start_time", &start),
        ("end_time", &end),
        ("count", &count),
    ];
    let counts = chunk.counts.iter().flat_map(|(connection, count)| [*connection, *count]);
    put_record(out, &fields, &counts.flat_map(u32::to_le_bytes).collect::<Vec<_>>());
}

fn bz2(content: &[u8]) -> io::Result<Vec<u8>> {
    let mut encoder =
        bzip2::write::BzEncoder::new(Vec::with_capacity(content.len() / 2), bzip2::Compression::default());
    encoder.write_all(content)?;
    encoder.finish()
}

/// As roslz4 demands it: independent blocks, a checksum of the whole and none of blocks.
fn lz4(content: &[u8]) -> io::Result<Vec<u8>> {
    let info = FrameInfo::new()
        .block_mode(BlockMode::Independent)
        .block_size(BlockSize::Max1MB)
        .block_checksums(false)
        .content_checksum(true);
    let mut encoder = FrameEncoder::with_frame_info(info, Vec::with_capacity(content.len() / 2));
    encoder.write_all(content)?;
    encoder.finish().map_err(io::Error::other)
}
