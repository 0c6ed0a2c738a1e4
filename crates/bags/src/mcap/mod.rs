//! MCAP in and out: <https://mcap.dev/spec>.
//!
//! The reader walks from record to record itself instead of through the `mcap` crate's `LinearReader`. That one was
//! looked at (0.26) and is right for whole files; on damaged ones it ends at the first error for good, says no offsets,
//! delivers either a chunk's messages before its checksum was compared or none of a chunk that is cut short, and with
//! checksums compared first allocates what the chunk's header declares. Here a chunk whose checksum disagrees is dropped
//! whole and reading goes on behind it, one that is cut short by the end of the file is used up to there, and no length
//! is believed beyond what the file holds. The writer is the `mcap` crate's.

mod channels;
mod reader;
mod record;
mod records;
mod summary;
mod writer;

pub use reader::McapReader;
pub use writer::{McapCompression, McapWriter};

/// The first bytes of a file, and its last.
pub(crate) const MAGIC: &[u8] = b"\x89MCAP0\r\n";
