//! What can go wrong while reading or writing a file.

use crate::compression::Compression;
use crate::excerpt::Excerpt;
use std::io;

/// A failure that ends reading or writing. Bad lines of a sensor log are not among them: those are counted in the
/// [`ReadReport`](crate::ReadReport) and reading goes on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FormatError {
    /// The stream below failed.
    #[error("the stream failed: {0}")]
    Io(#[from] io::Error),
    /// A line of a trajectory or relations file is not what it should be.
    #[error("line {line}: expected {expected}, found {found}")]
    Line {
        /// Number of the line, from 1.
        line: u64,
        /// What should have stood there.
        expected: String,
        /// What stands there, shortened.
        found: Excerpt,
    },
    /// A compressed stream ends or breaks before its end; everything before was delivered.
    #[error(
        "the {compression} stream is torn at byte {compressed_offset_bytes} \
         (after {delivered_bytes} bytes of content): {cause}"
    )]
    Torn {
        /// How the stream is compressed.
        compression: Compression,
        /// Compressed bytes consumed before the tear.
        compressed_offset_bytes: u64,
        /// Decompressed bytes delivered before the tear.
        delivered_bytes: u64,
        /// The decoder's reason.
        cause: String,
    },
    /// A value that a text format cannot carry.
    #[error("{what} is {value}, expected a finite number of magnitude up to {limit}")]
    OutOfRange {
        /// Which value.
        what: &'static str,
        /// The value.
        value: f64,
        /// The largest magnitude that can be written.
        limit: f64,
    },
    /// Something about a laser that a CARMEN log has no way to say.
    #[error("a CARMEN log cannot carry laser `{laser}`: {reason}")]
    LaserNotRepresentable {
        /// Name of the laser.
        laser: String,
        /// What cannot be said.
        reason: &'static str,
    },
    /// A map whose cells are not as many as its sides say.
    #[error("a map of {width} x {height} cells needs {expected} of them, found {found}")]
    CellCount {
        /// Cells along x.
        width: usize,
        /// Cells along y.
        height: usize,
        /// Their product.
        expected: u128,
        /// Cells given.
        found: usize,
    },
    /// A map whose cell size or origin is no use.
    #[error("map {what} is {value}, expected {expected}")]
    MapGeometry {
        /// Which number.
        what: &'static str,
        /// The number.
        value: f64,
        /// What it should be.
        expected: &'static str,
    },
    /// A map's YAML or image that is none, or lacks something.
    #[error("{place}: expected {expected}, found {found}")]
    MapFile {
        /// What of it.
        place: String,
        /// What should have been there.
        expected: String,
        /// What is there.
        found: String,
    },
    /// The picture could not be encoded.
    #[error("the PNG encoder failed: {0}")]
    Png(#[from] png::EncodingError),
}
