//! How uneven floors tilt and lift a robot.

use crate::rng::Rng;
use mapwright_geom::sin_cos;
use std::f64::consts::TAU;

/// Waves that each motion is made of.
const WAVES: usize = 5;
/// Their lengths, metres of way.
const LENGTHS_M: [f64; 2] = [0.8, 6.0];

/// How far an uneven floor tilts and lifts the robot on its way; a robot that stands does not wobble.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wobble {
    /// Sigma of pitch and of roll, radians.
    pub tilt_sigma_rad: f64,
    /// Sigma of the height, metres.
    pub heave_sigma_m: f64,
}

impl Wobble {
    /// A floor as flat as a table.
    pub const NONE: Self = Self { tilt_sigma_rad: 0.0, heave_sigma_m: 0.0 };
}

impl Default for Wobble {
    /// Half a degree and 4 mm: lino and door sills.
    fn default() -> Self {
        Self { tilt_sigma_rad: 0.5f64.to_radians(), heave_sigma_m: 0.004 }
    }
}

/// A sum of waves over the way driven.
#[derive(Debug, Clone)]
pub(crate) struct Waves {
    amplitude: f64,
    /// Phases at the start and radians per metre.
    waves: [[f64; 2]; WAVES],
}

impl Waves {
    pub(crate) fn draw(sigma: f64, rng: &mut Rng) -> Self {
        let amplitude = sigma * (2.0 / WAVES as f64).sqrt();
        let waves = [(); WAVES].map(|()| [rng.uniform(0.0, TAU), TAU / rng.uniform(LENGTHS_M[0], LENGTHS_M[1])]);
        Self { amplitude, waves }
    }

    pub(crate) fn at(&self, driven_m: f64) -> f64 {
        self.amplitude * self.waves.iter().map(|[phase, per_m]| sin_cos(phase + per_m * driven_m).0).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waves_have_the_sigma_asked_for() {
        let waves = Waves::draw(0.02, &mut Rng::new(4));
        let values: Vec<f64> = (0..100_000).map(|k| waves.at(f64::from(k) * 0.05)).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let sigma = (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt();
        assert!(mean.abs() < 1e-3 && (sigma / 0.02 - 1.0).abs() < 0.1, "{mean} {sigma}");
    }
}
