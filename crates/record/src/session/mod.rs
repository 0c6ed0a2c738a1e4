//! What lasts of a run, and its versioned encoding.

mod read;
mod write;

use crate::keyframe::{Edge, Keyframe};
use mapwright_geom::{Pose2, Stamp};

/// What a file of a session begins with; the version follows, two bytes, least significant first.
const MAGIC: &[u8; 18] = b"mapwright session\n";
/// The version that is written, and read.
const VERSION: u16 = 1;

/// Everything that maps, trajectories and graphs of a run are functions of.
///
/// The encoding is little endian, without padding: magic, version, settings, lasers, scans, keyframes, edges, and the
/// CRC-32 of all that. A range takes two bytes, a scan that is no keyframe 56.
///
/// ```
/// use mapwright_record::Session;
/// let session = Session { settings: "{}".to_owned(), ..Session::default() };
/// assert_eq!(Session::decode(&session.encode()), Ok(session));
/// assert!(Session::decode(b"mapwright?").is_err());
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Session {
    /// The run's settings in whatever words its program has for them.
    pub settings: String,
    /// Every scan in arrival order.
    pub scans: Vec<SessionScan>,
    /// Keyframes in the order they were made; each [`Keyframe::scan`] is a place in `scans`.
    pub keyframes: Vec<Keyframe>,
    /// Pose of the robot in the map at each keyframe, with every correction.
    pub map_from_keyframe: Vec<Pose2>,
    /// Edges that stand, between keyframes of this session. Of an information matrix the upper triangle is kept.
    pub edges: Vec<Edge>,
}

/// Where the robot was at a scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SessionScan {
    /// The scan's stamp.
    pub stamp: Stamp,
    /// Pose of the robot in the map, with every correction.
    pub map_from_robot: Pose2,
    /// Pose of the robot by odometry alone; never jumps.
    pub odom_from_robot: Pose2,
}

/// Why bytes are no session.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SessionError {
    /// The first bytes are another file's.
    #[error("byte 0: expected a session of mapwright, found something else")]
    NoSession,
    /// A version that this program does not know.
    #[error("byte 18: expected version {VERSION} of the session's encoding, found {found}")]
    Version {
        /// What stands there.
        found: u16,
    },
    /// The file ends too early, or claims more than it holds.
    #[error("byte {offset_bytes}: expected {expected}, found the end of the file after {left_bytes} bytes")]
    Cut {
        /// Where.
        offset_bytes: usize,
        /// What should have come.
        expected: &'static str,
        /// How much is left from there.
        left_bytes: usize,
    },
    /// A value that no run writes.
    #[error("byte {offset_bytes}: expected {expected}, found {found}")]
    Value {
        /// Where the value begins.
        offset_bytes: usize,
        /// What should have stood there.
        expected: &'static str,
        /// What stands there.
        found: String,
    },
    /// The bytes do not add up.
    #[error("expected the checksum {expected:08x}, found {found:08x}: the file is damaged")]
    Checksum {
        /// What the file says.
        expected: u32,
        /// What its bytes give.
        found: u32,
    },
}

#[cfg(test)]
mod tests;
