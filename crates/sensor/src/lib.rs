//! What sensors deliver, and what is done with it before any map is involved.
//!
//! - [`LaserModel`], [`LaserScan`], [`Odometry`]: readings as they arrive.

mod scan;

pub use scan::{LaserModel, LaserScan, Odometry};
