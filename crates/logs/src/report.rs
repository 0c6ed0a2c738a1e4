//! What became of a log's messages.

use crate::clock::ClockStep;
use crate::plan::Plan;
use crate::survey::Survey;
use mapwright_formats::{Noted, OddHeads, OrderReport, RangeReport, TopicReport};
use mapwright_geom::Pose2;

/// Messages that could not be used.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Refused {
    /// How many.
    pub count: u64,
    /// Which message of the recording was the first, from 1, where it lies, and what is wrong with it.
    pub first: Option<String>,
}

impl Refused {
    pub(crate) fn note(&mut self, place: u64, offset_bytes: u64, reason: impl FnOnce() -> String) {
        self.count += 1;
        self.first.get_or_insert_with(|| format!("message {place} at byte {offset_bytes}: {}", reason()));
    }
}

/// What the second pass delivered. Memory is bounded, however long or broken the recording.
#[derive(Debug, Clone, Default)]
pub struct StreamReport {
    /// Messages of all topics read.
    pub messages: u64,
    /// Scans delivered.
    pub scans: u64,
    /// Readings of sonars delivered.
    pub sonar_readings: u64,
    /// Those that were passed over, for odometry did not come within 4,096 of them.
    pub sonars_passed_over: u64,
    /// Readings of odometry delivered.
    pub odometry: u64,
    /// Turn rates delivered.
    pub turn_rates: u64,
    /// The topics used: that of scans, that of odometry where there is one, those of further lasers. Places are numbers of messages.
    pub topics: Vec<TopicReport>,
    /// Messages delivered after others of a later stamp, for they came later than the window allows.
    pub late: Noted,
    /// What is subtracted from the places of odometry, metres, where these lie too far out to be mapped in.
    pub odometry_origin_m: Option<[f64; 2]>,
    /// Clocks that were set, and clocks that differ: how often, and the first.
    pub clock_steps: u64,
    /// The first of these.
    pub first_clock_step: Option<ClockStep>,
    /// Headers without a stamp; the time of recording stands in.
    pub unstamped: Noted,
    /// Messages of the topics used that could not be decoded.
    pub undecodable: Refused,
    /// Scans and readings that were decoded and cannot be used.
    pub unusable: Refused,
    /// Readings of the gyroscope that were decoded and cannot be used: sweeps are straightened without them.
    pub refused_turn_rates: Refused,
    /// Scans without a reading of odometry near enough, where there is odometry.
    pub without_odometry: Noted,
    /// The scan's stamp less that of the last reading of odometry, at the first of these, seconds.
    pub odometry_behind_s: Option<f64>,
    /// Ranges that are NaN or infinite, delivered as they are.
    pub non_finite_ranges: u64,
    /// Heads of scans that contradict themselves, and what was used.
    pub odd_heads: OddHeads,
    /// Scans whose ranges say nothing.
    pub ranges: RangeReport,
    /// In which order scans and readings were delivered.
    pub order: OrderReport,
    /// Where the log has the laser, and where it is asked for instead.
    pub moved_mount: Option<[Pose2; 2]>,
    /// Points of clouds outside of the slice, and those that are not finite.
    pub points_outside: u64,
    /// Points of clouds that made a scan.
    pub points_used: u64,
    /// The most memory that the reader's buffers and the window held, bytes.
    pub held_bytes: usize,
}

/// All that is known of one recording.
#[derive(Debug, Clone)]
pub struct RecordingReport {
    /// What the first pass found, and what the container's reader says of all of it.
    pub survey: Survey,
    /// What was used, and why.
    pub plan: Plan,
    /// What the second pass delivered.
    pub stream: StreamReport,
}

/// The report of one log.
#[derive(Debug)]
#[non_exhaustive]
pub enum LogReport {
    /// Of a CARMEN log.
    Carmen(Box<mapwright_formats::ReadReport>),
    /// Of a recording of messages.
    Recording(Box<RecordingReport>),
}

impl LogReport {
    /// Scans delivered that can be mapped with.
    #[must_use]
    pub fn scans(&self) -> u64 {
        match self {
            Self::Carmen(report) => report.scans - report.ranges.beyond_reach.count.min(report.scans),
            Self::Recording(report) => {
                report.stream.scans - report.stream.ranges.beyond_reach.count.min(report.stream.scans)
            }
        }
    }

    /// Readings of rings of sonars delivered.
    #[must_use]
    pub fn sonar_readings(&self) -> u64 {
        match self {
            Self::Carmen(report) => report.sonar_readings,
            Self::Recording(report) => report.stream.sonar_readings,
        }
    }

    /// What is to be said of the scans' ranges.
    #[must_use]
    pub fn ranges(&self) -> &RangeReport {
        match self {
            Self::Carmen(report) => &report.ranges,
            Self::Recording(report) => &report.stream.ranges,
        }
    }

    /// Heads of scans that contradict themselves.
    #[must_use]
    pub fn odd_heads(&self) -> &OddHeads {
        match self {
            Self::Carmen(report) => &report.odd_heads,
            Self::Recording(report) => &report.stream.odd_heads,
        }
    }

    /// In which order the log's events were delivered.
    #[must_use]
    pub fn order(&self) -> OrderReport {
        match self {
            Self::Carmen(report) => report.order,
            Self::Recording(report) => report.stream.order,
        }
    }

    pub(crate) fn set_moved_mount(&mut self, said_and_used: [Pose2; 2]) {
        match self {
            Self::Carmen(report) => report.moved_mount = Some(said_and_used),
            Self::Recording(report) => report.stream.moved_mount = Some(said_and_used),
        }
    }

    pub(crate) fn set_order(&mut self, order: OrderReport) {
        match self {
            Self::Carmen(report) => report.order = order,
            Self::Recording(report) => report.stream.order = order,
        }
    }

    pub(crate) fn set_ranges(&mut self, ranges: RangeReport) {
        match self {
            Self::Carmen(report) => report.ranges = ranges,
            Self::Recording(report) => report.stream.ranges = ranges,
        }
    }
}
