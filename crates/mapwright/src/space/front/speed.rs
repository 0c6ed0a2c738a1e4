//! How fast the robot is, by matches and by what pushes it in between: a Kalman filter with one variance for all axes.

use mapwright_geom::stored;
use mapwright_sensor::Pushed;
use nalgebra::{UnitQuaternion, Vector3};

/// An accelerometer of the cheap kind is wrong by so much all the time, besides what gravity's direction is, metres per second squared.
const PUSH_M_PER_S2: f64 = 0.1;
/// and in the same way for so long, seconds.
const ALIKE_S: f64 = 1.0;
/// The way from match to match is wrong by so much, metres.
const WAY_M: f64 = 0.01;

/// A velocity in the robot's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Velocity {
    pub(super) m_per_s: Vector3<f64>,
    pub(super) variance: f64,
}
stored!(Velocity { m_per_s, variance });

impl Velocity {
    pub(super) fn is_sound(&self) -> bool {
        self.m_per_s.norm().is_finite() && (0.0..f64::INFINITY).contains(&self.variance)
    }
}

/// What pushed the robot since the last cloud, how it turned, and how surely gravity was told from that.
#[derive(Debug, Clone, Copy)]
pub(super) struct Push {
    pub(super) pushed: Pushed,
    pub(super) start_from_end: UnitQuaternion<f64>,
    pub(super) down_sigma_rad: f64,
}

impl Push {
    fn sigma_m_per_s2(&self) -> f64 {
        PUSH_M_PER_S2.hypot(mapwright_sensor::STANDARD_GRAVITY_M_PER_S2 * self.down_sigma_rad)
    }

    /// The way of a robot that began with such a velocity, in its frame then, and its standard deviation, metres: ways that err alike say as
    /// much together as one.
    pub(super) fn way(&self, from: Velocity) -> (Vector3<f64>, f64) {
        let elapsed_s = self.pushed.elapsed_s;
        let by_push_m = 0.5 * self.sigma_m_per_s2() * elapsed_s * elapsed_s;
        let alike = (ALIKE_S / elapsed_s).max(1.0).sqrt();
        (from.m_per_s * elapsed_s + self.pushed.way_m, alike * by_push_m.hypot(from.variance.sqrt() * elapsed_s))
    }

    /// Its velocity then.
    pub(super) fn after(&self, from: Velocity) -> Velocity {
        let m_per_s = self.start_from_end.inverse() * (from.m_per_s + self.pushed.velocity_m_per_s);
        let elapsed_s = self.pushed.elapsed_s;
        Velocity {
            m_per_s,
            variance: from.variance + self.sigma_m_per_s2().powi(2) * elapsed_s * elapsed_s.max(ALIKE_S),
        }
    }

    /// Its velocity at the beginning, of which something may be known, once it is known how far it came.
    pub(super) fn learn(&self, known: Option<Velocity>, moved_m: Vector3<f64>) -> Velocity {
        let elapsed_s = self.pushed.elapsed_s;
        let found = (moved_m - self.pushed.way_m) / elapsed_s;
        let variance = (WAY_M / elapsed_s).powi(2) + (0.5 * self.sigma_m_per_s2() * elapsed_s).powi(2);
        let Some(known) = known else { return Velocity { m_per_s: found, variance } };
        let gain = known.variance / (known.variance + variance);
        Velocity { m_per_s: known.m_per_s + gain * (found - known.m_per_s), variance: (1.0 - gain) * known.variance }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_velocity_is_learnt_from_ways_and_carried_by_pushes() {
        let push = Vector3::new(0.5, 0.0, 0.0);
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.0, 0.3));
        let (mut truth, mut known) = (Vector3::new(1.0, 0.2, 0.0), None);
        for k in 0..20 {
            let pushed = Pushed { way_m: push * 0.02, velocity_m_per_s: push * 0.2, elapsed_s: 0.2 };
            let step = Push { pushed, start_from_end: turn, down_sigma_rad: 0.005 };
            let noise = Vector3::new(if k % 2 == 0 { 0.01 } else { -0.01 }, 0.0, 0.0);
            let way = truth * 0.2 + push * 0.02;
            if let Some(known) = known {
                let (predicted, sigma_m) = step.way(known);
                assert!((predicted - way).norm() < 3.0 * sigma_m, "{k}: {predicted} {way}");
            }
            known = Some(step.after(step.learn(known, way + noise)));
            truth = turn.inverse() * (truth + push * 0.2);
        }
        let known = known.unwrap();
        assert!((known.m_per_s - truth).norm() < 0.05 && known.variance.sqrt() < 0.1, "{known:?} {truth}");
    }
}
