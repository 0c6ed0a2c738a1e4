//! Poses as numbers, and which of them are sound.

use mapwright_geom::{Apart, Pose, Pose2, Pose3};
use nalgebra::{Quaternion, Unit};

/// At most so many numbers has a pose.
pub(crate) const MOST_NUMBERS: usize = 7;

/// The numbers of a pose; those beyond [`Pose::NUMBERS`] are zero.
pub(crate) fn to_numbers<P: Pose>(pose: P) -> [f64; MOST_NUMBERS] {
    P::apart::<ToNumbers>(pose)
}

/// The pose of these numbers, to the bit and whatever they are.
pub(crate) fn from_numbers<P: Pose>(numbers: [f64; MOST_NUMBERS]) -> P {
    P::apart::<FromNumbers>(numbers)
}

/// Whether a pose is finite, within 10^6 m, and its rotation one: a heading within half a turn, a quaternion of length one.
#[must_use]
pub fn is_sound<P: Pose>(pose: P) -> bool {
    pose.is_within_bounds() && P::apart::<IsTurn>(pose)
}

struct ToNumbers;
struct FromNumbers;
struct IsTurn;

impl Apart for ToNumbers {
    type Of<'a, P: Pose> = P;
    type Output<P: Pose> = [f64; MOST_NUMBERS];

    fn plane(Pose2 { x, y, theta }: Pose2) -> [f64; MOST_NUMBERS] {
        [x, y, theta, 0.0, 0.0, 0.0, 0.0]
    }

    fn space(pose: Pose3) -> [f64; MOST_NUMBERS] {
        let ([x, y, z], [i, j, k, w]) = (pose.translation.into(), pose.rotation.coords.into());
        [x, y, z, i, j, k, w]
    }
}

impl Apart for FromNumbers {
    type Of<'a, P: Pose> = [f64; MOST_NUMBERS];
    type Output<P: Pose> = P;

    // not `new`, which wraps and may change the last digit
    fn plane([x, y, theta, ..]: [f64; MOST_NUMBERS]) -> Pose2 {
        Pose2 { x, y, theta }
    }

    fn space([x, y, z, i, j, k, w]: [f64; MOST_NUMBERS]) -> Pose3 {
        Pose3 { translation: [x, y, z].into(), rotation: Unit::new_unchecked(Quaternion::new(w, i, j, k)) }
    }
}

impl Apart for IsTurn {
    type Of<'a, P: Pose> = P;
    type Output<P: Pose> = bool;

    fn plane(pose: Pose2) -> bool {
        pose.theta.abs() <= std::f64::consts::PI
    }

    fn space(pose: Pose3) -> bool {
        (pose.rotation.coords.norm_squared() - 1.0).abs() <= 1e-6
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_of_the_plane_and_of_space_keep_every_bit() {
        let plane = Pose2::new(0.1, -0.0, -3.0);
        let space = Pose3::identity().turned([0.3, -0.2, 1.1]).moved([1.0, 0.1, -7.3]);
        let bits = |numbers: [f64; MOST_NUMBERS]| numbers.map(f64::to_bits);
        assert_eq!(bits(to_numbers(from_numbers::<Pose2>(to_numbers(plane)))), bits(to_numbers(plane)));
        assert_eq!(bits(to_numbers(from_numbers::<Pose3>(to_numbers(space)))), bits(to_numbers(space)));
        assert!(is_sound(plane) && is_sound(space));
        assert!(!is_sound(Pose2 { theta: 4.0, ..plane }) && !is_sound(Pose2 { x: f64::NAN, ..plane }));
        assert!(!is_sound(from_numbers::<Pose3>([0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.5])));
        assert_eq!((Pose2::NUMBERS, Pose3::NUMBERS), (3, 7));
    }
}
