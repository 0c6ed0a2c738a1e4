//! Messages and where they come from, as plain data.

use mapwright_geom::Stamp;
use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

/// How the bytes of messages are laid out.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Encoding {
    /// ROS 1 serialisation.
    Ros1,
    /// CDR with its header of four bytes, as in ROS 2.
    Cdr,
    /// Another, by the name that the container has for it.
    Other(String),
}

impl Encoding {
    pub(crate) fn from_name(name: &str) -> Self {
        match name {
            "ros1" => Self::Ros1,
            "cdr" => Self::Cdr,
            other => Self::Other(other.to_owned()),
        }
    }

    /// The name that MCAP and rosbag2 have for it.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Ros1 => "ros1",
            Self::Cdr => "cdr",
            Self::Other(name) => name,
        }
    }
}

impl fmt::Display for Encoding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The language of a message definition.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum DefinitionFormat {
    /// ROS 1's `.msg`, dependencies appended.
    Ros1Msg,
    /// ROS 2's `.msg`, dependencies appended.
    Ros2Msg,
    /// ROS 2's `.idl`.
    Ros2Idl,
    /// Another, by the name that the container has for it.
    Other(String),
}

impl DefinitionFormat {
    pub(crate) fn from_name(name: &str) -> Self {
        match name {
            "ros1msg" => Self::Ros1Msg,
            "ros2msg" => Self::Ros2Msg,
            "ros2idl" => Self::Ros2Idl,
            other => Self::Other(other.to_owned()),
        }
    }

    /// The name that MCAP has for it.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Ros1Msg => "ros1msg",
            Self::Ros2Msg => "ros2msg",
            Self::Ros2Idl => "ros2idl",
            Self::Other(name) => name,
        }
    }
}

/// The definition of a message type as the recording carries it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Definition {
    /// Its language.
    pub format: DefinitionFormat,
    /// Its text; bytes that are no UTF-8 are replaced.
    pub text: Arc<str>,
}

/// A stream of messages of one type under one topic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Connection {
    /// Its number: dense, from 0, unique per opened recording; its place in `connections()`.
    pub id: u32,
    /// The topic.
    pub topic: String,
    /// The type as written, `sensor_msgs/LaserScan` or `sensor_msgs/msg/LaserScan`.
    pub type_name: String,
    /// How its messages are laid out.
    pub encoding: Encoding,
    /// The type's definition, where the recording carries it.
    pub definition: Option<Definition>,
    /// All else that the container says: `md5sum`, `callerid`, `latching` (ROS 1), `offered_qos_profiles`,
    /// `type_description_hash` (ROS 2).
    pub metadata: BTreeMap<String, String>,
}

impl Connection {
    /// A connection to be written; writers give ids of their own.
    pub fn new(topic: impl Into<String>, type_name: impl Into<String>, encoding: Encoding) -> Self {
        Self {
            id: 0,
            topic: topic.into(),
            type_name: type_name.into(),
            encoding,
            definition: None,
            metadata: BTreeMap::new(),
        }
    }

    /// With the type's definition.
    #[must_use]
    pub fn with_definition(mut self, format: DefinitionFormat, text: &str) -> Self {
        self.definition = Some(Definition { format, text: text.into() });
        self
    }

    /// With one more entry of [`metadata`](Self::metadata).
    #[must_use]
    pub fn with_metadata(mut self, key: &str, value: impl Into<String>) -> Self {
        self.metadata.insert(key.to_owned(), value.into());
        self
    }

    /// Whether a ROS 1 publisher has its last message sent to those who come later.
    #[must_use]
    pub fn latching(&self) -> bool {
        self.metadata.get("latching").is_some_and(|value| value == "1")
    }

    pub(crate) fn is_same_stream(&self, other: &Self) -> bool {
        self.topic == other.topic
            && self.type_name == other.type_name
            && self.encoding == other.encoding
            && self.metadata == other.metadata
            && self.definition == other.definition
    }
}

/// One message as it was recorded, lent until the next is asked for.
#[derive(Debug, Clone, Copy)]
pub struct RawMessage<'a> {
    /// Where it belongs.
    pub connection: &'a Connection,
    /// When the recorder received it.
    pub log_stamp: Stamp,
    /// When it was published, where the container says so.
    pub publish_stamp: Option<Stamp>,
    /// Where its record begins in the file; for a compressed chunk, where that begins; for a database, its row.
    pub offset_bytes: u64,
    /// Its bytes.
    pub data: &'a [u8],
}
