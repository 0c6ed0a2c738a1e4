//! A depth camera.

use super::turn::{rows, turned};
use super::world::SpaceWorld;
use crate::rng::Rng;
use mapwright_geom::Pose3;
use mapwright_sensor::{PinholeCamera, SpaceSensor};
use std::sync::Arc;

/// Beside a step in depth of more than this share a pixel lies on an edge.
const EDGE_SHARE: f64 = 0.05;

/// A depth camera and its faults. The robot stands still while an image is taken.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthSettings {
    /// Pixels and focal lengths.
    pub camera: Arc<PinholeCamera>,
    /// Its place on the robot, optical axis along z and x to the right; its ranges and their noise, both of depth along the axis.
    pub sensor: Arc<SpaceSensor>,
    /// Images a second; kept within 0.1 to 1000.
    pub rate_hz: f64,
    /// Probability that a pixel has no depth.
    pub dropout_probability: f64,
    /// Probability that a pixel on the edge of an object has no depth; else its depth is anything between the two sides.
    pub edge_dropout_probability: f64,
}

impl Default for DepthSettings {
    /// 320 x 240 pixels over 67 degrees, 30 Hz, looking ahead from 0.7 m above the floor, 0.2 to 6 m.
    fn default() -> Self {
        let camera = PinholeCamera {
            width: 320,
            height: 240,
            focal_px: [240.0, 240.0],
            centre_px: [159.5, 119.5],
            distortion: [0.0; 5],
        };
        // x right, y down, z ahead
        let robot_from_sensor = Pose3::from_quaternion([0.2, 0.0, 0.7], [-0.5, 0.5, -0.5, 0.5]).unwrap_or_default();
        Self {
            camera: Arc::new(camera),
            sensor: Arc::new(SpaceSensor { robot_from_sensor, ..SpaceSensor::depth_camera("simulated") }),
            rate_hz: 30.0,
            dropout_probability: 0.01,
            edge_dropout_probability: 0.5,
        }
    }
}

/// A camera ready to look.
#[derive(Debug, Clone)]
pub(crate) struct DepthCamera {
    settings: DepthSettings,
    directions: Vec<[f32; 2]>,
}

impl DepthCamera {
    pub(crate) fn new(settings: DepthSettings) -> Self {
        let directions = settings.camera.directions();
        Self { settings, directions }
    }

    pub(crate) fn settings(&self) -> &DepthSettings {
        &self.settings
    }

    /// Depths row by row, metres; zero where there is none. Every pixel has the noise of its depth.
    pub(crate) fn image(&self, world: &SpaceWorld, world_from_robot: Pose3, seed: u64, number: u64) -> Vec<f32> {
        let world_from_sensor = world_from_robot * self.settings.sensor.robot_from_sensor;
        let (rows, origin) = (rows(&world_from_sensor), world_from_sensor.translation.into());
        let far_m = 2.0 * self.settings.sensor.range_max_m;
        let depth = |[x, y]: &[f32; 2]| {
            let direction = turned(&rows, [f64::from(*x), f64::from(*y), 1.0]);
            world.cast(origin, direction, far_m).map_or(f64::INFINITY, |hit| hit.at)
        };
        let true_m: Vec<f64> = self.directions.iter().map(depth).collect();
        let mut rng = Rng::keyed(seed, number);
        (0..true_m.len()).map(|pixel| self.reading(&true_m, pixel, &mut rng)).collect()
    }

    fn reading(&self, true_m: &[f64], pixel: usize, rng: &mut Rng) -> f32 {
        let s = &self.settings;
        let (mut depth_m, fate, share) = (true_m[pixel], rng.unit(), rng.unit());
        let mut lost_share = s.dropout_probability;
        if let Some(other_m) = self.across_an_edge(true_m, pixel) {
            lost_share = s.edge_dropout_probability;
            depth_m += share * (other_m - depth_m);
        }
        depth_m += rng.normal(if depth_m.is_finite() { s.sensor.sigma_m(depth_m) } else { 0.0 });
        let is_seen = fate >= lost_share && (s.sensor.range_min_m..s.sensor.range_max_m).contains(&depth_m);
        if is_seen { depth_m as f32 } else { 0.0 }
    }

    /// The depth on the other side of an edge between this pixel and that to its right or below.
    fn across_an_edge(&self, true_m: &[f64], pixel: usize) -> Option<f64> {
        let width = self.settings.camera.width as usize;
        let right = (pixel % width + 1 < width).then_some(pixel + 1);
        let beside = [right, Some(pixel + width)].into_iter().flatten().filter_map(|at| true_m.get(at).copied());
        let is_step = |other_m: &f64| (other_m - true_m[pixel]).abs() > EDGE_SHARE * other_m.min(true_m[pixel]);
        let mut beside = beside;
        beside.find(is_step)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::Solid;

    /// A wall 2 m ahead of the camera to the left, one 4 m ahead to the right.
    fn image(seed: u64) -> (Vec<f32>, usize) {
        let camera = DepthCamera::new(DepthSettings::default());
        let world = SpaceWorld::new(vec![
            Solid::aligned([2.2, 0.0, -9.0], [3.0, 9.0, 9.0]),
            Solid::aligned([4.2, -9.0, -9.0], [5.0, 9.0, 9.0]),
        ]);
        (camera.image(&world, Pose3::default(), seed, 0), 320)
    }

    #[test]
    fn noise_grows_with_the_square_of_the_depth() {
        let (depth_m, width) = image(2);
        for (columns, true_m) in [(10..150, 2.0), (170..310, 4.0)] {
            let seen = depth_m.chunks(width).flat_map(|row| &row[columns.clone()]).filter(|d| **d > 0.0);
            let errors: Vec<f64> = seen.map(|d| f64::from(*d) - true_m).collect();
            let n = errors.len() as f64;
            let (mean, square) = (errors.iter().sum::<f64>() / n, errors.iter().map(|e| e * e).sum::<f64>() / n);
            let wanted = SpaceSensor::depth_camera("").sigma_m(true_m);
            assert!(mean.abs() < 5.0 * wanted / n.sqrt(), "{mean}");
            assert!((square.sqrt() / wanted - 1.0).abs() < 5.0 / (2.0 * n).sqrt(), "{square}");
            assert!((n / (140.0 * 240.0) - 0.99).abs() < 0.003, "{n}");
        }
    }

    #[test]
    fn edges_lie_anywhere_between_the_two_sides_or_are_lost() {
        let (depth_m, width) = image(2);
        let edge: Vec<f32> = depth_m.chunks(width).map(|row| row[159]).collect();
        let lost = edge.iter().filter(|d| **d == 0.0).count();
        let between = edge.iter().filter(|d| (2.1..3.9).contains(*d)).count();
        assert!((90..150).contains(&lost) && between > 80, "{lost} lost, {between} between");
    }
}
