//! Sightings around a moment as one least-squares problem whose unknown is the relative pose at that moment.
//!
//! A sighting at another moment measures `a_t_from_b_t = a_t_from_a * a_from_b * b_from_b_t`, where odometry knows the outer two up
//! to its noise. That noise is no unknown: it is integrated into the covariance of the residuals (generalised least squares), so that a
//! sighting counts the less the farther the robots drove since, and sightings behind one stretch of bad odometry err together.

use crate::dead_reckoning::{DeadReckoning, Place};
use crate::noise::{Likeness, OdometryNoise};
use crate::sighting::{RobotId, Sighting};
use mapwright_geom::{Pose2, Stamp, wrap_angle};
use nalgebra::{DMatrix, DVector, Matrix2x3, Matrix3, Vector3};

/// Robots do not come closer, metres; keeps the bearing's derivative finite.
const CLOSEST_M: f64 = 0.01;

/// Noise of everything that is measured.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Noise {
    /// Of the odometry of both robots.
    pub odometry: OdometryNoise,
    /// Of sightings among each other; their standard deviations are their own.
    pub likeness: Likeness,
}

/// Odometry of the two robots of a pair.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wheels<'a> {
    pub(crate) of_a: &'a DeadReckoning,
    pub(crate) of_b: &'a DeadReckoning,
}

/// One sighting beside the moment.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Entry {
    pub(crate) sighting: Sighting,
    /// Its place in the list of the pair's sightings.
    pub(crate) index: usize,
    pub(crate) is_by_a: bool,
    /// After the moment, seconds.
    pub(crate) after_s: f64,
    a: Side,
    b: Side,
}

/// One robot at one entry.
#[derive(Debug, Clone, Copy)]
struct Side {
    place: Place,
    now_from_then: Pose2,
}

/// The sightings of a pair around a moment.
#[derive(Debug, Clone)]
pub(crate) struct Window {
    pub(crate) stamp: Stamp,
    pub(crate) entries: Vec<Entry>,
    now: [Place; 2],
}

impl Window {
    /// None where odometry of either robot does not reach the moment; so are sightings left out.
    pub(crate) fn new(a: RobotId, stamp: Stamp, sightings: &[(usize, Sighting)], wheels: Wheels<'_>) -> Option<Self> {
        let now = [wheels.of_a.at(stamp)?, wheels.of_b.at(stamp)?];
        let side = |place: Place, now: Place| Side {
            place,
            now_from_then: now.odom_from_robot.between(place.odom_from_robot),
        };
        let entry = |&(index, sighting): &(usize, Sighting)| {
            Some(Entry {
                sighting,
                index,
                is_by_a: sighting.observer == a,
                after_s: sighting.stamp.secs_since(stamp),
                a: side(wheels.of_a.at(sighting.stamp)?, now[0]),
                b: side(wheels.of_b.at(sighting.stamp)?, now[1]),
            })
        };
        Some(Self { stamp, entries: sightings.iter().filter_map(entry).collect(), now })
    }

    /// The same without one entry.
    pub(crate) fn without(&self, entry: usize) -> Self {
        let mut left = self.clone();
        left.entries.remove(entry);
        left
    }

    /// The pose of `b` in `a` at the moment, if this is what was between them: `a` as at one entry, `b` as at another.
    pub(crate) fn carried_to_now(&self, a_then_from_b_then: Pose2, of_a: &Entry, of_b: &Entry) -> Pose2 {
        of_a.a.now_from_then * a_then_from_b_then * of_b.b.now_from_then.inverse()
    }

    /// Residuals at a relative pose with their derivatives.
    pub(crate) fn linearised(&self, a_from_b: Pose2) -> Linearised {
        let mut rows = Vec::new();
        for (place, entry) in self.entries.iter().enumerate() {
            let a_then_from_b_then = entry.a.now_from_then.inverse() * a_from_b * entry.b.now_from_then;
            let (expected, of_then) = expected(a_then_from_b_then, entry.is_by_a);
            let of_now = of_then * entry.b.now_from_then.inverse().adjoint();
            let of_a = -of_then * a_then_from_b_then.inverse().adjoint();
            let sighting = &entry.sighting;
            let measured = [
                sighting.range_m.map(|m| (m - expected[0], sighting.range_sigma_m)),
                sighting.bearing_rad.map(|rad| (wrap_angle(rad - expected[1]), sighting.bearing_sigma_rad)),
            ];
            for (kind, (residual, sigma)) in measured.into_iter().enumerate().filter_map(|(k, m)| Some((k, m?))) {
                let row = |matrix: &Matrix2x3<f64>| matrix.row(kind).transpose();
                rows.push(Row {
                    entry: place,
                    kind,
                    residual,
                    sigma,
                    of_now: row(&of_now),
                    of_a: row(&of_a),
                    of_b: row(&of_then),
                });
            }
        }
        Linearised { rows }
    }

    /// Covariance of the residuals: odometry's errors, carried to each sighting, and the sightings' own.
    pub(crate) fn covariance(&self, linearised: &Linearised, noise: &Noise) -> DMatrix<f64> {
        let rows = &linearised.rows;
        let columns = self.odometry_columns(rows, &noise.odometry);
        let mut covariance = &columns * columns.transpose();
        for (i, row) in rows.iter().enumerate() {
            covariance[(i, i)] += row.sigma * row.sigma;
            for (j, other) in rows[..i].iter().enumerate() {
                let (one, two) = (&self.entries[row.entry], &self.entries[other.entry]);
                if row.kind == other.kind && one.is_by_a == two.is_by_a {
                    let apart_s = (one.after_s - two.after_s).abs();
                    let shared = noise.likeness.correlation(apart_s) * row.sigma * other.sigma;
                    covariance[(i, j)] += shared;
                    covariance[(j, i)] += shared;
                }
            }
        }
        covariance
    }

    /// One column for each independent error of odometry with standard deviation 1: three a robot and stretch between stamps, and
    /// the drift of each robot, which goes the other way before the moment.
    fn odometry_columns(&self, rows: &[Row], noise: &OdometryNoise) -> DMatrix<f64> {
        let stretches: Vec<_> = [0, 1].into_iter().flat_map(|robot| self.stretches(robot)).collect();
        let mut columns = DMatrix::zeros(rows.len(), 3 * stretches.len() + 2);
        for (number, stretch) in stretches.iter().enumerate() {
            let [position_m2, heading_rad2] = noise.after(stretch.seconds, stretch.way_m, stretch.turned_rad);
            let sigmas = Vector3::new(position_m2.sqrt(), position_m2.sqrt(), heading_rad2.sqrt());
            for (i, row) in rows.iter().enumerate() {
                let entry = &self.entries[row.entry];
                let is_behind = entry.after_s * stretch.sign > 0.0 && entry.after_s.abs() >= stretch.ends_s;
                if is_behind {
                    let (side, by_pose) = if stretch.robot == 0 { (&entry.a, row.of_a) } else { (&entry.b, row.of_b) };
                    let then_from_middle = side.now_from_then.between(stretch.now_from_middle);
                    let carried = then_from_middle.adjoint().transpose() * by_pose;
                    for k in 0..3 {
                        columns[(i, 3 * number + k)] = carried[k] * sigmas[k];
                    }
                    let drifted_rad = noise.drift_rad_per_s * stretch.seconds * stretch.sign;
                    columns[(i, 3 * stretches.len() + stretch.robot)] += carried[2] * drifted_rad;
                }
            }
        }
        columns
    }

    /// The robot's way cut at the stamps of the entries, from the moment outwards to either side.
    fn stretches(&self, robot: usize) -> Vec<Stretch> {
        let mut stretches = Vec::new();
        for sign in [-1.0, 1.0] {
            let mut beside: Vec<&Entry> = self.entries.iter().filter(|entry| entry.after_s * sign > 0.0).collect();
            beside.sort_by(|one, two| one.after_s.abs().total_cmp(&two.after_s.abs()));
            let (mut place, mut now_from_last, mut begins_s) = (self.now[robot], Pose2::IDENTITY, 0.0);
            for entry in beside {
                let side = if robot == 0 { &entry.a } else { &entry.b };
                let ends_s = entry.after_s.abs();
                if ends_s > begins_s {
                    let step = now_from_last.between(side.now_from_then).log();
                    stretches.push(Stretch {
                        robot,
                        sign,
                        ends_s,
                        seconds: ends_s - begins_s,
                        way_m: (side.place.way_m - place.way_m).abs(),
                        turned_rad: (side.place.turned_rad - place.turned_rad).abs(),
                        now_from_middle: now_from_last * Pose2::exp(step.map(|component| 0.5 * component)),
                    });
                    (place, now_from_last, begins_s) = (side.place, side.now_from_then, ends_s);
                }
            }
        }
        stretches
    }
}

/// A piece of a robot's way between two stamps of entries.
struct Stretch {
    robot: usize,
    sign: f64,
    ends_s: f64,
    seconds: f64,
    way_m: f64,
    turned_rad: f64,
    now_from_middle: Pose2,
}

/// One measured number.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row {
    pub(crate) entry: usize,
    /// 0 range, 1 bearing.
    pub(crate) kind: usize,
    residual: f64,
    sigma: f64,
    /// Derivatives of what is expected by right perturbations of the relative pose now, and of either robot then.
    of_now: Vector3<f64>,
    of_a: Vector3<f64>,
    of_b: Vector3<f64>,
}

/// Residuals, measured less expected, and what they depend on.
#[derive(Debug, Clone)]
pub(crate) struct Linearised {
    pub(crate) rows: Vec<Row>,
}

impl Linearised {
    pub(crate) fn residuals(&self) -> DVector<f64> {
        DVector::from_iterator(self.rows.len(), self.rows.iter().map(|row| row.residual))
    }

    pub(crate) fn jacobian(&self) -> DMatrix<f64> {
        DMatrix::from_fn(self.rows.len(), 3, |row, column| self.rows[row].of_now[column])
    }
}

/// Range and bearing of one robot from the other, and their derivatives by a right perturbation of `a_from_b`.
fn expected(a_from_b: Pose2, is_by_a: bool) -> ([f64; 2], Matrix2x3<f64>) {
    let seen = if is_by_a { a_from_b } else { a_from_b.inverse() };
    let range_m = seen.x.hypot(seen.y).max(CLOSEST_M);
    let (ux, uy) = (seen.x / range_m, seen.y / range_m);
    let of_place = Matrix2x3::new(ux, uy, 0.0, -uy / range_m, ux / range_m, 0.0);
    // How the seen place moves: turned into a's frame; or, seen from b, the opposite way.
    let moves = if is_by_a {
        let (s, c) = a_from_b.theta.sin_cos();
        Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
    } else {
        Matrix3::new(-1.0, 0.0, seen.y, 0.0, -1.0, -seen.x, 0.0, 0.0, -1.0)
    };
    ([range_m, seen.y.atan2(seen.x)], of_place * moves)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn derivatives_are_those_of_differences(x in 0.3..4.0f64, y in -3.0..3.0f64, theta in -3.0..3.0f64, is_by_a in any::<bool>()) {
            let a_from_b = Pose2::new(x, y, theta);
            let (at, derivative) = expected(a_from_b, is_by_a);
            for k in 0..3 {
                let mut step = [0.0; 3];
                step[k] = 1e-6;
                let (moved, _) = expected(a_from_b * Pose2::exp(step), is_by_a);
                prop_assert!(((moved[0] - at[0]) / 1e-6 - derivative[(0, k)]).abs() < 1e-4);
                prop_assert!((wrap_angle(moved[1] - at[1]) / 1e-6 - derivative[(1, k)]).abs() < 1e-4);
            }
        }
    }
}
