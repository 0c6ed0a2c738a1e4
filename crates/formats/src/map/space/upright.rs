//! Which way is up in a map whose frame does not say so.

use super::vectors::{cross, dot, horizontals, unit};

/// Points looked at; more say nothing new.
const POINTS_USED: usize = 12_000;
/// Bins of a histogram of heights on either side of the mean; what lies farther out is left aside.
const HALF_BINS: f64 = 1000.0;
/// Steps between the directions tried, degrees, how many of them to either side, and bins of how many times the width: what is
/// narrow is missed between directions far apart.
const STAGES: [(f64, i32, f64); 3] = [(4.0, 11, 4.0), (1.0, 4, 2.0), (0.25, 4, 1.0)];

/// The direction in which the points' heights cluster most: floors, tables and ceilings lie at few heights. It is looked for within
/// `reach_deg` of a guess (45 at most, for beyond lie the walls), to a quarter of a degree; the guess itself where the points say nothing,
/// along z where it is none.
///
/// A direction's score is the sum of squares of the histogram of heights with bins of `bin_m` metres, as for
/// [`dominant_wall_angle`](crate::dominant_wall_angle). It counts by the cosine of the angle to the guess, for a wall before a
/// camera that looks down lies at one height as well.
#[must_use]
pub fn upward(points_m: &[[f32; 3]], guess: [f64; 3], reach_deg: f64, bin_m: f64) -> [f64; 3] {
    let guess = unit(guess).unwrap_or([0.0, 0.0, 1.0]);
    let points = centred_sample(points_m);
    if points.is_empty() || !(bin_m > 0.0 && bin_m.is_finite()) {
        return guess;
    }
    let least = reach_deg.clamp(0.0, 45.0).to_radians().cos();
    let mut bins = vec![0_u32; 2 * HALF_BINS as usize + 1];
    let mut up = guess;
    for (step_deg, steps, wider) in STAGES {
        let mut best = (f64::NEG_INFINITY, up);
        for direction in around(up, step_deg, steps) {
            let near = dot(direction, guess);
            let score = near * concentration(direction, &points, wider * bin_m, &mut bins);
            if near >= least && score > best.0 {
                best = (score, direction);
            }
        }
        up = best.1;
    }
    up
}

/// Directions about one, on a square grid of steps.
fn around(centre: [f64; 3], step_deg: f64, steps: i32) -> impl Iterator<Item = [f64; 3]> {
    let first = horizontals(centre)[0];
    let second = cross(centre, first);
    let step = step_deg.to_radians();
    let tilted = move |i: i32, j: i32| {
        let (a, b) = (f64::from(i) * step, f64::from(j) * step);
        unit(std::array::from_fn(|k| centre[k] + a * first[k] + b * second[k]))
    };
    (-steps..=steps).flat_map(move |i| (-steps..=steps).filter_map(move |j| tilted(i, j)))
}

/// Every n-th of the finite points, about their mean.
fn centred_sample(points_m: &[[f32; 3]]) -> Vec<[f64; 3]> {
    let step = points_m.len().div_ceil(POINTS_USED).max(1);
    let finite = |p: &&[f32; 3]| p.iter().all(|v| v.abs() < 1e6);
    let sample: Vec<_> = points_m.iter().step_by(step).filter(finite).map(|p| p.map(f64::from)).collect();
    let share = 1.0 / sample.len().max(1) as f64;
    let mean: [f64; 3] = std::array::from_fn(|k| share * sample.iter().map(|p| p[k]).sum::<f64>());
    sample.into_iter().map(|p| std::array::from_fn(|k| p[k] - mean[k])).collect()
}

/// Sum of squares of the histogram of the points' heights along a direction.
fn concentration(direction: [f64; 3], points: &[[f64; 3]], bin_m: f64, bins: &mut [u32]) -> f64 {
    bins.fill(0);
    let along = direction.map(|v| v / bin_m);
    for &point in points {
        let bin = dot(point, along);
        if bin.abs() < HALF_BINS {
            bins[(bin + HALF_BINS) as usize] += 1;
        }
    }
    bins.iter().map(|&count| f64::from(count) * f64::from(count)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_floor_says_what_is_up_and_the_walls_do_not() {
        // a camera's frame, pitched down by 25 degrees: y down, z ahead
        let (s, c) = mapwright_geom::sin_cos(25_f64.to_radians());
        let turned = |[x, y, z]: [f64; 3]| [x, c * y - s * z, s * y + c * z].map(|v| v as f32);
        let mut points = Vec::new();
        for i in 0..60 {
            for j in 0..60 {
                let (a, b) = (0.05 * f64::from(i), 0.05 * f64::from(j));
                points.push(turned([a - 1.5, 1.2, 1.0 + b])); // floor
                points.push(turned([a - 1.5, 1.2 - 0.6 * b, 4.0])); // wall ahead
            }
        }
        let up = upward(&points, [0.0, -1.0, 0.0], 45.0, 0.02);
        assert!(dot(up, [0.0, -c, -s]) > 0.5_f64.to_radians().cos(), "{up:?}");
        assert_eq!(upward(&[], [0.0, -2.0, 0.0], 45.0, 0.02), [0.0, -1.0, 0.0]);
        assert_eq!(upward(&[[f32::NAN; 3]], [0.0; 3], f64::NAN, f64::NAN), [0.0, 0.0, 1.0]);
    }
}
