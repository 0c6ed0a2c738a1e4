//! What the plane and space have in common: one trait for poses, one for the matrices over their tangents.
//!
//! Cycles are found, judged and corrected by code over [`Pose`], written once. It is sealed: [`Pose2`] is SE(2), [`Pose3`]
//! is SE(3), and there is no third.
//!
//! ```
//! use mapwright_geom::{Pose, TangentMatrix, compose_covariance};
//!
//! /// Pose and covariance after some steps, each with the same variances per metre and per radian.
//! fn dead_reckoning<P: Pose>(steps: &[P]) -> (P, P::Matrix) {
//!     steps.iter().fold((P::identity(), P::Matrix::zero()), |(world_from_a, covariance), a_from_b| {
//!         let noise = P::Matrix::from_variances(0.01 * a_from_b.length(), 0.001 * a_from_b.angle());
//!         (world_from_a * *a_from_b, compose_covariance(&covariance, *a_from_b, &noise))
//!     })
//! }
//!
//! let (world_from_robot, covariance) = dead_reckoning(&[mapwright_geom::Pose2::new(1.0, 0.0, 0.5); 4]);
//! assert!(world_from_robot.is_within_bounds() && covariance.position_variance_m2() > 0.04);
//! ```

use crate::angle::wrap_angle;
use crate::point::Point;
use crate::pose2::Pose2;
use crate::pose3::Pose3;
use crate::sealed::Sealed;
use crate::stored::Stored;
use crate::tangent::{Tangent, TangentMatrix};
use nalgebra::{UnitQuaternion, Vector3, Vector6};
use std::fmt::Debug;
use std::ops::Mul;

/// Poses beyond this are refused, metres along any axis.
pub const FARTHEST_M: f64 = 1e6;

/// A rigid motion; as `a_from_b` it is the pose of frame `b` seen from frame `a`.
///
/// Tangents are right perturbations, translation (metres) first, then rotation (radians). `a * b` composes.
pub trait Pose:
    Copy + Debug + PartialEq + Default + Send + Sync + Mul<Output = Self> + Stored + Sealed + 'static
{
    /// Components of a tangent: 3 in the plane, 6 in space.
    const DIMENSION: usize;
    /// How many of them are translation: 2 in the plane, 3 in space.
    const TRANSLATION: usize;
    /// Numbers that it is told by: x, y, heading in the plane; in space x, y, z and the quaternion's i, j, k, w.
    const NUMBERS: usize;

    /// A position, metres: `[f64; 2]` or `[f64; 3]`.
    type Point: Point;
    /// A small motion, metres and radians: a vector of 3 or 6 components.
    type Tangent: Tangent<Matrix = Self::Matrix>;
    /// Covariance or information of tangents: 3 by 3 or 6 by 6.
    type Matrix: TangentMatrix<Tangent = Self::Tangent>;

    /// The motion that moves nothing.
    #[must_use]
    fn identity() -> Self {
        Self::default()
    }

    /// `b_from_a` of `a_from_b`.
    #[must_use]
    fn inverse(self) -> Self;

    /// `b_from_c` of `a_from_b` (self) and `a_from_c`: where the other is, seen from here.
    #[must_use]
    fn between(self, a_from_c: Self) -> Self;

    /// `self * exp(tangent)`.
    #[must_use]
    fn retract(self, tangent: &Self::Tangent) -> Self;

    /// The tangent that leads to another pose: `self.retract(&self.local(other)) = other`. Rotation lies within half a turn.
    #[must_use]
    fn local(self, other: Self) -> Self::Tangent;

    /// `self * exp(t) = exp(self.adjoint() * t) * self`.
    #[must_use]
    fn adjoint(self) -> Self::Matrix;

    /// Distance of the two origins, metres.
    #[must_use]
    fn distance(self, other: Self) -> f64;

    /// Distance of the two frames' origins whose motion this is, metres.
    #[must_use]
    fn length(self) -> f64 {
        Self::default().distance(self)
    }

    /// By how much this turns, radians in `[0, pi]`.
    #[must_use]
    fn angle(self) -> f64;

    /// Where the origin of the inner frame is in the outer one, metres.
    #[must_use]
    fn position(self) -> Self::Point;

    /// The same in space, zero along z for the plane.
    #[must_use]
    fn translation(self) -> [f64; 3];

    /// A point of frame `b` in frame `a`, metres.
    #[must_use]
    fn transform_point(self, point_b: Self::Point) -> Self::Point;

    /// The same motion of space; that of the plane stays in the plane of x and y.
    #[must_use]
    fn in_space(self) -> Pose3;

    /// Whether every component is finite.
    #[must_use]
    fn is_finite(self) -> bool;

    /// Whether every component is finite and no coordinate is beyond [`FARTHEST_M`].
    #[must_use]
    fn is_within_bounds(self) -> bool {
        self.is_finite() && self.translation().iter().all(|v| v.abs() <= FARTHEST_M)
    }

    /// The rotation vector along the axes of the outer frame, radians, that [turns](Pose::turned) this orientation into
    /// that of another pose, by half a turn at most; in the plane along z.
    #[must_use]
    fn turn_to(self, other: Self) -> [f64; 3];

    /// Turned about its own origin by a rotation vector along the axes of the outer frame, radians; the plane heeds z alone.
    #[must_use]
    fn turned(self, outer_rad: [f64; 3]) -> Self;

    /// Moved along the axes of the outer frame, metres; the plane heeds x and y alone.
    #[must_use]
    fn moved(self, outer_m: [f64; 3]) -> Self;

    /// Does work that is written apart for the plane and for space; which of the two is known when this is compiled.
    fn apart<W: Apart>(work: W::Of<'_, Self>) -> W::Output<Self>;
}

/// Work that is not the same code in the plane and in space, or needs to know the number of components; done by
/// [`Pose::apart`].
pub trait Apart {
    /// What the work is done on.
    type Of<'a, P: Pose>;
    /// What comes out.
    type Output<P: Pose>;

    /// The work in the plane.
    fn plane(work: Self::Of<'_, Pose2>) -> Self::Output<Pose2>;

    /// The work in space.
    fn space(work: Self::Of<'_, Pose3>) -> Self::Output<Pose3>;
}

impl Pose for Pose2 {
    const DIMENSION: usize = 3;
    const TRANSLATION: usize = 2;
    const NUMBERS: usize = 3;

    type Point = [f64; 2];
    type Tangent = Vector3<f64>;
    type Matrix = crate::Cov3;

    #[inline]
    fn inverse(self) -> Self {
        self.inverse()
    }

    #[inline]
    fn between(self, a_from_c: Self) -> Self {
        self.between(a_from_c)
    }

    #[inline]
    fn retract(self, tangent: &Self::Tangent) -> Self {
        self * Self::exp((*tangent).into())
    }

    #[inline]
    fn local(self, other: Self) -> Self::Tangent {
        self.between(other).log().into()
    }

    #[inline]
    fn adjoint(self) -> Self::Matrix {
        self.adjoint()
    }

    #[inline]
    fn distance(self, other: Self) -> f64 {
        self.distance(other)
    }

    #[inline]
    fn angle(self) -> f64 {
        self.theta.abs()
    }

    #[inline]
    fn position(self) -> [f64; 2] {
        [self.x, self.y]
    }

    #[inline]
    fn translation(self) -> [f64; 3] {
        [self.x, self.y, 0.0]
    }

    #[inline]
    fn transform_point(self, point_b: [f64; 2]) -> [f64; 2] {
        self.transform(point_b)
    }

    fn in_space(self) -> Pose3 {
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.0, self.theta));
        Pose3 { translation: self.translation().into(), rotation }
    }

    #[inline]
    fn is_finite(self) -> bool {
        self.is_finite()
    }

    #[inline]
    fn turn_to(self, other: Self) -> [f64; 3] {
        [0.0, 0.0, wrap_angle(other.theta - self.theta)]
    }

    #[inline]
    fn turned(self, outer_rad: [f64; 3]) -> Self {
        self * Self::new(0.0, 0.0, outer_rad[2])
    }

    #[inline]
    fn moved(self, outer_m: [f64; 3]) -> Self {
        Self::new(self.x + outer_m[0], self.y + outer_m[1], self.theta)
    }

    #[inline]
    fn apart<W: Apart>(work: W::Of<'_, Self>) -> W::Output<Self> {
        W::plane(work)
    }
}

impl Pose for Pose3 {
    const DIMENSION: usize = 6;
    const TRANSLATION: usize = 3;
    const NUMBERS: usize = 7;

    type Point = [f64; 3];
    type Tangent = Vector6<f64>;
    type Matrix = crate::Cov6;

    #[inline]
    fn inverse(self) -> Self {
        self.inverse()
    }

    #[inline]
    fn between(self, a_from_c: Self) -> Self {
        self.between(a_from_c)
    }

    #[inline]
    fn retract(self, tangent: &Self::Tangent) -> Self {
        self * Self::exp(*tangent)
    }

    #[inline]
    fn local(self, other: Self) -> Self::Tangent {
        self.between(other).log()
    }

    #[inline]
    fn adjoint(self) -> Self::Matrix {
        self.adjoint()
    }

    #[inline]
    fn distance(self, other: Self) -> f64 {
        self.distance(other)
    }

    #[inline]
    fn angle(self) -> f64 {
        self.rotation.angle()
    }

    #[inline]
    fn position(self) -> [f64; 3] {
        self.translation.into()
    }

    #[inline]
    fn translation(self) -> [f64; 3] {
        self.translation.into()
    }

    #[inline]
    fn transform_point(self, point_b: [f64; 3]) -> [f64; 3] {
        self.transform(point_b.into()).into()
    }

    #[inline]
    fn in_space(self) -> Self {
        self
    }

    #[inline]
    fn is_finite(self) -> bool {
        self.is_finite()
    }

    #[inline]
    fn turn_to(self, other: Self) -> [f64; 3] {
        (other.rotation * self.rotation.inverse()).scaled_axis().into()
    }

    #[inline]
    fn turned(self, outer_rad: [f64; 3]) -> Self {
        let mut rotation = UnitQuaternion::from_scaled_axis(Vector3::from(outer_rad)) * self.rotation;
        rotation.renormalize_fast();
        Self { rotation, ..self }
    }

    #[inline]
    fn moved(self, outer_m: [f64; 3]) -> Self {
        Self { translation: self.translation + Vector3::from(outer_m), ..self }
    }

    #[inline]
    fn apart<W: Apart>(work: W::Of<'_, Self>) -> W::Output<Self> {
        W::space(work)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn tangent<P: Pose>(numbers: &[f64]) -> P::Tangent {
        P::Tangent::from_fn(|k| numbers[k])
    }

    fn pose<P: Pose>(numbers: &[f64]) -> P {
        P::identity().retract(&tangent::<P>(numbers))
    }

    fn close<P: Pose>(a: P, b: P) -> bool {
        a.distance(b) < 1e-9 && a.between(b).angle() < 1e-7
    }

    fn laws<P: Pose>(a: &[f64], b: &[f64]) -> Result<(), TestCaseError> {
        let (small, a, b) = (tangent::<P>(a), pose::<P>(a), pose::<P>(b));
        prop_assert!(close(a.retract(&a.local(b)), b));
        prop_assert!(close(a * a.between(b), b) && close(a.inverse() * b, a.between(b)));
        prop_assert!(close(a.retract(&small), P::identity().retract(&(a.adjoint() * small)) * a));
        prop_assert!((a.length() - a.in_space().length()).abs() < 1e-12);
        prop_assert!((a.angle() - a.in_space().angle()).abs() < 1e-7);
        prop_assert!((a * b).in_space().distance(a.in_space() * b.in_space()) < 1e-12);
        prop_assert!(P::identity().distance(a) <= a.length() && a.position()[0] == a.translation()[0]);
        Ok(())
    }

    fn outer_axes<P: Pose>(a: &[f64], b: &[f64]) -> Result<(), TestCaseError> {
        let (a, b) = (pose::<P>(a), pose::<P>(b));
        let turned = a.turned(a.turn_to(b));
        prop_assert!(turned.between(b).angle() < 1e-7 && turned.distance(a) == 0.0);
        let [from, to] = [a, b].map(P::translation);
        prop_assert!(close(turned.moved([0, 1, 2].map(|k| to[k] - from[k])), b));
        let there = P::Point::from_fn(|axis| 0.3 + axis as f64);
        let back = a.inverse().transform_point(a.transform_point(there)).minus(there);
        prop_assert!(back.dot(back) < 1e-20);
        Ok(())
    }

    proptest! {
        #[test]
        fn the_plane_and_space_obey_the_same_laws(
            a in prop::array::uniform6(-1.7..1.7f64), b in prop::array::uniform6(-1.7..1.7f64),
        ) {
            laws::<Pose2>(&a, &b)?;
            laws::<Pose3>(&a, &b)?;
            outer_axes::<Pose2>(&a, &b)?;
            outer_axes::<Pose3>(&a, &b)?;
        }
    }

    #[test]
    fn bounds_refuse_what_is_far_or_not_a_number() {
        assert!(Pose2::new(FARTHEST_M, -FARTHEST_M, 1.0).is_within_bounds());
        assert!(!Pose2::new(0.0, 1.1 * FARTHEST_M, 0.0).is_within_bounds());
        assert!(!Pose2::new(0.0, 0.0, f64::NAN).is_within_bounds());
        let far = Pose3::identity().moved([0.0, 0.0, -1.1 * FARTHEST_M]);
        assert!(!far.is_within_bounds() && far.is_finite() && Pose3::identity().is_within_bounds());
    }
}
