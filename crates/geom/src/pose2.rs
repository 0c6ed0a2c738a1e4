//! SE(2): rigid motions of the plane.

use crate::angle::wrap_angle;
use nalgebra::{Matrix3, Vector3};
use std::ops::Mul;

/// A rigid motion of the plane; as `a_from_b` it is the pose of frame `b` seen from frame `a`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pose2 {
    /// Metres along x of the outer frame.
    pub x: f64,
    /// Metres along y of the outer frame.
    pub y: f64,
    /// Heading in radians, in `(-pi, pi]`.
    pub theta: f64,
}

impl Pose2 {
    /// The motion that moves nothing.
    pub const IDENTITY: Self = Self { x: 0.0, y: 0.0, theta: 0.0 };

    /// A pose from metres and radians; the heading is wrapped.
    #[must_use]
    pub fn new(x: f64, y: f64, theta: f64) -> Self {
        Self { x, y, theta: wrap_angle(theta) }
    }

    /// `b_from_a` of `a_from_b`.
    #[must_use]
    pub fn inverse(self) -> Self {
        let (s, c) = self.theta.sin_cos();
        Self::new(-c * self.x - s * self.y, s * self.x - c * self.y, -self.theta)
    }

    /// `b_from_c` of `a_from_b` (self) and `a_from_c`: where the other is, seen from here.
    #[must_use]
    pub fn between(self, a_from_c: Self) -> Self {
        let (s, c) = self.theta.sin_cos();
        let (dx, dy) = (a_from_c.x - self.x, a_from_c.y - self.y);
        Self::new(c * dx + s * dy, -s * dx + c * dy, a_from_c.theta - self.theta)
    }

    /// A point of frame `b` in frame `a`, metres.
    #[must_use]
    pub fn transform(self, point_b: [f64; 2]) -> [f64; 2] {
        let (s, c) = self.theta.sin_cos();
        [self.x + c * point_b[0] - s * point_b[1], self.y + s * point_b[0] + c * point_b[1]]
    }

    /// The motion reached by moving with the constant twist `(vx, vy, omega)` for unit time.
    #[must_use]
    pub fn exp(twist: [f64; 3]) -> Self {
        let [vx, vy, w] = twist;
        let (a, b) = if w.abs() < 1e-5 {
            (1.0 - w * w / 6.0, w / 2.0 - w * w * w / 24.0)
        } else {
            (w.sin() / w, (1.0 - w.cos()) / w)
        };
        Self::new(a * vx - b * vy, b * vx + a * vy, w)
    }

    /// The twist whose [`Pose2::exp`] this is, with rotation in `(-pi, pi]`.
    #[must_use]
    pub fn log(self) -> [f64; 3] {
        let w = self.theta;
        let half = w / 2.0;
        let k = if w.abs() < 1e-5 { 1.0 - w * w / 12.0 } else { half / half.tan() };
        [k * self.x + half * self.y, -half * self.x + k * self.y, w]
    }

    /// Distance of the two origins, metres.
    #[must_use]
    pub fn distance(self, other: Self) -> f64 {
        (self.x - other.x).hypot(self.y - other.y)
    }

    /// Whether every component is finite.
    #[must_use]
    pub fn is_finite(self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.theta.is_finite()
    }

    /// The adjoint: `self * exp(t) = exp(self.adjoint() * t) * self`.
    #[must_use]
    pub fn adjoint(self) -> Matrix3<f64> {
        let (s, c) = self.theta.sin_cos();
        Matrix3::new(c, -s, self.y, s, c, -self.x, 0.0, 0.0, 1.0)
    }

    /// The components as a vector `(x, y, theta)`.
    #[must_use]
    pub fn to_vector(self) -> Vector3<f64> {
        Vector3::new(self.x, self.y, self.theta)
    }
}

impl Mul for Pose2 {
    type Output = Self;

    #[allow(clippy::suspicious_arithmetic_impl)] // headings of composed motions add
    fn mul(self, b_from_c: Self) -> Self {
        let [x, y] = self.transform([b_from_c.x, b_from_c.y]);
        Self::new(x, y, self.theta + b_from_c.theta)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pose() -> impl Strategy<Value = Pose2> {
        (-50.0..50.0f64, -50.0..50.0f64, -3.1..3.1f64).prop_map(|(x, y, t)| Pose2::new(x, y, t))
    }

    fn close(a: Pose2, b: Pose2) -> bool {
        a.distance(b) < 1e-9 && wrap_angle(a.theta - b.theta).abs() < 1e-9
    }

    proptest! {
        #[test]
        fn group_laws(a in pose(), b in pose(), c in pose()) {
            prop_assert!(close((a * b) * c, a * (b * c)));
            prop_assert!(close(a * a.inverse(), Pose2::IDENTITY));
            prop_assert!(close(a * a.between(b), b));
        }

        #[test]
        fn exp_and_log_are_inverse(a in pose(), tiny in -1e-6..1e-6f64) {
            prop_assert!(close(Pose2::exp(a.log()), a));
            let slow = Pose2::new(a.x, a.y, tiny);
            prop_assert!(close(Pose2::exp(slow.log()), slow));
        }

        #[test]
        fn adjoint_moves_a_perturbation_across(a in pose(), t in prop::array::uniform3(-0.3..0.3f64)) {
            let moved = a.adjoint() * Vector3::from(t);
            prop_assert!(close(a * Pose2::exp(t), Pose2::exp(moved.into()) * a));
        }
    }
}
