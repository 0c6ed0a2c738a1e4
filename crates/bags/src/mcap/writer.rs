//! MCAP out.

use crate::error::BagError;
use crate::message::{Connection, DefinitionFormat};
use mapwright_geom::Stamp;
use mcap::records::MessageHeader;
use mcap::write::{WriteOptions, Writer};
use std::io::{Seek, Write};

/// A chunk is closed when it has grown to this.
const CHUNK_BYTES: u64 = 1 << 20;

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
pub struct McapWriter<W: Write + Seek> {
    writer: Writer<W>,
    sequences: Vec<u32>,
}

impl<W: Write + Seek> std::fmt::Debug for McapWriter<W> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("McapWriter").field("connections", &self.sequences.len()).finish_non_exhaustive()
    }
}

impl<W: Write + Seek> McapWriter<W> {
    /// A file from the start of `writer`.
    ///
    /// # Errors
    ///
    /// [`BagError::Mcap`].
    pub fn new(writer: W, compression: McapCompression) -> Result<Self, BagError> {
        Self::with_chunk_bytes(writer, compression, CHUNK_BYTES)
    }

    /// The same, with chunks closed when they have grown to so many bytes, instead of 1 MiB.
    ///
    /// # Errors
    ///
    /// [`BagError::Mcap`].
    pub fn with_chunk_bytes(writer: W, compression: McapCompression, chunk_bytes: u64) -> Result<Self, BagError> {
        let compression = match compression {
            McapCompression::None => None,
            McapCompression::Zstd => Some(mcap::Compression::Zstd),
        };
        let options = WriteOptions::new()
            .profile("ros2")
            .library(concat!("mapwright ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(chunk_bytes))
            .compression(compression)
            .compression_threads(0);
        Ok(Self { writer: options.create(writer).map_err(error)?, sequences: Vec::new() })
    }

    /// A further connection and the id it gets. Its definition becomes the schema, an empty `ros2msg` where it has none.
    ///
    /// # Errors
    ///
    /// [`BagError::Mcap`], as for more than 65,535 connections.
    pub fn add_connection(&mut self, connection: &Connection) -> Result<u32, BagError> {
        let (format, text) = match &connection.definition {
            Some(definition) => (definition.format.name(), &*definition.text),
            None => (DefinitionFormat::Ros2Msg.name(), ""),
        };
        let schema = self.writer.add_schema(&connection.type_name, format, text.as_bytes()).map_err(error)?;
        let mut metadata = connection.metadata.clone();
        metadata.entry("offered_qos_profiles".to_owned()).or_default(); // rosbag2 looks for it
        let encoding = connection.encoding.name();
        let id = self.writer.add_channel(schema, &connection.topic, encoding, &metadata).map_err(error)?;
        let places = (usize::from(id) + 1).max(self.sequences.len());
        self.sequences.resize(places, 0);
        Ok(u32::from(id))
    }

    /// Appends a message, received at `log_stamp` and published at `publish_stamp`.
    ///
    /// # Errors
    ///
    /// [`BagError::NotRepresentable`] for stamps before their epoch or a connection that was not added;
    /// [`BagError::Mcap`].
    pub fn write(
        &mut self,
        connection: u32,
        log_stamp: Stamp,
        publish_stamp: Stamp,
        data: &[u8],
    ) -> Result<(), BagError> {
        let channel_id = u16::try_from(connection).ok().filter(|id| usize::from(*id) < self.sequences.len());
        let Some(channel_id) = channel_id else {
            return Err(not_representable("a message", "a connection that was added", connection.to_string()));
        };
        let sequence = self.sequences[usize::from(channel_id)];
        let (log_time, publish_time) = (nanoseconds(log_stamp)?, nanoseconds(publish_stamp)?);
        let header = MessageHeader { channel_id, sequence, log_time, publish_time };
        self.writer.write_to_known_channel(&header, data).map_err(error)?;
        self.sequences[usize::from(channel_id)] = sequence.wrapping_add(1);
        Ok(())
    }

    /// Closes the last chunk and writes the summary.
    ///
    /// # Errors
    ///
    /// [`BagError::Mcap`].
    pub fn finish(mut self) -> Result<W, BagError> {
        self.writer.finish().map_err(error)?;
        Ok(self.writer.into_inner())
    }
}

fn error(error: mcap::McapError) -> BagError {
    match error {
        mcap::McapError::Io(error) => BagError::Io(error),
        other => BagError::Mcap(other.to_string()),
    }
}

fn not_representable(what: &'static str, expected: &'static str, found: String) -> BagError {
    BagError::NotRepresentable { container: "MCAP", what, expected, found }
}

fn nanoseconds(stamp: Stamp) -> Result<u64, BagError> {
    u64::try_from(stamp.0).map_err(|_| not_representable("a stamp", "none before its epoch", format!("{} ns", stamp.0)))
}
