//! The rotation between two sets of vectors.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Iterations after which a singular value decomposition is given up; a matrix of three by three takes some ten.
const ITERATIONS_MOST: usize = 1000;

/// The rotation that takes one set of vectors nearest to another, by least squares (Wahba's problem; Kabsch 1976, "A solution for the best
/// rotation to relate two sets of vectors").
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BestRotation {
    /// Takes the second set to the first.
    pub rotation: UnitQuaternion<f64>,
    /// Directions in which the first set and the second one have most in common, of length one: the rotation takes one to the other.
    pub principal: [Vector3<f64>; 2],
    /// What the sets have in common along that direction and along the second and third, falling, in the unit of the sum: where the second is
    /// nothing beside the first, all vectors lie on one line and the turn about it is anything.
    pub common: [f64; 3],
}

impl BestRotation {
    /// Of the sum over pairs of vectors `first * second^T`; none where that is not finite.
    #[must_use]
    pub fn of(across: &Matrix3<f64>) -> Option<Self> {
        if !across.iter().all(|v| v.is_finite()) {
            return None;
        }
        let parts = across.try_svd(true, true, 5.0 * f64::EPSILON, ITERATIONS_MOST)?;
        let (u, v_t) = (parts.u?, parts.v_t?);
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| parts.singular_values[b].total_cmp(&parts.singular_values[a]));
        let mut signs = Vector3::repeat(1.0);
        signs[order[2]] = (u * v_t).determinant().signum();
        let rotation = Rotation3::from_matrix_unchecked(u * Matrix3::from_diagonal(&signs) * v_t);
        Some(Self {
            rotation: UnitQuaternion::from_rotation_matrix(&rotation),
            principal: [u.column(order[0]).into_owned(), v_t.row(order[0]).transpose()],
            common: order.map(|k| parts.singular_values[k]),
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;

    fn across(vectors: &[[f64; 3]], rotation: UnitQuaternion<f64>) -> Matrix3<f64> {
        let of_one = |v: &[f64; 3]| (rotation * Vector3::from(*v)) * Vector3::from(*v).transpose();
        vectors.iter().map(of_one).sum()
    }

    #[test]
    fn two_directions_tell_a_rotation_and_one_tells_which_direction() {
        let rotation = UnitQuaternion::from_euler_angles(0.4, -1.1, 2.0);
        let found = BestRotation::of(&across(&[[1.0, 0.1, 0.0], [0.0, 0.5, 0.2]], rotation)).unwrap();
        assert!(found.rotation.angle_to(&rotation) < 1e-9 && found.common[1] > 0.1 * found.common[0], "{found:?}");
        let along = Vector3::new(0.6, 0.0, 0.8);
        let found = BestRotation::of(&across(&[along.into(), (-2.0 * along).into()], rotation)).unwrap();
        let [first, second] = found.principal;
        assert!(found.common[1] < 1e-9 && (rotation * second - first).norm() < 1e-9, "{found:?}");
        assert!(second.cross(&along).norm() < 1e-9);
    }

    #[test]
    fn what_is_not_finite_has_no_rotation() {
        assert_eq!(BestRotation::of(&Matrix3::repeat(f64::NAN)), None);
        assert!(BestRotation::of(&Matrix3::zeros()).is_some_and(|found| found.common == [0.0; 3]));
    }
}
