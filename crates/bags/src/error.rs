//! What makes a recording unusable as a whole.

use std::io;
use std::path::Path;

/// A failure that ends opening, reading or writing. Damage within a recording is not among them: it is described in the
/// [`ReadReport`](crate::ReadReport), and reading goes on where that is safe.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BagError {
    /// The stream below failed.
    #[error("the stream failed: {0}")]
    Io(#[from] io::Error),
    /// The first bytes are those of no container that is read here.
    #[error("byte 0: expected a ROS 1 bag, an MCAP file or an SQLite database, found {found}")]
    UnknownContainer {
        /// The first bytes, as text.
        found: String,
    },
    /// A container of a version that is not read here.
    #[error("byte {offset_bytes}: expected {expected}, found {found}")]
    Version {
        /// Where the version stands.
        offset_bytes: u64,
        /// The versions that are read.
        expected: &'static str,
        /// What stands there.
        found: String,
    },
    /// An SQLite database can only be opened by its path.
    #[error("byte 0: found an SQLite database, which must be opened by its path")]
    NeedsPath,
    /// An SQLite database, and this build was made without the feature `sqlite`.
    #[error("found an SQLite database, expected another container: this build lacks the feature `sqlite`")]
    WithoutSqlite,
    /// The database cannot be read at all.
    #[error("{path}: expected a ROS 2 bag as an SQLite database, found: {found}")]
    Database {
        /// The file.
        path: String,
        /// SQLite's complaint, or what is missing.
        found: String,
    },
    /// A file or folder could not be opened or read.
    #[error("{path}: {cause}")]
    Path {
        /// The file or folder.
        path: String,
        /// The system's reason.
        cause: io::Error,
    },
    /// A folder without any file of a recording.
    #[error("{path}: expected .mcap, .db3 or .bag files, found {found}")]
    EmptyFolder {
        /// The folder.
        path: String,
        /// What is there instead.
        found: String,
    },
    /// A compressed file grows beyond what its length makes believable.
    #[error("{path}: expected at most {limit_bytes} bytes after decompression, found more")]
    Bomb {
        /// The file.
        path: String,
        /// The most that is unpacked.
        limit_bytes: u64,
    },
    /// Something that a container has no way to say.
    #[error("{container} cannot carry {what}: expected {expected}, found {found}")]
    NotRepresentable {
        /// The container to be written.
        container: &'static str,
        /// Which value.
        what: &'static str,
        /// What it can carry.
        expected: &'static str,
        /// The value.
        found: String,
    },
    /// The MCAP encoder failed.
    #[error("the MCAP encoder failed: {0}")]
    Mcap(String),
}

impl BagError {
    /// Why a file or folder could not be opened or read.
    pub(crate) fn at(path: &Path, cause: io::Error) -> Self {
        Self::Path { path: path.display().to_string(), cause }
    }
}
