//! What the solver needs to know about poses beside [`Pose`], for the plane and for space.

use crate::gravity;
use mapwright_geom::{Pose, Pose2, Pose3, skew, wrap_angle};
use nalgebra::{Matrix2, Matrix3, Rotation3, SMatrix, SVector, UnitQuaternion, Vector3};

/// How the rotation of an error in space is measured, and hence what its information means; the plane has one way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RotationError {
    /// By twice the vector part of the quaternion with positive real part. With information over half angles in the
    /// file this is the chi-square that g2o prints.
    #[default]
    QuaternionVector,
    /// By the rotation vector, the file's information being over angles: how GTSAM reads such files.
    RotationVector,
}

/// Poses with tangents of `D` components, and how their errors are measured and linearised.
pub(crate) trait PoseGroup<const D: usize>:
    Pose<Tangent = SVector<f64, D>, Matrix = SMatrix<f64, D, D>>
{
    /// Coordinates of an error pose in which chi-square is measured, to first order its tangent.
    #[must_use]
    fn coordinates(self, metric: RotationError) -> SVector<f64, D>;

    /// Derivative of the coordinates by a right perturbation.
    #[must_use]
    fn coordinates_jacobian(self, metric: RotationError) -> SMatrix<f64, D, D>;

    /// Coordinates of the error `self * first.inverse() * second` of a measurement that is the inverse of this pose.
    #[inline]
    #[must_use]
    fn error_between(self, first: Self, second: Self, metric: RotationError) -> SVector<f64, D> {
        (self * (first.inverse() * second)).coordinates(metric)
    }

    /// The same, its derivative by a right perturbation of `second`, and the adjoint of `second.inverse() * first`.
    #[inline]
    #[must_use]
    fn linear_error_between(
        self,
        first: Self,
        second: Self,
        metric: RotationError,
    ) -> (SVector<f64, D>, SMatrix<f64, D, D>, SMatrix<f64, D, D>) {
        let first_from_second = first.inverse() * second;
        let error = self * first_from_second;
        (error.coordinates(metric), error.coordinates_jacobian(metric), first_from_second.inverse().adjoint())
    }

    /// Error of a measured downward direction and its derivative by a right perturbation; none in the plane.
    #[must_use]
    fn tilt(self, down: &Vector3<f64>) -> Option<(Vector3<f64>, SMatrix<f64, 3, D>)>;

    /// How far position and heading are from where they are held, in standard deviations, and the derivative; none in the plane.
    #[must_use]
    fn held(self, at: Self) -> Option<(SVector<f64, 4>, SMatrix<f64, 4, D>)>;

    /// Rotation and translation in space; the plane is that of x and y.
    #[must_use]
    fn parts(self) -> (Matrix3<f64>, Vector3<f64>);

    /// The pose with the rotation nearest to a matrix; none where no rotation is nearest.
    #[must_use]
    fn from_parts(rotation: &Matrix3<f64>, translation: Vector3<f64>) -> Option<Self>;
}

impl PoseGroup<3> for Pose2 {
    fn coordinates(self, _: RotationError) -> SVector<f64, 3> {
        SVector::<f64, 3>::new(self.x, self.y, wrap_angle(self.theta))
    }

    fn coordinates_jacobian(self, _: RotationError) -> SMatrix<f64, 3, 3> {
        let (s, c) = self.theta.sin_cos();
        Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
    }

    #[inline]
    fn error_between(self, first: Self, second: Self, _: RotationError) -> SVector<f64, 3> {
        (self * first.between(second)).to_vector()
    }

    /// As the group's definition, with one sine for each of the three angles.
    #[inline]
    fn linear_error_between(
        self,
        first: Self,
        second: Self,
        _: RotationError,
    ) -> (SVector<f64, 3>, SMatrix<f64, 3, 3>, SMatrix<f64, 3, 3>) {
        let (sine, cosine) = first.theta.sin_cos();
        let (dx, dy) = (second.x - first.x, second.y - first.y);
        let (x, y) = (cosine * dx + sine * dy, cosine * dy - sine * dx);
        let turn = wrap_angle(second.theta - first.theta);
        let ((s, c), (own_s, own_c)) = (turn.sin_cos(), self.theta.sin_cos());
        let error =
            Vector3::new(self.x + own_c * x - own_s * y, self.y + own_s * x + own_c * y, wrap_angle(self.theta + turn));
        let (error_s, error_c) = (own_s * c + own_c * s, own_c * c - own_s * s);
        let jacobian = Matrix3::new(error_c, -error_s, 0.0, error_s, error_c, 0.0, 0.0, 0.0, 1.0);
        let adjoint = Matrix3::new(c, s, s * x - c * y, -s, c, c * x + s * y, 0.0, 0.0, 1.0);
        (error, jacobian, adjoint)
    }

    fn tilt(self, _: &Vector3<f64>) -> Option<(Vector3<f64>, SMatrix<f64, 3, 3>)> {
        None
    }

    fn held(self, _: Self) -> Option<(SVector<f64, 4>, SMatrix<f64, 4, 3>)> {
        None
    }

    fn parts(self) -> (Matrix3<f64>, Vector3<f64>) {
        (self.coordinates_jacobian(RotationError::default()), Vector3::new(self.x, self.y, 0.0))
    }

    fn from_parts(rotation: &Matrix3<f64>, translation: Vector3<f64>) -> Option<Self> {
        let upper: Matrix2<f64> = rotation.fixed_view::<2, 2>(0, 0).into_owned();
        let (cosine, sine) = (upper.trace(), upper.m21 - upper.m12);
        let pose = Self::new(translation.x, translation.y, sine.atan2(cosine));
        (cosine.hypot(sine) > 1e-9 && pose.is_finite()).then_some(pose)
    }
}

impl PoseGroup<6> for Pose3 {
    fn coordinates(self, metric: RotationError) -> SVector<f64, 6> {
        let t = self.translation;
        let turn = match metric {
            RotationError::QuaternionVector => 2.0 * quaternion_parts(self).0,
            RotationError::RotationVector => self.rotation.scaled_axis(),
        };
        SVector::<f64, 6>::new(t.x, t.y, t.z, turn.x, turn.y, turn.z)
    }

    fn coordinates_jacobian(self, metric: RotationError) -> SMatrix<f64, 6, 6> {
        jacobian_at(self, &self.coordinates(metric), metric)
    }

    /// As the definition, with one arc tangent.
    #[inline]
    fn linear_error_between(
        self,
        first: Self,
        second: Self,
        metric: RotationError,
    ) -> (SVector<f64, 6>, SMatrix<f64, 6, 6>, SMatrix<f64, 6, 6>) {
        let first_from_second = first.inverse() * second;
        let error = self * first_from_second;
        let coordinates = error.coordinates(metric);
        (coordinates, jacobian_at(error, &coordinates, metric), first_from_second.inverse().adjoint())
    }

    fn tilt(self, down: &Vector3<f64>) -> Option<(Vector3<f64>, SMatrix<f64, 3, 6>)> {
        Some(gravity::tilt(self, down))
    }

    fn held(self, at: Self) -> Option<(SVector<f64, 4>, SMatrix<f64, 4, 6>)> {
        Some(gravity::held(self, at))
    }

    fn parts(self) -> (Matrix3<f64>, Vector3<f64>) {
        (*self.rotation.to_rotation_matrix().matrix(), self.translation)
    }

    fn from_parts(rotation: &Matrix3<f64>, translation: Vector3<f64>) -> Option<Self> {
        if !rotation.iter().chain(translation.iter()).all(|v| v.is_finite()) {
            return None;
        }
        let nearest = polar_rotation(rotation).or_else(|| nearest_rotation(rotation))?;
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(nearest));
        Some(Self { translation, rotation }).filter(|pose| pose.is_finite())
    }
}

/// Times that the polar iteration is repeated at most; what takes longer is nearly singular.
const POLAR_STEPS: usize = 12;

/// The orthogonal factor of a matrix with positive determinant, by Newton's iteration scaled with that (Higham 1986,
/// "Computing the polar decomposition", section 3); none for others and nearly singular ones.
fn polar_rotation(matrix: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let mut rotation = *matrix;
    for _ in 0..POLAR_STEPS {
        let (x, y, z) = (rotation.column(0), rotation.column(1), rotation.column(2));
        let cofactors = Matrix3::from_columns(&[y.cross(&z), z.cross(&x), x.cross(&y)]);
        let determinant = x.dot(&cofactors.column(0));
        if determinant.is_nan() || determinant <= 1e-9 * rotation.norm().powi(3) {
            return None;
        }
        let scale = determinant.cbrt().recip();
        let next = rotation * (0.5 * scale) + cofactors * (0.5 / (scale * determinant));
        let change = (next - rotation).norm_squared();
        rotation = next;
        // convergence is quadratic
        if change < 1e-18 {
            return Some(rotation);
        }
    }
    None
}

/// The nearest rotation by singular values.
fn nearest_rotation(matrix: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let svd = matrix.try_svd(true, true, 1e-12, 200)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    let sign = (u.determinant() * v_t.determinant()).signum();
    let smallest = svd.singular_values.imin();
    let mut signs = Vector3::repeat(1.0);
    signs[smallest] = sign;
    Some(u * Matrix3::from_diagonal(&signs) * v_t)
}

/// Derivative of the coordinates, which are known, by a right perturbation.
fn jacobian_at(pose: Pose3, coordinates: &SVector<f64, 6>, metric: RotationError) -> SMatrix<f64, 6, 6> {
    let (vector, real) = quaternion_parts(pose);
    let turn = match metric {
        RotationError::QuaternionVector => skew(&vector) + Matrix3::from_diagonal_element(real),
        RotationError::RotationVector => {
            inverse_right_jacobian(&coordinates.fixed_rows::<3>(3).into_owned(), real / vector.norm())
        }
    };
    let mut jacobian = SMatrix::<f64, 6, 6>::zeros();
    jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(pose.rotation.to_rotation_matrix().matrix());
    jacobian.fixed_view_mut::<3, 3>(3, 3).copy_from(&turn);
    jacobian
}

/// Derivative of the rotation vector by a right perturbation (Sola, Deray, Atchuthan 2018, eq. 144), given the cotangent
/// of half its angle.
fn inverse_right_jacobian(turn: &Vector3<f64>, half_cotangent: f64) -> Matrix3<f64> {
    let angle2 = turn.norm_squared();
    let k =
        if angle2 < 1e-6 { 1.0 / 12.0 + angle2 / 720.0 } else { (1.0 - 0.5 * angle2.sqrt() * half_cotangent) / angle2 };
    let cross = skew(turn);
    Matrix3::identity() + 0.5 * cross + k * cross * cross
}

/// Vector and real part of the rotation's quaternion with positive real part.
fn quaternion_parts(pose: Pose3) -> (Vector3<f64>, f64) {
    let (vector, real) = (pose.rotation.imag(), pose.rotation.w);
    if real < 0.0 { (-vector, -real) } else { (vector, real) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Derivative by central differences.
    fn numeric<P: PoseGroup<D>, const D: usize>(pose: P, metric: RotationError) -> SMatrix<f64, D, D> {
        let step = 1e-6;
        let mut jacobian = SMatrix::<f64, D, D>::zeros();
        for k in 0..D {
            let mut tangent = SVector::<f64, D>::zeros();
            tangent[k] = step;
            let difference = pose.retract(&tangent).coordinates(metric) - pose.retract(&-tangent).coordinates(metric);
            jacobian.set_column(k, &(difference / (2.0 * step)));
        }
        jacobian
    }

    proptest! {
        #[test]
        fn jacobians_are_the_derivatives(t in prop::array::uniform6(-1.5..1.5f64)) {
            let (space, plane) = (Pose3::exp(t.into()), Pose2::new(t[0], t[1], t[2]));
            for metric in [RotationError::QuaternionVector, RotationError::RotationVector] {
                prop_assert!((space.coordinates_jacobian(metric) - numeric(space, metric)).norm() < 1e-8);
                prop_assert!((plane.coordinates_jacobian(metric) - numeric(plane, metric)).norm() < 1e-8);
            }
        }

        #[test]
        fn errors_of_the_plane_follow_the_definition(t in prop::array::uniform9(-4.0..4.0f64)) {
            let [measured, first, second] = [0, 3, 6].map(|k| Pose2::new(t[k], t[k + 1], t[k + 2]));
            let metric = RotationError::default();
            let between = first.inverse() * second;
            let error = measured * between;
            let found = measured.linear_error_between(first, second, metric);
            let difference = found.0 - error.to_vector();
            prop_assert!(difference.xy().norm() + wrap_angle(difference.z).abs() < 1e-12);
            prop_assert!((found.1 - error.coordinates_jacobian(metric)).norm() < 1e-12);
            prop_assert!((found.2 - between.inverse().adjoint()).norm() < 1e-12);
            let difference = found.0 - measured.error_between(first, second, metric);
            prop_assert!(difference.xy().norm() + wrap_angle(difference.z).abs() < 1e-12);
        }

        #[test]
        fn parts_make_the_pose(t in prop::array::uniform6(-1.5..1.5f64), scale in 0.1..10.0f64) {
            let space = Pose3::exp(t.into());
            let (rotation, translation) = space.parts();
            let again = Pose3::from_parts(&(rotation * scale), translation).unwrap();
            prop_assert!(space.between(again).coordinates(RotationError::default()).norm() < 1e-9);
            let plane = Pose2::new(t[0], t[1], t[2]);
            let (rotation, translation) = plane.parts();
            let again = Pose2::from_parts(&(rotation * scale), translation).unwrap();
            prop_assert!(plane.between(again).to_vector().norm() < 1e-9);
        }
    }
}
