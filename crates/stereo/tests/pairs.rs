//! Pairs whose disparities are known, because they were drawn.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests say what they expect by unwrapping it")]

use mapwright_stereo::{DisparityMap, GreyImage, Matcher, MatcherSettings, Pairing};

const WIDTH: u32 = 200;
const HEIGHT: u32 = 120;

/// Numbers that look random, by their place.
fn hash(seed: u64, x: i64, y: i64) -> f64 {
    let mut h = seed ^ (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (y as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
    for _ in 0..3 {
        h ^= h >> 31;
        h = h.wrapping_mul(0x7fb5_d329_728e_a185);
    }
    (h >> 11) as f64 / (1_u64 << 53) as f64
}

/// A texture without edges of pixels: values of a lattice, between which cosines go.
fn texture(seed: u64, x: f64, y: f64) -> f64 {
    let octave = |spacing: f64, seed: u64| {
        let (u, v) = (x / spacing, y / spacing);
        let ease = |t: f64| 0.5 - 0.5 * (std::f64::consts::PI * t.fract().rem_euclid(1.0)).cos();
        let (i, j) = (u.floor() as i64, v.floor() as i64);
        let (a, b) = (ease(u - u.floor()), ease(v - v.floor()));
        let at = |di, dj| hash(seed, i + di, j + dj);
        (at(0, 0) * (1.0 - a) + at(1, 0) * a) * (1.0 - b) + (at(0, 1) * (1.0 - a) + at(1, 1) * a) * b
    };
    0.5 * octave(3.0, seed) + 0.5 * octave(11.0, seed + 1)
}

/// A surface: where it is in the left image, its texture there, and its disparity.
struct Surface<'a> {
    seed: u64,
    disparity: &'a dyn Fn(f64, f64) -> f64,
    is_there: &'a dyn Fn(f64, f64) -> bool,
}

/// What each camera sees of surfaces, the nearest last. The right camera's row lies that much lower.
fn draw(surfaces: &[Surface<'_>], noise: f64, seed: u64, lower: f64) -> [GreyImage; 2] {
    let shade = |value: f64, x: u32, y: u32, side: u64| {
        let random: f64 = (0..12).map(|k| hash(seed + 10 * side + 100 * k, i64::from(x), i64::from(y))).sum();
        (40.0 + 170.0 * value + noise * (random - 6.0)).round().clamp(0.0, 255.0) as u16
    };
    let image = |side: u64| {
        let mut pixels = Vec::new();
        for y in 0..HEIGHT {
            for x in 0..WIDTH {
                let v = f64::from(y) - if side == 1 { lower } else { 0.0 };
                let mut value = 0.0;
                for surface in surfaces {
                    let mut u = f64::from(x);
                    // the column in the left image of what is seen at this one of the right
                    for _ in 0..if side == 1 { 30 } else { 0 } {
                        u = f64::from(x) + (surface.disparity)(u, v);
                    }
                    if (surface.is_there)(u, v) {
                        value = texture(surface.seed, u, v);
                    }
                }
                pixels.push(shade(value, x, y, side));
            }
        }
        GreyImage::new(WIDTH, HEIGHT, pixels).unwrap()
    };
    [image(0), image(1)]
}

fn plane(disparity: &dyn Fn(f64, f64) -> f64, noise: f64) -> [GreyImage; 2] {
    draw(&[Surface { seed: 5, disparity, is_there: &|_, _| true }], noise, 77, 0.0)
}

fn matched([left, right]: &[GreyImage; 2], disparities: u32) -> DisparityMap {
    let settings = MatcherSettings { disparities: Some(disparities), ..MatcherSettings::default() };
    let mut map = DisparityMap::default();
    Matcher::new(settings).unwrap().match_pair(left, right, &mut map).unwrap();
    map
}

/// Errors of what is known, away from the edges, with the standard deviations that are said.
fn errors(map: &DisparityMap, truth: &dyn Fn(f64, f64) -> f64) -> Vec<(f64, f64)> {
    let places = (6..HEIGHT - 6).flat_map(|y| (40..WIDTH - 6).map(move |x| (x, y)));
    let known = places.filter_map(|(x, y)| map.at(x, y).map(|known| (x, y, known)));
    known.map(|(x, y, (d, sigma))| (f64::from(d) - truth(f64::from(x), f64::from(y)), f64::from(sigma))).collect()
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value * value, count + 1.0));
    f64::sqrt(sum / count)
}

#[test]
fn sigma_is_honest_of_planes_of_any_slant_and_noise() {
    let slants: [(&str, &dyn Fn(f64, f64) -> f64); 8] = [
        ("level.1", &|_, _| 12.1), ("level.2", &|_, _| 12.2), ("level.3", &|_, _| 12.3), ("level.4", &|_, _| 12.4), ("level.5", &|_, _| 12.5),
        ("ground", &|_, y| 5.0 + 0.12 * y),
        ("wall", &|x, _| 8.0 + 0.08 * x),
        ("both", &|x, y| 6.0 + 0.03 * x + 0.05 * y),
    ];
    for noise in [0.0, 2.0, 5.0, 10.0] {
        for (name, truth) in slants {
            let map = matched(&plane(truth, noise), 32);
            let all = errors(&map, truth);
            let good: Vec<_> = all.iter().filter(|(error, _)| error.abs() <= 1.0).collect();
            let off = rms(good.iter().map(|(error, _)| *error));
            let normalised = rms(good.iter().map(|(error, sigma)| error / sigma));
            let mean = good.iter().map(|(error, _)| *error).sum::<f64>() / good.len() as f64;
            let wrong = 1.0 - good.len() as f64 / all.len() as f64;
            println!(
                "noise {noise:4.1} {name:6} known {:.3} wrong {wrong:.4} rms {off:.3} mean {mean:.3} said {:.3} normalised {normalised:.2}",
                all.len() as f64 / (f64::from(HEIGHT - 12) * f64::from(WIDTH - 46)),
                rms(good.iter().map(|(_, sigma)| *sigma)),
            );
        }
    }
}
