//! The laser: rays into the world, and everything that spoils them.

use crate::math::{Point, add, compose, rotate};
use crate::rng::Rng;
use crate::shape::Circle;
use crate::world::Moment;
use mapwright_geom::{Pose2, sin_cos};
use mapwright_sensor::LaserModel;
use std::sync::Arc;

/// Ranges to whoever carries the robot, metres.
const COVERED_M: [f64; 2] = [0.1, 0.45];

/// A laser and its faults.
#[derive(Debug, Clone, PartialEq)]
pub struct LaserSettings {
    /// How it looks at the world. With a `beam_period_s`, beam `i` is taken from where the robot is at its time.
    pub model: Arc<LaserModel>,
    /// Beams a scan.
    pub beams: usize,
    /// Sigma of a range, metres.
    pub range_sigma_m: f64,
    /// Probability that a beam returns nothing.
    pub no_return_probability: f64,
    /// Probability that a beam returns anything from zero to the maximum range.
    pub random_reading_probability: f64,
    /// Ranges come in multiples of this, metres; zero for all ranges.
    pub quantum_m: f64,
    /// What is delivered where nothing returned, metres.
    pub no_return_reading_m: f64,
}

impl LaserSettings {
    /// Equally spaced beams over a field of view centred on the robot's x axis; 0.015 m noise and nothing else wrong.
    #[must_use]
    pub fn with_field_of_view(field_of_view_rad: f64, beams: usize) -> Self {
        let full_turn = field_of_view_rad > std::f64::consts::TAU - 1e-6;
        let steps = if full_turn { beams } else { beams.saturating_sub(1) };
        let model = LaserModel {
            name: "simulated".to_owned(),
            angle_min_rad: -0.5 * field_of_view_rad,
            angle_step_rad: field_of_view_rad / steps.max(1) as f64,
            range_min_m: 0.02,
            range_max_m: 30.0,
            robot_from_laser: Pose2::IDENTITY,
            inverted: false,
            beam_period_s: 0.0,
        };
        Self {
            model: Arc::new(model),
            beams,
            range_sigma_m: 0.015,
            no_return_probability: 0.0,
            random_reading_probability: 0.0,
            quantum_m: 0.0,
            no_return_reading_m: 81.83,
        }
    }
}

impl Default for LaserSettings {
    /// 180 beams over half a turn, as from a SICK LMS 200.
    fn default() -> Self {
        Self::with_field_of_view(std::f64::consts::PI, 180)
    }
}

/// A laser ready to sweep.
#[derive(Debug, Clone)]
pub(crate) struct Scanner {
    settings: LaserSettings,
    /// Directions of the beams in the laser's frame seen from above.
    directions: Vec<Point>,
}

impl Scanner {
    pub(crate) fn new(settings: LaserSettings) -> Self {
        let model = &settings.model;
        let sense = if model.inverted { -1.0 } else { 1.0 };
        let direction =
            |beam: usize| rotate([1.0, 0.0], sense * (model.angle_min_rad + beam as f64 * model.angle_step_rad));
        let directions = (0..settings.beams).map(direction).collect();
        Self { settings, directions }
    }

    pub(crate) fn model(&self) -> &Arc<LaserModel> {
        &self.settings.model
    }

    /// Time from the first to the last beam, seconds.
    pub(crate) fn sweep_s(&self) -> f64 {
        self.settings.model.beam_period_s.max(0.0) * self.settings.beams.saturating_sub(1) as f64
    }

    pub(crate) fn world_from_laser(&self, world_from_robot: Pose2) -> Pose2 {
        compose(world_from_robot, self.settings.model.robot_from_laser)
    }

    /// A person at a bearing and distance from the laser.
    pub(crate) fn person(&self, world_from_laser: Pose2, bearing_rad: f64, distance_m: f64, radius_m: f64) -> Circle {
        let away = rotate([distance_m, 0.0], world_from_laser.theta + bearing_rad);
        Circle { center: add([world_from_laser.x, world_from_laser.y], away), radius_m }
    }

    /// One sweep; `world_from_robot_at` tells where the robot is so many seconds after the first beam.
    pub(crate) fn sweep(
        &self,
        moment: &Moment<'_>,
        world_from_robot_at: impl Fn(f64) -> Pose2,
        rng: &mut Rng,
    ) -> Vec<f32> {
        let period_s = self.settings.model.beam_period_s.max(0.0);
        let mut view = View::new(self.world_from_laser(world_from_robot_at(0.0)));
        let mut ranges_m = Vec::with_capacity(self.directions.len());
        for (beam, &direction) in self.directions.iter().enumerate() {
            if period_s > 0.0 {
                view = View::new(self.world_from_laser(world_from_robot_at(beam as f64 * period_s)));
            }
            ranges_m.push(self.reading(moment, &view, direction, rng) as f32);
        }
        ranges_m
    }

    /// A sweep with something right before the laser all around.
    pub(crate) fn covered(&self, rng: &mut Rng) -> Vec<f32> {
        let reading = |_: &Point| rng.uniform(COVERED_M[0], COVERED_M[1]) as f32;
        self.directions.iter().map(reading).collect()
    }

    fn reading(&self, moment: &Moment<'_>, view: &View, direction: Point, rng: &mut Rng) -> f64 {
        let s = &self.settings;
        let fate = rng.unit();
        if fate < s.no_return_probability {
            return s.no_return_reading_m;
        }
        let range_m = if fate < s.no_return_probability + s.random_reading_probability {
            rng.uniform(0.0, s.model.range_max_m)
        } else {
            (moment.cast(view.origin, view.turned(direction)) + rng.normal(s.range_sigma_m)).max(0.0)
        };
        let range_m = if s.quantum_m > 0.0 { (range_m / s.quantum_m).round() * s.quantum_m } else { range_m };
        if range_m < s.model.range_max_m { range_m } else { s.no_return_reading_m }
    }
}

/// Where rays start and how the laser is turned.
struct View {
    origin: Point,
    sin: f64,
    cos: f64,
}

impl View {
    fn new(world_from_laser: Pose2) -> Self {
        let (sin, cos) = sin_cos(world_from_laser.theta);
        Self { origin: [world_from_laser.x, world_from_laser.y], sin, cos }
    }

    fn turned(&self, direction: Point) -> Point {
        [self.cos * direction[0] - self.sin * direction[1], self.sin * direction[0] + self.cos * direction[1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::Segment;
    use crate::world::World;

    /// A wall 4 m ahead, one 2 m to the left, nothing else.
    fn sweep(settings: LaserSettings, seed: u64) -> Vec<f32> {
        let ahead = Segment { a: [4.0, -50.0], b: [4.0, 1.9] };
        let left = Segment { a: [-50.0, 2.0], b: [3.9, 2.0] };
        let world = World::new(vec![ahead, left], vec![]);
        let moment = world.at(0.0, [0.0; 2], settings.model.range_max_m + 1.0);
        Scanner::new(settings).sweep(&moment, |_| Pose2::IDENTITY, &mut Rng::new(seed))
    }

    fn three_beams(change: impl FnOnce(&mut LaserModel)) -> LaserSettings {
        let mut settings = LaserSettings::with_field_of_view(std::f64::consts::PI, 3);
        let mut model = (*settings.model).clone();
        change(&mut model);
        settings.model = Arc::new(model);
        settings.range_sigma_m = 0.0;
        settings
    }

    #[test]
    fn beams_run_counter_clockwise_and_the_other_way_upside_down() {
        assert_eq!(sweep(three_beams(|_| {}), 0), [81.83, 4.0, 2.0]);
        assert_eq!(sweep(three_beams(|m| m.inverted = true), 0), [2.0, 4.0, 81.83]);
        let offset = three_beams(|m| m.robot_from_laser = Pose2::new(1.0, 0.5, 0.0));
        assert_eq!(sweep(offset, 0), [81.83, 3.0, 1.5]);
    }

    #[test]
    fn noise_has_the_moments_asked_for() {
        let mut settings = three_beams(|m| (m.angle_min_rad, m.angle_step_rad) = (0.0, 0.0));
        settings.beams = 40_000;
        settings.range_sigma_m = 0.02;
        let errors: Vec<f64> = sweep(settings, 5).iter().map(|&r| f64::from(r) - 4.0).collect();
        let n = errors.len() as f64;
        let mean = errors.iter().sum::<f64>() / n;
        let sigma = (errors.iter().map(|e| e * e).sum::<f64>() / n).sqrt();
        assert!(mean.abs() < 5.0 * 0.02 / n.sqrt(), "{mean}");
        assert!((sigma / 0.02 - 1.0).abs() < 5.0 / (2.0 * n).sqrt(), "{sigma}");
    }

    #[test]
    fn faults_come_as_often_as_asked() {
        let mut settings = three_beams(|m| (m.angle_min_rad, m.angle_step_rad) = (0.0, 0.0));
        settings.beams = 40_000;
        settings.no_return_probability = 0.1;
        settings.random_reading_probability = 0.2;
        let ranges = sweep(settings, 5);
        let share = |test: fn(f32) -> bool| ranges.iter().filter(|&&r| test(r)).count() as f64 / 40_000.0;
        assert!((share(|r| r == 81.83) - 0.1).abs() < 0.008);
        assert!((share(|r| r != 81.83 && r != 4.0) - 0.2).abs() < 0.01);
    }

    #[test]
    fn ranges_come_in_multiples() {
        let mut settings = LaserSettings { quantum_m: 0.01, ..LaserSettings::default() };
        settings.range_sigma_m = 0.05;
        let ranges = sweep(settings, 9);
        assert!(ranges.iter().all(|&r| (f64::from(r) * 100.0 - (f64::from(r) * 100.0).round()).abs() < 1e-3));
    }
}
