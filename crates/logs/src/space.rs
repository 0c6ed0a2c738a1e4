//! Recordings of sensors in space: clouds of points and images of depth, as clouds.
//!
//! A [`SpacePlan`] says which topic is mapped, how its sensor sits on the robot and where odometry comes from, each with its
//! reason; a [`SpaceStream`] reads the recording once more and delivers the clouds, and the readings of an inertial sensor, in order of
//! arrival. Messages that cannot be
//! used are counted in its notes and end nothing.

mod calibrator;
mod camera;
mod imu;
mod maker;
mod packets;
mod plan;
mod stream;
mod wheels;

pub use calibrator::{ImuCalibrator, ImuFit};
pub use imu::ImuSource;
pub use plan::SpacePlan;
pub use stream::{SpaceEvent, SpaceStream};
