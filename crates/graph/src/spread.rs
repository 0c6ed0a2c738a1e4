//! The backwards correction of a cycle in closed form (Thrun, Burgard, Fox, chapter on incremental mapping), in the plane
//! and in space: what a closure contradicts is shared among the steps of the loop, rotation first, then the translation
//! that remains.
//!
//! Sharing the error of the poses in the map's frame instead would bend a loop that a constant heading bias has bent
//! already the other way.
//!
//! *Rotation in space.* Let `R_k` be the orientation after step `k`, and `w` the rotation vector, along the axes of the
//! map, that is missing at the end: `R* = exp(w) R_n`. With `c_k` the sum of the shares up to step `k`, `R'_k = exp(c_k
//! w) R_k` meets `R*` exactly at `c_n = 1`. Step `k` then turns from `R'_k-1` to `R'_k` by `R_k-1^T exp((c_k - c_k-1)
//! w) R_k`: its own rotation and its share of `w`, seen from where the robot is. All shares turn about one axis of the
//! map, so they commute, and nothing has to be iterated. To first order these are the most probable rotations where
//! those of the steps err independently and about any axis alike, with variances in proportion to the shares: the least
//! `sum |d_k|^2 / s_k` under `sum R_k d_k = w` is `d_k = s_k / (sum s) R_k^T w`. Akin are the pose chains of Dubbelman
//! and Browning ("COP-SLAM", 2015) and, with slerp in place of the rotation vector, the paths of Grisetti, Stachniss
//! and Burgard ("Nonlinear constraint network optimization for efficient map learning", 2009). A bias about an axis
//! that turns with the robot out of the plane it drives in is no such error: of it a rest is left to the translation.

use mapwright_geom::Pose;

/// How much of the error each step of the loop takes, in proportion; in the order of the chain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Share {
    /// Of the rotation, such as the variance of the step's heading.
    pub rotation: f64,
    /// Of the translation, such as the variance of its length.
    pub translation: f64,
}

/// Why an error cannot be spread.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SpreadError {
    /// The loop does not lie within the chain.
    #[error("expected a loop of poses first < last < {poses}, found {first} and {last}")]
    Loop {
        /// First pose of the loop.
        first: usize,
        /// Last pose of the loop.
        last: usize,
        /// Poses of the chain.
        poses: usize,
    },
    /// Not one share for every step of the loop.
    #[error("expected {expected} shares, one for each step of the loop, found {found}")]
    Shares {
        /// Steps of the loop.
        expected: usize,
        /// Shares given.
        found: usize,
    },
    /// A pose or a share is of no use.
    #[error("expected finite poses and shares that are not negative, found otherwise")]
    Value,
}

/// Shares in proportion to each step's motion: turning errs with turning and with distance, translation with distance.
///
/// A loop that does not move takes its error in equal parts.
#[must_use]
pub fn shares_by_motion<P: Pose>(loop_poses: &[P]) -> Vec<Share> {
    let steps = loop_poses.windows(2).map(|pair| pair[0].between(pair[1]));
    steps.map(|step| Share { rotation: step.angle() + step.length(), translation: step.length() }).collect()
}

/// Moves the poses of a chain so that the pose `last` is `first_from_last` seen from `first`, exactly.
///
/// Poses up to `first` stay, those after `last` are carried rigidly. Between them every step turns by its share of the
/// rotation, the chain is integrated anew, and what translation remains is shared.
///
/// # Errors
/// The loop does not lie within the chain, there is not one share for each of its steps, or a number is not finite or, of a
/// share, negative.
pub fn spread<P: Pose>(
    world_from_robot: &mut [P],
    first: usize,
    last: usize,
    first_from_last: P,
    shares: &[Share],
) -> Result<(), SpreadError> {
    let poses = world_from_robot.len();
    if first >= last || last >= poses {
        return Err(SpreadError::Loop { first, last, poses });
    }
    if shares.len() != last - first {
        return Err(SpreadError::Shares { expected: last - first, found: shares.len() });
    }
    let usable = |share: &Share| [share.rotation, share.translation].iter().all(|s| s.is_finite() && *s >= 0.0);
    if !first_from_last.is_finite() || !world_from_robot.iter().all(|p| p.is_finite()) || !shares.iter().all(usable) {
        return Err(SpreadError::Value);
    }
    let old_last = world_from_robot[last];
    let world_from_last = world_from_robot[first] * first_from_last;
    share_rotation(&mut world_from_robot[first..=last], world_from_last, shares);
    share_translation(&mut world_from_robot[first..=last], world_from_last, shares);
    for pose in &mut world_from_robot[last + 1..] {
        *pose = world_from_last * old_last.between(*pose);
    }
    Ok(())
}

/// Turns each step by its share and integrates the chain anew.
///
/// A step turns half of its own share before it drives and half after, as an arc does; so a loop that a constant bias of
/// the heading has bent closes with nothing left to spread.
fn share_rotation<P: Pose>(chain: &mut [P], world_from_last: P, shares: &[Share]) {
    let missing_rad = chain[chain.len() - 1].turn_to(world_from_last);
    let steps: Vec<P> = chain.windows(2).map(|pair| pair[0].between(pair[1])).collect();
    let turns = in_proportion(shares.iter().map(|share| share.rotation).collect());
    for (at, (step, turn)) in steps.into_iter().zip(turns).enumerate() {
        let half_rad = missing_rad.map(|missing| 0.5 * missing * turn);
        chain[at + 1] = (chain[at].turned(half_rad) * step).turned(half_rad);
    }
}

/// Moves each pose by the shares of all steps before it; the last one is put where it belongs.
fn share_translation<P: Pose>(chain: &mut [P], world_from_last: P, shares: &[Share]) {
    let end = chain.len() - 1;
    let [from, to] = [chain[end], world_from_last].map(P::translation);
    let missing_m = [0, 1, 2].map(|axis| to[axis] - from[axis]);
    let mut moved = 0.0;
    let parts = in_proportion(shares.iter().map(|share| share.translation).collect());
    for (pose, part) in chain[1..].iter_mut().zip(parts) {
        moved += part;
        *pose = pose.moved(missing_m.map(|missing| moved * missing));
    }
    chain[end] = world_from_last;
}

/// The shares with sum one; equal ones where all are zero.
fn in_proportion(mut shares: Vec<f64>) -> Vec<f64> {
    let largest = shares.iter().fold(0.0_f64, |most, s| most.max(*s));
    let scale = if largest > 0.0 { largest } else { 1.0 };
    shares.iter_mut().for_each(|s| *s = if largest > 0.0 { *s / scale } else { 1.0 });
    let sum: f64 = shares.iter().sum();
    shares.iter_mut().for_each(|s| *s /= sum);
    shares
}
