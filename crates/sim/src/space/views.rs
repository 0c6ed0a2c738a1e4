//! What two places in space see in common: the truth about revisits.

use super::drive::SpaceDrive;
use super::lidar::LidarSettings;
use super::turn::{rows, turned};
use super::world::SpaceWorld;
use crate::drive::stamp_ns;
use crate::views::{BEHIND_M, Revisits, Sample, Sight};
use mapwright_geom::{Pose3, Stamp, sin_cos};
use std::f64::consts::TAU;

/// Directions looked at of each view: elevations within the lidar's field of view times azimuths.
const ELEVATIONS: usize = 5;
const AZIMUTHS: usize = 18;
/// The drive is looked at so often a second.
const LOOKS_HZ: f64 = 2.0;

impl Revisits<Pose3> {
    /// Which times of a drive in space see the same place with its lidar, as [`Revisits::of`] for the plane.
    #[must_use]
    pub fn in_space(drive: &SpaceDrive) -> Self {
        let viewer = Viewer::new(&drive.site().world, drive.lidar());
        let way = (0..).map_while(|number| {
            let stamp = Stamp(stamp_ns(number, LOOKS_HZ));
            Some((stamp, drive.world_from_robot(stamp)?))
        });
        Self::among(&viewer, &viewer.samples(way))
    }
}

/// A lidar's eye without noise.
struct Viewer<'a> {
    world: &'a SpaceWorld,
    robot_from_sensor: Pose3,
    directions: Vec<[f64; 3]>,
    range_m: f64,
    /// Sines of the lowest and the highest elevation.
    edge_sines: [f64; 2],
}

impl<'a> Viewer<'a> {
    fn new(world: &'a SpaceWorld, lidar: &LidarSettings) -> Self {
        let elevations = || lidar.elevations_rad.iter().copied();
        let (low_rad, high_rad) =
            (elevations().fold(f64::INFINITY, f64::min), elevations().fold(f64::NEG_INFINITY, f64::max));
        let direction = |k: usize| {
            let share = ((k / AZIMUTHS) as f64 + 0.5) / ELEVATIONS as f64;
            let (up, out) = sin_cos(low_rad + share * (high_rad - low_rad));
            let (sin, cos) = sin_cos(TAU * (k % AZIMUTHS) as f64 / AZIMUTHS as f64);
            [out * cos, out * sin, up]
        };
        let beams = if low_rad <= high_rad { ELEVATIONS * AZIMUTHS } else { 0 };
        Self {
            world,
            robot_from_sensor: lidar.sensor.robot_from_sensor,
            directions: (0..beams).map(direction).collect(),
            range_m: lidar.sensor.range_max_m,
            edge_sines: [sin_cos(low_rad).0, sin_cos(high_rad).0],
        }
    }

    fn sees(&self, origin: [f64; 3], up: [f64; 3], point: [f64; 3]) -> bool {
        let to_point: [f64; 3] = std::array::from_fn(|k| point[k] - origin[k]);
        let range_m = dot(to_point, to_point).sqrt();
        let [low, high] = self.edge_sines.map(|sine| sine * range_m);
        if range_m > self.range_m || range_m <= 0.0 || !(low..=high).contains(&dot(up, to_point)) {
            return false;
        }
        self.world.cast(origin, to_point.map(|v| v / range_m), range_m - BEHIND_M).is_none()
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Sight for Viewer<'_> {
    type Pose = Pose3;
    type Point = [f64; 3];

    fn turn_rad(from: Pose3, to: Pose3) -> f64 {
        from.between(to).rotation.angle()
    }

    fn sample(&self, stamp: Stamp, along_m: f64, world_from_robot: Pose3) -> Sample<Pose3, [f64; 3]> {
        let world_from_sensor = world_from_robot * self.robot_from_sensor;
        let (rows, origin) = (rows(&world_from_sensor), world_from_sensor.translation.into());
        let end = |&direction: &[f64; 3]| {
            let direction = turned(&rows, direction);
            let hit = self.world.cast(origin, direction, self.range_m)?;
            Some(std::array::from_fn(|k| origin[k] + hit.at * direction[k]))
        };
        Sample { stamp, along_m, world_from_robot, view: self.directions.iter().filter_map(end).collect() }
    }

    fn share_seen(&self, view: &[[f64; 3]], world_from_robot: Pose3) -> f64 {
        let world_from_sensor = world_from_robot * self.robot_from_sensor;
        let (origin, up) = (world_from_sensor.translation.into(), rows(&world_from_sensor).map(|row| row[2]));
        let seen = view.iter().filter(|&&point| self.sees(origin, up, point)).count();
        seen as f64 / view.len().max(1) as f64
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;
    use crate::REVISIT_OVERLAP;
    use crate::space::{SpaceDriveSettings, worlds};

    #[test]
    fn a_place_is_seen_from_itself_whatever_the_heading_and_not_from_the_storey_above() {
        let site = worlds::look_alike_storeys(3);
        let viewer = Viewer::new(&site.world, &LidarSettings::default());
        let [x, y, z] = site.waypoints[2];
        let at = |z: f64, yaw: f64| {
            let rotation = Pose3::exp([0.0, 0.0, 0.0, 0.0, 0.0, yaw].into()).rotation;
            viewer.sample(Stamp(0), 0.0, Pose3 { translation: [x, y, z].into(), rotation })
        };
        let here = at(z, 0.0);
        assert!(here.view.len() > ELEVATIONS * AZIMUTHS / 2);
        assert!(viewer.overlap(&here, &at(z, 2.0)) > 0.9);
        assert!(viewer.overlap(&here, &at(z + 3.2, 0.0)) < 0.1);
    }

    #[test]
    fn a_drive_comes_back_where_it_passes_by_again() {
        let drive = SpaceDrive::new(worlds::two_storey(3).into(), SpaceDriveSettings::default());
        let revisits = Revisits::in_space(&drive);
        let height = |stamp| drive.world_from_robot(stamp).unwrap().translation.z;
        let (low, high) = (|z: f64| z < 0.2, |z: f64| z > 3.0);
        for pair in revisits.pairs() {
            let [a, b] = [pair.earlier, pair.later].map(height);
            assert!(pair.overlap > REVISIT_OVERLAP && !(low(a) && high(b) || high(a) && low(b)), "{a} {b}");
            assert!(revisits.contains(pair.later, pair.earlier));
        }
        // The drive ends where it began.
        let last = revisits.stretches().pop().unwrap();
        assert!(drive.duration_s() - last[1].secs_since(Stamp(0)) < 2.0);
    }
}
