//! Worlds, robots and lasers with known truth, all functions of a seed.
//!
//! Same seed, same bytes, on every machine: the random stream, its Gaussians and all trigonometry are built from plain
//! IEEE operations. Nothing reads a clock, and a [`Drive`] is lazy, so that a recording may be as long as it likes.
//!
//! ```
//! use mapwright_sim::{Drive, DriveSettings, worlds};
//! let site = worlds::office_floor(7).with_people(3, 7);
//! let drive = Drive::new(site.into(), DriveSettings { seed: 7, ..DriveSettings::default() });
//! for (scan, world_from_robot) in drive.log(5) {
//!     assert_eq!(scan.ranges_m.len(), 180);
//!     assert!(world_from_robot.is_finite() && scan.odom_from_robot.is_some());
//! }
//! ```
//!
//! - [`worlds`]: office floors, suites of rooms, corridors, loops of up to 2 km, look-alikes, a building that never ends.
//! - [`World`], [`Site`], [`Route`]: build your own.
//! - [`Drive`], [`DriveSettings`], [`Incident`]: robot, wheels, laser, and what goes wrong.
//! - [`PerturbScans`], [`in_gaps`]: harder versions of any recording, real ones included.
//! - [`Revisits`]: which times of a drive truly see the same place.
//! - [`worlds::look_alike`]: buildings made to deceive. [`kidnapping`]: robots carried away.
//! - [`Radio`]: what robots hear of each other: lost, late, twice, out of order.
//! - [`SonarSettings`], [`sonar_drive`]: a ring of sonars among smooth walls.
//! - [`Rovers`]: several robots in one world that drive where they are told and get in each other's way.
//! - [`space`]: worlds with storeys, lidars, depth cameras and drives in space.
//! - [`failed_match_cases`]: 200 recordings in which a match must fail.

mod band;
mod build;
mod drive;
mod failures;
mod furnish;
mod gap;
mod grid;
mod kidnap;
mod laser;
mod math;
mod odometry;
mod perturb;
mod radio;
mod rng;
mod robot;
mod route;
mod rovers;
mod shape;
mod sonar;
pub mod space;
mod views;
mod world;
pub mod worlds;

pub use drive::{Drive, DriveSettings, Event, TrueScan};
pub use failures::{FAILED_MATCH_CASES, FailedMatchCase, FailureKind, failed_match_cases};
pub use gap::{EventTime, Gap, GapError, in_gaps};
pub use kidnap::{Kidnapping, STAY_S, kidnapping};
pub use laser::LaserSettings;
pub use math::Point;
pub use odometry::OdometryNoise;
pub use perturb::{HasScan, PerturbScans};
pub use radio::{Arrival, Radio, RadioSettings};
pub use rng::Rng;
pub use robot::{Incident, RobotSettings};
pub use route::{Route, Site};
pub use rovers::{Rovers, Twist};
pub use shape::{Circle, Segment};
pub use sonar::{SonarSettings, TrueSonar, sonar_drive};
pub use views::{REVISIT_OVERLAP, REVISIT_PATH_M, Revisit, Revisits, view_overlap};
pub use world::{Door, Moment, Schedule, Walker, World};
