//! Containers of robots' messages: ROS 1 bags, MCAP and ROS 2 bags in; MCAP and ROS 1 bags out.
//!
//! What is in a message is none of this crate's business: it yields the raw bytes with their topic, their type as written
//! and their stamps, one message at a time and lent until the next, in order of arrival.
//!
//! ```
//! use mapwright_bags::{BagReader, Connection, Encoding, McapCompression, McapWriter};
//! use mapwright_geom::Stamp;
//! use std::io::Cursor;
//!
//! let mut file = Cursor::new(Vec::new());
//! let mut writer = McapWriter::new(&mut file, McapCompression::Zstd)?;
//! let scans = writer.add_connection(&Connection::new("/scan", "sensor_msgs/msg/LaserScan", Encoding::Cdr))?;
//! writer.write(scans, Stamp(1), Stamp(1), &[0, 1, 0, 0])?;
//! writer.finish()?;
//!
//! let mut reader = BagReader::open(file)?; // a ROS 1 bag or MCAP, told by the first bytes
//! while let Some(message) = reader.next_message()? {
//!     assert_eq!((&*message.connection.topic, message.data.len()), ("/scan", 4));
//! }
//! assert!(!reader.report().has_losses());
//! # Ok::<(), mapwright_bags::BagError>(())
//! ```
//!
//! [`Recording`] opens a path, be it a file, a database or a folder of a ROS 2 bag. Damage never ends in an error: what
//! lies before it is delivered as it was recorded, reading goes on behind it where that is safe, and the [`ReadReport`]
//! says where it was. Memory does not depend on a recording's length: a chunk or a message is the most that is held, and
//! no length that a file claims is believed beyond what the file holds.

mod bag1;
mod catalog;
mod contents;
mod decode;
mod error;
mod folder;
mod lz4;
mod mcap;
mod message;
mod place;
mod reader;
mod report;
#[cfg(feature = "sqlite")]
mod sqlite;
mod window;

pub use bag1::{Bag1Compression, Bag1Reader, Bag1Writer};
pub use contents::{FolderContents, METADATA};
pub use error::BagError;
pub use folder::Recording;
pub use mcap::{McapCompression, McapReader, McapWriter};
pub use message::{Connection, Definition, DefinitionFormat, Encoding, RawMessage};
pub use reader::BagReader;
pub use report::{ConnectionReport, Container, Damage, DamageKind, Damages, Place, ReadReport};
#[cfg(feature = "sqlite")]
pub use sqlite::SqliteReader;
