//! Containers of robots' messages: ROS 1 bags, MCAP and ROS 2 bags in; MCAP and ROS 1 bags out.
#![warn(missing_docs)]

mod bag1;
mod catalog;
mod decode;
mod error;
mod mcap;
mod message;
mod report;
mod window;

pub use bag1::{Bag1Compression, Bag1Reader, Bag1Writer};
pub use error::BagError;
pub use mcap::{McapCompression, McapReader, McapWriter};
pub use message::{Connection, Definition, DefinitionFormat, Encoding, RawMessage};
pub use report::{ConnectionReport, Container, Damage, DamageKind, Damages, ReadReport};
