//! Maps from moving sensors, one reading at a time.
//!
//! ```
//! use mapwright::{LaserModel, LaserScan, Mapper, Pose2, Settings, Stamp};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let mut mapper = Mapper::new(Settings::default())?;
//! let laser = LaserModel { range_max_m: 30.0, ..LaserModel::half_circle("front", 181) };
//! let scan = LaserScan {
//!     stamp: Stamp(0),
//!     laser: laser.into(),
//!     ranges_m: vec![2.0; 181],
//!     odom_from_robot: Some(Pose2::IDENTITY),
//! };
//! let update = mapper.add_scan(&scan);
//! assert!(update.keyframe.is_some());
//! # Ok(())
//! # }
//! ```

mod advice;
mod closing;
mod jobs;
mod live;
mod mapper;
mod motion;
mod patches;
mod probe;
mod render;
mod settings;

#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
struct ReadmeExamples;

pub use advice::{Advice, Place};
pub use jobs::{Job, JobResult};
pub use live::LiveReport;
pub use mapper::{DOUBT_SHARE, DOUBT_SIGMAS, KNOWN_SHARE, LOST_SHARE, Mapper, Mended, TrajectoryPose};
pub use mapwright_geom::{Cov3, Pose2, Stamp};
pub use mapwright_grid::{CountGrid, LiveMap};
pub use mapwright_record::{
    Candidate, Detection, Edge, EdgeKind, Evidence, Keyframe, KeyframeId, MatchReport, Objection, Status, Update,
    Verdict,
};
pub use mapwright_sensor::{BeamCounts, LaserModel, LaserScan, Odometry, Sweep, TurnRate};
pub use probe::{NoProbe, Probe, Stage};
pub use render::{Doubted, GlobalMap};
pub use settings::{
    Correction, Jobs, KeyframeSettings, LivePolicy, LiveSettings, LoopSettings, MapSettings, MatchingSettings,
    MotionSettings, Optimizer, ScanSettings, SettingLine, Settings, SettingsError,
};
