//! A robot maps while it drives.
//!
//! What arrives goes through three stages, each of which counts what it does not hand on, so that what has arrived is what was used, what was
//! dropped for a reason and what waits ([`Tally`]):
//!
//! 1. [`Door`]: a bounded queue between the threads that receive and the one that maps. Where it is full the newest wins. Nobody who receives ever
//!    waits for the mapper.
//! 2. [`Gate`]: scans wait there until transforms say where the laser sits and where odometry has the robot at their stamps, up to a bound, and
//!    become scans of the mapper. It is a value that is told what time it is: the same messages at the same times give the same scans.
//! 3. [`map`]: the mapper on the thread that calls it, its jobs on another. A closure that takes seconds to verify makes no scan wait.
//!
//! [`Gate::missing`] says in words what the robot lacks.
//!
//! What a ROS 2 node answers besides, services, parameters and the like, is [`node`]'s.
//!
//! Nothing here knows a network. Whoever does puts what arrives in at the door and sends out what [`map`] tells.
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod door;
mod gate;
mod mapping;
pub mod node;
pub mod outgoing;
mod pulse;
mod tally;
pub mod wire;

pub use door::{Door, Lane, Next};
pub use gate::{Arrived, Gate, GateSettings, KnownSensors, Passed, Reading};
pub use mapping::{Asked, Driver, Heard, Results, map};
pub use tally::{Reason, Tally};
