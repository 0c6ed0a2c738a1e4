//! Edges: what gives echoes from one point, as a door's frame does, wherever it is heard from.

use crate::arc::Arc2;
use crate::fit::{Fit, GATE_SIGMAS, LEAST_ECHOES, places};
use crate::wall::{KNOWN_TO_M, Wall};
use mapwright_geom::{sin_cos, wrap_angle};

/// Steps of Gauss-Newton; arcs are nearly straight where they cross.
const STEPS: usize = 8;
/// Which arcs agree on a point is asked anew so many times.
const ROUNDS: usize = 3;
/// A point that so many times as many arcs agree on as on a line is preferred to it: sonars hear an edge in turn while the robot passes it.
const MORE: f64 = 1.25;
/// A point is preferred to a line by so much of the summed squared deviations: both have two numbers.
const CLEARLY: f64 = 1.0;
/// Arcs that cross more steeply than this say where a point is, cosine between their directions (10 degrees).
const LEAST_SPREAD: f64 = 0.985;

/// The point that the arcs of a line agree on, where they agree on it better than on the line, or more of them.
pub(crate) fn edge(arcs: &[Arc2], free: &[bool], fit: &Fit) -> Option<Wall> {
    let of_line = || fit.echoes.iter().filter_map(|&(k, _)| arcs.get(k));
    let line_normal = unit(fit.line.normal_rad);
    let line_cost: f64 =
        of_line().map(|arc| ((arc.depth_m(line_normal) - fit.line.depth_m) / arc.sigma_m()).powi(2)).sum();
    let middle_m = fit.echoes.get(fit.echoes.len() / 2)?.1;
    let along = [-line_normal[1], line_normal[0]];
    let start = [0, 1].map(|axis| fit.line.depth_m * line_normal[axis] + middle_m * along[axis]);
    let mut point = crossing(&of_line().collect::<Vec<_>>(), start)?;
    let mut chosen: Vec<usize> = Vec::new();
    for _ in 0..ROUNDS {
        chosen = (0..arcs.len()).filter(|&k| free[k] && deviation(&arcs[k], point) <= GATE_SIGMAS).collect();
        point = crossing(&chosen.iter().map(|&k| &arcs[k]).collect::<Vec<_>>(), point)?;
    }
    let point_cost: f64 = of_line().map(|arc| deviation(arc, point).min(2.0 * GATE_SIGMAS).powi(2)).sum();
    let explains_more = chosen.len() as f64 > MORE * fit.echoes.len() as f64;
    if !explains_more && point_cost + CLEARLY >= line_cost {
        return None;
    }
    let distance_m = point[0].hypot(point[1]);
    let normal_rad = point[1].atan2(point[0]);
    let echoes: Vec<(usize, f64)> = chosen.into_iter().map(|k| (k, 0.0)).collect();
    let is_enough = places(arcs, &echoes) >= LEAST_ECHOES;
    is_enough.then_some(Wall { normal_rad, depth_m: distance_m, seen_m: [0.0; 2], known_beyond_m: KNOWN_TO_M, echoes })
}

/// How far an arc lies from a point in its standard deviations; infinite where the point is outside of its cone.
fn deviation(arc: &Arc2, point: [f64; 2]) -> f64 {
    let (away, distance_m) = towards(arc, point);
    if !arc.faces(away) {
        return f64::INFINITY;
    }
    (distance_m - arc.range_m).abs() / arc.sigma_m()
}

/// Direction and distance of a point from an arc's sonar.
fn towards(arc: &Arc2, point: [f64; 2]) -> (f64, f64) {
    let at = arc.stretch_from_sonar;
    let away = [point[0] - at.x, point[1] - at.y];
    (wrap_angle(away[1].atan2(away[0])), away[0].hypot(away[1]))
}

/// Where arcs cross, by least squares; none where they hardly do.
fn crossing(arcs: &[&Arc2], start: [f64; 2]) -> Option<[f64; 2]> {
    let mut point = start;
    for _ in 0..STEPS {
        let ([a, b, c], g) = normal_equations(arcs, point);
        let determinant = a * c - b * b;
        // With all arcs in one direction up to an angle s the determinant is about (1 - cos^2 s) of what it can be.
        if determinant <= 0.25 * (1.0 - LEAST_SPREAD * LEAST_SPREAD) * 0.25 * (a + c).powi(2) {
            return None;
        }
        let step = [(c * g[0] - b * g[1]) / determinant, (a * g[1] - b * g[0]) / determinant];
        point = [point[0] - step[0], point[1] - step[1]];
    }
    point.iter().all(|part| part.is_finite()).then_some(point)
}

fn unit(angle_rad: f64) -> [f64; 2] {
    let (sin, cos) = sin_cos(angle_rad);
    [cos, sin]
}

/// By how much the echoes of a wall agree better on its line than on any point: the difference of the summed squared deviations.
pub(crate) fn line_rather_than_point(arcs: &[Arc2], wall: &Wall) -> f64 {
    let (normal, _) = wall.axes();
    let echoes: Vec<&Arc2> = wall.echoes.iter().filter_map(|&(k, _)| arcs.get(k)).collect();
    let point = nearest_to_all(&echoes, wall.at(0.5 * (wall.seen_m[0] + wall.seen_m[1])));
    let of_line = |arc: &&Arc2| (arc.depth_m(normal) - wall.depth_m) / arc.sigma_m();
    let of_point = |arc: &&Arc2| deviation(arc, point).min(2.0 * GATE_SIGMAS);
    echoes.iter().map(|arc| of_point(arc).powi(2) - of_line(arc).powi(2)).sum()
}

/// The point that arcs agree on best, by damped least squares: where they hardly cross it stays where it was looked for.
fn nearest_to_all(arcs: &[&Arc2], start: [f64; 2]) -> [f64; 2] {
    let mut point = start;
    for _ in 0..STEPS {
        let ([a, b, c], g) = normal_equations(arcs, point);
        let damping = 0.01 * (a + c);
        let (a, c) = (a + damping, c + damping);
        let determinant = a * c - b * b;
        if determinant <= 0.0 {
            break;
        }
        point = [point[0] - (c * g[0] - b * g[1]) / determinant, point[1] - (a * g[1] - b * g[0]) / determinant];
    }
    point
}

/// Of the distances to a point over the arcs: products of directions, and directions times what they are off by.
fn normal_equations(arcs: &[&Arc2], point: [f64; 2]) -> ([f64; 3], [f64; 2]) {
    let (mut products, mut off) = ([0.0; 3], [0.0; 2]);
    for arc in arcs {
        let (away_rad, distance_m) = towards(arc, point);
        let [nx, ny] = unit(away_rad);
        let weight = arc.sigma_m().powi(-2);
        let off_m = distance_m - arc.range_m;
        products[0] += weight * nx * nx;
        products[1] += weight * nx * ny;
        products[2] += weight * ny * ny;
        off[0] += weight * nx * off_m;
        off[1] += weight * ny * off_m;
    }
    (products, off)
}
