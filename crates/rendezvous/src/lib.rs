//! Robots that see each other.

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod dead_reckoning;
mod encounters;
mod hypotheses;
mod noise;
mod sighting;
mod solve;
mod window;

pub use dead_reckoning::{DeadReckoning, Place, Velocity};
pub use encounters::{Encounter, Kind, PairResult, RefusalReason, Settings, meet};
pub use hypotheses::WaitReason;
pub use noise::{Likeness, OdometryNoise};
pub use sighting::{RobotId, Sighting};
pub use window::Noise;
