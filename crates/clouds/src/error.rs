//! What makes a recording unusable as a whole.

use std::io;

/// A failure that ends reading. What is wrong with single frames is not among them: it is counted in the
/// [`Notes`](crate::Notes), and reading goes on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CloudError {
    /// A file could not be read.
    #[error("{file}: {cause}")]
    Io {
        /// The file.
        file: String,
        /// The system's reason.
        cause: io::Error,
    },
    /// A file is not what its place or its first bytes say that it is.
    #[error("{file}, byte {offset_bytes}: expected {expected}, found {found}")]
    Content {
        /// The file.
        file: String,
        /// Where in it, decompressed.
        offset_bytes: u64,
        /// What should have been there.
        expected: String,
        /// What is there.
        found: String,
    },
    /// The folder's files do not say what is needed.
    #[error("the folder does not say {what}: give {key}")]
    Missing {
        /// What.
        what: String,
        /// What to say to the command line.
        key: &'static str,
    },
    /// What the caller said of the camera is no camera.
    #[error("{key}: {reason}")]
    Options {
        /// Of the command line.
        key: &'static str,
        /// Why.
        reason: String,
    },
    /// Images of two cameras cannot be those of a pair.
    #[error("{left} and {right}: {reason}")]
    Pair {
        /// What was taken for the left one.
        left: String,
        /// What was taken for the right one.
        right: String,
        /// Why, and what to do.
        reason: String,
    },
    /// There are several recordings in the folder.
    #[error("expected one recording, found one in each of {}: name one", folders.join(", "))]
    Several {
        /// Where.
        folders: Vec<String>,
    },
    /// Not one frame could be read.
    #[error("none of {frames} frames could be read; the first: {first}")]
    NoFrames {
        /// How many there are.
        frames: usize,
        /// What was wrong with the first.
        first: String,
    },
}

impl CloudError {
    pub(crate) fn content(
        file: &str,
        offset_bytes: usize,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Self {
        Self::Content {
            file: file.to_owned(),
            offset_bytes: offset_bytes as u64,
            expected: expected.into(),
            found: found.into(),
        }
    }
}
