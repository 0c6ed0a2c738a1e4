//! The log of a session as bytes: what a mapper appends to a file while it maps, and what becomes a [`Session`] again.
//!
//! All numbers are little endian, without padding; lengths in metres, angles in radians. The file begins with
//!
//! | bytes | what |
//! |---|---|
//! | 18 | `mapwright session` and a line feed |
//! | 2 | version of the file, 2 |
//!
//! and goes on with entries to its end:
//!
//! | bytes | what |
//! |---|---|
//! | 1 | kind |
//! | 1 | version of the kind, 1 |
//! | 4 | length of the payload, bytes |
//! | length | payload |
//! | 4 | CRC-32 (IEEE) of all of the entry before it |
//!
//! Entries of a kind, or of a version of one, that the reader does not know are skipped and counted. The payloads:
//!
//! | kind | payload |
//! |---|---|
//! | 1 run | number u32, code of the measurements u8 (1: sweeps, 2: clouds), robot u128, session u32, settings as UTF-8 to the end |
//! | 2 sensor | number u32, its bytes to the end |
//! | 3 scan | number u32, stamp i64 (ns), keyframe u32 (all ones: none), keyframe from robot, odom from robot |
//! | 4 keyframe | number u32, run u32, seq u32, stamp i64 (ns), scan u64, hardly fits u8, map from keyframe, sensor u32, measurement to the end |
//! | 5 fragment | first keyframe u32, start u8 |
//! | 6 edge | number u32, from u32, to u32, kind u8, candidate u32 (all ones: none), from from to, information |
//! | 7 remeasured | edge u32, from from to, information |
//! | 8 withdrawn | edge u32 |
//! | 9 candidate | number u32, from u32, to as run u32 and seq u32, detection u8, verdict u8 and u8, points u32, agreeing u32, mask u8, numbers of the mask's bits (score, ambiguity, overlap, inlier share, contradiction, cycle chi-square) f64 each, from from to if bit 6, covariance |
//! | 10 verdict | candidate u32, verdict u8 and u8, agreeing u32 |
//! | 11 beams left out | keyframe u32, reason u8, all of them u8, else their places to the end, u32 each |
//! | 12 wheel slip | scan u64, from as run u32 and seq u32, metres f64 |
//! | 14 odometry origin | the first scan it holds for u64, pose |
//! | 13 snapshot | number u32, and to the end: keyframe u32, map from keyframe |
//! | 16 gravity | keyframe u32, down in its frame 3 f64, standard deviation f64 |
//! | 17 return to a run | number of the run u32 |
//! | 15 checkpoint | what the mapper knew then, to the end; of use only to the same version of it, where nothing came after and nothing was lost |
//!
//! A pose is x, y, heading (f64), in space x, y, z and a unit quaternion i, j, k, w; a matrix all of its rows.
//! The bytes of a laser: first bearing, step, least and largest range, time from beam to beam (f64), robot from
//! laser, upside down u8, name as UTF-8; those of a sweep: metres a code f64, twist a second 3 f64, scatters u8, and a code of
//! two bytes a beam. Those of a sensor of space: least and largest range, noise and its growth with the squared range (f64), robot from
//! sensor, name as UTF-8; those of a cloud: metres a step f64, points u32, three coordinates a point i16 each, the upper half of a float
//! a point if the highest bit of the number of points is set (intensities), and three bytes a point if it has colours.
//!
//! Runs, sensors, scans, keyframes, edges and candidates carry their numbers, each counted from zero through the whole log, and
//! other entries refer to them by these. So it is known what a damaged entry has taken with it: what refers to it no longer
//! fits and is left out by name; nothing is ever taken for something else. A sensor stands before the first keyframe
//! that uses it.
//!
//! Version 1, one block with one checksum and without candidates, is read and no longer written.
//!
//! ```
//! use mapwright_record::{Entry, LogWriter, Run, Session};
//!
//! let mut file = Vec::new();
//! let mut writer: LogWriter = LogWriter::new();
//! let entry = Entry::Run(Run::default());
//! writer.append(&mut file, &entry)?;
//! writer.finish(&mut file);
//!
//! file.truncate(file.len() - 3); // the power fails
//! let (session, report): (Session, _) = Session::read(&file)?;
//! assert_eq!(session, Session::default());
//! assert_eq!(report.good_bytes, Some(20));
//! assert_eq!(report.losses[0].to_string(), "expected an entry, found 32 bytes of 35, at byte 20: 32 bytes left out");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod bytes;
mod codes;
mod read;
mod space_sweep;
pub(crate) mod sweep;
mod v1;
mod write;

pub use read::{EntryReader, checkpoint_end, read_entries, read_log};
pub use write::LogWriter;

use crate::keyframe::Measurement;
use crate::session::Session;
use codes::Kind;
use std::sync::Arc;

/// What a file of a session begins with; the version follows, two bytes.
pub const SESSION_MAGIC: &[u8; 18] = b"mapwright session\n";
/// The version that is written.
const VERSION: u16 = 2;
/// The version of every kind of entry that is written.
const ENTRY_VERSION: u8 = 1;
/// Bytes of magic and version.
const HEADER_BYTES: usize = 20;
/// Bytes of an entry before its payload.
const ENTRY_HEADER_BYTES: usize = 6;
/// Bytes of an entry's checksum.
const CHECKSUM_BYTES: usize = 4;
/// Where no keyframe or no candidate is meant.
const NONE: u32 = u32::MAX;

/// Why bytes are no session at all.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// The first bytes are another file's.
    #[error("byte 0: expected a session of mapwright, found something else")]
    NoSession,
    /// The file ends within its first 20 bytes.
    #[error("byte 0: expected a session of mapwright, found {bytes} bytes of its first 20")]
    Cut {
        /// How many there are.
        bytes: usize,
    },
    /// A version that this program does not know, or not for this kind of measurement.
    #[error("byte 18: expected version 1 or 2 of a session's file, found {found}")]
    Version {
        /// What stands there.
        found: u16,
    },
    /// A file of version 1 is damaged or cut; it has no parts that could be told to be whole.
    #[error("expected the checksum {expected:08x}, found {found:08x}: the file is damaged")]
    Checksum {
        /// What the file says.
        expected: u32,
        /// What its bytes give.
        found: u32,
    },
    /// A value in a file of version 1 that no run writes.
    #[error("byte {offset_bytes}: expected {expected}, found {found}")]
    Value {
        /// Where the value ends.
        offset_bytes: usize,
        /// What should have stood there.
        expected: &'static str,
        /// What stands there.
        found: String,
    },
}

/// What became of a log's bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LogReport {
    /// The version of the file.
    pub version: u16,
    /// Entries that were taken in, those of sensors among them; none in version 1, which has no entries.
    pub entries: usize,
    /// Whole entries of a kind, or a version of one, that this program does not know. They were skipped.
    pub unknown: usize,
    /// How often something was left out.
    pub lost: usize,
    /// Bytes of all that was left out.
    pub lost_bytes: usize,
    /// The first [`LogReport::LOSSES_AT_MOST`] losses, in the order of the file.
    pub losses: Vec<LogLoss>,
    /// Cut to this length, the file may be appended to by [`LogWriter::resume`]: all of it, or all before a torn tail. None
    /// where it may not, and the session is to be [encoded](Session::encode) anew: in version 1, and where anything before the
    /// tail was left out.
    pub good_bytes: Option<usize>,
}

impl LogReport {
    /// So many losses are told one by one.
    pub const LOSSES_AT_MOST: usize = 100;

    fn new(version: u16) -> Self {
        Self { version, entries: 0, unknown: 0, lost: 0, lost_bytes: 0, losses: Vec::new(), good_bytes: None }
    }

    /// Whether nothing was left out; entries of later versions are not counted as that.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.lost == 0
    }

    fn lose(&mut self, loss: LogLoss) {
        self.lost += 1;
        self.lost_bytes += loss.bytes;
        if self.losses.len() < Self::LOSSES_AT_MOST {
            self.losses.push(loss);
        }
    }
}

/// Something of a log that was left out.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("expected {expected}, found {found}, at byte {offset_bytes}: {bytes} bytes left out{}", of(*.entry))]
pub struct LogLoss {
    /// Where the entry begins.
    pub offset_bytes: usize,
    /// How many bytes were left out.
    pub bytes: usize,
    /// What entry it was, where its checksum is right: it is whole, and no longer fits to what is left.
    pub entry: Option<&'static str>,
    /// What should have stood there.
    pub expected: &'static str,
    /// What stands there.
    pub found: String,
}

fn of(entry: Option<&'static str>) -> String {
    entry.map(|entry| format!(" of a whole entry ({entry})")).unwrap_or_default()
}

/// The distinct sensors, in the order of their first keyframes: the order they have in a log.
#[derive(Debug)]
struct Sensors<M: Measurement>(Vec<Arc<M::Sensor>>);

impl<M: Measurement> Sensors<M> {
    fn of(session: &Session<M>) -> Self {
        let mut sensors = Self(Vec::new());
        for keyframe in session.keyframes() {
            let sensor = keyframe.sweep.sensor();
            if sensors.place(sensor).is_none() {
                sensors.0.push(Arc::clone(sensor));
            }
        }
        sensors
    }

    fn place(&self, sensor: &Arc<M::Sensor>) -> Option<usize> {
        // the newest is the likeliest
        self.0.iter().rposition(|known| Arc::ptr_eq(known, sensor) || known == sensor)
    }
}

#[cfg(test)]
mod tests;
