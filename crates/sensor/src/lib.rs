//! What sensors deliver, and what is done with it before any map is involved.
//!
//! - [`LaserModel`], [`LaserScan`], [`Odometry`], [`TurnRate`]: readings as they arrive.

mod motion;
mod prepared;
mod scan;
mod turning;

pub use motion::{Decomposed, MotionModel};
pub use prepared::{BEAM_DROPPED, BEAM_NO_RETURN, BeamCounts, BeamTable, Sweep, SweepPoints};
pub use scan::{LaserModel, LaserScan, Odometry};
pub use turning::{TurnRate, TurnRates};
