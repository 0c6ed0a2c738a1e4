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
    type Truth = dyn Fn(f64, f64) -> f64;
    let planes: [(&str, &Truth); 8] = [
        ("level.1", &|_, _| 12.1),
        ("level.2", &|_, _| 12.2),
        ("level.3", &|_, _| 12.3),
        ("level.4", &|_, _| 12.4),
        ("level.5", &|_, _| 12.5),
        ("ground", &|_, y| 5.0 + 0.12 * y),
        ("wall", &|x, _| 8.0 + 0.08 * x),
        ("both", &|x, y| 6.0 + 0.03 * x + 0.05 * y),
    ];
    // grey values of 255, and the error that is left, pixels
    for (noise, most) in [(0.0, 0.09), (2.0, 0.11), (5.0, 0.16), (10.0, 0.25)] {
        for (name, truth) in planes {
            let all = errors(&matched(&plane(truth, noise), 32), truth);
            let off = rms(all.iter().map(|(error, _)| *error));
            let said = rms(all.iter().map(|(_, sigma)| *sigma));
            let normalised = rms(all.iter().map(|(error, sigma)| error / sigma));
            let known = all.len() as f64 / (f64::from(HEIGHT - 12) * f64::from(WIDTH - 46));
            println!(
                "noise {noise:4.1} {name:7} known {known:.3} rms {off:.3} said {said:.3} normalised {normalised:.2}"
            );
            assert!(known > 0.99 && off < most, "{name} with noise {noise}: {known} {off}");
            assert!(normalised < 1.0, "{name} with noise {noise}: {normalised}");
            assert!(noise < 2.0 || normalised > 0.4, "{name} with noise {noise}: {normalised}");
        }
    }
}

/// A square in front of a wall.
fn square_and_wall() -> [GreyImage; 2] {
    let wall = Surface { seed: 5, disparity: &|_, _| 6.0, is_there: &|_, _| true };
    let square = Surface { seed: 9, disparity: &|_, _| 18.0, is_there: &is_square };
    draw(&[wall, square], 2.0, 77, 0.0)
}

fn is_square(x: f64, y: f64) -> bool {
    (80.0..130.0).contains(&x) && (40.0..90.0).contains(&y)
}

#[test]
fn what_one_camera_sees_is_unknown() {
    let map = matched(&square_and_wall(), 32);
    let (mut hidden, mut hidden_known, mut seen, mut wrong, mut known) = (0, 0, 0, 0, 0);
    for (x, y) in (10..HEIGHT - 10).flat_map(|y| (30..WIDTH - 10).map(move |x| (x, y))) {
        let (u, v) = (f64::from(x), f64::from(y));
        // the square hides from the right camera what lies 12 pixels left of it
        let is_hidden = !is_square(u, v) && is_square(u + 12.0, v);
        let at = map.at(x, y);
        if is_hidden {
            hidden += 1;
            hidden_known += u32::from(at.is_some());
        } else {
            seen += 1;
            let truth = if is_square(u, v) { 18.0 } else { 6.0 };
            known += u32::from(at.is_some());
            wrong += u32::from(at.is_some_and(|(d, _)| (d - truth).abs() > 1.0));
        }
    }
    println!("hidden {hidden}, of which known {hidden_known}; seen {seen}, known {known}, wrong {wrong}");
    assert!(5 * hidden_known < 2 * hidden, "{hidden_known} of {hidden}");
    assert!(100 * known > 97 * seen && 100 * wrong < 2 * seen, "{known} and {wrong} of {seen}");
}

#[test]
fn a_matcher_is_used_again_for_any_size() {
    let small = square_and_wall().map(|image| {
        let rows = image.pixels().chunks(WIDTH as usize).take(50);
        GreyImage::new(101, 50, rows.flat_map(|row| &row[40..141]).copied().collect()).unwrap()
    });
    let large = plane(&|x, _| 8.0 + 0.08 * x, 5.0);
    let settings = MatcherSettings { disparities: Some(32), ..MatcherSettings::default() };
    let (mut matcher, mut map) = (Matcher::new(settings).unwrap(), DisparityMap::default());
    for [left, right] in [&large, &small, &large] {
        matcher.match_pair(left, right, &mut map).unwrap();
        let fresh = matched(&[left.clone(), right.clone()], 32);
        let bits =
            |map: &DisparityMap| map.disparity().iter().chain(map.sigma()).map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&map), bits(&fresh));
    }
}

#[test]
fn gain_offset_and_bits_do_not_matter() {
    let [left, right] = plane(&|x, _| 8.0 + 0.08 * x, 2.0);
    let before = matched(&[left.clone(), right.clone()], 32);
    let changed = |image: &GreyImage, gain: u16, offset: u16| {
        GreyImage::new(WIDTH, HEIGHT, image.pixels().iter().map(|v| gain * v + offset).collect()).unwrap()
    };
    let same = before
        .disparity()
        .iter()
        .zip(matched(&[changed(&left, 200, 9), changed(&right, 100, 3000)], 32).disparity().to_vec());
    let apart = rms(same.filter(|(a, b)| !a.is_nan() && !b.is_nan()).map(|(a, b)| f64::from(a - b)));
    assert!(apart < 0.05, "{apart}");
}

#[test]
fn images_of_one_value_are_of_no_depth() {
    let flat = GreyImage::new(64, 48, vec![100; 64 * 48]).unwrap();
    let map = matched(&[flat.clone(), flat], 16);
    let camera = mapwright_stereo::StereoCamera {
        width: 64,
        height: 48,
        fx: 60.0,
        fy: 60.0,
        cx: 32.0,
        cx_right: 32.0,
        cy: 24.0,
        baseline_m: 0.1,
    };
    assert_eq!(map.points(&camera).count(), 0);
}

#[test]
fn swapped_images_are_found() {
    let [left, right] = square_and_wall();
    let pairing = Pairing::of(&left, &right, 0.0).unwrap();
    assert!(pairing.matched > 40 && pairing.words().is_empty(), "{pairing:?} {:?}", pairing.words());
    assert!((pairing.disparity_px - 6.0).abs() < 0.3 && pairing.lower_px.abs() < 0.1, "{pairing:?}");
    let swapped = Pairing::of(&right, &left, 0.0).unwrap();
    assert!(swapped.is_swapped(), "{swapped:?}");
    let words = swapped.words();
    assert!(words.len() == 1 && words[0].ends_with("left and right are swapped"), "{words:?}");
}

#[test]
fn rows_that_do_not_lie_beside_each_other_are_found() {
    for lower in [-4.0, 2.5] {
        let surface = Surface { seed: 5, disparity: &|x, _| 8.0 + 0.08 * x, is_there: &|_, _| true };
        let [left, right] = draw(&[surface], 2.0, 77, lower);
        let pairing = Pairing::of(&left, &right, 0.0).unwrap();
        assert!((f64::from(pairing.lower_px) - lower).abs() < 0.2, "{pairing:?}");
        assert!(pairing.is_misaligned() && !pairing.is_swapped());
        let words = pairing.words();
        assert!(words[0].contains("pixels lower than the left one") && words[0].contains("not rectified"), "{words:?}");
    }
}

#[test]
fn images_of_different_things_are_found() {
    let [left, _] = plane(&|_, _| 8.0, 2.0);
    let other = draw(&[Surface { seed: 500, disparity: &|_, _| 8.0, is_there: &|_, _| true }], 2.0, 3, 0.0);
    let pairing = Pairing::of(&left, &other[1], 0.0).unwrap();
    assert!(!pairing.is_swapped() && !pairing.words().is_empty(), "{pairing:?}");
    let flat = GreyImage::new(WIDTH, HEIGHT, vec![9; (WIDTH * HEIGHT) as usize]).unwrap();
    assert_eq!(Pairing::of(&flat, &flat, 0.0).unwrap().matched, 0);
}

#[test]
fn what_cannot_be_matched_is_refused() {
    let of = |width, height| GreyImage::new(width, height, vec![1; (width * height) as usize]).unwrap();
    let told = |settings: MatcherSettings, left: GreyImage, right: GreyImage| {
        let matcher = Matcher::new(settings);
        matcher.and_then(|mut m| m.match_pair(&left, &right, &mut DisparityMap::default())).unwrap_err().to_string()
    };
    let usual = MatcherSettings::default();
    assert_eq!(told(usual, of(20, 10), of(20, 11)), "right image: expected 20 x 10 pixels, found 20 x 11");
    let many = MatcherSettings { disparities: Some(20), ..usual };
    assert_eq!(told(many, of(20, 10), of(20, 10)), "disparities: expected fewer than the image's 20 columns, found 20");
    assert!(told(MatcherSettings { disparities: Some(1), ..usual }, of(20, 10), of(20, 10)).contains("2 at least"));
    assert!(told(MatcherSettings { uniqueness: f32::NAN, ..usual }, of(20, 10), of(20, 10)).contains("found NaN"));
    assert!(told(usual, of(2, 2), of(2, 2)).contains("disparities"));
    assert!(Pairing::of(&of(20, 10), &of(19, 10), 0.0).unwrap_err().to_string().contains("found 19 x 10"));
    // the smallest images are none the less matched
    for (width, height) in [(3, 1), (4, 1), (3, 2), (3, 3), (5, 4)] {
        let image = of(width, height);
        Matcher::new(usual).unwrap().match_pair(&image, &image, &mut DisparityMap::default()).unwrap();
        Pairing::of(&image, &image, 0.0).unwrap();
    }
}
