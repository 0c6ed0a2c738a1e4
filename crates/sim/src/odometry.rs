//! What the wheels report: the true motion with noise, a wrong scale and a drift of the heading.

use crate::math::compose;
use crate::math::rotate;
use crate::rng::Rng;
use crate::robot::Arc2;
use mapwright_geom::Pose2;

/// Noise of the wheels, after *Probabilistic Robotics* (2005), Table 5.6.
///
/// The table's variances, `alpha` times squared motions, hold for one step of motion and depend on how motion is cut
/// into steps. Here they hold for a motion of one metre or one radian and grow in proportion to the motion, so that
/// the same drive drifts alike at every rate.
#[derive(Debug, Clone, PartialEq)]
pub struct OdometryNoise {
    /// Variance of a rotation per radian turned, rad^2/rad (of each of the two rotations of a step).
    pub alpha1: f64,
    /// Variance of a rotation per metre driven, rad^2/m (of each of the two rotations of a step).
    pub alpha2: f64,
    /// Variance of the translation per metre driven, m^2/m.
    pub alpha3: f64,
    /// Variance of the translation per radian turned, m^2/rad.
    pub alpha4: f64,
    /// Sigma, over seeds, of the constant relative error of distances.
    pub scale_sigma: f64,
    /// Sigma, over seeds, of the constant relative error of turns.
    pub turn_scale_sigma: f64,
    /// Sigma, over seeds, of the constant drift of the heading, rad/m.
    pub heading_bias_sigma_rad_per_m: f64,
}

impl OdometryNoise {
    /// Perfect wheels.
    pub const NONE: Self = Self {
        alpha1: 0.0,
        alpha2: 0.0,
        alpha3: 0.0,
        alpha4: 0.0,
        scale_sigma: 0.0,
        turn_scale_sigma: 0.0,
        heading_bias_sigma_rad_per_m: 0.0,
    };
}

impl Default for OdometryNoise {
    /// An office robot: per metre 3 % and 2 degrees, per radian 3 degrees, 1.5 % scale, 0.5 degrees a metre of drift.
    fn default() -> Self {
        Self {
            alpha1: 2.7e-3,
            alpha2: 6.1e-4,
            alpha3: 9e-4,
            alpha4: 1e-5,
            scale_sigma: 0.015,
            turn_scale_sigma: 0.015,
            heading_bias_sigma_rad_per_m: 0.5f64.to_radians(),
        }
    }
}

/// The wheels of one robot.
#[derive(Debug, Clone)]
pub(crate) struct Wheels {
    noise: OdometryNoise,
    rng: Rng,
    scale: f64,
    turn_scale: f64,
    heading_bias_rad_per_m: f64,
    odom_from_robot: Pose2,
}

impl Wheels {
    pub(crate) fn new(noise: OdometryNoise, seed: u64) -> Self {
        let mut rng = Rng::keyed(seed, 0x0077_6865_656c);
        let scale = 1.0 + rng.normal(noise.scale_sigma);
        let turn_scale = 1.0 + rng.normal(noise.turn_scale_sigma);
        let heading_bias_rad_per_m = rng.normal(noise.heading_bias_sigma_rad_per_m);
        Self { noise, rng, scale, turn_scale, heading_bias_rad_per_m, odom_from_robot: Pose2::IDENTITY }
    }

    pub(crate) fn odom_from_robot(&self) -> Pose2 {
        self.odom_from_robot
    }

    /// Counts one more arc.
    pub(crate) fn count(&mut self, wheel_move: Arc2) {
        let (trans_m, turn_rad) = (wheel_move.distance_m, wheel_move.turn_rad);
        let rot_sigma = (self.noise.alpha1 * turn_rad.abs() / 2.0 + self.noise.alpha2 * trans_m.abs()).sqrt();
        let trans_sigma = (self.noise.alpha3 * trans_m.abs() + self.noise.alpha4 * turn_rad.abs()).sqrt();
        let half_rad = 0.5 * (self.turn_scale * turn_rad + self.heading_bias_rad_per_m * trans_m);
        let rot1 = half_rad + self.rng.normal(rot_sigma);
        let trans = self.scale * trans_m + self.rng.normal(trans_sigma);
        let rot2 = half_rad + self.rng.normal(rot_sigma);
        let [x, y] = rotate([trans, 0.0], rot1);
        self.odom_from_robot = compose(self.odom_from_robot, Pose2::new(x, y, rot1 + rot2));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean and variance over seeds of what is reported after `steps` equal arcs.
    fn moments(noise: &OdometryNoise, arc: Arc2, steps: usize, value: fn(Pose2) -> f64) -> (f64, f64) {
        let seeds = 4_000;
        let reported = |seed: u64| {
            let mut wheels = Wheels::new(noise.clone(), seed);
            (0..steps).for_each(|_| wheels.count(arc));
            value(wheels.odom_from_robot())
        };
        let values: Vec<f64> = (0..seeds).map(reported).collect();
        let mean = values.iter().sum::<f64>() / seeds as f64;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (seeds - 1) as f64;
        (mean, variance)
    }

    /// Five sigma of a sample variance, relative.
    const LOOSE: f64 = 5.0 * 0.0224;

    #[test]
    fn a_metre_has_the_noise_asked_for_at_every_step_length() {
        for steps in [1, 100] {
            let noise = OdometryNoise { alpha2: 0.0, alpha3: 9e-4, ..OdometryNoise::NONE };
            let arc = Arc2 { distance_m: 1.0 / steps as f64, turn_rad: 0.0 };
            let (mean, variance) = moments(&noise, arc, steps, |p| p.x);
            assert!((mean - 1.0).abs() < 5.0 * 0.03 / 4_000f64.sqrt());
            assert!((variance / 9e-4 - 1.0).abs() < LOOSE, "{variance}");
            let noise = OdometryNoise { alpha2: 6.1e-4, ..OdometryNoise::NONE };
            let (_, variance) = moments(&noise, arc, steps, |p| p.theta);
            assert!((variance / (2.0 * 6.1e-4) - 1.0).abs() < LOOSE, "{variance}");
        }
    }

    #[test]
    fn a_radian_has_the_noise_asked_for() {
        let noise = OdometryNoise { alpha1: 2.7e-3, ..OdometryNoise::NONE };
        let (mean, variance) = moments(&noise, Arc2 { distance_m: 0.0, turn_rad: 0.02 }, 50, |p| p.theta);
        assert!((mean - 1.0).abs() < 5.0 * 0.052 / 4_000f64.sqrt());
        assert!((variance / 2.7e-3 - 1.0).abs() < LOOSE, "{variance}");
    }

    #[test]
    fn systematic_errors_are_spread_over_seeds() {
        let noise = OdometryNoise { scale_sigma: 0.015, ..OdometryNoise::NONE };
        let arc = Arc2 { distance_m: 0.5, turn_rad: 0.0 };
        let (_, variance) = moments(&noise, arc, 20, |p| p.x);
        assert!((variance.sqrt() / 0.15 - 1.0).abs() < LOOSE);
        let noise = OdometryNoise { heading_bias_sigma_rad_per_m: 0.01, ..OdometryNoise::NONE };
        let (mean, variance) = moments(&noise, arc, 20, |p| p.theta);
        assert!(mean.abs() < 0.01 && (variance.sqrt() / 0.1 - 1.0).abs() < LOOSE);
    }
}
