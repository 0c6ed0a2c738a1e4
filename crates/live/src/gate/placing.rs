//! Where sensors sit on the robot.

use super::{Gate, Ready, TOPICS_MOST};
use mapwright_geom::{Pose3, Stamp};
use mapwright_ros::{Mounting, RosError};
use mapwright_sensor::{LaserModel, SpaceSensor};
use std::sync::Arc;

/// A laser's plane is tilted by no more, degrees: else a wall is not where it seems.
const TILT_MOST_DEG: f64 = 5.0;

/// How a sensor sits on the robot.
#[derive(Debug, Clone, Copy)]
pub(super) enum Mounted {
    InPlane(Mounting),
    InSpace(Pose3),
}

impl Gate {
    /// Whether a frame lies between odometry's and the robot's, or is the robot's.
    pub(super) fn is_on_the_way(&self, frame: &str) -> bool {
        let mut at = self.settings.robot_frame.trim_start_matches('/');
        let frame = frame.trim_start_matches('/');
        while at != self.settings.odom_frame.trim_start_matches('/') {
            if at == frame {
                return true;
            }
            match self.transforms.parent(at) {
                Some(above) => at = above,
                None => return false,
            }
        }
        false
    }

    pub(super) fn place(&self, frame: &str, stamp: Stamp, has_waited: bool) -> Ready<Result<Mounted, RosError>> {
        let known = &self.settings.known;
        if let Some((robot_from_laser, inverted)) = known.laser.filter(|_| !self.settings.is_in_space) {
            return Ready::Now(Ok(Mounted::InPlane(Mounting { robot_from_laser, inverted, ..Mounting::IDENTITY })));
        }
        match self.transforms.lookup(&self.settings.robot_frame, frame, stamp) {
            Ok(pose) if self.settings.is_in_space => {
                let pose = known.lidar.map_or(pose, |found| pose.moved_in_plane(found));
                Ready::Now(Ok(Mounted::InSpace(pose)))
            }
            Ok(pose) => Ready::Now(Mounting::project(pose, TILT_MOST_DEG).map(Mounted::InPlane)),
            Err(_) if !has_waited => Ready::Wait,
            Err(error) => Ready::Now(Err(error)),
        }
    }

    /// The laser where it sits; lasers that are alike are shared.
    pub(super) fn placed(&mut self, laser: &LaserModel, mounting: &Mounting) -> Arc<LaserModel> {
        let Mounting { robot_from_laser, inverted, .. } = *mounting;
        let laser = LaserModel { robot_from_laser, inverted, ..laser.clone() };
        match self.lasers.get(&laser.name) {
            Some(known) if **known == laser => Arc::clone(known),
            _ => {
                if self.lasers.len() >= TOPICS_MOST {
                    self.lasers.clear();
                }
                let made = Arc::new(laser);
                self.lasers.insert(made.name.clone(), Arc::clone(&made));
                made
            }
        }
    }

    /// The same of a sensor in space.
    pub(super) fn placed_in_space(&mut self, sensor: &SpaceSensor, robot_from_sensor: Pose3) -> Arc<SpaceSensor> {
        let sensor = SpaceSensor { robot_from_sensor, ..sensor.clone() };
        match self.sensors.get(&sensor.name) {
            Some(known) if **known == sensor => Arc::clone(known),
            _ => {
                if self.sensors.len() >= TOPICS_MOST {
                    self.sensors.clear();
                }
                let made = Arc::new(sensor);
                self.sensors.insert(made.name.clone(), Arc::clone(&made));
                made
            }
        }
    }
}
