//! A pair of cameras side by side.

use super::texture;
use super::turn::{rows, turned};
use super::world::SpaceWorld;
use crate::rng::Rng;
use mapwright_geom::Pose3;
use mapwright_sensor::PinholeCamera;
use std::sync::Arc;

/// Grey value where nothing is: an even sky.
const SKY_GREY: f64 = 205.0;
/// Beyond this nothing is seen, metres.
const FAR_M: f64 = 200.0;

/// A stereo camera and its faults. The robot stands still while a pair is taken; both images are rectified.
#[derive(Debug, Clone, PartialEq)]
pub struct StereoSettings {
    /// Pixels and focal lengths of either camera, without distortion.
    pub camera: Arc<PinholeCamera>,
    /// From the left camera to the right one, metres.
    pub baseline_m: f64,
    /// The left camera's place on the robot, optical axis along z and x to the right.
    pub robot_from_left: Pose3,
    /// Pairs a second; kept within 0.1 to 1000.
    pub rate_hz: f64,
    /// Standard deviation of each pixel, grey values.
    pub noise_grey: f64,
    /// The right camera exposes differently: its grey values are those times this,
    pub right_gain: f64,
    /// plus this.
    pub right_offset_grey: f64,
}

impl Default for StereoSettings {
    /// 320 x 240 pixels over 67 degrees, 0.12 m apart, 30 Hz, looking ahead from 0.7 m above the floor as the simulated depth camera does;
    /// noise of 2 grey values, the right image a tenth darker.
    fn default() -> Self {
        let depth = super::depth::DepthSettings::default();
        Self {
            camera: depth.camera,
            baseline_m: 0.12,
            robot_from_left: depth.sensor.robot_from_sensor,
            rate_hz: depth.rate_hz,
            noise_grey: 2.0,
            right_gain: 0.9,
            right_offset_grey: 4.0,
        }
    }
}

/// A pair ready to look.
#[derive(Debug, Clone)]
pub(crate) struct StereoPair {
    settings: StereoSettings,
    directions: Vec<[f32; 2]>,
}

impl StereoPair {
    pub(crate) fn new(settings: StereoSettings) -> Self {
        let directions = settings.camera.directions();
        Self { settings, directions }
    }

    pub(crate) fn settings(&self) -> &StereoSettings {
        &self.settings
    }

    /// Grey values of the left and the right image, row by row. The pattern of surfaces is that of `seed`, the noise that of the pair's
    /// number.
    pub(crate) fn images(
        &self,
        world: &SpaceWorld,
        world_from_robot: Pose3,
        (pattern, seed): (u64, u64),
        number: u64,
    ) -> [Vec<u8>; 2] {
        let s = &self.settings;
        let beside = Pose3 { translation: [s.baseline_m, 0.0, 0.0].into(), ..Pose3::identity() };
        let cameras = [s.robot_from_left, s.robot_from_left * beside];
        let exposures = [(1.0, 0.0), (s.right_gain, s.right_offset_grey)];
        [0, 1].map(|side| {
            let mut rng = Rng::keyed(seed ^ side as u64, number);
            let (gain, offset) = exposures[side];
            let seen = self.seen(world, world_from_robot * cameras[side], pattern);
            let value = |grey: f64| (gain * grey + offset + rng.normal(s.noise_grey)).round().clamp(0.0, 255.0) as u8;
            seen.map(value).collect()
        })
    }

    /// What a camera sees, without noise.
    fn seen<'a>(
        &'a self,
        world: &'a SpaceWorld,
        world_from_camera: Pose3,
        pattern: u64,
    ) -> impl Iterator<Item = f64> + 'a {
        let (rows, origin): (_, [f64; 3]) = (rows(&world_from_camera), world_from_camera.translation.into());
        let [fx, fy] = self.settings.camera.focal_px;
        let focal = fx.min(fy);
        self.directions.iter().map(move |[x, y]| {
            let direction = turned(&rows, [f64::from(*x), f64::from(*y), 1.0]);
            let Some(hit) = world.cast(origin, direction, FAR_M) else { return SKY_GREY };
            let at = [0, 1, 2].map(|k| origin[k] + hit.at * direction[k]);
            world
                .solids()
                .get(hit.solid)
                .map_or(SKY_GREY, |solid| texture::grey(pattern, (hit.solid, solid), at, hit.at / focal))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::Solid;

    #[test]
    fn the_right_camera_sees_a_wall_further_left_by_its_disparity() {
        let settings =
            StereoSettings { noise_grey: 0.0, right_gain: 1.0, right_offset_grey: 0.0, ..StereoSettings::default() };
        // 240 px * 0.12 m / 2.4 m: 12 pixels
        let world = SpaceWorld::new(vec![Solid::aligned([2.6, -9.0, -9.0], [3.0, 9.0, 9.0])]);
        let pair = StereoPair::new(settings);
        let [left, right] = pair.images(&world, Pose3::identity(), (1, 2), 0);
        let mut least = (u64::MAX, 0);
        for shift in 0..30 {
            let off = |y: usize, x: usize| u64::from(left[320 * y + x].abs_diff(right[320 * y + x - shift]));
            let sum = (0..240).flat_map(|y| (40..320).map(move |x| (y, x))).map(|(y, x)| off(y, x)).sum();
            least = least.min((sum, shift));
        }
        assert_eq!(least.1, 12);
        assert!(least.0 < 2 * 240 * 280, "{}", least.0);
        let again = pair.images(&world, Pose3::identity(), (1, 2), 0);
        assert_eq!(again, [left, right]);
    }

    #[test]
    fn noise_and_exposure_are_those_asked_for() {
        let world = SpaceWorld::new(Vec::new());
        let pair = StereoPair::new(StereoSettings::default());
        let [left, right] = pair.images(&world, Pose3::identity(), (1, 2), 5);
        let mean = |image: &[u8]| image.iter().map(|v| f64::from(*v)).sum::<f64>() / image.len() as f64;
        let square = left.iter().map(|v| (f64::from(*v) - mean(&left)).powi(2)).sum::<f64>() / left.len() as f64;
        assert!((mean(&left) - SKY_GREY).abs() < 0.1 && (mean(&right) - (0.9 * SKY_GREY + 4.0)).abs() < 0.1);
        // rounding adds a twelfth
        assert!((square - 4.083).abs() < 0.15, "{square}");
        assert_ne!(pair.images(&world, Pose3::identity(), (1, 2), 6)[0], left);
    }
}
