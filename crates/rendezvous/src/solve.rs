//! The most probable relative pose of a window, its covariance, and which sightings are none.

use crate::window::{Linearised, Noise, Window};
use mapwright_geom::{Cov3, Pose2};
use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Vector2, Vector3};
use std::f64::consts::TAU;

const ITERATIONS: usize = 12;
/// Steps below these end the iterations, metres and radians.
const SMALL_STEP: f64 = 1e-6;
/// Longest step in a direction: metres, metres, radians. What is known of one side bends over farther ones.
const LONGEST_STEP: [f64; 3] = [1.0, 1.0, 0.5];
/// A direction whose share of a sighting's redundancy is smaller says nothing.
const LEAST_REDUNDANCY: f64 = 1e-6;

/// Quantile of the normal distribution, standard deviations.
const ONE_IN_A_THOUSAND: f64 = 3.09;

/// How often sightings are of something else, and where those would lie.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Outliers {
    /// Share of sightings that are wrong.
    pub(crate) share: f64,
    /// Ranges of wrong ones are anywhere up to this, metres.
    pub(crate) range_m: f64,
}

/// A relative pose that explains the sightings.
#[derive(Debug, Clone)]
pub(crate) struct Mode {
    pub(crate) a_from_b: Pose2,
    pub(crate) covariance: Cov3,
    /// Window of the sightings that are believed.
    pub(crate) window: Window,
    /// Places in the pair's list of those that are not.
    pub(crate) refused: Vec<usize>,
    /// Logarithm of the mode's weight among all modes, nats.
    pub(crate) evidence: f64,
    pub(crate) chi2: f64,
    /// Measured numbers less the pose's three.
    pub(crate) freedom: usize,
}

impl Mode {
    /// Whether residuals are larger than one in a thousand right ones has them: Wilson and Hilferty's quantile of chi-square.
    pub(crate) fn is_inconsistent(&self) -> bool {
        let freedom = self.freedom as f64;
        let spread = 2.0 / (9.0 * freedom);
        self.freedom > 0 && self.chi2 > freedom * (1.0 - spread + ONE_IN_A_THOUSAND * spread.sqrt()).powi(3)
    }
}

/// Climbs from a start; none where the sightings leave a direction open.
pub(crate) fn climb(window: &Window, start: Pose2, noise: &Noise, outliers: &Outliers) -> Option<Mode> {
    let (mut window, mut refused, mut a_from_b) = (window.clone(), Vec::new(), start);
    let (mut of_refused, all) = (0.0, window.entries.len());
    while 2 * refused.len() <= all {
        let fit = fit(&window, a_from_b, noise)?;
        a_from_b = fit.a_from_b;
        let Some((worst, log_density)) = fit.worst(&window, outliers) else {
            let evidence = fit.evidence() + of_refused;
            let freedom = fit.linearised.rows.len().saturating_sub(3);
            let covariance = fit.covariance;
            return Some(Mode { a_from_b, covariance, window, refused, evidence, chi2: fit.chi2, freedom });
        };
        of_refused += log_density;
        refused.push(window.entries[worst].index);
        window = window.without(worst);
    }
    None // what most sightings contradict is no mode
}

struct Fit {
    a_from_b: Pose2,
    covariance: Cov3,
    linearised: Linearised,
    /// `C^-1` of the residuals.
    information: DMatrix<f64>,
    log_determinant: f64,
    chi2: f64,
}

/// Gauss-Newton steps; the covariance of the residuals follows the pose.
fn fit(window: &Window, start: Pose2, noise: &Noise) -> Option<Fit> {
    let mut a_from_b = start;
    for _ in 0..ITERATIONS {
        let weighed = Weighed::at(window, a_from_b, noise)?;
        let step = weighed.covariance * weighed.gradient;
        let shortened = (0..3).map(|k| step[k].abs() / LONGEST_STEP[k]).fold(1.0, f64::max);
        let step = step / shortened;
        a_from_b = a_from_b * Pose2::exp(step.into());
        if step.amax() < SMALL_STEP {
            break;
        }
    }
    let weighed = Weighed::at(window, a_from_b, noise)?;
    let residuals = weighed.linearised.residuals();
    let chi2 = residuals.dot(&(&weighed.information * &residuals));
    let Weighed { linearised, information, log_determinant, covariance, .. } = weighed;
    let is_sound = a_from_b.is_finite() && chi2.is_finite() && mapwright_geom::is_covariance(&covariance);
    is_sound.then_some(Fit { a_from_b, covariance, linearised, information, log_determinant, chi2 })
}

/// The normal equations at a pose.
struct Weighed {
    linearised: Linearised,
    information: DMatrix<f64>,
    log_determinant: f64,
    covariance: Matrix3<f64>,
    gradient: Vector3<f64>,
}

impl Weighed {
    fn at(window: &Window, a_from_b: Pose2, noise: &Noise) -> Option<Self> {
        let linearised = window.linearised(a_from_b);
        if linearised.rows.len() < 3 {
            return None;
        }
        let factor = window.covariance(&linearised, noise).cholesky()?;
        let log_determinant = 2.0 * factor.l_dirty().diagonal().iter().map(|v| v.ln()).sum::<f64>();
        let information = factor.inverse();
        let jacobian = linearised.jacobian();
        let weighed = jacobian.transpose() * &information;
        let normal: DMatrix<f64> = &weighed * &jacobian;
        let normal = Matrix3::from_fn(|row, column| 0.5 * (normal[(row, column)] + normal[(column, row)]));
        let gradient: DVector<f64> = &weighed * linearised.residuals();
        let covariance = normal.cholesky()?.inverse();
        Some(Self {
            linearised,
            information,
            log_determinant,
            covariance,
            gradient: Vector3::from_fn(|k, _| gradient[k]),
        })
    }
}

impl Fit {
    /// Laplace's approximation of the probability of all residuals under this mode.
    fn evidence(&self) -> f64 {
        let rows = self.linearised.rows.len() as f64;
        let spread = 0.5 * (self.covariance.determinant().ln() + 3.0 * TAU.ln());
        spread - 0.5 * (self.chi2 + self.log_determinant + rows * TAU.ln())
    }

    /// The sighting that is most surely none, given all others, and the logarithm of its density as such; none where all are likelier
    /// right than wrong.
    fn worst(&self, window: &Window, outliers: &Outliers) -> Option<(usize, f64)> {
        let jacobian = self.linearised.jacobian();
        let weighed = &self.information * &jacobian;
        // Redundancy: what residuals say once the pose is fitted.
        let redundancy = &self.information - &weighed * self.covariance * weighed.transpose();
        let pulled = &redundancy * self.linearised.residuals();
        let as_outlier = |entry: usize| {
            let odds = self.odds_of_outlier(entry, &redundancy, &pulled, outliers)?;
            Some((entry, odds))
        };
        let worst = (0..window.entries.len()).filter_map(as_outlier).max_by(|one, two| one.1.total_cmp(&two.1))?;
        let log_density = |entry: usize| {
            let kinds = self.linearised.rows.iter().filter(|row| row.entry == entry).map(|row| row.kind);
            outliers.share.ln() - kinds.map(|kind| outliers.extent(kind).ln()).sum::<f64>()
        };
        (worst.1 > 0.0).then(|| (worst.0, log_density(worst.0)))
    }

    /// Logarithm of the odds that a sighting is wrong, by how it lies to what the others predict; none where they predict nothing.
    fn odds_of_outlier(
        &self,
        entry: usize,
        redundancy: &DMatrix<f64>,
        pulled: &DVector<f64>,
        outliers: &Outliers,
    ) -> Option<f64> {
        let rows: Vec<usize> =
            (0..self.linearised.rows.len()).filter(|i| self.linearised.rows[*i].entry == entry).collect();
        // In units of the extent over which wrong ones lie; a missing one has redundancy 0.
        let unit = |k: usize| rows.get(k).map_or(0.0, |i| outliers.extent(self.linearised.rows[*i].kind));
        let of = |j: usize, k: usize| match (rows.get(j), rows.get(k)) {
            (Some(j_row), Some(k_row)) => redundancy[(*j_row, *k_row)] * unit(j) * unit(k),
            _ => 0.0,
        };
        let block = Matrix2::new(of(0, 0), of(0, 1), of(1, 0), of(1, 1));
        let pull = Vector2::from_fn(|k, _| rows.get(k).map_or(0.0, |i| pulled[*i] * unit(k)));
        let eigen = block.symmetric_eigen();
        let largest = eigen.eigenvalues.max();
        let mut odds = (outliers.share / (1.0 - outliers.share)).ln();
        let mut predicted = 0;
        for k in 0..2 {
            let information = eigen.eigenvalues[k];
            if information > LEAST_REDUNDANCY * largest && information > 1.0 {
                let along = eigen.eigenvectors.column(k).dot(&pull);
                odds += 0.5 * (along * along / information - information.ln() + TAU.ln());
                predicted += 1;
            }
        }
        (predicted > 0).then_some(odds)
    }
}

impl Outliers {
    /// Over what length or angle wrong measurements of a kind are spread.
    fn extent(&self, kind: usize) -> f64 {
        if kind == 0 { self.range_m } else { TAU }
    }
}
