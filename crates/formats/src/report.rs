//! What a reader has seen, and what was lost on the way.

use crate::error::FormatError;
use crate::excerpt::Excerpt;
use crate::jump::JumpWatch;
use crate::noted::{Noted, OddHeads, OrderReport, PLACES_KEPT, RangeReport};
use crate::stamp_watch::StampWatch;
use mapwright_geom::Pose2;
use std::collections::BTreeMap;
use std::fmt;

/// Unknown tags counted by name; further ones are counted together.
const TAGS_KEPT: usize = 64;

/// Why a line was dropped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum DropReason {
    /// A field is no number, or no number that makes sense there.
    BadNumber,
    /// The line ends too early.
    MissingField,
    /// The line goes on behind its last field, as when its count of readings is wrong.
    SurplusFields,
    /// No beams at all, or more than any laser has.
    BeamCount,
    /// A pose is not finite or beyond 10^6 m.
    PoseRefused,
    /// The stamp is no time that can be represented.
    StampRefused,
    /// The line is longer than 16 MiB.
    LineTooLong,
    /// The line does not begin with a word.
    NotText,
    /// The file ends within the line.
    TruncatedLastLine,
}

impl fmt::Display for DropReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::BadNumber => "bad number",
            Self::MissingField => "missing field",
            Self::SurplusFields => "surplus fields",
            Self::BeamCount => "bad number of beams",
            Self::PoseRefused => "pose refused",
            Self::StampRefused => "stamp refused",
            Self::LineTooLong => "line too long",
            Self::NotText => "not text",
            Self::TruncatedLastLine => "truncated last line",
        })
    }
}

/// One line that was dropped.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DroppedLine {
    /// Number of the line, from 1.
    pub line: u64,
    /// What should have stood there.
    pub expected: String,
    /// What stood there.
    pub found: Excerpt,
}

impl fmt::Display for DroppedLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}: expected {}, found {}", self.line, self.expected, self.found)
    }
}

/// The lines dropped for one reason.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Drops {
    /// How many.
    pub count: u64,
    /// The first 20 of them.
    pub first: Vec<DroppedLine>,
}

/// One kind of event of a log.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TopicReport {
    /// Its tag or topic name.
    pub name: String,
    /// Events delivered.
    pub events: u64,
    /// Stamps that did not run forward.
    pub stamps: StampWatch,
    /// Odometry poses that the robot cannot have driven to since the one before.
    pub odometry: JumpWatch,
    /// Scans with another number of beams than the one before.
    pub beam_count_changes: Noted,
}

/// What a reader has seen so far. Memory is bounded, however long or broken the log.
#[derive(Debug, Default)]
pub struct ReadReport {
    /// Lines read, dropped ones and comments included.
    pub lines: u64,
    /// Bytes read, after decompression.
    pub bytes: u64,
    /// Scans delivered.
    pub scans: u64,
    /// Readings of rings of sonars delivered.
    pub sonar_readings: u64,
    /// Odometry readings delivered (those of scans not counted).
    pub odometry: u64,
    /// Delivered events by tag, in order of first appearance.
    pub topics: Vec<TopicReport>,
    /// Lines by tag that carry no event: known ones such as `PARAM`, and unknown ones by name.
    pub other_tags: BTreeMap<String, u64>,
    /// Lines with tags that found no place among `other_tags`.
    pub uncounted_tags: u64,
    /// Lines that should have been events or parameters and were dropped.
    pub drops: BTreeMap<DropReason, Drops>,
    /// Scans delivered without odometry because their pose was infinite or beyond 10^6 m.
    pub refused_scan_poses: Noted,
    /// What is subtracted from the places of odometry, metres, where these lie too far out to be mapped in.
    pub odometry_origin_m: Option<[f64; 2]>,
    /// Odometry never moved, though what is seen did: it was left out by whoever read the log.
    pub odometry_never_moved: bool,
    /// Events without a stamp of their own; they carry the one before.
    pub unstamped: Noted,
    /// Ranges that are NaN or infinite, delivered as they are.
    pub non_finite_ranges: u64,
    /// Heads of scans that contradict themselves, and what was used.
    pub odd_heads: OddHeads,
    /// Scans delivered whose ranges say nothing; noted by who takes the scans.
    pub ranges: RangeReport,
    /// In which order the events were delivered; noted by who puts them in order.
    pub order: OrderReport,
    /// Where the log has the laser, and where it is asked for instead; noted by who puts it there.
    pub moved_mount: Option<[Pose2; 2]>,
    /// Whether the file ended within a line that is lost for that reason.
    pub truncated_last_line: bool,
    /// Where a compressed stream was torn ([`FormatError::Torn`]).
    pub tear: Option<FormatError>,
}

impl ReadReport {
    /// Whether at least one scan, or reading of sonars, came out: false for an empty, a binary or a foreign file.
    #[must_use]
    pub fn has_scans(&self) -> bool {
        self.scans > 0 || self.sonar_readings > 0
    }

    /// Whether something that should have been an event is missing.
    #[must_use]
    pub fn has_losses(&self) -> bool {
        self.dropped_lines() > 0 || self.tear.is_some() || self.refused_scan_poses.count > 0
    }

    /// Lines dropped for any reason.
    #[must_use]
    pub fn dropped_lines(&self) -> u64 {
        self.drops.values().map(|d| d.count).sum()
    }

    /// Stamps that stepped backwards, over all topics.
    #[must_use]
    pub fn backward_stamps(&self) -> u64 {
        self.topics.iter().map(|t| t.stamps.backward.count).sum()
    }

    /// The report of one topic.
    #[must_use]
    pub fn topic(&self, name: &str) -> Option<&TopicReport> {
        self.topics.iter().find(|t| t.name == name)
    }

    /// Counts a dropped line; its details are only made up while there is room for them.
    pub(crate) fn drop_line(&mut self, reason: DropReason, details: impl FnOnce() -> DroppedLine) {
        let drops = self.drops.entry(reason).or_default();
        drops.count += 1;
        if drops.first.len() < PLACES_KEPT {
            drops.first.push(details());
        }
    }

    /// Counts a line that carries no event.
    pub(crate) fn count_tag(&mut self, tag: &str) {
        if let Some(count) = self.other_tags.get_mut(tag) {
            *count += 1;
        } else if self.other_tags.len() < TAGS_KEPT {
            self.other_tags.insert(tag.to_owned(), 1);
        } else {
            self.uncounted_tags += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_stays_bounded_while_counts_go_on() {
        let mut report = ReadReport::default();
        for line in 0..1000_u64 {
            report.count_tag(&format!("TAG{line}"));
            report.drop_line(DropReason::BadNumber, || DroppedLine {
                line,
                expected: "a number".into(),
                found: Excerpt::new(b"x"),
            });
            report.unstamped.note(line);
        }
        assert_eq!((report.other_tags.len(), report.uncounted_tags), (TAGS_KEPT, 1000 - TAGS_KEPT as u64));
        let drops = &report.drops[&DropReason::BadNumber];
        assert_eq!((drops.count, drops.first.len()), (1000, PLACES_KEPT));
        assert_eq!(drops.first[3].to_string(), "line 3: expected a number, found `x`");
        assert_eq!((report.unstamped.count, report.unstamped.first_places.len()), (1000, PLACES_KEPT));
        assert!(report.has_losses() && !report.has_scans());
    }
}
