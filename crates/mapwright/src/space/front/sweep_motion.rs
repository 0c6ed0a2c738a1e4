//! How the robot moves during a sweep: its velocity by the last matches, its turning by inertial readings where there are some.

use super::span::Span;
use mapwright_geom::Pose3;
use mapwright_sensor::ImuPiece;
use nalgebra::{Vector3, Vector6};

/// The way through a sweep, leg by leg, and how the points say that it differs from that.
#[derive(Debug, Clone, Default)]
pub(super) struct SweepMotion {
    legs: Vec<Leg>,
    /// Its middle, seconds after the stamp, and the twist that comes on top, in the frame of the middle.
    bent: Option<(f64, Vector6<f64>)>,
}

/// From a time on, seconds after the stamp, the robot moves evenly.
#[derive(Debug, Clone, Copy)]
struct Leg {
    from_s: f64,
    /// None in the middle.
    middle_from_robot: Option<Pose3>,
    twist_per_s: Vector6<f64>,
}

impl SweepMotion {
    /// Nothing is known of it.
    pub(super) fn forget(&mut self) {
        self.legs.clear();
        self.bent = None;
    }

    /// It does not differ from that.
    pub(super) fn straighten(&mut self) {
        self.bent = None;
    }

    /// It differs from that by so much.
    pub(super) fn bend(&mut self, twist_per_s: Vector6<f64>, span: Span) {
        self.bent = Some((span.middle_s(), twist_per_s));
    }

    /// The robot goes on as it did.
    pub(super) fn carry_on(&mut self, twist_per_s: Vector6<f64>, span: Span) {
        self.forget();
        self.legs.push(Leg { from_s: span.middle_s(), middle_from_robot: None, twist_per_s });
    }

    /// The robot turns as was read, the bias taken off, with an even velocity along its own axes; the pieces begin with the span.
    pub(super) fn turn(
        &mut self,
        pieces: impl Iterator<Item = ImuPiece>,
        bias_rad_per_s: Vector3<f64>,
        velocity_m_per_s: Vector3<f64>,
        span: Span,
    ) {
        self.forget();
        let mut first_from_robot = Pose3::identity();
        for piece in pieces {
            let (v, omega) = (velocity_m_per_s, piece.turn_rate_rad_per_s - bias_rad_per_s);
            let twist_per_s = Vector6::new(v.x, v.y, v.z, omega.x, omega.y, omega.z);
            let from_s = span.first_s + piece.middle_s - 0.5 * piece.elapsed_s;
            self.legs.push(Leg { from_s, middle_from_robot: Some(first_from_robot), twist_per_s });
            first_from_robot = first_from_robot * Pose3::exp(twist_per_s * piece.elapsed_s);
        }
        let Some(first_from_middle) = self.middle_from_robot(span.middle_s()) else { return };
        for leg in &mut self.legs {
            leg.middle_from_robot =
                leg.middle_from_robot.map(|first_from_leg| first_from_middle.between(first_from_leg));
        }
    }

    /// Where the robot is so many seconds after the stamp, seen from the middle of the sweep; none where nothing is known.
    #[inline]
    pub(super) fn middle_from_robot(&self, time_s: f64) -> Option<Pose3> {
        let read = self.by_legs(time_s);
        let Some((middle_s, twist_per_s)) = self.bent else { return read };
        Some(Pose3::exp(twist_per_s * (time_s - middle_s)) * read.unwrap_or_else(Pose3::identity))
    }

    #[inline]
    fn by_legs(&self, time_s: f64) -> Option<Pose3> {
        let after = self.legs.partition_point(|leg| leg.from_s <= time_s);
        let leg = self.legs.get(after.saturating_sub(1))?;
        let step = Pose3::exp(leg.twist_per_s * (time_s - leg.from_s));
        Some(leg.middle_from_robot.map_or(step, |middle_from_leg| middle_from_leg * step))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_geom::Stamp;
    use mapwright_sensor::{ImuReading, ImuReadings};

    const SPAN: Span = Span { first_s: 0.0, last_s: 0.1 };

    #[test]
    fn even_turning_as_read_is_even_turning_carried_on() {
        let twist = Vector6::new(1.0, 0.2, -0.1, 0.3, -0.5, 2.0);
        let mut readings = ImuReadings::default();
        for k in -5..20 {
            readings.add(ImuReading {
                stamp: Stamp(k * 7_000_000),
                turn_rate_rad_per_s: twist.fixed_rows::<3>(3).into_owned() + Vector3::repeat(0.05),
                specific_force_m_per_s2: None,
            });
        }
        let (mut carried, mut read) = (SweepMotion::default(), SweepMotion::default());
        assert!(read.middle_from_robot(0.0).is_none());
        carried.carry_on(twist, SPAN);
        let velocity = twist.fixed_rows::<3>(0).into_owned();
        let pieces = || readings.pieces(Stamp(0), Stamp(100_000_000));
        read.turn(pieces(), Vector3::repeat(0.05), velocity, SPAN);
        assert!(read.legs.len() > 10);
        for time_s in [-0.01, 0.0, 0.033, 0.05, 0.0777, 0.1, 0.11] {
            let [a, b] = [&carried, &read].map(|motion| motion.middle_from_robot(time_s).unwrap());
            assert!(a.distance(b) < 1e-9 && a.rotation.angle_to(&b.rotation) < 1e-7, "{time_s}: {a:?} {b:?}");
        }
    }
}
