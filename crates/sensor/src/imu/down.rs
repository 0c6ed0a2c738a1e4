//! Where down is: what an accelerometer says, averaged while a gyroscope turns it along.

use mapwright_geom::Stored;
use nalgebra::Vector3;

/// Standard gravity, metres per second squared (ISO 80000-3).
pub const STANDARD_GRAVITY_M_PER_S2: f64 = 9.806_65;
/// What pushes a robot besides gravity is something else after so long, seconds: a speed is reached, a turn is made.
const PUSHED_S: f64 = 1.0;
/// A force that differs from gravity by more than this share says nothing.
const FARTHEST_SHARE: f64 = 0.5;
/// Below this a force is given in multiples of gravity, as some drivers do, metres per second squared.
const IN_MULTIPLES_BELOW: f64 = 3.0;
/// Bias of an accelerometer of the cheap kind, by which the direction is wrong however long it is averaged: 0.05 m/s^2, radians.
const BIAS_RAD: f64 = 0.005;
/// White noise of a gyroscope of the cheap kind, rad^2 a second: 0.06 degrees in the root of a second.
pub const TURN_NOISE_RAD2_PER_S: f64 = 1e-6;

/// The direction of gravity since it was begun: a Kalman filter with one variance for both angles.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Down(Option<(Vector3<f64>, f64)>);

/// A direction has unit length within this.
const UNIT_WITHIN: f64 = 1e-6;
/// Nothing is known of a direction long before its variance is this, rad^2.
const LEAST_KNOWN_RAD2: f64 = 1e6;

impl Stored for Down {
    fn put(&self, out: &mut Vec<u8>) {
        self.0.put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        let known: Option<(Vector3<f64>, f64)> = Stored::take(from)?;
        let is_sound = known.is_none_or(|(down, variance_rad2)| {
            (down.norm() - 1.0).abs() < UNIT_WITHIN && (0.0..=LEAST_KNOWN_RAD2).contains(&variance_rad2)
        });
        is_sound.then_some(Self(known))
    }
}

/// Where down is, and how surely.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DownEstimate {
    /// The direction of gravity in the robot's frame, of length one.
    pub down_in_robot: Vector3<f64>,
    /// Standard deviation of its angle about any level axis, radians.
    pub sigma_rad: f64,
}

/// A force in metres per second squared, which some drivers give in multiples of gravity.
#[must_use]
pub fn in_metres(force: Vector3<f64>) -> Vector3<f64> {
    if force.norm() < IN_MULTIPLES_BELOW { force * STANDARD_GRAVITY_M_PER_S2 } else { force }
}

impl Down {
    /// The robot turns by a rotation vector over so many seconds, the rate being wrong by so much a second in the same way all the time.
    pub fn turn(&mut self, turn_rad: Vector3<f64>, elapsed_s: f64, bias_sigma_rad_per_s: f64) {
        let Some((down, variance_rad2)) = &mut self.0 else { return };
        let back = nalgebra::UnitQuaternion::from_scaled_axis(-turn_rad);
        *down = (back * *down).normalize();
        let sigma_rad = variance_rad2.sqrt() + bias_sigma_rad_per_s * elapsed_s;
        *variance_rad2 = sigma_rad * sigma_rad + TURN_NOISE_RAD2_PER_S * elapsed_s;
    }

    /// A specific force was read over so many seconds, while the robot was accelerated by `push`, in its own frame, give or take
    /// `push_sigma` (m/s^2). Whether it says anything: the norm of what is left is near gravity's.
    pub fn weigh(&mut self, force: Vector3<f64>, push: Vector3<f64>, push_sigma: f64, elapsed_s: f64) -> bool {
        let at_rest = in_metres(force) - push;
        let norm = at_rest.norm();
        let off_m_per_s2 = (norm - STANDARD_GRAVITY_M_PER_S2).abs();
        // not `>`: NaN must fail
        if !(off_m_per_s2 <= FARTHEST_SHARE * STANDARD_GRAVITY_M_PER_S2 && elapsed_s > 0.0) {
            return false;
        }
        let found = -at_rest / norm;
        let sigma_rad = push_sigma.hypot(off_m_per_s2) / STANDARD_GRAVITY_M_PER_S2;
        let found_rad2 = sigma_rad * sigma_rad;
        let Some((down, variance_rad2)) = &mut self.0 else {
            self.0 = Some((found, found_rad2));
            return true;
        };
        let gain = *variance_rad2 / (*variance_rad2 + found_rad2 * PUSHED_S / elapsed_s);
        let mean = *down + gain * (found - *down);
        // opposite to each other: the newer counts
        *down = mean.try_normalize(1e-6).unwrap_or(found);
        *variance_rad2 *= 1.0 - gain;
        true
    }

    /// What is known; none before the first force.
    #[must_use]
    pub fn estimate(&self) -> Option<DownEstimate> {
        let (down_in_robot, variance_rad2) = self.0?;
        Some(DownEstimate { down_in_robot, sigma_rad: (variance_rad2 + BIAS_RAD * BIAS_RAD).sqrt() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    const G: f64 = STANDARD_GRAVITY_M_PER_S2;

    fn up(robot_from_world: UnitQuaternion<f64>) -> Vector3<f64> {
        robot_from_world * Vector3::new(0.0, 0.0, G)
    }

    #[test]
    fn standing_longer_says_more_and_turning_keeps_what_was_said() {
        let tilted = UnitQuaternion::from_euler_angles(0.2, -0.1, 0.4);
        let mut down = Down::default();
        assert!(down.estimate().is_none());
        assert!(down.weigh(up(tilted), Vector3::zeros(), 0.5, 0.01));
        let first = down.estimate().unwrap();
        (0..500).for_each(|_| assert!(down.weigh(up(tilted), Vector3::zeros(), 0.5, 0.01)));
        let later = down.estimate().unwrap();
        assert!(later.sigma_rad < 0.5 * first.sigma_rad && later.sigma_rad > 0.01, "{later:?} after {first:?}");
        assert!((later.down_in_robot + up(tilted) / G).norm() < 1e-9);
        let turn = Vector3::new(0.1, 0.5, -0.3);
        down.turn(turn, 1.0, 0.001);
        let turned = down.estimate().unwrap();
        let expected = UnitQuaternion::from_scaled_axis(-turn) * (-up(tilted) / G);
        assert!((turned.down_in_robot - expected).norm() < 1e-9 && turned.sigma_rad > later.sigma_rad);
    }

    #[test]
    fn pushes_count_little_and_falling_nothing() {
        let mut down = Down::default();
        let level = Vector3::new(0.0, 0.0, G);
        (0..200).for_each(|_| assert!(down.weigh(level, Vector3::zeros(), 0.5, 0.01)));
        let before = down.estimate().unwrap();
        for bad in [Vector3::zeros(), Vector3::repeat(f64::NAN), level * 2.0, Vector3::new(1e200, 0.0, 1e200)] {
            assert!(!down.weigh(bad, Vector3::zeros(), 0.5, 0.01), "{bad}");
        }
        assert_eq!(down.estimate(), Some(before));
        let pushed = Vector3::new(3.0, 0.0, G);
        let [mut told, mut untold] = [down; 2];
        for _ in 0..100 {
            assert!(
                told.weigh(pushed, Vector3::zeros(), 3.5, 0.01) && untold.weigh(pushed, Vector3::zeros(), 0.5, 0.01)
            );
        }
        let off = |down: Down| down.estimate().unwrap().down_in_robot.xy().norm();
        assert!(off(told) < 0.2 * off(untold), "{} {}", off(told), off(untold));
        let push = Vector3::new(3.0, 0.0, 0.0);
        let mut known = down;
        (0..100).for_each(|_| assert!(known.weigh(pushed, push, 0.5, 0.01)));
        assert!(off(known) < 1e-9);
    }

    #[test]
    fn multiples_of_gravity_are_understood() {
        let mut down = Down::default();
        assert!(
            down.weigh(Vector3::new(0.0, 0.0, 1.01), Vector3::zeros(), 0.5, 0.01)
                && !down.weigh(Vector3::new(0.0, 0.0, 0.2), Vector3::zeros(), 0.5, 0.01)
        );
        assert_eq!(down.estimate().unwrap().down_in_robot, -Vector3::z());
    }

    #[test]
    fn forces_that_contradict_each_other_keep_a_direction() {
        let mut down = Down::default();
        for k in 0..1000 {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            down.weigh(Vector3::new(0.0, 0.0, sign * G), Vector3::zeros(), 0.5, 10.0);
            assert!((down.estimate().unwrap().down_in_robot.norm() - 1.0).abs() < 1e-9);
        }
    }
}
