//! What sensors deliver, and what is done with it before any map is involved.
//!
//! - [`LaserModel`], [`LaserScan`], [`Odometry`], [`TurnRate`]: readings of the plane as they arrive.
//! - [`SpaceSensor`], [`Cloud`], [`PinholeCamera`], [`DepthImage`]: readings of space.

mod cloud;
mod motion;
mod prepared;
mod scan;
mod space_sweep;
mod turning;

pub use cloud::{Cloud, DepthImage, PinholeCamera, SpaceSensor};
pub use motion::{Decomposed, MotionModel};
pub use prepared::{BEAM_DROPPED, BEAM_NO_RETURN, BeamCounts, BeamTable, Sweep, SweepPoints};
pub use scan::{LaserModel, LaserScan, Odometry};
pub use space_sweep::SpaceSweep;
pub use turning::{TurnRate, TurnRates};
