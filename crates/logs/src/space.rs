//! Recordings of sensors in space: clouds of points, images of depth and scans of lasers that tilt, as clouds.
//!
//! A [`SpacePlan`] says which topics are mapped, how their sensors sit on the robot and where odometry comes from, each with its
//! reason; a [`SpaceStream`] reads the recording once more and delivers the clouds, and the readings of an inertial sensor, in order of
//! arrival, those of several sensors in that of their stamps. Messages that cannot be
//! used are counted in its notes and end nothing.

mod calibrator;
mod camera;
mod further;
mod imu;
mod maker;
mod packets;
mod pair_maker;
mod plan;
mod queue;
mod stereo;
mod stream;
mod tilting;
mod topic;

pub use calibrator::{ImuCalibrator, ImuFit};
pub use imu::ImuSource;
pub use plan::SpacePlan;
pub use stream::{SpaceEvent, SpaceStream};
