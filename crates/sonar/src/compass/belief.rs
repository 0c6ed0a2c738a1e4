//! What is believed of a heading, but for right angles: a histogram (*Probabilistic Robotics*, section 8.2).

use mapwright_geom::{sin_cos, wrap_angle};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Bins of half a degree.
const BINS: usize = 180;
const BIN_RAD: f64 = FRAC_PI_2 / BINS as f64;
/// What wheels get wrong is spread over so many standard deviations.
const REACH_SIGMAS: f64 = 3.0;

/// An angle without its right angles, between -45 and 45 degrees.
pub(super) fn wrap_right_angle(angle_rad: f64) -> f64 {
    0.25 * wrap_angle(4.0 * angle_rad)
}

/// Probabilities of the angles within a right angle; they sum to one.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Belief([f64; BINS]);

impl Default for Belief {
    /// Any angle.
    fn default() -> Self {
        Self([1.0 / BINS as f64; BINS])
    }
}

impl Belief {
    /// What the direction of a wall says of what a heading is off by: with probability `parallel` the wall is parallel to the building's,
    /// and else its direction is any.
    pub(super) fn of_wall(direction_rad: f64, sigma_rad: f64, parallel: f64) -> Self {
        let mut told = [0.0; BINS];
        for (bin, told) in told.iter_mut().enumerate() {
            let off_rad = wrap_right_angle((bin as f64 + 0.5) * BIN_RAD + direction_rad);
            *told = (-0.5 * (off_rad / sigma_rad).powi(2)).exp();
        }
        let total: f64 = told.iter().sum();
        Self(told.map(|value| parallel * value / total + (1.0 - parallel) / BINS as f64))
    }

    /// After wheels have erred by this standard deviation: the same forwards in time and backwards.
    pub(super) fn spread(&self, sigma_rad: f64) -> Self {
        let bins = sigma_rad / BIN_RAD;
        let reach = ((REACH_SIGMAS * bins).ceil() as usize).clamp(1, BINS / 2 - 1);
        let mut weights = [0.0; BINS / 2];
        if bins < 1.0 {
            // The variance of a step to either side with this probability.
            weights[0] = 1.0 - bins * bins;
            weights[1] = 0.5 * bins * bins;
        } else {
            weights
                .iter_mut()
                .take(reach + 1)
                .enumerate()
                .for_each(|(k, w)| *w = (-0.5 * (k as f64 / bins).powi(2)).exp());
        }
        let total = weights[0] + 2.0 * weights[1..].iter().sum::<f64>();
        let mut spread = [0.0; BINS];
        for (bin, mass) in self.0.iter().enumerate() {
            spread[bin] += mass * weights[0] / total;
            for (k, weight) in weights.iter().enumerate().take(reach + 1).skip(1) {
                let share = mass * weight / total;
                spread[(bin + k) % BINS] += share;
                spread[(bin + BINS - k) % BINS] += share;
            }
        }
        Self(spread)
    }

    /// By both.
    pub(super) fn with(&self, other: &Self) -> Self {
        let mut product = [0.0; BINS];
        product.iter_mut().zip(self.0.iter().zip(&other.0)).for_each(|(product, (a, b))| *product = a * b);
        let total: f64 = product.iter().sum();
        if total > 0.0 { Self(product.map(|value| value / total)) } else { Self::default() }
    }

    /// How likely the other is where this is believed.
    pub(super) fn likelihood(&self, other: &Self) -> f64 {
        self.0.iter().zip(&other.0).map(|(a, b)| a * b).sum()
    }

    /// The mean angle, between -45 and 45 degrees, and how much it is believed: 0 where any is as likely, 1 where no other is.
    pub(super) fn mean(&self) -> (f64, f64) {
        let (mut x, mut y) = (0.0, 0.0);
        for (bin, mass) in self.0.iter().enumerate() {
            let (sin, cos) = sin_cos(TAU * (bin as f64 + 0.5) / BINS as f64);
            x += mass * cos;
            y += mass * sin;
        }
        (0.25 * y.atan2(x), x.hypot(y))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walls_tell_an_angle_and_wheels_blur_it() {
        let told = Belief::of_wall(-0.3, 0.02, 0.9);
        let (mean_rad, sure) = told.mean();
        assert!((mean_rad - 0.3).abs() < 0.01 && sure > 0.85, "{mean_rad} {sure}");
        let turned = Belief::of_wall(-0.3 + FRAC_PI_2, 0.02, 0.9).mean().0;
        assert!((turned - 0.3).abs() < 0.01, "walls at right angles say the same: {turned}");
        for sigma_rad in [0.001, 0.05, 0.4] {
            let spread = told.spread(sigma_rad);
            let (kept_rad, less) = spread.mean();
            assert!((kept_rad - 0.3).abs() < 0.01 && less < sure, "{sigma_rad}: {kept_rad} {less}");
            assert!((spread.0.iter().sum::<f64>() - 1.0).abs() < 1e-9);
        }
        assert!(Belief::default().mean().1 < 1e-9);
    }

    #[test]
    fn the_same_direction_told_twice_outweighs_another() {
        let both = Belief::of_wall(0.1, 0.02, 0.4).with(&Belief::of_wall(0.1, 0.02, 0.4));
        let all = both.with(&Belief::of_wall(0.5, 0.02, 0.4));
        assert!((all.mean().0 + 0.1).abs() < 0.05, "{:?}", all.mean());
    }
}
