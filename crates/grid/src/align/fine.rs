//! From a coarse pose to the one at which walls lie upon walls, to a part of a cell.

use super::judge::turned;
use super::walls::{FIELD_RADIUS_CELLS, Level, Surface, Walls};
use mapwright_geom::{Cov3, Pose2};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;

/// Steps of Gauss-Newton at each width at most.
const STEPS: usize = 12;
/// A step that moves walls by less than this share of a cell is the last.
const SETTLED: f64 = 1e-3;
/// In the end walls that lie so many cells apart count a quarter of those that lie upon each other.
const LAST_WIDTH_CELLS: f64 = 2.0;
/// The map is judged in squares with so many to a side, for the covariance: what bends a map bends a room, not a cell.
const SQUARES: f64 = 8.0;

/// The normal equations, in the tangent of the second map's frame.
#[derive(Debug, Clone, Copy, Default)]
struct Normal {
    h: Matrix3<f64>,
    g: Vector3<f64>,
}

impl Normal {
    fn add(&mut self, jacobian: Vector3<f64>, residual: f64, weight: f64) {
        self.h += weight * jacobian * jacobian.transpose();
        self.g += weight * residual * jacobian;
    }
}

/// The best pose near a given one: first by what lies within `width_m`, then ever closer.
pub(super) fn refine(a: &Walls<'_>, b: &Walls<'_>, from: Pose2, width_m: f64, stride: usize) -> Pose2 {
    let cell_m = a.map.resolution_m.max(b.map.resolution_m);
    let last_m = LAST_WIDTH_CELLS * cell_m;
    let mut a_from_b = from;
    let mut width_m = width_m.max(last_m);
    loop {
        for _ in 0..STEPS {
            let mut normal = Normal::default();
            for_each_pair(a, b, a_from_b, width_m, stride, |_, jacobian, residual, weight| {
                normal.add(jacobian, residual, weight);
            });
            let Some(step) = solved(&normal) else { return a_from_b };
            a_from_b = a_from_b * Pose2::exp([step[0], step[1], step[2]]);
            if step[0].hypot(step[1]).max(step[2].abs() * b.rms_radius_m) < SETTLED * cell_m {
                break;
            }
        }
        if width_m <= last_m {
            return a_from_b;
        }
        width_m = (width_m / 2.0).max(last_m);
    }
}

/// The step; where walls leave a direction open, none that way.
fn solved(normal: &Normal) -> Option<Vector3<f64>> {
    let mut h = normal.h;
    let damping = 1e-6 * h.trace() + 1e-12;
    (0..3).for_each(|k| h[(k, k)] += damping);
    h.cholesky().map(|factor| -factor.solve(&normal.g))
}

/// The covariance of a pose: how much its optimum would move if each square of the building were a draw of its own (White's
/// sandwich by clusters), so that what bends a map counts. In the tangent of the second map's middle.
pub(super) fn covariance(a: &Walls<'_>, b: &Walls<'_>, a_from_b: Pose2) -> Cov3 {
    let cell_m = a.map.resolution_m.max(b.map.resolution_m);
    let width_m = LAST_WIDTH_CELLS * cell_m;
    let side_m = (2.0 * b.half_sides[0].max(b.half_sides[1]) / SQUARES).max(cell_m);
    let mut squares: BTreeMap<[i64; 2], Normal> = BTreeMap::new();
    for_each_pair(a, b, a_from_b, width_m, 1, |place, jacobian, residual, weight| {
        let square = place.map(|m| (m / side_m).floor() as i64);
        squares.entry(square).or_default().add(jacobian, residual, weight);
    });
    let mut whole = Normal::default();
    let mut spread = Matrix3::zeros();
    for square in squares.values() {
        whole.h += square.h;
        spread += square.g * square.g.transpose();
    }
    // A whole map's place is known no better than a cell's is rounded in it.
    let rounded = cell_m * cell_m / 12.0;
    let r2 = b.rms_radius_m * b.rms_radius_m;
    let floor = Matrix3::from_diagonal(&Vector3::new(rounded, rounded, rounded / r2)) / squares.len().max(1) as f64;
    let damping = 1e-9 * whole.h.trace() + 1e-12;
    (0..3).for_each(|k| whole.h[(k, k)] += damping);
    let Some(inverse) = whole.h.try_inverse() else { return Cov3::identity() };
    let covariance = inverse * spread * inverse + floor;
    (covariance + covariance.transpose()) / 2.0
}

/// Walls of each map with what lies nearest in the other: where in the second map, the residual's derivative by the pose's right
/// perturbation, the residual in metres and its weight (Geman and McClure).
fn for_each_pair(
    a: &Walls<'_>,
    b: &Walls<'_>,
    a_from_b: Pose2,
    width_m: f64,
    stride: usize,
    mut call: impl FnMut([f64; 2], Vector3<f64>, f64, f64),
) {
    let b_from_a = a_from_b.inverse();
    let level = level_for(a, width_m);
    for surface in b.surfaces.iter().step_by(stride) {
        let place_a = a_from_b.transform(surface.at);
        let near = level.nearest(place_a).map(|number| &a.surfaces[number]);
        let normal = surface.normal.map(|normal| turned(a_from_b, normal));
        if let Some(near) = near.filter(|near| near.may_be(surface, normal)) {
            each_residual(near, place_a, width_m, |axis, residual, weight| {
                let [mx, my] = turned(b_from_a, axis);
                let [x, y] = surface.at;
                call(surface.at, Vector3::new(mx, my, x * my - y * mx), residual, weight);
            });
        }
    }
    let level = level_for(b, width_m);
    for surface in a.surfaces.iter().step_by(stride) {
        let place_b = b_from_a.transform(surface.at);
        let near = level.nearest(place_b).map(|number| &b.surfaces[number]);
        let normal = surface.normal.map(|normal| turned(b_from_a, normal));
        if let Some(near) = near.filter(|near| near.may_be(surface, normal)) {
            each_residual(near, place_b, width_m, |[mx, my], residual, weight| {
                let [x, y] = place_b;
                call(place_b, -Vector3::new(mx, my, x * my - y * mx), residual, weight);
            });
        }
    }
}

/// The finest level that knows walls so far away that they hardly count.
fn level_for<'a>(walls: &'a Walls<'_>, width_m: f64) -> &'a Level {
    let far = |level: &&Level| level.cell_m * f64::from(FIELD_RADIUS_CELLS) >= 2.0 * width_m;
    walls.levels.iter().find(far).unwrap_or(&walls.levels[walls.levels.len() - 1])
}

/// Axis, distance along it and weight: across a wall where it has a direction, else along both axes.
fn each_residual(near: &Surface, place: [f64; 2], width_m: f64, mut call: impl FnMut([f64; 2], f64, f64)) {
    let [dx, dy] = [place[0] - near.at[0], place[1] - near.at[1]];
    let share = (dx * dx + dy * dy) / (width_m * width_m);
    let weight = 1.0 / ((1.0 + share) * (1.0 + share));
    match near.normal {
        Some([nx, ny]) => call([nx, ny], dx * nx + dy * ny, weight),
        None => {
            call([1.0, 0.0], dx, weight / 2.0);
            call([0.0, 1.0], dy, weight / 2.0);
        }
    }
}
