//! Matches pairs of Middlebury's first sets, and compares with their truth:
//! `cargo run --release -p mapwright-stereo --example middlebury -- ../shared/data/stereo_middlebury [--noise S] [--gain G] [--offset O] [--half] [--unique U]`.
//!
//! Noise (grey values of 255, normal), gain and offset change the right image; noise the left one as well. `--half` halves both.
#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
    clippy::panic,
    reason = "an example says what it finds, and stops where files are missing"
)]

use mapwright_stereo::{DisparityMap, GreyImage, Matcher, MatcherSettings};
use std::path::Path;

/// A pair of the data set.
struct Pair {
    name: &'static str,
    images: [&'static str; 2],
    truth: &'static str,
    /// What a pixel of disparity is in the truth.
    scale: f32,
    disparities: u32,
    /// OpenCV's SGBM leaves so much: the density at which both are compared.
    density: f64,
}

const PAIRS: [Pair; 3] = [
    Pair {
        name: "teddy",
        images: ["im2.png", "im6.png"],
        truth: "disp2.png",
        scale: 4.0,
        disparities: 64,
        density: 0.86,
    },
    Pair {
        name: "venus",
        images: ["im2.png", "im6.png"],
        truth: "disp2.pgm",
        scale: 8.0,
        disparities: 32,
        density: 0.94,
    },
    Pair {
        name: "tsukuba",
        images: ["im3.png", "im4.png"],
        truth: "disp3.pgm",
        scale: 16.0,
        disparities: 16,
        density: 0.98,
    },
];
const RUNS: usize = 21;

fn main() {
    let folder = std::env::args().nth(1).unwrap();
    let option = |name: &str, usual: f32| {
        let value = std::env::args().skip_while(|word| word != name).nth(1);
        value.map_or(usual, |value| value.parse().unwrap())
    };
    let half = std::env::args().any(|word| word == "--half");
    let (noise, gain, offset) = (option("--noise", 0.0), option("--gain", 1.0), option("--offset", 0.0));
    let uniqueness = option("--unique", 1.0);
    for pair in PAIRS {
        let folder = Path::new(&folder).join(pair.name);
        let (mut random, mut width) = (1, 0);
        let [left, right] = [0, 1].map(|side| {
            let (size, mut pixels) = read_png(&folder.join(pair.images[side]));
            width = size[0];
            for value in pixels.iter_mut().flatten() {
                let changed = if side == 1 { f32::from(*value) * gain + offset } else { f32::from(*value) };
                *value = (changed + noise * normal(&mut random)).round().clamp(0.0, 255.0) as u8;
            }
            let mut image = GreyImage::default();
            image.set_rgb8(size[0], size[1], &pixels).unwrap();
            if half { halved(&image) } else { image }
        });
        let mut truth: Vec<f32> =
            read_truth(&folder.join(pair.truth)).iter().map(|v| f32::from(*v) / pair.scale).collect();
        let mut disparities = pair.disparities;
        if half {
            truth = half_truth(&truth, width, left.size());
            disparities /= 2;
        }
        let mut matcher =
            Matcher::new(MatcherSettings { disparities: Some(disparities), uniqueness, ..MatcherSettings::default() })
                .unwrap();
        let mut map = DisparityMap::default();
        let mut times: Vec<f64> = (0..RUNS)
            .map(|_| {
                let start = cpu_ms();
                matcher.match_pair(&left, &right, &mut map).unwrap();
                cpu_ms() - start
            })
            .collect();
        times.sort_by(f64::total_cmp);
        if let Ok(dump) = std::env::var("DUMP") {
            let bytes: Vec<u8> = map.disparity().iter().flat_map(|d| d.to_le_bytes()).collect();
            std::fs::write(Path::new(&dump).join(format!("{}.f32", pair.name)), bytes).unwrap();
        }
        let known = truth.iter().filter(|truth| **truth > 0.0).count() as f64;
        let both = truth.iter().zip(map.disparity()).zip(map.sigma());
        let mut matched: Vec<(f32, f32)> = both
            .filter(|((truth, disparity), _)| **truth > 0.0 && !disparity.is_nan())
            .map(|((truth, disparity), sigma)| ((disparity - truth).abs(), *sigma))
            .collect();
        let density = matched.len() as f64 / known;
        let within = |sigmas: f32| share(&matched, |(error, sigma)| *error <= sigmas * sigma);
        let (one, two) = (within(1.0), within(2.0));
        let bad = share(&matched, |(error, _)| *error > 1.0);
        let good: Vec<f32> = matched.iter().map(|(error, _)| *error).filter(|error| *error <= 1.0).collect();
        let rms = (good.iter().map(|error| error * error).sum::<f32>() / good.len() as f32).sqrt();
        matched.sort_by(|a, b| a.1.total_cmp(&b.1));
        matched.truncate((known * pair.density) as usize);
        let surest = share(&matched, |(error, _)| *error > 1.0);
        println!(
            "{:8} density {:5.2} %, off by more than 1: {bad:5.2} %, of the surest {:.0} %: {surest:5.2} %; rms of the others {rms:.3}; within 1 sigma {one:4.1} %, 2 {two:4.1} %; {:.1} ms (least {:.1})",
            pair.name,
            100.0 * density,
            100.0 * pair.density,
            times[RUNS / 2],
            times[0],
        );
    }
}

fn share(of: &[(f32, f32)], is: impl Fn(&(f32, f32)) -> bool) -> f64 {
    100.0 * of.iter().filter(|pair| is(pair)).count() as f64 / of.len() as f64
}

/// Milliseconds that this thread has run.
fn cpu_ms() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    text.split(' ').next().unwrap().parse::<f64>().unwrap() / 1e6
}

/// A number of mean 0 and variance 1, the sum of twelve even ones.
fn normal(state: &mut u64) -> f32 {
    let mut sum = -6.0;
    for _ in 0..12 {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        sum += (*state >> 40) as f32 / 16_777_216.0;
    }
    sum
}

fn halved(image: &GreyImage) -> GreyImage {
    let [width, height] = [image.width() / 2, image.height() / 2];
    let at = |x: u32, y: u32| u32::from(image.row(y as usize)[x as usize]);
    let mean = |x, y| (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1)) / 4;
    let pixels = (0..width * height).map(|k| mean(2 * (k % width), 2 * (k / width)) as u16).collect();
    GreyImage::new(width, height, pixels).unwrap()
}

fn half_truth(truth: &[f32], stride: u32, [width, height]: [u32; 2]) -> Vec<f32> {
    let at = |k: u32| 2 * (k / width) * stride + 2 * (k % width);
    (0..width * height).map(|k| 0.5 * truth[at(k) as usize]).collect()
}

fn read_png(path: &Path) -> ([u32; 2], Vec<[u8; 3]>) {
    let file = std::fs::File::open(path).unwrap_or_else(|cause| panic!("{}: {cause}", path.display()));
    let mut decoder = png::Decoder::new(std::io::BufReader::new(file));
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    let samples = info.color_type.samples();
    let colour = |p: &[u8]| if samples >= 3 { [p[0], p[1], p[2]] } else { [p[0]; 3] };
    ([info.width, info.height], bytes.chunks_exact(samples).map(colour).collect())
}

/// Grey values of a PNG or of a PGM without comments.
fn read_truth(path: &Path) -> Vec<u8> {
    if path.extension().is_some_and(|ending| ending == "png") {
        return read_png(path).1.iter().map(|pixel| pixel[0]).collect();
    }
    let bytes = std::fs::read(path).unwrap();
    let header = bytes.iter().enumerate().filter(|(_, byte)| byte.is_ascii_whitespace()).nth(3).unwrap().0;
    bytes[header + 1..].to_vec()
}
