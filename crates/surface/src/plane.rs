//! Planes through points.

use nalgebra::{Matrix3, Vector3};

/// How many points lie somewhere, and how; in the coordinates of whoever keeps them.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Moments {
    pub(crate) count: f64,
    sum: [f64; 3],
    /// Of xx, yy, zz, xy, xz and yz.
    products: [f64; 6],
}

impl Moments {
    #[inline]
    pub(crate) fn add(&mut self, [x, y, z]: [f64; 3]) {
        self.count += 1.0;
        let products = [x * x, y * y, z * z, x * y, x * z, y * z];
        (0..3).for_each(|k| self.sum[k] += [x, y, z][k]);
        (0..6).for_each(|k| self.products[k] += products[k]);
    }

    /// Adds others, whose coordinates begin at `shift`.
    pub(crate) fn merge(&mut self, other: &Self, shift: [f64; 3]) {
        self.count += other.count;
        for (k, (a, b)) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].into_iter().enumerate() {
            let crossed = shift[a] * other.sum[b] + shift[b] * other.sum[a];
            self.products[k] += other.products[k] + crossed + other.count * shift[a] * shift[b];
        }
        (0..3).for_each(|k| self.sum[k] += other.sum[k] + other.count * shift[k]);
    }

    pub(crate) fn mean(&self) -> Vector3<f64> {
        Vector3::from(self.sum) / self.count.max(1.0)
    }

    fn covariance(&self) -> Matrix3<f64> {
        let (mean, n) = (self.mean(), self.count.max(1.0));
        let of = |k: usize, a: usize, b: usize| self.products[k] / n - mean[a] * mean[b];
        let (xx, yy, zz, xy, xz, yz) = (of(0, 0, 0), of(1, 1, 1), of(2, 2, 2), of(3, 0, 1), of(4, 0, 2), of(5, 1, 2));
        Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
    }

    /// The plane that they lie closest to; none where they have no direction.
    pub(crate) fn plane(&self) -> Option<Plane> {
        let (normal, variances) = flattest(&self.covariance())?;
        Some(Plane { mean: self.mean(), normal, variances })
    }
}

/// A plane through points.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plane {
    pub(crate) mean: Vector3<f64>,
    /// Of length one, either way.
    pub(crate) normal: Vector3<f64>,
    /// Across the plane, and along it where it is least.
    pub(crate) variances: [f64; 2],
}

/// Newton's steps to the smallest root; they double the digits.
const STEPS: usize = 24;

/// The axis along which a covariance is least, and its two smaller variances.
///
/// Newton's method from 0 on the characteristic polynomial, which rises and bends down up to its first root, so that no step goes beyond it.
fn flattest(covariance: &Matrix3<f64>) -> Option<(Vector3<f64>, [f64; 2])> {
    let m = covariance;
    let trace = m.trace();
    let minors = m.m11 * m.m22 - m.m12 * m.m12 + m.m11 * m.m33 - m.m13 * m.m13 + m.m22 * m.m33 - m.m23 * m.m23;
    let determinant = m.determinant().max(0.0);
    let mut least = 0.0;
    for _ in 0..STEPS {
        let value = ((least - trace) * least + minors) * least - determinant;
        let slope = (3.0 * least - 2.0 * trace) * least + minors;
        let next = least - value / slope;
        if !(next > least && slope > 0.0) {
            break;
        }
        least = next;
    }
    let (half, product) = (0.5 * (trace - least), minors - least * (trace - least));
    let middle = half - (half * half - product).max(0.0).sqrt();
    let shifted = m - Matrix3::identity() * least;
    let column = |k: usize| shifted.column(k).into_owned();
    let across = [column(0).cross(&column(1)), column(0).cross(&column(2)), column(1).cross(&column(2))];
    let longest = across.into_iter().max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()))?;
    let normal = longest / longest.norm();
    normal.iter().all(|v| v.is_finite()).then_some((normal, [least, middle]))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

    use super::*;
    use nalgebra::{SymmetricEigen, UnitQuaternion};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_axis_is_that_of_an_eigensolver(axis in prop::array::uniform3(-3.0..3.0f64), s in prop::array::uniform3(0.01..2.0f64)) {
            prop_assume!({ let mut s = s; s.sort_by(f64::total_cmp); s[1] > 1.3 * s[0] });
            let turn = UnitQuaternion::from_scaled_axis(Vector3::from(axis)).to_rotation_matrix();
            let covariance = turn * Matrix3::from_diagonal(&Vector3::from(s)) * turn.transpose();
            let (normal, variances) = flattest(&covariance).unwrap();
            let eigen = SymmetricEigen::new(covariance);
            let mut order = [0, 1, 2];
            order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
            prop_assert!((variances[0] - eigen.eigenvalues[order[0]]).abs() < 1e-6);
            prop_assert!((variances[1] - eigen.eigenvalues[order[1]]).abs() < 1e-6);
            prop_assert!(normal.dot(&eigen.eigenvectors.column(order[0])).abs() > 1.0 - 1e-6);
        }

        #[test]
        fn merging_is_adding(points in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 4..20), shift in prop::array::uniform3(-2.0..2.0f64)) {
            let (mut apart, mut together, mut merged) = (Moments::default(), Moments::default(), Moments::default());
            for &point in &points {
                apart.add(point);
                together.add([0, 1, 2].map(|k| point[k] + shift[k]));
            }
            merged.merge(&apart, shift);
            prop_assert!((merged.covariance() - together.covariance()).norm() < 1e-9);
            prop_assert!((merged.mean() - together.mean()).norm() < 1e-9);
        }
    }

    #[test]
    fn one_place_has_no_plane() {
        let mut moments = Moments::default();
        (0..9).for_each(|_| moments.add([1.0, 2.0, 3.0]));
        assert!(moments.plane().is_none());
    }
}
