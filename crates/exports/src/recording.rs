//! Typed messages into a container, whichever it is.

use crate::error::ExportError;
use mapwright_bags::{Bag1Compression, Bag1Writer, Connection, DefinitionFormat, McapCompression, McapWriter};
use mapwright_geom::Stamp;
use mapwright_ros::{Encoding, builtin, encode, long_name, short_name};
use std::io::{Seek, Write};

/// How a publisher treats those who come later.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Durability {
    /// They get what is sent from then on.
    Volatile,
    /// They get the last message (latched, transient local).
    TransientLocal,
}

impl Durability {
    /// As rosbag2 records it, all policies spelt out.
    fn qos_profiles(self) -> String {
        let (depth, durability) = match self {
            Self::Volatile => (10, 2),
            Self::TransientLocal => (1, 1),
        };
        let for_ever = "\n    sec: 9223372036\n    nsec: 854775807\n";
        format!(
            "- history: 1\n  depth: {depth}\n  reliability: 1\n  durability: {durability}\n  deadline:{for_ever}  \
             lifespan:{for_ever}  liveliness: 1\n  liveliness_lease_duration:{for_ever}  \
             avoid_ros_namespace_conventions: false\n"
        )
    }
}

/// A topic that was added.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Topic(u32);

/// A recording that is being written. Messages are received in the order in which they are written.
#[derive(Debug)]
pub(crate) struct Recording<W: Write + Seek> {
    container: Container<W>,
    /// Stamp of the newest message: none is received before.
    last: Option<Stamp>,
}

#[derive(Debug)]
enum Container<W: Write + Seek> {
    Bag1(Box<Bag1Writer<W>>),
    Mcap(Box<McapWriter<W>>),
}

impl<W: Write + Seek> Recording<W> {
    pub(crate) fn bag1(writer: W) -> Result<Self, ExportError> {
        Ok(Self { container: Container::Bag1(Box::new(Bag1Writer::new(writer, Bag1Compression::Lz4)?)), last: None })
    }

    pub(crate) fn mcap(writer: W) -> Result<Self, ExportError> {
        Ok(Self { container: Container::Mcap(Box::new(McapWriter::new(writer, McapCompression::Zstd)?)), last: None })
    }

    pub(crate) fn encoding(&self) -> Encoding {
        match self.container {
            Container::Bag1(_) => Encoding::Ros1,
            Container::Mcap(_) => Encoding::Cdr,
        }
    }

    /// A topic of messages of a standard type.
    pub(crate) fn add(&mut self, topic: &str, type_name: &str, durability: Durability) -> Result<Topic, ExportError> {
        let definition = builtin::text(type_name, self.encoding())?;
        let id = match &mut self.container {
            Container::Bag1(writer) => {
                let md5sum = builtin::definition(type_name, Encoding::Ros1)?.md5sum()?;
                let latching = if durability == Durability::TransientLocal { "1" } else { "0" };
                let connection = Connection::new(topic, short_name(type_name), mapwright_bags::Encoding::Ros1)
                    .with_definition(DefinitionFormat::Ros1Msg, &definition)
                    .with_metadata("md5sum", md5sum)
                    .with_metadata("callerid", "/mapwright")
                    .with_metadata("latching", latching);
                writer.add_connection(&connection)?
            }
            Container::Mcap(writer) => {
                let connection = Connection::new(topic, long_name(type_name), mapwright_bags::Encoding::Cdr)
                    .with_definition(DefinitionFormat::Ros2Msg, &definition)
                    .with_metadata("offered_qos_profiles", durability.qos_profiles());
                writer.add_connection(&connection)?
            }
        };
        Ok(Topic(id))
    }

    /// Appends a message of its stamp.
    pub(crate) fn write<'a>(
        &mut self,
        topic: Topic,
        stamp: Stamp,
        message: &impl mapwright_ros::Field<'a>,
    ) -> Result<(), ExportError> {
        let bytes = encode(message, self.encoding())?;
        self.write_bytes(topic, stamp, &bytes)
    }

    /// Appends a message that is encoded already.
    pub(crate) fn write_bytes(&mut self, topic: Topic, stamp: Stamp, bytes: &[u8]) -> Result<(), ExportError> {
        let received = self.last.map_or(stamp, |last| last.max(stamp));
        self.last = Some(received);
        match &mut self.container {
            Container::Bag1(writer) => writer.write(topic.0, received, bytes)?,
            Container::Mcap(writer) => writer.write(topic.0, received, stamp, bytes)?,
        }
        Ok(())
    }

    pub(crate) fn finish(self) -> Result<W, ExportError> {
        Ok(match self.container {
            Container::Bag1(writer) => writer.finish()?,
            Container::Mcap(writer) => writer.finish()?,
        })
    }
}
