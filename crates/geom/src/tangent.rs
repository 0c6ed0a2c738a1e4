//! Tangents of poses, their covariances and information, and how covariances propagate.

use crate::sealed::Sealed;
use crate::stored::Stored;
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
    + Stored
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
