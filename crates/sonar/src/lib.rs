//! Sonars in the plane: from echoes that say no direction to walls that can be matched and drawn.
//!
//! An echo says that something lies on the arc that its cone has at its range, and no more. Echoes of a smooth wall all come from
//! where the sound meets it straight on, so that the arcs of one wall have one tangent, from wherever they were heard (regions of
//! constant depth: Leonard and Durrant-Whyte 1992; the Hough transform over them: Tardós et al. 2002). A [`Gatherer`] collects
//! readings over a stretch of way by odometry, finds those tangents, and hands out a [`Stretch`]: a [`LaserScan`] that stands
//! for the walls and goes through the mapper like any other, and what the echoes say of each cell (the inverse model of
//! *Probabilistic Robotics*, chapter 9, with the arc shrunk to the place that the other echoes leave). Before that the directions of
//! walls correct odometry's headings: those of a building are mostly parallel or at right angles.
//!
//! [`LaserScan`]: mapwright_sensor::LaserScan

mod arc;
mod compass;
mod drawn;
mod edge;
mod fit;
mod gather;
mod hough;
mod place;
mod scan;
mod wall;

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::panic, reason = "tests may")]
mod tests;

pub use arc::Arc2;
pub use drawn::{DrawnEchoes, HeardWalls};
pub use gather::{EchoCounts, Gatherer, GathererSettings, Stretch};
pub use wall::Wall;
