//! Errors of trajectories in space: absolute, after the best rigid alignment (Umeyama 1991), and relative, from each pose to the next.

use crate::error::EvalError;
use crate::stats::ErrorStats;
use mapwright_geom::{Pose3, Stamp};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Stamps of pairs differ by no more than this, seconds.
const MAX_STAMP_DIFFERENCE_S: f64 = 0.01;

/// Errors of an estimate.
#[derive(Debug, Clone, PartialEq)]
pub struct SpaceErrors {
    /// Pairs that were compared.
    pub pairs: usize,
    /// Distance of each aligned position from the reference's, metres.
    pub absolute_m: ErrorStats,
    /// Of each step between paired poses that follow each other: how far it ends from the reference's, metres,
    pub relative_m: ErrorStats,
    /// and by how much it turns differently, degrees.
    pub relative_deg: ErrorStats,
    /// The motion that aligns the estimate.
    pub world_from_map: Pose3,
}

/// Compares an estimate with a reference; both are in order of their stamps.
///
/// # Errors
/// Where fewer than two pairs of stamps match.
pub fn space_errors(reference: &[(Stamp, Pose3)], estimate: &[(Stamp, Pose3)]) -> Result<SpaceErrors, EvalError> {
    let pairs = paired(reference, estimate);
    if pairs.len() < 2 {
        return Err(no_match(reference, estimate));
    }
    let world_from_map = alignment(&pairs);
    let absolute: Vec<f64> = pairs.iter().map(|(truth, pose)| truth.distance(world_from_map * *pose)).collect();
    let step = |w: &[(Pose3, Pose3)]| w[0].0.between(w[1].0).between(w[0].1.between(w[1].1));
    let steps: Vec<Pose3> = pairs.windows(2).map(step).collect();
    let metres: Vec<f64> = steps.iter().map(|error| error.translation.norm()).collect();
    let degrees: Vec<f64> = steps.iter().map(|error| error.rotation.angle().to_degrees()).collect();
    let stats = |errors: &[f64]| ErrorStats::of(errors).ok_or_else(|| no_match(reference, estimate));
    Ok(SpaceErrors {
        pairs: pairs.len(),
        absolute_m: stats(&absolute)?,
        relative_m: stats(&metres)?,
        relative_deg: stats(&degrees)?,
        world_from_map,
    })
}

fn no_match(reference: &[(Stamp, Pose3)], estimate: &[(Stamp, Pose3)]) -> EvalError {
    let (reference, estimate) = (reference.len(), estimate.len());
    EvalError::NoMatchingStamps { reference, estimate, max_difference_s: MAX_STAMP_DIFFERENCE_S }
}

/// Poses of both at the nearest stamps, each once.
fn paired(reference: &[(Stamp, Pose3)], estimate: &[(Stamp, Pose3)]) -> Vec<(Pose3, Pose3)> {
    let (mut pairs, mut at) = (Vec::new(), 0);
    for (stamp, pose) in estimate.iter().filter(|(_, pose)| pose.is_finite()) {
        let away_s = |k: usize| reference.get(k).map_or(f64::INFINITY, |(other, _)| other.secs_since(*stamp).abs());
        while away_s(at + 1) < away_s(at) {
            at += 1;
        }
        if away_s(at) <= MAX_STAMP_DIFFERENCE_S && reference[at].1.is_finite() {
            pairs.push((reference[at].1, *pose));
            at += 1;
        }
    }
    pairs
}

fn alignment(pairs: &[(Pose3, Pose3)]) -> Pose3 {
    let share = 1.0 / pairs.len() as f64;
    let mean = |of: fn(&(Pose3, Pose3)) -> Vector3<f64>| pairs.iter().map(of).sum::<Vector3<f64>>() * share;
    let (truth, map) = (mean(|pair| pair.0.translation), mean(|pair| pair.1.translation));
    let product = |(a, b): &(Pose3, Pose3)| (a.translation - truth) * (b.translation - map).transpose();
    let covariance: Matrix3<f64> = pairs.iter().map(product).sum::<Matrix3<f64>>() * share;
    let svd = covariance.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Pose3::identity() };
    let sign = if (u * v_t).determinant() < 0.0 { -1.0 } else { 1.0 };
    // The singular values fall, so that the last axis is the one to be mirrored.
    let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t;
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Pose3 { translation: truth - rotation * map, rotation }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector6;

    #[test]
    fn a_moved_trajectory_is_aligned_and_an_error_is_found() {
        let truth: Vec<(Stamp, Pose3)> = (0..50)
            .map(|k| {
                let t = 0.1 * f64::from(k);
                (
                    Stamp(i64::from(k) * 100_000_000),
                    Pose3::exp(Vector6::new(t, t.sin(), 0.3 * t.cos(), 0.0, 0.1 * t, 0.2 * t)),
                )
            })
            .collect();
        let moved = Pose3::exp(Vector6::new(3.0, -2.0, 1.0, 0.4, -0.2, 1.5));
        let mut estimate: Vec<(Stamp, Pose3)> =
            truth.iter().map(|&(stamp, pose)| (Stamp(stamp.0 + 1000), moved * pose)).collect();
        let errors = space_errors(&truth, &estimate).unwrap();
        assert!(errors.pairs == 50 && errors.absolute_m.max < 1e-9 && errors.relative_deg.max < 1e-6, "{errors:?}");
        estimate[20].1.translation.z += 0.1;
        let errors = space_errors(&truth, &estimate).unwrap();
        assert!((errors.absolute_m.max - 0.1).abs() < 0.01 && (errors.relative_m.max - 0.1).abs() < 0.01, "{errors:?}");
        assert!(space_errors(&truth[..1], &estimate).is_err());
    }
}
