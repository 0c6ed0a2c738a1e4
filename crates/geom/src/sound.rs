//! Which numbers out of a checkpoint can be gone on with.

use crate::pose::{FARTHEST_M, Pose};
use crate::tangent::TangentMatrix;
use std::f64::consts::PI;

/// Whether a session takes such a pose, and what comes next after it.
#[must_use]
pub fn is_in_place(pose: impl Pose) -> bool {
    pose.translation().iter().all(|metres| metres.abs() <= 0.5 * FARTHEST_M) && pose.angle() <= PI + 1e-9
}

/// Whether no two axes are correlated by more than wholly, up to rounding.
#[must_use]
pub fn is_covariance<M: TangentMatrix>(matrix: &M) -> bool {
    let is_sound = |(row, column): (usize, usize)| {
        let most = matrix[(row, row)] * matrix[(column, column)];
        matrix[(row, row)] >= 0.0 && matrix[(row, column)].powi(2) <= 1.000_001 * most
    };
    (0..M::SIZE).flat_map(|row| (0..M::SIZE).map(move |column| (row, column))).all(is_sound)
}
