//! Which numbers out of a checkpoint can be gone on with.

use crate::pose::FARTHEST_M;
use crate::pose2::Pose2;
use crate::tangent::Cov3;
use std::f64::consts::PI;

/// Whether a session takes such a pose, and what comes next after it.
#[must_use]
pub fn is_in_place(pose: Pose2) -> bool {
    let farthest_m = pose.x.abs().max(pose.y.abs());
    farthest_m <= 0.5 * FARTHEST_M && pose.theta.abs() <= PI
}

/// Whether no two axes are correlated by more than wholly, up to rounding.
#[must_use]
pub fn is_covariance(matrix: &Cov3) -> bool {
    let is_sound = |(row, column): (usize, usize)| {
        let most = matrix[(row, row)] * matrix[(column, column)];
        matrix[(row, row)] >= 0.0 && matrix[(row, column)].powi(2) <= 1.000_001 * most
    };
    (0..3).flat_map(|row| (0..3).map(move |column| (row, column))).all(is_sound)
}
