//! ROS 1 bags, version 2.0, in and out: <http://wiki.ros.org/Bags/Format/2.0>.
//!
//! The reader walks from record to record and needs no index. Records of uncompressed chunks are read like any others,
//! so that a chunk's own lengths hardly matter; a compressed chunk is decompressed as a whole. The index at the end is
//! looked at first where there is one: it names the connections before the first message, stands in for damaged
//! descriptions within chunks, and says where the next chunk begins when the way there is lost.
//!
//! ROS 1 bags have no checksums, but lz4 and bzip2 do: a compressed chunk that does not decompress to its end is dropped
//! as a whole, for nobody knows which of its bytes are right. One that is cut short by the end of the file is used up to
//! there.

mod connections;
mod index;
mod reader;
mod record;
mod writer;

pub use reader::Bag1Reader;
pub use writer::{Bag1Compression, Bag1Writer};

/// The first bytes of a bag.
pub(crate) const MAGIC: &[u8] = b"#ROSBAG V2.0\n";
