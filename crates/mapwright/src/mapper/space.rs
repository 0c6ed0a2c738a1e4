//! What a mapper of space has beside.

use super::SpaceMapper;
use crate::front_end::{ByJoins, FrontEnd, Maps};
use crate::space::{ImuReport, SpaceFrontEnd};
use mapwright_geom::{Cov6, Pose3, Stamp};
use mapwright_record::{KeyframeId, Update};
use mapwright_sensor::{Cloud, ImuReading, ImuTaken, SpaceSweep};

impl Maps for SpaceSweep {
    type Scan = Cloud;
    type FrontEnd = SpaceFrontEnd;
    type Locator = ByJoins;
}

/// A reading that comes before a cloud.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SpaceReading {
    /// Of an inertial sensor, turned into the robot's frame.
    Imu(ImuReading),
    /// Odometry was read at this stamp; what it said comes with the clouds ([`Cloud::odom_from_robot`]).
    Odometry(Stamp),
}

impl SpaceMapper {
    /// Remembers a reading: [`SpaceMapper::add_imu`], [`SpaceMapper::hear_odometry`].
    pub fn add_reading(&mut self, reading: SpaceReading) {
        match reading {
            SpaceReading::Imu(reading) => drop(self.add_imu(reading)),
            SpaceReading::Odometry(stamp) => self.hear_odometry(stamp),
        }
    }

    /// Remembers a reading of an inertial sensor, for the robot's rotation between clouds and during a sweep, and for where down is:
    /// hand in what was read before the end of a sweep before its cloud. What comes late, in disorder or not at all is counted
    /// ([`SpaceMapper::imu_report`]) and does no harm.
    pub fn add_imu(&mut self, reading: ImuReading) -> ImuTaken {
        self.front.add_imu(reading)
    }

    /// Remembers that odometry was read at this stamp: through a time without clouds in which wheels go on being read a robot is where they say.
    /// What they say comes with the clouds ([`Cloud::odom_from_robot`]).
    pub fn hear_odometry(&mut self, stamp: Stamp) {
        self.front.hear_odometry(stamp);
    }

    /// What became of the readings so far.
    #[must_use]
    pub fn imu_report(&self) -> ImuReport {
        self.front.imu_report()
    }

    /// When the middle of the last cloud's sweep was, and the robot's pose then, which is what its points tell: that of the stamp is carried on
    /// from there. In the front end's frame, which corrections do not move.
    #[must_use]
    pub fn middle_of_sweep(&self, last: &Cloud) -> (Stamp, Pose3) {
        self.front.middle_of(last)
    }

    /// One cloud through the pipeline: [`add_scan`](super::MapperOf::add_scan).
    pub fn add_cloud(&mut self, cloud: &Cloud) -> Update<SpaceSweep> {
        self.add_scan(cloud)
    }

    /// How certain each keyframe is relative to the newest one: covariance of the newest one's pose seen from it, a right perturbation,
    /// translation first, metres and radians.
    pub fn certainty(&mut self) -> Vec<(KeyframeId, Cov6)> {
        let known = self.front.survey(self.store.past());
        known.into_iter().map(|known| (self.store.id(known.first), known.covariance)).collect()
    }

    /// Voxels of all resolutions that clouds are matched with: what the local map takes in memory.
    #[must_use]
    pub fn local_map_voxels(&self) -> usize {
        self.front.local_map_voxels()
    }

    /// Side of the smallest voxels, metres, once there was a cloud with enough points to derive it from.
    #[must_use]
    pub fn resolution_m(&self) -> Option<f64> {
        self.front.scale().map(|scale| scale.resolution_m)
    }

    /// How far the sensor sees, root mean square of the first such cloud's ranges, metres.
    #[must_use]
    pub fn range_m(&self) -> Option<f64> {
        self.front.scale().map(|scale| scale.range_m)
    }
}
