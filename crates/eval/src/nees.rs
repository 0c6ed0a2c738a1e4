//! Whether covariances are honest: the normalised estimation error squared.

use mapwright_geom::{Cov3, Pose2};
use statrs::function::gamma::checked_gamma_lr;

/// Degrees of freedom of a pose in the plane.
const DOF: f64 = 3.0;

/// Accumulates `e^T P^-1 e` of pose errors `e` with covariance `P`.
///
/// An honest covariance gives samples that are chi-square distributed with three degrees of freedom, so that their mean
/// lies in [`Nees::mean_interval`] (Bar-Shalom, Li, Kirubarajan 2001, section 5.4). A mean above it says that the
/// covariance is too small, one below that it is too large.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Nees {
    /// Samples accumulated.
    pub count: usize,
    /// Samples left out: NaN, infinity or a covariance that is not positive definite.
    pub refused: usize,
    sum: f64,
}

impl Nees {
    /// Adds one estimate with the covariance of its right perturbation (m^2, m rad, rad^2); says whether it counted.
    pub fn add(&mut self, world_from_robot: Pose2, estimated_world_from_robot: Pose2, covariance: &Cov3) -> bool {
        self.add_error(estimated_world_from_robot.between(world_from_robot).log(), covariance)
    }

    /// Adds one error `(x, y, theta)` in metres and radians with its covariance, and says whether it counted.
    pub fn add_error(&mut self, error: [f64; 3], covariance: &Cov3) -> bool {
        let sample = normalised_squared(error, covariance);
        match sample {
            Some(sample) => {
                self.sum += sample;
                self.count += 1;
            }
            None => self.refused += 1,
        }
        sample.is_some()
    }

    /// Mean of the samples; expected is 3.
    #[must_use]
    pub fn mean(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / self.count as f64)
    }

    /// The interval in which the mean of this many samples lies with probability `confidence` when covariances are
    /// honest and errors independent. None without samples, or for a confidence outside of (0, 1).
    #[must_use]
    pub fn mean_interval(&self, confidence: f64) -> Option<(f64, f64)> {
        let n = self.count as f64;
        let tail = 0.5 * (1.0 - confidence);
        Some((chi_square_quantile(tail, DOF * n)? / n, chi_square_quantile(1.0 - tail, DOF * n)? / n))
    }

    /// Whether the mean lies in [`Nees::mean_interval`]; false without samples.
    #[must_use]
    pub fn is_consistent(&self, confidence: f64) -> bool {
        self.mean().zip(self.mean_interval(confidence)).is_some_and(|(mean, (low, high))| (low..=high).contains(&mean))
    }
}

/// `e^T P^-1 e` through Cholesky's factor `P = L L^T`, as the square of `L^-1 e`.
fn normalised_squared([x, y, theta]: [f64; 3], covariance: &Cov3) -> Option<f64> {
    let l11 = positive_root(covariance[(0, 0)])?;
    let (l21, l31) = (covariance[(1, 0)] / l11, covariance[(2, 0)] / l11);
    let l22 = positive_root(covariance[(1, 1)] - l21 * l21)?;
    let l32 = (covariance[(2, 1)] - l31 * l21) / l22;
    let l33 = positive_root(covariance[(2, 2)] - l31 * l31 - l32 * l32)?;
    let a = x / l11;
    let b = (y - l21 * a) / l22;
    let c = (theta - l31 * a - l32 * b) / l33;
    let sample = a * a + b * b + c * c;
    sample.is_finite().then_some(sample)
}

fn positive_root(pivot: f64) -> Option<f64> {
    (pivot > 0.0 && pivot.is_finite()).then(|| pivot.sqrt())
}

/// The value that a chi-square variable with `dof` degrees of freedom stays below with `probability`. None for a
/// probability outside of (0, 1) or for degrees of freedom that are not positive and finite.
///
/// Bisects the regularised incomplete gamma function: statrs 0.18 stops its own `inverse_cdf` 0.4 short at 300 degrees.
#[must_use]
pub fn chi_square_quantile(probability: f64, dof: f64) -> Option<f64> {
    let in_range = probability > 0.0 && probability < 1.0 && dof > 0.0 && dof.is_finite();
    let below = |value: f64| checked_gamma_lr(0.5 * dof, 0.5 * value).ok();
    let (mut low, mut high) = (0.0, in_range.then_some(dof)?);
    while below(high)? < probability {
        (low, high) = (high, 2.0 * high);
    }
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return Some(middle);
        }
        if below(middle)? < probability {
            low = middle;
        } else {
            high = middle;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_agree_with_scipy() {
        // scipy.stats.chi2.ppf(probability, dof)
        let expected = [
            (0.025, 3.0, 0.215_795_282_623_897_85),
            (0.5, 3.0, 2.365_973_884_375_337_7),
            (0.95, 3.0, 7.814_727_903_251_179),
            (0.95, 2.0, 5.991_464_547_107_979),
            (0.999, 1.0, 10.827_566_170_662_733),
            (0.025, 300.0, 253.912_322_602_489_75),
            (0.975, 300.0, 349.874_468_829_915_26),
            (0.005, 30_000.0, 29_372.810_251_636_794),
        ];
        for (probability, dof, value) in expected {
            let got = chi_square_quantile(probability, dof).unwrap();
            assert!((got - value).abs() < 1e-7 * value, "{probability} {dof}: {got} {value}");
        }
        assert_eq!(chi_square_quantile(0.0, 3.0), None);
        assert_eq!(chi_square_quantile(0.5, 0.0), None);
        assert_eq!(chi_square_quantile(0.5, f64::NAN), None);
    }

    #[test]
    fn a_hundred_samples_may_have_a_mean_from_2_54_to_3_50() {
        let hundred = Nees { count: 100, ..Nees::default() };
        let (low, high) = hundred.mean_interval(0.95).unwrap();
        assert!((low - 2.54).abs() < 0.005 && (high - 3.50).abs() < 0.005, "{low} {high}");
        assert_eq!(Nees::default().mean_interval(0.95), None);
    }

    #[test]
    fn a_correlated_covariance_is_inverted() {
        let covariance = Cov3::new(0.04, 0.01, 0.002, 0.01, 0.09, -0.003, 0.002, -0.003, 0.01);
        let error = [0.1, -0.2, 0.05];
        let inverse = covariance.try_inverse().unwrap();
        let mut expected = 0.0;
        for i in 0..3 {
            for j in 0..3 {
                expected += error[i] * inverse[(i, j)] * error[j];
            }
        }
        let mut nees = Nees::default();
        assert!(nees.add_error(error, &covariance));
        assert!((nees.mean().unwrap() - expected).abs() < 1e-12);
    }

    #[test]
    fn too_small_and_too_large_covariances_are_caught_and_broken_ones_counted() {
        let verdict = |claimed_variance: f64| {
            let mut nees = Nees::default();
            for k in 0..99 {
                let error = [[0.1, 0.0, 0.0], [0.0, -0.1, 0.0], [0.0, 0.0, 0.1]][k % 3].map(|e| e * 3.0f64.sqrt());
                nees.add(Pose2::exp(error), Pose2::IDENTITY, &Cov3::from_diagonal_element(claimed_variance));
            }
            nees
        };
        assert!(verdict(0.01).is_consistent(0.95));
        assert!(!verdict(0.005).is_consistent(0.95) && verdict(0.005).mean() > Some(3.0));
        assert!(!verdict(0.02).is_consistent(0.95) && verdict(0.02).mean() < Some(3.0));
        assert_eq!((verdict(-0.01).count, verdict(-0.01).refused), (0, 99));
    }
}
