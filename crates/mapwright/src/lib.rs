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
mod audit;
mod back;
mod breaks;
mod cycles;
mod front;
mod front_end;
mod jobs;
mod local_map;
mod locate;
mod mapper;
mod odometry;
mod patches;
mod pose;
mod probe;
mod render;
mod sensors;
mod settings;
mod space;
mod store;
mod told;
mod visits;
mod watch;

#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
struct ReadmeExamples;

pub use advice::{Advice, Place};
pub use audit::{Audit, audit};
pub use front::{DOUBT_SHARE, DOUBT_SIGMAS, KNOWN_SHARE, LOST_SHARE};
pub use front_end::{Maps, Reading};
pub use jobs::{Job, JobResult};
pub use locate::{Location, Withdrawal};
pub use mapper::{Adopted, Mapper, MapperOf, Sighted, SpaceMapper, SpaceReading, WaysSeen};
pub use mapwright_geom::{Cov3, Cov6, Pose2, Pose3, Stamp};
pub use mapwright_grid::{BeamAgreement, CountGrid, LocalMap};
pub use mapwright_record::{
    Adoption, Beams, Candidate, Checkpoint, Detection, Edge, EdgeKind, Entry, EntryError, Evidence, Fragment,
    FragmentStart, Gravity, Keyframe, KeyframeId, LeftOut, LeftOutReason, LocalMapReport, Localisation, MatchReport,
    Objection, OdometryLink, OdometryOrigin, Piece, RecordedEdge, Run, RunId, ScanPose, SeparateMap, Session,
    SessionEdge, Snapshot, Status, TrajectoryPose, Update, Verdict, WheelSlip, groups,
};
pub use mapwright_sensor::{BeamCounts, LaserModel, LaserScan, Odometry, Sweep, TurnRate};
pub use mapwright_sensor::{Cloud, DepthImage, ImuReading, ImuTaken, PinholeCamera, SpaceSensor, SpaceSweep};
pub use mapwright_voxel::{Occupancy, OccupancySettings};
pub use probe::{NoProbe, Probe, Stage};
pub use render::GlobalMap;
pub use settings::{
    Correction, Jobs, KeyframeSettings, LivePolicy, LiveSettings, LoopSettings, MapSettings, MatchingSettings,
    MotionSettings, Optimizer, ScanSettings, SettingLine, Settings, SettingsError,
};
pub use space::{
    ImuMount, ImuReport, MapPoints, MapSurfel, MapSurfels, SpaceMap, SurfaceMap, occupancy_of, points_of,
    points_of_map, surface_settings, surfels_of, usual_range_m, white_of,
};
pub use visits::{MISFIT_M, Visits, visit_pairs};
