//! What keeps a pair of images from being matched.

/// A failure of this crate. Pixels that cannot be matched are no failure: their disparity is unknown.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StereoError {
    /// The numbers of a camera cannot be those of one.
    #[error("{of}: expected {expected}, found {found}")]
    Calibration {
        /// Which camera, and which of its numbers.
        of: String,
        /// What should have been there.
        expected: &'static str,
        /// What is there.
        found: String,
    },
    /// An image has another size than it should have.
    #[error("{what}: expected {} x {} pixels, found {} x {}", expected[0], expected[1], found[0], found[1])]
    Size {
        /// Which image.
        what: &'static str,
        /// Pixels across and down that it should have.
        expected: [u32; 2],
        /// Pixels across and down that it has.
        found: [u32; 2],
    },
    /// An image is too small or too large to be matched, or has more or fewer pixels than its size says.
    #[error("{what}: expected {expected}, found {found}")]
    Image {
        /// Which image.
        what: &'static str,
        /// What should have been there.
        expected: String,
        /// What is there.
        found: String,
    },
    /// What the caller asked for cannot be done.
    #[error("{setting}: expected {expected}, found {found}")]
    Settings {
        /// Which setting.
        setting: &'static str,
        /// What may be asked for.
        expected: String,
        /// What was.
        found: String,
    },
    /// A file of calibration is not what it should be.
    #[error("{file}, line {line}: expected {expected}, found {found}")]
    File {
        /// Which kind of file.
        file: &'static str,
        /// Where in it, from 1 on; 0 if it is the file as a whole.
        line: usize,
        /// What should have been there.
        expected: String,
        /// What is there.
        found: String,
    },
}
