//! A spinning lidar.

use super::turn::{rows, turned};
use super::world::SpaceWorld;
use crate::rng::Rng;
use mapwright_geom::{Pose3, sin_cos};
use mapwright_sensor::SpaceSensor;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// A lidar whose beams lie above each other and turn counter-clockwise, seen from above, from straight behind.
#[derive(Debug, Clone, PartialEq)]
pub struct LidarSettings {
    /// Its place on the robot, its ranges and their noise.
    pub sensor: Arc<SpaceSensor>,
    /// Each beam's angle above the sensor's plane of x and y, radians.
    pub elevations_rad: Vec<f64>,
    /// Directions in which all beams are taken, at even times, a turn.
    pub columns: usize,
    /// Turns a second; kept within 0.1 to 1000.
    pub rate_hz: f64,
    /// Probability that a beam returns nothing.
    pub dropout_probability: f64,
}

impl LidarSettings {
    /// Evenly spaced beams from `low_rad` to `high_rad`; 1024 columns, 10 Hz, 0.5 to 100 m, sigma 0.02 m, 1 % lost, 0.9 m above
    /// the floor.
    #[must_use]
    pub fn with_field_of_view(beams: usize, low_rad: f64, high_rad: f64) -> Self {
        let step_rad = (high_rad - low_rad) / beams.saturating_sub(1).max(1) as f64;
        let mut robot_from_sensor = Pose3::identity();
        robot_from_sensor.translation.z = 0.9;
        let sensor = SpaceSensor { range_max_m: 100.0, robot_from_sensor, ..SpaceSensor::lidar("simulated") };
        Self {
            sensor: Arc::new(sensor),
            elevations_rad: (0..beams).map(|beam| low_rad + beam as f64 * step_rad).collect(),
            columns: 1024,
            rate_hz: 10.0,
            dropout_probability: 0.01,
        }
    }

    /// 16 beams over 30 degrees, as of a Velodyne VLP-16, or up to 128 over 45 degrees, as of an Ouster OS1.
    #[must_use]
    pub fn spinning(beams: usize) -> Self {
        let half_rad = if beams <= 16 { 15f64 } else { 22.5 }.to_radians();
        Self::with_field_of_view(beams, -half_rad, half_rad)
    }

    /// Points in a cloud.
    #[must_use]
    pub fn points(&self) -> usize {
        self.columns * self.elevations_rad.len()
    }
}

impl Default for LidarSettings {
    /// 32 beams over 45 degrees.
    fn default() -> Self {
        Self::spinning(32)
    }
}

/// A lidar ready to turn.
#[derive(Debug, Clone)]
pub(crate) struct Lidar {
    settings: LidarSettings,
    /// Sines and cosines of the beams' elevations.
    elevations: Vec<(f64, f64)>,
}

impl Lidar {
    pub(crate) fn new(settings: LidarSettings) -> Self {
        let elevations = settings.elevations_rad.iter().map(|angle_rad| sin_cos(*angle_rad)).collect();
        Self { settings, elevations }
    }

    pub(crate) fn settings(&self) -> &LidarSettings {
        &self.settings
    }

    /// When a column is taken after the first, seconds.
    pub(crate) fn column_s(&self, column: usize) -> f64 {
        column as f64 / (self.settings.columns.max(1) as f64 * self.settings.rate_hz)
    }

    /// The points of a turn, column by column, in the sensor's frame at each column's time; NaN where nothing returned.
    /// `world_from_robot_at` is asked for seconds after the first column. Every column has a random stream of its own.
    pub(crate) fn turn(
        &self,
        world: &SpaceWorld,
        world_from_robot_at: impl Fn(f64) -> Pose3,
        seed: u64,
        turn: u64,
    ) -> Vec<[f32; 3]> {
        let columns = self.settings.columns;
        let mut points_m = Vec::with_capacity(self.settings.points());
        for column in 0..columns {
            let world_from_sensor = world_from_robot_at(self.column_s(column)) * self.settings.sensor.robot_from_sensor;
            let mut rng = Rng::keyed(seed, turn.wrapping_mul(columns as u64).wrapping_add(column as u64));
            let azimuth = sin_cos(column as f64 * TAU / columns as f64 - PI);
            self.column(world, &world_from_sensor, azimuth, &mut rng, &mut points_m);
        }
        points_m
    }

    fn column(
        &self,
        world: &SpaceWorld,
        world_from_sensor: &Pose3,
        (sin, cos): (f64, f64),
        rng: &mut Rng,
        points_m: &mut Vec<[f32; 3]>,
    ) {
        let sensor = &self.settings.sensor;
        let (world_from_sensor, origin) = (rows(world_from_sensor), world_from_sensor.translation.into());
        for &(up, out) in &self.elevations {
            let direction = [out * cos, out * sin, up];
            let lost = rng.chance(self.settings.dropout_probability);
            let hit = world.cast(origin, turned(&world_from_sensor, direction), sensor.range_max_m);
            let range_m = hit.map_or(f64::NAN, |hit| hit.at + rng.normal(sensor.sigma_m(hit.at)));
            let is_seen = !lost && (sensor.range_min_m..sensor.range_max_m).contains(&range_m);
            points_m.push(if is_seen { direction.map(|v| (v * range_m) as f32) } else { [f32::NAN; 3] });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::Solid;

    /// 4 m to a wall all around, 20 m up and down.
    fn room() -> SpaceWorld {
        let wall = |x: f64, y: f64| {
            Solid::aligned([x - 1.0, y - 1.0 - 9.0 * x.abs(), -20.0], [x + 1.0, y + 1.0 + 9.0 * x.abs(), 20.0])
        };
        SpaceWorld::new(vec![
            wall(5.0, 0.0),
            wall(-5.0, 0.0),
            Solid::aligned([-9.0, 4.0, -20.0], [9.0, 5.0, 20.0]),
            Solid::aligned([-9.0, -5.0, -20.0], [9.0, -4.0, 20.0]),
        ])
    }

    fn lidar(change: impl FnOnce(&mut LidarSettings, &mut SpaceSensor)) -> Lidar {
        let mut settings = LidarSettings::spinning(16);
        let mut sensor = SpaceSensor { range_sigma_m: 0.0, ..(*settings.sensor).clone() };
        settings.dropout_probability = 0.0;
        change(&mut settings, &mut sensor);
        settings.sensor = Arc::new(sensor);
        Lidar::new(settings)
    }

    #[test]
    fn beams_turn_from_behind_to_the_right_and_low_beams_come_first() {
        let lidar = lidar(|settings, _| settings.columns = 4);
        let points = lidar.turn(&room(), |_| Pose3::default(), 0, 0);
        for (column, ahead) in [[-4.0, 0.0], [0.0, -4.0], [4.0, 0.0], [0.0, 4.0]].into_iter().enumerate() {
            let [x, y, z] = points[16 * column];
            assert!((x - ahead[0]).abs() < 1e-5 && (y - ahead[1]).abs() < 1e-5, "{x} {y}");
            assert!((f64::from(z) + 4.0 * 15f64.to_radians().tan()).abs() < 1e-5, "{z}");
        }
    }

    #[test]
    fn ranges_have_the_noise_and_the_losses_asked_for() {
        let lidar = lidar(|settings, sensor| {
            sensor.range_sigma_m = 0.02;
            settings.dropout_probability = 0.1;
            settings.elevations_rad = vec![0.0; 20_000];
            settings.columns = 1;
        });
        let points = lidar.turn(&room(), |_| Pose3::default(), 3, 0);
        let errors: Vec<f64> = points.iter().filter(|p| p[0].is_finite()).map(|p| -f64::from(p[0]) - 4.0).collect();
        let n = errors.len() as f64;
        assert!((n / 20_000.0 - 0.9).abs() < 0.01, "{n}");
        let mean = errors.iter().sum::<f64>() / n;
        let sigma = (errors.iter().map(|e| e * e).sum::<f64>() / n).sqrt();
        assert!(mean.abs() < 5.0 * 0.02 / n.sqrt(), "{mean}");
        assert!((sigma / 0.02 - 1.0).abs() < 5.0 / (2.0 * n).sqrt(), "{sigma}");
    }

    #[test]
    fn what_is_too_near_or_too_far_does_not_return() {
        let near = lidar(|_, sensor| sensor.range_min_m = 7.0).turn(&room(), |_| Pose3::default(), 0, 0);
        let far = lidar(|_, sensor| sensor.range_max_m = 3.9).turn(&room(), |_| Pose3::default(), 0, 0);
        assert!(near.iter().chain(&far).all(|p| p[0].is_nan()));
    }
}
