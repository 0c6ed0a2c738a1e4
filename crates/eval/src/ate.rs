//! Absolute trajectory error.

use crate::associate::{MAX_STAMP_DIFFERENCE_S, PosePair, StampedPose, associate, finite_pairs};
use crate::error::EvalError;
use crate::stats::{ErrorStats, PoseErrors};
use mapwright_geom::Pose2;

/// What may be done to the estimate before it is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Alignment {
    /// Nothing: both are in one frame.
    None,
    /// The best rotation and translation (`evo_ape -a`).
    #[default]
    Rigid,
    /// The best rotation, translation and scale (`evo_ape -a -s`).
    Similarity,
}

/// A rigid motion after a scaling.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Similarity2 {
    /// What the estimate's positions are multiplied with, before they are moved.
    pub scale: f64,
    /// The motion into the reference's frame.
    pub world_from_map: Pose2,
}

impl Similarity2 {
    /// Changes nothing.
    pub const IDENTITY: Self = Self { scale: 1.0, world_from_map: Pose2::IDENTITY };

    /// The estimate's pose in the reference's frame.
    #[must_use]
    pub fn apply(&self, map_from_robot: Pose2) -> Pose2 {
        let scaled = Pose2 { x: self.scale * map_from_robot.x, y: self.scale * map_from_robot.y, ..map_from_robot };
        self.world_from_map * scaled
    }
}

/// Absolute trajectory error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ate {
    /// How the estimate was aligned.
    pub alignment: Similarity2,
    /// Distance of each aligned position from the reference's, metres.
    pub translation_m: ErrorStats,
    /// Absolute difference of each aligned heading from the reference's, degrees.
    pub rotation_deg: ErrorStats,
    /// Pairs left out because of NaN or infinity.
    pub not_finite: usize,
}

/// Absolute trajectory error of an estimate: stamps paired by [`associate`] within [`MAX_STAMP_DIFFERENCE_S`], the
/// estimate aligned, each pose compared. `evo_ape tum reference estimate -a` computes the same for planar trajectories.
///
/// One difference: evo aligns in space, and lays an estimate face down on the plane when its mirror image fits better, so
/// that a mirrored trajectory scores zero there. Here an estimate stays face up.
///
/// # Errors
/// When no stamps match, no pose is finite, or one trajectory does not move and so cannot be aligned.
pub fn ate(reference: &[StampedPose], estimate: &[StampedPose], alignment: Alignment) -> Result<Ate, EvalError> {
    ate_of_pairs(&associate(reference, estimate, MAX_STAMP_DIFFERENCE_S)?, alignment)
}

/// [`ate`] of poses that are paired already.
///
/// # Errors
/// When no pose is finite, or one trajectory does not move and so cannot be aligned.
pub fn ate_of_pairs(pairs: &[PosePair], alignment: Alignment) -> Result<Ate, EvalError> {
    let (pairs, not_finite) = finite_pairs(pairs)?;
    let alignment = align(&pairs, alignment)?;
    let errors: Vec<_> = pairs.iter().map(|pair| pose_error(pair, &alignment)).collect();
    let PoseErrors { translation_m, rotation_deg } =
        PoseErrors::of(&errors).ok_or(EvalError::NothingFinite { pairs: pairs.len() })?;
    Ok(Ate { alignment, translation_m, rotation_deg, not_finite })
}

/// Metres and degrees.
pub(crate) fn pose_error(pair: &PosePair, alignment: &Similarity2) -> (f64, f64) {
    let estimated_from_true = alignment.apply(pair.map_from_robot).between(pair.world_from_robot);
    (estimated_from_true.x.hypot(estimated_from_true.y), estimated_from_true.theta.abs().to_degrees())
}

/// The alignment that minimises the summed squared distances of the positions (Umeyama 1991, eqs. 34 to 42; in the
/// plane the rotation of eq. 40 has the closed form `atan2(sum of cross products, sum of dot products)`).
///
/// # Errors
/// [`EvalError::NotAlignable`] when one trajectory does not move.
pub fn align(pairs: &[PosePair], alignment: Alignment) -> Result<Similarity2, EvalError> {
    if alignment == Alignment::None {
        return Ok(Similarity2::IDENTITY);
    }
    let [map_x, map_y] = centroid(pairs.iter().map(|p| p.map_from_robot));
    let [world_x, world_y] = centroid(pairs.iter().map(|p| p.world_from_robot));
    let (mut dot, mut cross, mut map_spread) = (0.0, 0.0, 0.0);
    for pair in pairs {
        let (mx, my) = (pair.map_from_robot.x - map_x, pair.map_from_robot.y - map_y);
        let (wx, wy) = (pair.world_from_robot.x - world_x, pair.world_from_robot.y - world_y);
        dot += mx * wx + my * wy;
        cross += mx * wy - my * wx;
        map_spread += mx * mx + my * my;
    }
    let covariance = dot.hypot(cross);
    // also false for NaN; evo refuses covariances whose singular values are below the machine epsilon
    let alignable = covariance > f64::EPSILON * pairs.len() as f64;
    if !alignable {
        return Err(EvalError::NotAlignable { pairs: pairs.len() });
    }
    let scale = if alignment == Alignment::Similarity { covariance / map_spread } else { 1.0 };
    let rotation = Pose2::new(0.0, 0.0, cross.atan2(dot));
    let [x, y] = rotation.transform([scale * map_x, scale * map_y]);
    Ok(Similarity2 { scale, world_from_map: Pose2::new(world_x - x, world_y - y, rotation.theta) })
}

fn centroid(poses: impl ExactSizeIterator<Item = Pose2>) -> [f64; 2] {
    let n = poses.len() as f64;
    let (x, y) = poses.fold((0.0, 0.0), |(x, y), pose| (x + pose.x, y + pose.y));
    [x / n, y / n]
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_geom::Stamp;
    use proptest::prelude::*;

    fn pair(k: usize, world_from_robot: Pose2, map_from_robot: Pose2) -> PosePair {
        PosePair { stamp: Stamp(k as i64), world_from_robot, map_from_robot }
    }

    fn curve(k: usize) -> Pose2 {
        let s = k as f64;
        Pose2::new(0.3 * s, 2.0 * (0.2 * s).sin(), 0.1 * s)
    }

    proptest! {
        #[test]
        fn a_moved_and_scaled_copy_is_brought_back(
            x in -50.0..50.0f64, y in -50.0..50.0f64, theta in -3.1..3.1f64, scale in 0.2..5.0f64,
        ) {
            let truth = Similarity2 { scale, world_from_map: Pose2::new(x, y, theta) };
            let pairs: Vec<_> = (0..60).map(|k| pair(k, truth.apply(curve(k)), curve(k))).collect();
            let got = ate_of_pairs(&pairs, Alignment::Similarity).unwrap();
            prop_assert!((got.alignment.scale - scale).abs() < 1e-9);
            prop_assert!(got.translation_m.max < 1e-9 && got.rotation_deg.max < 1e-9);
        }
    }

    #[test]
    fn no_pose_in_the_neighbourhood_of_the_alignment_is_better() {
        let noisy = |k: usize| Pose2::new(curve(k).x + 0.1 * (k % 7) as f64, curve(k).y - 0.07 * (k % 5) as f64, 0.0);
        let pairs: Vec<_> = (0..60).map(|k| pair(k, curve(k), noisy(k))).collect();
        let best = align(&pairs, Alignment::Rigid).unwrap();
        let cost = |world_from_map: Pose2| -> f64 {
            let moved = Similarity2 { world_from_map, ..best };
            pairs.iter().map(|p| moved.apply(p.map_from_robot).distance(p.world_from_robot).powi(2)).sum()
        };
        for step in [[1e-3, 0.0, 0.0], [0.0, 1e-3, 0.0], [0.0, 0.0, 1e-4]] {
            let back = step.map(|s| -s);
            assert!(cost(best.world_from_map * Pose2::exp(step)) > cost(best.world_from_map));
            assert!(cost(best.world_from_map * Pose2::exp(back)) > cost(best.world_from_map));
        }
    }

    #[test]
    fn a_mirrored_trajectory_is_wrong() {
        let mirrored = |pose: Pose2| Pose2::new(pose.x, -pose.y, -pose.theta);
        let pairs: Vec<_> = (0..60).map(|k| pair(k, curve(k), mirrored(curve(k)))).collect();
        assert!(ate_of_pairs(&pairs, Alignment::Rigid).unwrap().translation_m.rmse > 1.0);
    }

    #[test]
    fn nan_is_left_out_and_counted_and_standstill_refused() {
        let mut pairs: Vec<_> = (0..10).map(|k| pair(k, curve(k), curve(k))).collect();
        pairs[3].map_from_robot.x = f64::NAN;
        let got = ate_of_pairs(&pairs, Alignment::Rigid).unwrap();
        assert_eq!((got.not_finite, got.translation_m.count), (1, 9));
        let standing: Vec<_> = (0..10).map(|k| pair(k, curve(k), curve(0))).collect();
        assert_eq!(align(&standing, Alignment::Rigid), Err(EvalError::NotAlignable { pairs: 10 }));
        assert!(ate_of_pairs(&standing, Alignment::None).is_ok());
    }
}
