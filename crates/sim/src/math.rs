//! Points of the plane, and functions built from plain IEEE operations so that a seed gives the same bytes on every CPU.

use mapwright_geom::{Pose2, sin_cos};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, LN_2, PI, SQRT_2};

/// A point or vector in the world, metres.
pub type Point = [f64; 2];

pub(crate) fn add(a: Point, b: Point) -> Point {
    [a[0] + b[0], a[1] + b[1]]
}

pub(crate) fn sub(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1]]
}

pub(crate) fn scale(a: Point, factor: f64) -> Point {
    [a[0] * factor, a[1] * factor]
}

pub(crate) fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

pub(crate) fn cross(a: Point, b: Point) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

pub(crate) fn norm(a: Point) -> f64 {
    dot(a, a).sqrt()
}

pub(crate) fn distance(a: Point, b: Point) -> f64 {
    norm(sub(a, b))
}

/// `a` at 0, `b` at 1.
pub(crate) fn lerp(a: Point, b: Point, share: f64) -> Point {
    add(a, scale(sub(b, a), share))
}

/// The unit vector along `a`; zero for zero.
pub(crate) fn unit(a: Point) -> Point {
    let length = norm(a);
    if length > 0.0 { scale(a, 1.0 / length) } else { [0.0, 0.0] }
}

/// `vector` turned by an angle.
pub(crate) fn rotate(vector: Point, angle_rad: f64) -> Point {
    let (s, c) = sin_cos(angle_rad);
    [c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]]
}

/// Natural logarithm of a positive, normal number: `e ln 2 + 2 atanh((m - 1) / (m + 1))`, error below 1e-14.
pub(crate) fn ln(x: f64) -> f64 {
    let bits = x.to_bits();
    let mut exponent = ((bits >> 52) & 0x7ff) as i64 - 1023;
    let mut mantissa = f64::from_bits((bits & 0x000f_ffff_ffff_ffff) | 0x3ff0_0000_0000_0000);
    if mantissa > SQRT_2 {
        mantissa *= 0.5;
        exponent += 1;
    }
    let z = (mantissa - 1.0) / (mantissa + 1.0);
    let z2 = z * z;
    let series = (0..10).rev().fold(0.0, |sum, k| sum * z2 + 1.0 / f64::from(2 * k + 1));
    exponent as f64 * LN_2 + 2.0 * z * series
}

/// The angle of the vector `(x, y)`, radians in `[-pi, pi]`; zero for the zero vector.
pub(crate) fn atan2(y: f64, x: f64) -> f64 {
    let (ax, ay) = (x.abs(), y.abs());
    if ax == 0.0 && ay == 0.0 {
        return 0.0;
    }
    let octant = if ay <= ax { atan_unit(ay / ax) } else { FRAC_PI_2 - atan_unit(ax / ay) };
    let half = if x < 0.0 { PI - octant } else { octant };
    if y < 0.0 { -half } else { half }
}

/// Arc tangent on `[0, 1]` with the minimax polynomial of fdlibm's `s_atan.c`, moved by pi/4 above tan(pi/8).
fn atan_unit(t: f64) -> f64 {
    const POLY: [f64; 11] = [
        3.333_333_333_333_293e-1,
        -1.999_999_999_987_648_3e-1,
        1.428_571_427_250_346_6e-1,
        -1.111_111_040_546_235_6e-1,
        9.090_887_133_436_507e-2,
        -7.691_876_205_044_83e-2,
        6.661_073_137_387_531e-2,
        -5.833_570_133_790_573_5e-2,
        4.976_877_994_615_932e-2,
        -3.653_157_274_421_691_6e-2,
        1.628_582_011_536_578_2e-2,
    ];
    if t > SQRT_2 - 1.0 {
        return FRAC_PI_4 - atan_unit((1.0 - t) / (1.0 + t));
    }
    let z = t * t;
    t - t * z * POLY.iter().rev().fold(0.0, |sum, c| sum * z + c)
}

/// `a_from_c` of `a_from_b` and `b_from_c`.
pub(crate) fn compose(a_from_b: Pose2, b_from_c: Pose2) -> Pose2 {
    let [x, y] = rotate([b_from_c.x, b_from_c.y], a_from_b.theta);
    Pose2::new(a_from_b.x + x, a_from_b.y + y, a_from_b.theta + b_from_c.theta)
}

/// `b_from_c` of `a_from_b` and `a_from_c`.
pub(crate) fn between(a_from_b: Pose2, a_from_c: Pose2) -> Pose2 {
    let [x, y] = rotate([a_from_c.x - a_from_b.x, a_from_c.y - a_from_b.y], -a_from_b.theta);
    Pose2::new(x, y, a_from_c.theta - a_from_b.theta)
}

/// The pose after driving an arc of the given length while turning by the given angle.
pub(crate) fn advance(pose: Pose2, distance_m: f64, turn_rad: f64) -> Pose2 {
    let half = 0.5 * turn_rad;
    let sinc = if half.abs() < 1e-4 { 1.0 - half * half / 6.0 } else { sin_cos(half).0 / half };
    let [x, y] = rotate([distance_m * sinc, 0.0], pose.theta + half);
    Pose2::new(pose.x + x, pose.y + y, pose.theta + turn_rad)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logarithm_and_arc_tangent_agree_with_the_standard_library() {
        for i in 1..100_000 {
            let x = f64::from(i) * 1e-5;
            assert!((ln(x) - x.ln()).abs() < 1e-14 * (1.0 + x.ln().abs()), "ln {x}");
            let angle_rad = f64::from(i - 50_000) * 6e-5;
            let (y, x) = angle_rad.sin_cos();
            assert!((atan2(3.0 * y, 3.0 * x) - y.atan2(x)).abs() < 1e-15 * 4.0, "atan2 {angle_rad}");
        }
        assert_eq!(atan2(0.0, -1.0), PI);
        assert_eq!(atan2(0.0, 0.0), 0.0);
    }

    #[test]
    fn arcs_and_groups_agree_with_the_geometry_crate() {
        let (a, b) = (Pose2::new(1.0, -2.0, 2.5), Pose2::new(0.3, 0.2, -1.0));
        assert!(compose(a, b).distance(a * b) < 1e-12);
        assert!(between(a, b).distance(a.between(b)) < 1e-12);
        let arc = advance(a, 0.7, 0.9);
        assert!(arc.distance(a * Pose2::exp([0.7, 0.0, 0.9])) < 1e-12);
    }
}
