//! Robots that see each other: relative poses with covariances, from sightings and odometry.
//!
//! A [`Sighting`] is a range, a bearing or both of one robot from another. Two robots that see each other within a second have an
//! [`Encounter`]; one-sided sightings, and ranges alone, wait until motion between them leaves one answer. Sightings around the moment
//! are solved together, with odometry's noise in the covariance of their residuals. Values in, values out; stamps are taken as given.
//!
//! ```
//! use mapwright_geom::Stamp;
//! use mapwright_rendezvous::{DeadReckoning, Settings, Sighting, Velocity, meet_all};
//!
//! let stands = |s: i32| Velocity { stamp: Stamp::from_secs_f64(s.into()), forward_m_per_s: 0.0, turn_rad_per_s: 0.0 };
//! let wheels = DeadReckoning::from_velocities(&[stands(0), stands(1)]);
//! let sees = |observer, observed, bearing_rad| Sighting {
//!     observer,
//!     observed: Some(observed),
//!     stamp: Stamp::from_secs_f64(0.5),
//!     range_m: Some(2.0),
//!     bearing_rad: Some(bearing_rad),
//!     range_sigma_m: 0.1,
//!     bearing_sigma_rad: 0.01,
//! };
//! let sightings = [sees(1, 2, 0.0), sees(2, 1, 0.3)];
//! let meetings = meet_all(&[(1, &wheels), (2, &wheels)], &sightings, &Settings::default());
//! let encounter = &meetings.pairs[0].1.encounters[0];
//! assert!((encounter.a_from_b.x - 2.0).abs() < 1e-3 && encounter.covariance[(0, 0)] < 0.1 * 0.1);
//! assert!((encounter.a_from_b.theta - (std::f64::consts::PI - 0.3)).abs() < 1e-3);
//! ```

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod dead_reckoning;
mod encounters;
mod hypotheses;
mod noise;
mod sighting;
mod solve;
mod window;

pub use dead_reckoning::{DeadReckoning, Place, Velocity};
pub use encounters::{Encounter, Kind, Meetings, PairResult, RefusalReason, Settings, meet, meet_all};
pub use hypotheses::WaitReason;
pub use noise::{Likeness, OdometryNoise};
pub use sighting::{RobotId, Sighting};
pub use window::Noise;
