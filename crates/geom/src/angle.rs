//! Angles: wrapping, and a sine and cosine that are the same on every processor.

use std::f64::consts::{FRAC_2_PI, PI, TAU};

/// The angle in `(-pi, pi]` that differs from `angle_rad` by a multiple of a full turn.
///
/// NaN and infinite angles come back as NaN.
#[must_use]
pub fn wrap_angle(angle_rad: f64) -> f64 {
    if angle_rad > -PI && angle_rad <= PI {
        return angle_rad;
    }
    let wrapped = angle_rad - TAU * ((angle_rad + PI) / TAU).floor();
    if wrapped <= -PI {
        wrapped + TAU
    } else if wrapped > PI {
        wrapped - TAU
    } else {
        wrapped
    }
}

/// Sine and cosine with plain IEEE additions and multiplications only, hence bit-equal on every CPU and C library.
///
/// The error is below 1e-15 for `|angle_rad| <= 100`. The argument is reduced to `[-pi/4, pi/4]` with a three-part pi/2
/// (Cody and Waite 1980) and the minimax polynomials of fdlibm's `__kernel_sin` and `__kernel_cos` are evaluated there.
#[must_use]
pub fn sin_cos(angle_rad: f64) -> (f64, f64) {
    const PIO2_1: f64 = 1.570_796_326_734_125_6e0;
    const PIO2_2: f64 = 6.077_100_506_303_966e-11;
    const PIO2_3: f64 = 2.022_266_248_795_950_6e-21;
    let quadrant = (angle_rad * FRAC_2_PI).round();
    let r = ((angle_rad - quadrant * PIO2_1) - quadrant * PIO2_2) - quadrant * PIO2_3;
    let z = r * r;
    let sin_poly = -1.666_666_666_666_663_2e-1
        + z * (8.333_333_333_322_49e-3
            + z * (-1.984_126_982_985_795e-4
                + z * (2.755_731_370_707_007e-6 + z * (-2.505_076_025_340_686e-8 + z * 1.589_690_995_211_55e-10))));
    let cos_poly = 4.166_666_666_666_66e-2
        + z * (-1.388_888_888_887_411e-3
            + z * (2.480_158_728_947_673e-5
                + z * (-2.755_731_435_139_066_3e-7
                    + z * (2.087_572_321_298_175e-9 - z * 1.135_964_755_778_819_5e-11))));
    let sin_r = r + r * z * sin_poly;
    let cos_r = 1.0 - 0.5 * z + z * z * cos_poly;
    match (quadrant as i64).rem_euclid(4) {
        0 => (sin_r, cos_r),
        1 => (cos_r, -sin_r),
        2 => (-sin_r, -cos_r),
        _ => (-cos_r, sin_r),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrapping_lands_in_the_half_open_turn() {
        for k in -50..50 {
            for a in [1e-6 - PI, -1.0, 0.0, 0.5, PI - 1e-6] {
                let wrapped = wrap_angle(a + TAU * f64::from(k));
                assert!(wrapped > -PI && wrapped <= PI);
                assert!((wrapped - a).abs() < 1e-12);
            }
        }
        assert_eq!(wrap_angle(-PI), PI);
        assert!(wrap_angle(f64::NAN).is_nan());
        assert!(wrap_angle(f64::INFINITY).is_nan());
    }

    #[test]
    fn sine_and_cosine_agree_with_the_standard_library() {
        for i in -200_000..200_000 {
            let a = f64::from(i) * 5e-4 + 1e-5;
            let (s, c) = sin_cos(a);
            assert!((s - a.sin()).abs() < 1e-15, "sin {a}");
            assert!((c - a.cos()).abs() < 1e-15, "cos {a}");
        }
    }
}
