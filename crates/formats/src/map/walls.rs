//! The direction in which a building's walls run.

use mapwright_geom::sin_cos;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// Points looked at; more say nothing new.
const POINTS_USED: usize = 4096;

/// Bins on either side of the centre; what lies farther out is left aside.
const HALF_BINS: usize = 4096;

/// Walls have a direction where projections along it are so many times as concentrated as in the median of all directions: discs of random points
/// and trees reach 1.2, buildings (intel, fr079, acapulco, edmonton, fhw) 1.4 to 1.9, clutter with a wall of a fifth of its points 1.8.
const DISTINCT: f32 = 1.25;

/// The angle of the walls against the x axis, modulo a quarter turn, in `[-pi/4, pi/4)`; zero where there are no points.
///
/// Turned by minus this angle, walls are parallel to the axes. The angle is where the points' projections onto the two
/// axes are most concentrated: the sum of squares of both histograms, with bins of `bin_m` metres (the map's
/// resolution), is the largest; found to a tenth of a degree.
#[must_use]
pub fn dominant_wall_angle(points: &[[f64; 2]], bin_m: f64) -> f64 {
    search(points, bin_m).map_or(0.0, |found| found.0)
}

/// The same where walls have a direction: along it projections are distinctly more concentrated than along most others.
#[must_use]
pub fn wall_direction(points: &[[f64; 2]], bin_m: f64) -> Option<f64> {
    search(points, bin_m).filter(|(_, distinct)| *distinct >= DISTINCT).map(|(angle_rad, _)| angle_rad)
}

/// The angle, and how many times as concentrated projections are as in the median of all directions.
fn search(points: &[[f64; 2]], bin_m: f64) -> Option<(f64, f32)> {
    let points = centred_sample(points);
    if points.is_empty() || !(bin_m > 0.0 && bin_m.is_finite()) {
        return None;
    }
    let degrees = (-45..45).map(|degrees| f64::from(degrees).to_radians());
    let (coarse, mut scores) = best_of(degrees, &points, 4.0 * bin_m);
    let most = scores.iter().copied().fold(0.0, f32::max);
    let median = *scores.select_nth_unstable_by(45, f32::total_cmp).1;
    let tenths = (-15..=15).map(|tenths| coarse + (0.1 * f64::from(tenths)).to_radians());
    Some((wrap_quarter(best_of(tenths, &points, bin_m).0), most / median.max(f32::MIN_POSITIVE)))
}

fn wrap_quarter(angle_rad: f64) -> f64 {
    (angle_rad + FRAC_PI_4).rem_euclid(FRAC_PI_2) - FRAC_PI_4
}

/// Every n-th of the finite points, about their mean.
fn centred_sample(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let step = points.len().div_ceil(POINTS_USED).max(1);
    let finite = |p: &&[f64; 2]| p[0].abs() < 1e9 && p[1].abs() < 1e9;
    let sample: Vec<_> = points.iter().step_by(step).filter(finite).copied().collect();
    let count = sample.len().max(1) as f64;
    let mean = |k: usize| sample.iter().map(|p| p[k]).sum::<f64>() / count;
    let (mean_x, mean_y) = (mean(0), mean(1));
    sample.into_iter().map(|[x, y]| [x - mean_x, y - mean_y]).collect()
}

/// The first of the angles with the largest score, and the scores of all.
fn best_of(angles_rad: impl Iterator<Item = f64>, points: &[[f64; 2]], bin_m: f64) -> (f64, Vec<f32>) {
    let mut bins = [vec![0.0_f32; 2 * HALF_BINS + 2], vec![0.0_f32; 2 * HALF_BINS + 2]];
    let (mut best, mut scores) = ((f32::NEG_INFINITY, 0.0), Vec::new());
    for angle_rad in angles_rad {
        let score = concentration(angle_rad, points, bin_m, &mut bins);
        if score > best.0 {
            best = (score, angle_rad);
        }
        scores.push(score);
    }
    (best.1, scores)
}

/// Sum of squares of the histograms of the points' projections onto axes turned by the angle.
fn concentration(angle_rad: f64, points: &[[f64; 2]], bin_m: f64, bins: &mut [Vec<f32>; 2]) -> f32 {
    let (s, c) = sin_cos(angle_rad);
    let (s, c) = (s / bin_m, c / bin_m);
    bins.iter_mut().for_each(|b| b.fill(0.0));
    for [x, y] in points {
        spread(&mut bins[0], c * x + s * y);
        spread(&mut bins[1], c * y - s * x);
    }
    bins.iter().flatten().map(|count| count * count).sum()
}

/// Adds one point, shared between the two bins it lies between.
fn spread(bins: &mut [f32], at: f64) {
    let at = at + HALF_BINS as f64;
    if at >= 0.0 && at < 2.0 * HALF_BINS as f64 {
        let below = at as usize;
        let share = (at - below as f64) as f32;
        bins[below] += 1.0 - share;
        bins[below + 1] += share;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_geom::Pose2;

    /// A room of 8 by 5 metres with some clutter, turned.
    fn room(angle_rad: f64) -> Vec<[f64; 2]> {
        let turn = Pose2::new(3.0, -2.0, angle_rad);
        let clutter = (0..300).map(|i| [f64::from(i * 37 % 80) * 0.1, f64::from(i * 53 % 50) * 0.1]);
        let walls = (0..160).flat_map(|i| {
            let t = f64::from(i) * 0.05;
            [[t, 0.0], [t, 5.0], [0.0, t * 0.625], [8.0, t * 0.625]]
        });
        walls.chain(clutter).map(|p| turn.transform(p).map(|v| (v / 0.05).round() * 0.05)).collect()
    }

    #[test]
    fn the_walls_of_a_room_are_found_at_any_angle() {
        for degrees in [-44.0, -30.5, -3.2, 0.0, 1.0, 12.3, 44.4, 80.0_f64] {
            let found = dominant_wall_angle(&room(degrees.to_radians()), 0.05);
            let error = wrap_quarter(found - degrees.to_radians());
            assert!(error.abs() < 0.35_f64.to_radians(), "{degrees}: {}", found.to_degrees());
        }
    }

    #[test]
    fn no_points_and_odd_points_give_an_angle_too() {
        assert_eq!(dominant_wall_angle(&[], 0.05), 0.0);
        assert_eq!(dominant_wall_angle(&[[f64::NAN, 1.0]], 0.05), 0.0);
        assert_eq!(dominant_wall_angle(&[[1.0, 1.0]], 0.0), 0.0);
        assert!(dominant_wall_angle(&[[1e300, 1.0], [1e8, -1e8], [0.0, 0.0]], 0.05).is_finite());
    }

    #[test]
    fn what_has_no_walls_has_no_direction() {
        let disc = |k: i32| {
            let (s, c) = sin_cos(f64::from(k) * 2.399_963);
            let r = 0.1 * f64::from(k).sqrt();
            [r * c, r * s]
        };
        let circle = |k: i32| sin_cos(f64::from(k) * 0.01);
        let round: Vec<[f64; 2]> = (0..628).map(circle).map(|(s, c)| [9.0 * c, 9.0 * s]).collect();
        assert_eq!(wall_direction(&(0..3000).map(disc).collect::<Vec<_>>(), 0.05), None);
        assert_eq!(wall_direction(&round, 0.05), None);
        for degrees in [-30.5, 12.3_f64] {
            let found = wall_direction(&room(degrees.to_radians()), 0.05).expect("a room has walls");
            assert!((found - degrees.to_radians()).abs() < 0.35_f64.to_radians());
        }
    }
}
