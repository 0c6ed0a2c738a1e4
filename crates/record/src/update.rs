//! What one scan or one job led to.

use crate::entry::Entry;
use crate::error::EntryError;
use crate::id::KeyframeId;
use crate::keyframe::Measurement;
use mapwright_geom::{Pose, Stamp};
use mapwright_sensor::{BeamCounts, Sweep};

/// How well the robot knows where it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Status {
    /// The scan agrees with the map and with odometry.
    Tracking,
    /// The match is doubtful; its variance was raised. In space also: what is seen leaves some direction of the pose to the prediction.
    Degraded,
    /// No pose explains the scan; the pose is odometry's, and nothing is written to the map.
    Lost,
}

impl Status {
    /// Lower-case name for reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Tracking => "tracking",
            Self::Degraded => "degraded",
            Self::Lost => "lost",
        }
    }
}

/// Whether what the robot maps is joined with what was mapped before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Localisation {
    /// It is.
    #[default]
    Joined,
    /// Since a break it maps a fragment of its own: where that lies in the map odometry alone tells, if anything does.
    Apart,
}

impl Localisation {
    /// Lower-case name for reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Joined => "joined",
            Self::Apart => "apart",
        }
    }
}

/// What the local map consists of: the keyframes that scans are matched against.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LocalMapReport {
    /// Keyframes in it.
    pub keyframes: usize,
    /// Keyframes that were taken out because they were no longer certain relative to the robot; those that were left behind
    /// where the map began anew are not counted.
    pub gated_out: u64,
    /// Keyframes that were drawn again.
    pub let_in: u64,
    /// Keyframes that gave way to other views of the same area.
    pub superseded: u64,
}

/// How the pose of a scan was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatchReport {
    /// Beams that took part.
    pub beams: u32,
    /// Share of those beams in known territory that fit the map, 0 to 1.
    pub inlier_share: f64,
    /// How far those beams end off what the map has, the median, metres; in the plane it is not measured.
    pub off_m: Option<f64>,
    /// Share of the beams that end in territory the map knows, 0 to 1.
    pub known_share: f64,
    /// Distance between the match and odometry's prediction in standard deviations of the motion model.
    pub odometry_sigmas: f64,
    /// Evaluations of the objective, one field look-up a beam each.
    pub evaluations: u32,
    /// Starts tried beyond the prediction.
    pub restarts: u32,
    /// Whether the correlative search was used.
    pub searched: bool,
    /// It fits only what was mapped since a scan that did not fit.
    pub unconfirmed: bool,
}

/// Everything that anybody outside may know about one scan, or about the result of one job: then `scan` is the newest scan, of
/// which nothing new is said (`beams`, `matched`, `refused` and `keyframe` are empty), and the pose is the corrected one.
#[derive(Debug, Clone, PartialEq)]
pub struct Update<M: Measurement = Sweep> {
    /// Number of the scan in arrival order, from zero.
    pub scan: u64,
    /// The scan's stamp.
    pub stamp: Stamp,
    /// Pose of the robot in the map.
    pub map_from_robot: M::Pose,
    /// Covariance of the pose relative to `anchor`, without one relative to the map (right perturbation; m^2, m rad, rad^2).
    pub covariance: <M::Pose as Pose>::Matrix,
    /// Keyframe that supplied most of the matched points.
    pub anchor: Option<KeyframeId>,
    /// How well the robot knows where it is.
    pub status: Status,
    /// Whether what it maps is joined with the rest.
    pub localisation: Localisation,
    /// Frame of `odom_from_robot` in the map; jumps when the map is corrected. Not that of the robot's own odometry, whose numbers may begin anywhere.
    pub map_from_odom: M::Pose,
    /// Pose of the robot by odometry alone, summed up by the mapper from where it began; never jumps.
    pub odom_from_robot: M::Pose,
    /// The keyframe this scan became, if it did.
    pub keyframe: Option<KeyframeId>,
    /// What became of the beams.
    pub beams: BeamCounts,
    /// How the pose was found; `None` for a scan without a single return, and for the first.
    pub matched: Option<MatchReport>,
    /// The scan was refused as a whole for this reason (its pose is odometry's prediction).
    pub refused: Option<&'static str>,
    /// What the next scan is matched against.
    pub local_map: LocalMapReport,
    /// Keyframes made since a job waits to be fetched or to come back: old places are looked for once its result is there. It grows without end where
    /// jobs are handed out (`loops.jobs`) and nobody fetches them.
    pub waiting_keyframes: u32,
    /// What changed, in order: the scan itself, keyframes, edges, candidates and verdicts, what was withdrawn or left out, and
    /// who moved. All entries of all updates, in order, are the log; [`crate::Session`] is what they amount to.
    pub entries: Vec<Entry<M>>,
    /// Why something that happened is no entry: no session can hold it. Empty unless numbers are beyond all reason.
    pub unwritten: Vec<EntryError>,
}
