//! What can go wrong with a definition, a message or a transform.

use mapwright_geom::Stamp;

/// Why a definition, a message or a transform cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RosError {
    /// A definition's text is not what it should be.
    #[error("the definition of {message}, line {line}: expected {expected}, found {found}")]
    Definition {
        /// Type whose definition it is.
        message: String,
        /// Line of the text, from 1.
        line: usize,
        /// What should stand there.
        expected: &'static str,
        /// What stands there, shortened.
        found: String,
    },
    /// A definition uses a type that is defined nowhere.
    #[error("the definition of {message}, line {line}: type `{missing}` is defined nowhere")]
    MissingType {
        /// Type that uses it.
        message: String,
        /// Line of the text, from 1.
        line: usize,
        /// The type that is not there.
        missing: String,
    },
    /// A definition contains itself, or nests deeper than messages do.
    #[error("the definition of {message} {problem}: {chain}")]
    Nesting {
        /// Type whose definition it is.
        message: String,
        /// What is wrong.
        problem: &'static str,
        /// Types from the outermost to the innermost.
        chain: String,
    },
    /// A type that comes without a definition and is not built in.
    #[error("no definition of {message} comes with the file, and it is not one of the built-in types")]
    UnknownType {
        /// The type.
        message: String,
    },
    /// An encapsulation other than plain CDR.
    #[error("byte 0: expected plain CDR (0x0000 or 0x0001), found {found} (0x{code:04x})")]
    Encapsulation {
        /// Its name.
        found: &'static str,
        /// Its number.
        code: u16,
    },
    /// A message ends too early, or a length in it is longer than the message.
    #[error("byte {offset_bytes}, field `{field}`: expected {expected_bytes} bytes, found {left_bytes}")]
    Cut {
        /// Path of the field.
        field: String,
        /// Where in the message.
        offset_bytes: usize,
        /// Bytes that the field needs; a lower bound for lists.
        expected_bytes: usize,
        /// Bytes left.
        left_bytes: usize,
    },
    /// More bytes than the definition accounts for: the definition is another's.
    #[error(
        "byte {offset_bytes}: expected the message's end, found {left_bytes} more bytes; its definition does not fit"
    )]
    Trailing {
        /// Where in the message.
        offset_bytes: usize,
        /// Bytes left.
        left_bytes: usize,
    },
    /// A list longer than its definition allows.
    #[error("byte {offset_bytes}, field `{field}`: expected at most {limit} elements, found {found}")]
    Bound {
        /// Path of the field.
        field: String,
        /// Where in the message.
        offset_bytes: usize,
        /// The most there may be.
        limit: usize,
        /// How many there are.
        found: usize,
    },
    /// A field of a kind that is not decoded.
    #[error("field `{field}` is a {kind}, which is not decoded: {reason}")]
    Unsupported {
        /// Path of the field.
        field: String,
        /// Its type.
        kind: &'static str,
        /// Why not.
        reason: &'static str,
    },
    /// A definition in the file that lacks a field.
    #[error("{message} in this file has no field `{field}` ({expected}); it has {found}")]
    MissingField {
        /// Type of the message.
        message: String,
        /// Path of the field.
        field: String,
        /// Type the field should have.
        expected: String,
        /// Fields that are there.
        found: String,
    },
    /// A definition in the file whose field has another type.
    #[error("{message} in this file has field `{field}` as {found}, expected {expected}")]
    FieldType {
        /// Type of the message.
        message: String,
        /// Path of the field.
        field: String,
        /// Type the field should have.
        expected: String,
        /// Type it has.
        found: String,
    },
    /// Something too long to be written.
    #[error("a length of {found} does not fit into 32 bits")]
    TooLong {
        /// The length.
        found: usize,
    },
    /// A point cloud that contradicts itself.
    #[error("the point cloud's {what}: expected {expected}, found {found}")]
    Cloud {
        /// Which part.
        what: String,
        /// What it should be.
        expected: String,
        /// What it is.
        found: String,
    },
    /// An image of depth, or its camera, that contradicts itself.
    #[error("the image's {what}: expected {expected}, found {found}")]
    Image {
        /// Which part.
        what: &'static str,
        /// What it should be.
        expected: String,
        /// What it is.
        found: String,
    },
    /// A laser scan that cannot be mapped with.
    #[error("the scan of `{frame}`: {reason}")]
    Scan {
        /// The laser's frame.
        frame: String,
        /// What is wrong.
        reason: String,
    },
    /// A laser whose scan plane is not horizontal.
    #[error("the scan plane is tilted by {tilt_deg:.1} deg, expected at most {limit_deg:.1} deg")]
    Tilted {
        /// Angle of the plane against the horizontal.
        tilt_deg: f64,
        /// The most that is accepted.
        limit_deg: f64,
    },
    /// A transform that cannot be taken in.
    #[error("transform '{parent}' -> '{child}': {reason}")]
    Transform {
        /// Outer frame.
        parent: String,
        /// Inner frame.
        child: String,
        /// What is wrong.
        reason: String,
    },
    /// A frame that nobody publishes.
    #[error(
        "no transform from '{source_frame}' to '{target}': '{missing}' is published nowhere; frames known: {known}"
    )]
    UnknownFrame {
        /// Frame to go to.
        target: String,
        /// Frame to come from.
        source_frame: String,
        /// The one of them that is not known.
        missing: String,
        /// Frames that are known.
        known: String,
    },
    /// Two frames in different trees.
    #[error(
        "no transform from '{source_frame}' to '{target}': '{source_frame}' hangs below '{source_root}' and '{target}' \
         below '{target_root}', and nothing links the two"
    )]
    Unconnected {
        /// Frame to go to.
        target: String,
        /// Frame to come from.
        source_frame: String,
        /// Root of the target's tree.
        target_root: String,
        /// Root of the source's tree.
        source_root: String,
    },
    /// A link that is not known at the time.
    #[error(
        "'{parent}' -> '{child}' is known from {} s to {} s, {} s was asked for",
        seconds(*.first), seconds(*.last), seconds(*.asked)
    )]
    OutOfTime {
        /// Outer frame of the link.
        parent: String,
        /// Inner frame of the link.
        child: String,
        /// Oldest transform kept.
        first: Stamp,
        /// Newest transform kept.
        last: Stamp,
        /// The time asked for.
        asked: Stamp,
    },
}

impl RosError {
    /// The same, one level further out.
    pub(crate) fn inside(mut self, outer: &str) -> Self {
        if let Self::Cut { field, .. } | Self::Bound { field, .. } | Self::Unsupported { field, .. } = &mut self {
            let dot = if field.is_empty() || field.starts_with('[') { "" } else { "." };
            *field = format!("{outer}{dot}{field}");
        }
        self
    }
}

/// A stamp in seconds with milliseconds, exact at any epoch.
fn seconds(stamp: Stamp) -> String {
    let ms = i128::from(stamp.0).div_euclid(1_000_000);
    let sign = if ms < 0 { "-" } else { "" };
    format!("{sign}{}.{:03}", ms.abs() / 1000, ms.abs() % 1000)
}

/// The first characters of a text, for a message.
pub(crate) fn excerpt(text: &str) -> String {
    let mut short: String = text.chars().take(60).collect();
    if short.len() < text.len() {
        short.push_str("...");
    }
    format!("`{short}`")
}
