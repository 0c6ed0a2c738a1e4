//! SE(3): rigid motions of space.

use nalgebra::{Matrix3, Matrix6, Quaternion, UnitQuaternion, Vector3, Vector6};
use std::ops::Mul;

/// A rigid motion of space; as `a_from_b` it is the pose of frame `b` seen from frame `a`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose3 {
    /// Metres along the axes of the outer frame.
    pub translation: Vector3<f64>,
    /// Takes directions of the inner frame to the outer one.
    pub rotation: UnitQuaternion<f64>,
}

impl Default for Pose3 {
    fn default() -> Self {
        Self::identity()
    }
}

impl Pose3 {
    /// The motion that moves nothing.
    #[must_use]
    pub fn identity() -> Self {
        Self { translation: Vector3::zeros(), rotation: UnitQuaternion::identity() }
    }

    /// The same height, roll and pitch at another place of the plane: of that x, y and heading.
    #[must_use]
    pub fn moved_in_plane(self, to: crate::Pose2) -> Self {
        let (roll, pitch, _) = self.rotation.euler_angles();
        Self {
            rotation: UnitQuaternion::from_euler_angles(roll, pitch, to.theta),
            translation: Vector3::new(to.x, to.y, self.translation.z),
        }
    }

    /// A pose from metres and the components of a quaternion, which is normalised; none where it has no direction.
    #[must_use]
    pub fn from_quaternion(translation: [f64; 3], [x, y, z, w]: [f64; 4]) -> Option<Self> {
        let quaternion = Quaternion::new(w, x, y, z);
        let norm = quaternion.norm();
        let rotation = UnitQuaternion::new_unchecked(quaternion / norm);
        (norm.is_finite() && norm > 1e-9).then(|| Self { translation: translation.into(), rotation })
    }

    /// `b_from_a` of `a_from_b`.
    #[must_use]
    pub fn inverse(self) -> Self {
        let rotation = self.rotation.inverse();
        Self { translation: -(rotation * self.translation), rotation }
    }

    /// `b_from_c` of `a_from_b` (self) and `a_from_c`: where the other is, seen from here.
    #[must_use]
    pub fn between(self, a_from_c: Self) -> Self {
        let inverse = self.rotation.inverse();
        Self {
            translation: inverse * (a_from_c.translation - self.translation),
            rotation: renormalised(inverse * a_from_c.rotation),
        }
    }

    /// A point of frame `b` in frame `a`, metres.
    #[must_use]
    pub fn transform(self, point_b: Vector3<f64>) -> Vector3<f64> {
        self.rotation * point_b + self.translation
    }

    /// The motion reached by moving with the constant twist (translation, then rotation) for unit time.
    #[must_use]
    pub fn exp(twist: Vector6<f64>) -> Self {
        let (velocity, omega) = (twist.fixed_rows::<3>(0), twist.fixed_rows::<3>(3).into_owned());
        let angle2 = omega.norm_squared();
        let (b, c) = if angle2 < 1e-6 {
            (0.5 - angle2 / 24.0, 1.0 / 6.0 - angle2 / 120.0)
        } else {
            let angle = angle2.sqrt();
            // 1 - cos as 2 sin^2 of the half keeps its digits for small angles
            let half_sin = (0.5 * angle).sin();
            (2.0 * half_sin * half_sin / angle2, (angle - angle.sin()) / (angle2 * angle))
        };
        let turned = omega.cross(&velocity);
        let translation = velocity + b * turned + c * omega.cross(&turned);
        Self { translation, rotation: UnitQuaternion::from_scaled_axis(omega) }
    }

    /// The twist whose [`Pose3::exp`] this is, with an angle in `[0, pi]`.
    #[must_use]
    pub fn log(self) -> Vector6<f64> {
        let omega = self.rotation.scaled_axis();
        let angle2 = omega.norm_squared();
        let k = if angle2 < 1e-6 {
            1.0 / 12.0 + angle2 / 720.0
        } else {
            let half = 0.5 * angle2.sqrt();
            (1.0 - half / half.tan()) / angle2
        };
        let turned = omega.cross(&self.translation);
        let velocity = self.translation - 0.5 * turned + k * omega.cross(&turned);
        Vector6::new(velocity.x, velocity.y, velocity.z, omega.x, omega.y, omega.z)
    }

    /// The adjoint: `self * exp(t) = exp(self.adjoint() * t) * self`.
    #[must_use]
    pub fn adjoint(self) -> Matrix6<f64> {
        let rotation = *self.rotation.to_rotation_matrix().matrix();
        let mut adjoint = Matrix6::zeros();
        adjoint.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
        adjoint.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);
        adjoint.fixed_view_mut::<3, 3>(0, 3).copy_from(&(skew(&self.translation) * rotation));
        adjoint
    }

    /// Distance of the two origins, metres.
    #[must_use]
    pub fn distance(self, other: Self) -> f64 {
        (self.translation - other.translation).norm()
    }

    /// Whether every component is finite.
    #[must_use]
    pub fn is_finite(self) -> bool {
        self.translation.iter().chain(self.rotation.coords.iter()).all(|v| v.is_finite())
    }
}

impl Mul for Pose3 {
    type Output = Self;

    fn mul(self, b_from_c: Self) -> Self {
        let translation = self.transform(b_from_c.translation);
        Self { translation, rotation: renormalised(self.rotation * b_from_c.rotation) }
    }
}

/// The matrix of the cross product with a vector.
#[must_use]
pub fn skew(v: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

/// Rounding adds up over long products.
fn renormalised(mut rotation: UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    rotation.renormalize_fast();
    rotation
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pose() -> impl Strategy<Value = Pose3> {
        (prop::array::uniform3(-50.0..50.0f64), prop::array::uniform3(-1.7..1.7f64)).prop_map(|(t, r)| Pose3 {
            translation: t.into(),
            rotation: UnitQuaternion::from_scaled_axis(Vector3::from(r)),
        })
    }

    fn close(a: Pose3, b: Pose3) -> bool {
        a.distance(b) < 1e-9 && a.rotation.angle_to(&b.rotation) < 1e-7
    }

    proptest! {
        #[test]
        fn group_laws(a in pose(), b in pose(), c in pose()) {
            prop_assert!(close((a * b) * c, a * (b * c)));
            prop_assert!(close(a * a.inverse(), Pose3::identity()));
            prop_assert!(close(a * a.between(b), b));
        }

        #[test]
        fn exp_and_log_are_inverse(a in pose(), tiny in prop::array::uniform6(-2e-3..2e-3f64)) {
            prop_assert!(close(Pose3::exp(a.log()), a));
            let tiny = Vector6::from(tiny);
            prop_assert!((Pose3::exp(tiny).log() - tiny).norm() < 1e-14);
        }

        #[test]
        fn a_twist_moves_evenly(t in prop::array::uniform6(-1.0..1.0f64)) {
            let half = Pose3::exp(0.5 * Vector6::from(t));
            prop_assert!(close(half * half, Pose3::exp(t.into())));
        }

        #[test]
        fn adjoint_moves_a_perturbation_across(a in pose(), t in prop::array::uniform6(-0.3..0.3f64)) {
            let t = Vector6::from(t);
            prop_assert!(close(a * Pose3::exp(t), Pose3::exp(a.adjoint() * t) * a));
        }

        #[test]
        fn in_the_plane_it_is_the_plane_motion(t in prop::array::uniform3(-2.0..2.0f64)) {
            let [x, y, yaw] = crate::Pose2::exp(t).to_vector().into();
            let space = Pose3::exp(Vector6::new(t[0], t[1], 0.0, 0.0, 0.0, t[2]));
            let planar = Pose3 {
                translation: Vector3::new(x, y, 0.0),
                rotation: UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.0, yaw)),
            };
            prop_assert!(close(space, planar));
        }
    }

    #[test]
    fn a_quaternion_without_direction_is_none() {
        assert!(Pose3::from_quaternion([0.0; 3], [0.0; 4]).is_none());
        assert!(Pose3::from_quaternion([0.0; 3], [f64::NAN; 4]).is_none());
        assert!(Pose3::from_quaternion([0.0; 3], [1e300; 4]).is_none());
        assert!(close(Pose3::from_quaternion([0.0; 3], [0.0, 0.0, 0.0, 2.0]).unwrap(), Pose3::identity()));
    }
}
