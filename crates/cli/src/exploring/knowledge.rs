//! What robots know, however they came to know it.

use super::team::Team;
use super::told::Told;
use mapwright::{LaserScan, Pose2};
use mapwright_explore::OccupancyMap;

/// The robots' maps.
pub(super) enum Knowledge {
    /// From known starts in one frame, without a word said.
    Given(Team),
    /// As they told each other.
    Told(Box<Told>),
}

impl Knowledge {
    /// Takes in a robot's scan; whether it is part of the map.
    pub(super) fn add_scan(&mut self, number: usize, scan: &LaserScan, world_from_robot: Pose2) -> bool {
        match self {
            Self::Given(team) => team.add_scan(number, scan, world_from_robot),
            Self::Told(told) => told.add_scan(number, scan),
        }
    }

    /// Where a robot believes that it is.
    pub(super) fn map_from_robot(&self, number: usize, odom_from_robot: Pose2, world_from_robot: Pose2) -> Pose2 {
        match self {
            Self::Given(team) => team.map_from_robot(number, odom_from_robot, world_from_robot),
            Self::Told(told) => told.map_from_robot(number, odom_from_robot),
        }
    }

    /// A robot's map as it is now.
    pub(super) fn map(&self, number: usize) -> &OccupancyMap {
        match self {
            Self::Given(team) => team.map(number),
            Self::Told(told) => told.map(number),
        }
    }

    /// A robot is there.
    pub(super) fn stand(&mut self, number: usize, point_m: [f64; 2]) {
        match self {
            Self::Given(team) => team.stand(number, point_m),
            Self::Told(told) => told.shared(number).stand(point_m),
        }
    }

    /// Something held a robot there, or a robot died there.
    pub(super) fn feel(&mut self, number: usize, point_m: [f64; 2], radius_m: f64, until_s: f64) {
        match self {
            Self::Given(team) => team.feel(number, point_m, radius_m, until_s),
            Self::Told(told) => told.shared(number).feel(point_m, radius_m, until_s),
        }
    }

    pub(super) fn forget(&mut self, now_s: f64) {
        match self {
            Self::Given(team) => team.forget(now_s),
            Self::Told(told) => told.forget(now_s),
        }
    }

    /// How far keyframes lie from the truth, metres, rmse; none where poses are perfect.
    pub(super) fn error_m(&self, truth: &[Vec<(u64, Pose2)>]) -> Option<f64> {
        match self {
            Self::Given(team) => team.error_m(truth),
            Self::Told(told) => told.error_m(truth),
        }
    }
}
