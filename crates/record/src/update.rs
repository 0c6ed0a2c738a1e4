//! What one scan led to.

use crate::keyframe::KeyframeId;
use mapwright_geom::{Cov3, Pose2, Stamp};
use mapwright_sensor::BeamCounts;

/// How well the robot knows where it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Status {
    /// The scan agrees with the map and with odometry.
    Tracking,
    /// The match is doubtful; its variance was raised.
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

/// How the pose of a scan was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatchReport {
    /// Beams that took part.
    pub beams: u32,
    /// Share of those beams in known territory that fit the map, 0 to 1.
    pub inlier_share: f64,
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

/// Everything that anybody outside may know about one scan.
#[derive(Debug, Clone, PartialEq)]
pub struct Update {
    /// Number of the scan in arrival order, from zero.
    pub scan: u64,
    /// The scan's stamp.
    pub stamp: Stamp,
    /// Pose of the robot in the map.
    pub map_from_robot: Pose2,
    /// Covariance of the pose relative to `anchor` (right perturbation; m^2, m rad, rad^2).
    pub covariance: Cov3,
    /// Keyframe that supplied most of the matched points.
    pub anchor: Option<KeyframeId>,
    /// How well the robot knows where it is.
    pub status: Status,
    /// Frame of continuous odometry in the map; jumps when the map is corrected.
    pub map_from_odom: Pose2,
    /// Pose of the robot by odometry alone; never jumps.
    pub odom_from_robot: Pose2,
    /// The keyframe this scan became, if it did.
    pub keyframe: Option<KeyframeId>,
    /// What became of the beams.
    pub beams: BeamCounts,
    /// How the pose was found; `None` for a scan without a single return, and for the first.
    pub matched: Option<MatchReport>,
    /// The scan was refused as a whole for this reason (its pose is odometry's prediction).
    pub refused: Option<&'static str>,
}
