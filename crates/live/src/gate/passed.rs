//! What arrives at a gate, and what comes through it.

use mapwright::SpaceReading;
use mapwright_geom::Stamp;
use mapwright_sensor::{Cloud, LaserScan, Odometry, TurnRate};
use std::time::Duration;

/// When a message arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Arrived {
    /// Since the start, by a clock that is never set.
    pub since_start: Duration,
    /// By the clock that stamps are of: that of messages that have none.
    pub stamp: Stamp,
}

/// What comes through the gate.
#[derive(Debug, Clone, PartialEq)]
pub enum Passed {
    /// A scan, with its laser's place on the robot and odometry's pose at its stamp.
    Scan(LaserScan),
    /// A cloud, with its sensor's place on the robot and odometry's pose at its stamp.
    Cloud(Cloud),
    /// What was read between them.
    Reading(Reading),
}

/// What is read of the robot's motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reading {
    /// Where odometry has it.
    Odometry(Odometry),
    /// How fast a gyroscope says that it turns.
    Turning(TurnRate),
    /// What is read in space.
    InSpace(SpaceReading),
}

impl Reading {
    pub(super) fn stamp(&self) -> Stamp {
        match self {
            Self::Odometry(odometry) => odometry.stamp,
            Self::Turning(rate) => rate.stamp,
            Self::InSpace(SpaceReading::Imu(reading)) => reading.stamp,
            Self::InSpace(SpaceReading::Odometry(stamp)) => *stamp,
        }
    }
}
