//! What the wheels report: the true motion with noise, a wrong scale and a drift of the heading.

use crate::math::{between, compose, rotate};
use crate::rng::Rng;
use crate::robot::Arc2;
use mapwright_geom::{Cov3, Pose2, sin_cos};

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
    /// How often the wheels slip, a metre. A slip lasts 0.1 to 0.6 m of way: the wheels spin and report up to two and a
    /// half times the way, or skid and miss up to all of it, and the robot is turned by some 2 degrees unnoticed.
    pub slips_per_m: f64,
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
        slips_per_m: 0.0,
    };

    /// The same with a slip every 50 m on average.
    #[must_use]
    pub fn with_slips(self) -> Self {
        Self { slips_per_m: 0.02, ..self }
    }

    /// The same with all sigmas multiplied by `factor`; slips stay as frequent as they are.
    #[must_use]
    pub fn times(&self, factor: f64) -> Self {
        let variance = factor * factor;
        Self {
            alpha1: self.alpha1 * variance,
            alpha2: self.alpha2 * variance,
            alpha3: self.alpha3 * variance,
            alpha4: self.alpha4 * variance,
            scale_sigma: self.scale_sigma * factor,
            turn_scale_sigma: self.turn_scale_sigma * factor,
            heading_bias_sigma_rad_per_m: self.heading_bias_sigma_rad_per_m * factor,
            slips_per_m: self.slips_per_m,
        }
    }

    /// Covariance of x, y and heading of the last reported pose in the frame of the first, to first order; scale, turn
    /// scale and heading bias are unknown constants of the robot. Slips are left out. The poses should be 0.5 to 1 m
    /// apart: nearer ones take noise for turns.
    #[must_use]
    pub fn covariance(&self, reported: impl IntoIterator<Item = Pose2>) -> Cov3 {
        let mut spread = Spread::default();
        let mut reported = reported.into_iter();
        let Some(first) = reported.next() else {
            return Cov3::zeros();
        };
        let mut before = Pose2::IDENTITY;
        for odom_from_robot in reported {
            let here = between(first, odom_from_robot);
            spread.step(self, before, between(before, here));
            before = here;
        }
        spread.covariance(self)
    }
}

/// A vector over x, y and heading.
type Column = [f64; 3];

/// First-order propagation of the noise along a reported path.
#[derive(Debug, Default)]
struct Spread {
    /// Covariance by the independent noise of the steps.
    random: [Column; 3],
    /// What a unit of scale, turn scale and heading bias does to the pose.
    systematic: [Column; 3],
}

impl Spread {
    fn step(&mut self, noise: &OdometryNoise, first_from_before: Pose2, step: Pose2) {
        let (trans_m, turn_rad) = ((step.x * step.x + step.y * step.y).sqrt().copysign(step.x), step.theta);
        let [dx, dy] = rotate([step.x, step.y], first_from_before.theta);
        self.carry(dx, dy);
        let (sin, cos) = sin_cos(first_from_before.theta + 0.5 * turn_rad);
        let (rot1, trans, rot2) = ([-trans_m * sin, trans_m * cos, 1.0], [cos, sin, 0.0], [0.0, 0.0, 1.0]);
        let rot_variance = noise.alpha1 * turn_rad.abs() / 2.0 + noise.alpha2 * trans_m.abs();
        let trans_variance = noise.alpha3 * trans_m.abs() + noise.alpha4 * turn_rad.abs();
        for (column, variance) in [(rot1, rot_variance), (trans, trans_variance), (rot2, rot_variance)] {
            add_outer(&mut self.random, column, variance);
        }
        for k in 0..3 {
            let per_turn = 0.5 * (rot1[k] + rot2[k]);
            self.systematic[0][k] += trans_m * trans[k];
            self.systematic[1][k] += turn_rad * per_turn;
            self.systematic[2][k] += trans_m * per_turn;
        }
    }

    /// An error of the heading before a step moves its end sideways.
    fn carry(&mut self, dx: f64, dy: f64) {
        let moved = |column: Column| [column[0] - dy * column[2], column[1] + dx * column[2], column[2]];
        self.systematic = self.systematic.map(moved);
        // F P F^T: the rows, then the columns.
        let rows = transposed(self.random.map(moved));
        self.random = rows.map(moved);
    }

    fn covariance(&self, noise: &OdometryNoise) -> Cov3 {
        let mut sum = self.random;
        let sigmas = [noise.scale_sigma, noise.turn_scale_sigma, noise.heading_bias_sigma_rad_per_m];
        for (column, sigma) in self.systematic.into_iter().zip(sigmas) {
            add_outer(&mut sum, column, sigma * sigma);
        }
        let [[a, b, c], [d, e, f], [g, h, i]] = sum;
        Cov3::new(a, b, c, d, e, f, g, h, i)
    }
}

fn transposed(m: [Column; 3]) -> [Column; 3] {
    [0, 1, 2].map(|k| [m[0][k], m[1][k], m[2][k]])
}

fn add_outer(sum: &mut [Column; 3], column: Column, variance: f64) {
    for row in 0..3 {
        for k in 0..3 {
            sum[row][k] += variance * column[row] * column[k];
        }
    }
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
            slips_per_m: 0.0,
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
    /// A stream of its own: the other noise is the same with slips and without.
    slip_rng: Rng,
    slip: Option<Slip>,
    odom_from_robot: Pose2,
}

/// A slip under way.
#[derive(Debug, Clone, Copy)]
struct Slip {
    left_m: f64,
    /// What the wheels report of each metre.
    reported_share: f64,
    /// What odometry misses of the heading, rad/m.
    turn_rad_per_m: f64,
}

impl Slip {
    fn draw(rng: &mut Rng) -> Self {
        let length_m = rng.uniform(0.1, 0.6);
        let spins = rng.chance(0.5);
        let reported_share = if spins { rng.uniform(1.3, 2.5) } else { rng.uniform(0.0, 0.7) };
        Self { left_m: length_m, reported_share, turn_rad_per_m: rng.normal(2f64.to_radians()) / length_m }
    }
}

impl Wheels {
    pub(crate) fn new(noise: OdometryNoise, seed: u64) -> Self {
        let mut rng = Rng::keyed(seed, 0x0077_6865_656c);
        let scale = 1.0 + rng.normal(noise.scale_sigma);
        let turn_scale = 1.0 + rng.normal(noise.turn_scale_sigma);
        let heading_bias_rad_per_m = rng.normal(noise.heading_bias_sigma_rad_per_m);
        let slip_rng = Rng::keyed(seed, 0x736c_6970);
        let odom_from_robot = Pose2::IDENTITY;
        Self { noise, rng, scale, turn_scale, heading_bias_rad_per_m, slip_rng, slip: None, odom_from_robot }
    }

    pub(crate) fn odom_from_robot(&self) -> Pose2 {
        self.odom_from_robot
    }

    /// Counts one more arc.
    pub(crate) fn count(&mut self, wheel_move: Arc2) {
        let Arc2 { distance_m: trans_m, turn_rad } = self.slipped(wheel_move);
        let rot_sigma = (self.noise.alpha1 * turn_rad.abs() / 2.0 + self.noise.alpha2 * trans_m.abs()).sqrt();
        let trans_sigma = (self.noise.alpha3 * trans_m.abs() + self.noise.alpha4 * turn_rad.abs()).sqrt();
        let half_rad = 0.5 * (self.turn_scale * turn_rad + self.heading_bias_rad_per_m * trans_m);
        let rot1 = half_rad + self.rng.normal(rot_sigma);
        let trans = self.scale * trans_m + self.rng.normal(trans_sigma);
        let rot2 = half_rad + self.rng.normal(rot_sigma);
        let [x, y] = rotate([trans, 0.0], rot1);
        self.odom_from_robot = compose(self.odom_from_robot, Pose2::new(x, y, rot1 + rot2));
    }

    /// What is left of an arc where the wheels slip.
    fn slipped(&mut self, arc: Arc2) -> Arc2 {
        let driven_m = arc.distance_m.abs();
        if self.noise.slips_per_m <= 0.0 || driven_m == 0.0 {
            return arc;
        }
        if self.slip.is_none() && self.slip_rng.chance(self.noise.slips_per_m * driven_m) {
            self.slip = Some(Slip::draw(&mut self.slip_rng));
        }
        let Some(slip) = &mut self.slip else {
            return arc;
        };
        let Slip { reported_share, turn_rad_per_m, .. } = *slip;
        slip.left_m -= driven_m;
        if slip.left_m <= 0.0 {
            self.slip = None;
        }
        let turn_rad = arc.turn_rad + turn_rad_per_m * driven_m;
        Arc2 { distance_m: arc.distance_m * reported_share, turn_rad }
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

    #[test]
    fn slips_come_as_often_as_asked_and_change_nothing_else() {
        let arc = Arc2 { distance_m: 0.01, turn_rad: 0.0 };
        let end = |noise: OdometryNoise, seed: u64| {
            let mut wheels = Wheels::new(noise, seed);
            (0..10_000).for_each(|_| wheels.count(arc));
            wheels.odom_from_robot()
        };
        let slipping = |seed: u64| end(OdometryNoise::NONE.with_slips(), seed);
        let errors_m: Vec<f64> = (0..500).map(|seed| (slipping(seed).x - 100.0).abs()).collect();
        // Two slips in 100 m; e^-2 of the drives have none, and 1 % of those that have any end within a millimetre.
        let none = errors_m.iter().filter(|e| **e < 1e-3).count() as f64 / 500.0;
        assert!((none - (-2.0f64).exp()).abs() < 5.0 * 0.015 + 0.01, "{none}");
        assert_eq!(end(OdometryNoise::default(), 3), end(OdometryNoise::default(), 3));
        assert_ne!(slipping(3), slipping(4));
    }

    #[test]
    fn the_covariance_is_that_of_many_drives() {
        let noise = OdometryNoise::default().times(0.1);
        // A square of 10 m and one more side.
        let path = |noise: &OdometryNoise, seed: u64| {
            let mut wheels = Wheels::new(noise.clone(), seed);
            let mut poses = vec![Pose2::IDENTITY];
            for _ in 0..5 {
                for k in 0..600 {
                    let straight = Arc2 { distance_m: 0.02, turn_rad: 0.0 };
                    let corner = Arc2 { distance_m: 0.0, turn_rad: std::f64::consts::FRAC_PI_2 / 100.0 };
                    wheels.count(if k < 500 { straight } else { corner });
                    if k % 50 == 49 {
                        poses.push(wheels.odom_from_robot());
                    }
                }
            }
            poses
        };
        let expected = noise.covariance(path(&OdometryNoise::NONE, 0));
        let still = path(&OdometryNoise::NONE, 0)[60];
        let ends: Vec<Pose2> = (0..2_000).map(|seed| path(&noise, seed)[60]).collect();
        let errors = ends
            .iter()
            .map(|end| [end.x - still.x, end.y - still.y, mapwright_geom::wrap_angle(end.theta - still.theta)]);
        let mut found = [[0.0; 3]; 3];
        errors.for_each(|error| add_outer(&mut found, error, 1.0 / 2_000.0));
        for row in 0..3 {
            for k in 0..3 {
                let size = (expected[(row, row)] * expected[(k, k)]).sqrt();
                let off = (found[row][k] - expected[(row, k)]) / size;
                assert!(off.abs() < 0.16, "{row} {k}: {} instead of {}", found[row][k], expected[(row, k)]);
            }
        }
    }
}
