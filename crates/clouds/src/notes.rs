//! What was wrong with a recording without ending the reading of it.

use crate::error::CloudError;
use std::collections::BTreeMap;
use std::fmt;

/// Places kept of each kind of note; further ones are only counted.
const PLACES_KEPT: usize = 20;

/// What is wrong at some place of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum NoteKind {
    /// A frame that could not be read and is left out.
    UnreadableFrame,
    /// A frame that the folder speaks of, or that its numbers leave out, and that is not there.
    MissingFrame,
    /// A file that ends before its last point; what came before was delivered.
    Truncated,
    /// Bytes behind the last point, not read.
    Surplus,
    /// A cloud without points.
    EmptyCloud,
    /// A cloud with points that are not finite, delivered as they are: no returns.
    NotFinite,
    /// A stamp that lies before that of the frame before.
    BackwardStamp,
    /// A frame without a stamp of its own: it is 0.1 s after the one before.
    Unstamped,
    /// A message without a stamp of its own: it has that of its recording.
    RecordedStamp,
    /// A reading of odometry that could not be read and is left out.
    UnreadableOdometry,
    /// An inertial reading that could not be read or cannot be, and is left out.
    UnreadableImu,
    /// A cloud without odometry near its stamp, in a recording that has odometry.
    WithoutOdometry,
    /// Times of points that are no times of one sweep, left out.
    BadPointTimes,
    /// A colour image that is not there, or none within 20 ms.
    MissingColour,
    /// A colour image that could not be read, or is of another size than the depth.
    UnreadableColour,
    /// A row of a file of times, poses or names that is not what it should be, left out.
    BadRow,
    /// A file of times, poses or a calibration that is not used.
    FileNotUsed,
    /// A file with clouds that are not of the recording's kind, or not in its folder.
    OtherClouds,
    /// A PCD file whose points have a place of their own (VIEWPOINT), which is not applied: points are delivered in the sensor's frame.
    Viewpoint,
    /// A packet that is none of the sensor's, left out.
    ForeignPacket,
    /// A packet or block that is damaged, left out.
    BadPacket,
    /// Packets that were lost, by the sensor's clock.
    MissingPackets,
    /// The sensor's clock jumped; stamps go on by that of the capture.
    ClockJump,
    /// A cloud that is less than a revolution, delivered.
    PartialRevolution,
    /// An image of a pair of cameras of which the other one is missing, left out.
    WithoutPartner,
}

impl NoteKind {
    /// Whether something of the recording may be missing or wrong in what was delivered.
    #[must_use]
    pub fn loses_data(self) -> bool {
        let is_said_only = matches!(
            self,
            Self::NotFinite | Self::BackwardStamp | Self::EmptyCloud | Self::Viewpoint | Self::OtherClouds
        );
        // depth alone is mapped
        let is_said_only = is_said_only || self == Self::MissingColour;
        let is_of_messages = matches!(self, Self::RecordedStamp | Self::WithoutOdometry);
        !(is_said_only || is_of_messages || matches!(self, Self::ForeignPacket | Self::PartialRevolution))
    }
}

impl fmt::Display for NoteKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::UnreadableFrame => "unreadable frame",
            Self::MissingFrame => "missing frame",
            Self::Truncated => "truncated",
            Self::Surplus => "surplus bytes",
            Self::EmptyCloud => "empty cloud",
            Self::NotFinite => "points not finite",
            Self::BackwardStamp => "stamp runs backwards",
            Self::Unstamped => "no stamp",
            Self::RecordedStamp => "no stamp but that of the recording",
            Self::UnreadableOdometry => "unreadable odometry",
            Self::UnreadableImu => "unreadable inertial reading",
            Self::WithoutOdometry => "no odometry near a cloud",
            Self::BadPointTimes => "times of points refused",
            Self::MissingColour => "missing colour image",
            Self::UnreadableColour => "unreadable colour image",
            Self::BadRow => "bad row",
            Self::FileNotUsed => "file not used",
            Self::OtherClouds => "other clouds beside those",
            Self::Viewpoint => "viewpoint not applied",
            Self::ForeignPacket => "packet of something else",
            Self::BadPacket => "bad packet",
            Self::MissingPackets => "packets missing",
            Self::ClockJump => "the sensor's clock jumps",
            Self::PartialRevolution => "less than a revolution",
            Self::WithoutPartner => "no image of the other camera",
        })
    }
}

/// Where it was, and what was expected there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Note {
    /// The file.
    pub file: String,
    /// Where in it, decompressed.
    pub offset_bytes: u64,
    /// What should have been there.
    pub expected: String,
    /// What was there.
    pub found: String,
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, byte {}: expected {}, found {}", self.file, self.offset_bytes, self.expected, self.found)
    }
}

/// The notes of one kind.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Noted {
    /// How many.
    pub count: u64,
    /// The first 20 of them.
    pub first: Vec<Note>,
}

/// All that was noted. Memory is bounded, however long or broken the recording.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Notes {
    /// By kind.
    pub kinds: BTreeMap<NoteKind, Noted>,
}

impl Notes {
    /// How often something of the kind was noted.
    #[must_use]
    pub fn count(&self, kind: NoteKind) -> u64 {
        self.kinds.get(&kind).map_or(0, |noted| noted.count)
    }

    /// Whether something of the recording may be missing or wrong in what was delivered.
    #[must_use]
    pub fn has_losses(&self) -> bool {
        self.kinds.keys().any(|kind| kind.loses_data())
    }

    /// Adds what others have noted.
    pub fn extend(&mut self, others: &Self) {
        for (kind, more) in &others.kinds {
            let noted = self.kinds.entry(*kind).or_default();
            noted.count += more.count;
            let room = PLACES_KEPT.saturating_sub(noted.first.len());
            noted.first.extend(more.first.iter().take(room).cloned());
        }
    }

    /// Counts one more; its words are only made up while there is room for them.
    pub fn note<E: Into<String>, F: Into<String>>(
        &mut self,
        kind: NoteKind,
        file: &str,
        offset_bytes: usize,
        words: impl FnOnce() -> (E, F),
    ) {
        let noted = self.kinds.entry(kind).or_default();
        noted.count += 1;
        if noted.first.len() < PLACES_KEPT {
            let (expected, found) = words();
            noted.first.push(Note {
                file: file.to_owned(),
                offset_bytes: offset_bytes as u64,
                expected: expected.into(),
                found: found.into(),
            });
        }
    }

    /// Counts what would have been an error, had it not been about a part only.
    pub fn note_error(&mut self, kind: NoteKind, file: &str, error: CloudError) {
        match error {
            CloudError::Content { file, offset_bytes, expected, found } => {
                self.note(kind, &file, offset_bytes as usize, || (expected, found));
            }
            CloudError::Io { file, cause } => self.note(kind, &file, 0, || ("a readable file", cause.to_string())),
            other => self.note(kind, file, 0, || ("a readable file", other.to_string())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_stays_bounded_while_counts_go_on() {
        let mut notes = Notes::default();
        (0..1000).for_each(|at| notes.note(NoteKind::BadRow, "times.txt", at, || ("seconds", "x")));
        let twice = notes.clone();
        notes.extend(&twice);
        let noted = &notes.kinds[&NoteKind::BadRow];
        assert_eq!((noted.count, noted.first.len()), (2000, PLACES_KEPT));
        assert_eq!(noted.first[3].to_string(), "times.txt, byte 3: expected seconds, found x");
        assert!(notes.has_losses());
    }
}
