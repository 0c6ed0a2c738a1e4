//! Covariances carried along with poses.

use crate::pose::Pose;
use crate::tangent::TangentMatrix;

/// Covariance of `a_from_b * b_from_c` to first order, both given as right perturbations of independent poses.
///
/// `cov(a_from_c) = Ad(c_from_b) cov(a_from_b) Ad(c_from_b)^T + cov(b_from_c)` (Smith, Self, Cheeseman 1990, in the
/// right-perturbation form of Barfoot and Furgale 2014, eq. 40).
#[must_use]
#[inline]
pub fn compose_covariance<P: Pose>(cov_a_from_b: &P::Matrix, b_from_c: P, cov_b_from_c: &P::Matrix) -> P::Matrix {
    cov_a_from_b.carried_by(&b_from_c.inverse().adjoint()) + *cov_b_from_c
}

/// Covariance of `b_from_a` when `a_from_b` has `covariance`, both as right perturbations.
#[must_use]
#[inline]
pub fn inverse_covariance<P: Pose>(a_from_b: P, covariance: &P::Matrix) -> P::Matrix {
    covariance.carried_by(&a_from_b.adjoint())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tangent::{Cov3, Cov6, Tangent};
    use crate::{Pose2, Pose3};
    use proptest::prelude::*;

    fn diagonal<P: Pose>(entries: &[f64]) -> P::Matrix {
        P::Matrix::from_fn(|row, column| if row == column { entries[row] } else { 0.0 })
    }

    /// Against derivatives by differences.
    fn propagation<P: Pose>(a: &[f64], b: &[f64]) -> Result<(), TestCaseError> {
        let [a, b] = [a, b].map(|numbers| P::identity().retract(&P::Tangent::from_fn(|k| numbers[k])));
        let (cov_a, cov_b) = (
            diagonal::<P>(&[0.04, 0.01, 0.02, 0.03, 0.01, 0.02]),
            diagonal::<P>(&[0.01, 0.03, 0.005, 0.02, 0.01, 0.03]),
        );
        let derivative = |of: &dyn Fn(P) -> P| {
            let column = |k: usize| {
                let step = P::Tangent::from_fn(|row| if row == k { 1e-6 } else { 0.0 });
                of(a).local(of(a.retract(&step))) * 1e6
            };
            P::Matrix::from_fn(|row, k| column(k)[row])
        };
        let near = |expected: P::Matrix, got: P::Matrix| {
            (0..P::DIMENSION).all(|r| (0..P::DIMENSION).all(|c| (expected[(r, c)] - got[(r, c)]).abs() < 1e-6))
        };
        let composed = cov_a.carried_by(&derivative(&|a| a * b)) + cov_b;
        prop_assert!(near(composed, compose_covariance(&cov_a, b, &cov_b)));
        prop_assert!(near(cov_a.carried_by(&derivative(&P::inverse)), inverse_covariance(a, &cov_a)));
        Ok(())
    }

    fn variances<P: Pose>(turn: &[f64]) -> Result<(), TestCaseError> {
        // turned in space, a covariance is as large as before
        let pose = P::identity().turned([turn[0], turn[1], turn[2]]);
        let covariance = inverse_covariance(pose, &diagonal::<P>(&[0.04, 0.01, 0.02, 0.03, 0.05, 0.01]));
        let rotation = if P::TRANSLATION == 2 { 0.02 } else { 0.05 };
        prop_assert!((covariance.position_variance_m2() - 0.04).abs() < 1e-12);
        prop_assert!((covariance.rotation_variance_rad2() - rotation).abs() < 1e-12);
        let information = covariance.inverted();
        let tangent = P::Tangent::from_fn(|k| 0.1 * (k + 1) as f64);
        let seen = pose.inverse().adjoint() * tangent;
        let chi2: f64 = (0..P::DIMENSION)
            .map(|k| seen[k] * seen[k] / diagonal::<P>(&[0.04, 0.01, 0.02, 0.03, 0.05, 0.01])[(k, k)])
            .sum();
        prop_assert!(information.is_some_and(|information| (tangent.squared_by(&information) - chi2).abs() < 1e-9));
        Ok(())
    }

    proptest! {
        #[test]
        fn covariances_propagate_as_derivatives_say(
            a in prop::array::uniform6(-1.5..1.5f64), b in prop::array::uniform6(-1.5..1.5f64),
        ) {
            propagation::<Pose2>(&a, &b)?;
            propagation::<Pose3>(&a, &b)?;
        }

        #[test]
        fn largest_variances_do_not_depend_on_the_axes(turn in prop::array::uniform3(-3.0..3.0f64)) {
            variances::<Pose2>(&turn)?;
            variances::<Pose3>(&turn)?;
        }
    }

    #[test]
    fn nonsense_is_survived() {
        let broken = Cov6::from_fn(|_, _| f64::NAN);
        assert!(broken.position_variance_m2().is_nan() && broken.rotation_variance_rad2().is_nan());
        assert!(broken.inverted().is_none() && Cov3::zero().inverted().is_none() && !broken.is_finite());
        assert!((broken.fixed_view::<3, 3>(0, 0).into_owned() as Cov3).position_variance_m2().is_nan());
    }
}
