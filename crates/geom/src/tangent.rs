//! Tangents of poses, their covariances and information, and how covariances propagate.

use crate::pose::{Pose, sealed::Sealed};
use nalgebra::{Matrix3, Matrix6, SMatrix, SVector};
use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, Index, IndexMut, Mul, Neg, Sub};

/// Covariance of a plane pose's tangent `(x, y, theta)` in m^2, m rad, rad^2.
pub type Cov3 = Matrix3<f64>;
/// Covariance of a space pose's tangent, translation then rotation vector, in m^2, m rad, rad^2.
pub type Cov6 = Matrix6<f64>;

/// A tangent: metres, then radians.
pub trait Tangent:
    Copy
    + Debug
    + PartialEq
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Neg<Output = Self>
    + Mul<f64, Output = Self>
    + Index<usize, Output = f64>
    + IndexMut<usize>
    + Sealed
    + 'static
{
    /// The matrices that belong to it.
    type Matrix: TangentMatrix<Tangent = Self>;

    /// The tangent with these components.
    #[must_use]
    fn from_fn(component: impl FnMut(usize) -> f64) -> Self;

    /// `self^T matrix self`: with an information a chi-square, with a covariance a variance.
    #[must_use]
    fn squared_by(&self, matrix: &Self::Matrix) -> f64;
}

/// A symmetric matrix over tangents: a covariance, an information, or an adjoint that carries them.
pub trait TangentMatrix:
    Copy
    + Debug
    + PartialEq
    + Send
    + Sync
    + Add<Output = Self>
    + AddAssign
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Mul<Self::Tangent, Output = Self::Tangent>
    + Mul<f64, Output = Self>
    + Div<f64, Output = Self>
    + Index<(usize, usize), Output = f64>
    + IndexMut<(usize, usize)>
    + Sealed
    + 'static
{
    /// Rows, and as many columns: 3 in the plane, 6 in space.
    const SIZE: usize;

    /// What it is multiplied with.
    type Tangent;

    /// The matrix with these entries, by row and column.
    #[must_use]
    fn from_fn(entry: impl FnMut(usize, usize) -> f64) -> Self;

    /// Zero: the covariance of what is known for sure, the information of what says nothing.
    #[must_use]
    fn zero() -> Self {
        Self::from_fn(|_, _| 0.0)
    }

    /// Independent components, all of translation with one variance (m^2), all of rotation with the other (rad^2).
    #[must_use]
    fn from_variances(translation_m2: f64, rotation_rad2: f64) -> Self;

    /// Variance of the position in the direction in which it is least certain, m^2; NaN where an entry is not finite.
    #[must_use]
    fn position_variance_m2(&self) -> f64;

    /// Variance of the rotation about the axis about which it is least certain, rad^2: in the plane that of the heading;
    /// NaN where an entry is not finite.
    #[must_use]
    fn rotation_variance_rad2(&self) -> f64;

    /// The inverse; none where there is none or an entry is not finite.
    #[must_use]
    fn inverted(&self) -> Option<Self>;

    /// `jacobian self jacobian^T`: the covariance of what moves by the Jacobian where this is that of what moves.
    #[must_use]
    fn carried_by(&self, jacobian: &Self) -> Self;

    /// Whether every entry is finite.
    #[must_use]
    fn is_finite(&self) -> bool;
}

impl Sealed for SVector<f64, 3> {}
impl Sealed for SVector<f64, 6> {}
impl Sealed for SMatrix<f64, 3, 3> {}
impl Sealed for SMatrix<f64, 6, 6> {}

/// What both sizes share, but for their blocks.
macro_rules! tangent_matrix {
    ($size:literal, $translation:literal, $position:item, $rotation:item) => {
        impl Tangent for SVector<f64, $size> {
            type Matrix = SMatrix<f64, $size, $size>;

            #[inline]
            fn from_fn(mut component: impl FnMut(usize) -> f64) -> Self {
                Self::from_fn(|row, _| component(row))
            }

            #[inline]
            fn squared_by(&self, matrix: &Self::Matrix) -> f64 {
                self.dot(&(matrix * self))
            }
        }

        impl TangentMatrix for SMatrix<f64, $size, $size> {
            const SIZE: usize = $size;

            type Tangent = SVector<f64, $size>;

            #[inline]
            fn from_fn(entry: impl FnMut(usize, usize) -> f64) -> Self {
                Self::from_fn(entry)
            }

            fn from_variances(translation_m2: f64, rotation_rad2: f64) -> Self {
                let variance = |k| if k < $translation { translation_m2 } else { rotation_rad2 };
                Self::from_fn(|row, column| if row == column { variance(row) } else { 0.0 })
            }

            $position

            $rotation

            fn inverted(&self) -> Option<Self> {
                self.try_inverse().filter(TangentMatrix::is_finite)
            }

            #[inline]
            fn carried_by(&self, jacobian: &Self) -> Self {
                jacobian * self * jacobian.transpose()
            }

            fn is_finite(&self) -> bool {
                self.iter().all(|v| v.is_finite())
            }
        }
    };
}

tangent_matrix!(
    3,
    2,
    #[inline]
    fn position_variance_m2(&self) -> f64 {
        let position = self.fixed_view::<2, 2>(0, 0);
        if position.iter().all(|v| v.is_finite()) { position.symmetric_eigenvalues().max() } else { f64::NAN }
    },
    #[inline]
    fn rotation_variance_rad2(&self) -> f64 {
        self[(2, 2)]
    }
);

tangent_matrix!(
    6,
    3,
    fn position_variance_m2(&self) -> f64 {
        largest_eigenvalue(&self.fixed_view::<3, 3>(0, 0).into_owned())
    },
    fn rotation_variance_rad2(&self) -> f64 {
        largest_eigenvalue(&self.fixed_view::<3, 3>(3, 3).into_owned())
    }
);

/// Of a symmetric matrix; NaN where an entry is not finite.
fn largest_eigenvalue(matrix: &Matrix3<f64>) -> f64 {
    if matrix.iter().all(|v| v.is_finite()) { matrix.symmetric_eigenvalues().max() } else { f64::NAN }
}

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
