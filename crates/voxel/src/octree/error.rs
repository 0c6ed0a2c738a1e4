//! What can go wrong with OctoMap's files.

/// Why a file is no octree, or could not be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OctreeError {
    /// The stream failed.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// Another kind of file.
    #[error("byte 0: expected the line \"{expected}\"")]
    NoOctree {
        /// What such a file begins with.
        expected: &'static str,
    },
    /// The header says something that cannot be, or lacks something.
    #[error("byte {byte}: expected {expected}, found {found}")]
    Header {
        /// Where.
        byte: usize,
        /// What should be there.
        expected: &'static str,
        /// What is there, in words.
        found: String,
    },
    /// The file ends within its nodes.
    #[error("byte {byte}: expected {expected}, found the end of the file")]
    Cut {
        /// Where it ends.
        byte: usize,
        /// What should follow.
        expected: &'static str,
    },
    /// A node that cannot be.
    #[error("byte {byte}: {reason}")]
    Node {
        /// Where.
        byte: usize,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// Another number of nodes than the header says.
    #[error("the header says {said} nodes, found {found}")]
    Size {
        /// In the header.
        said: u64,
        /// In the file.
        found: u64,
    },
    /// Something follows the last node.
    #[error("byte {byte}: expected the end of the file, found {count} bytes more")]
    Trailing {
        /// Where the last node ends.
        byte: usize,
        /// How much follows.
        count: usize,
    },
}
