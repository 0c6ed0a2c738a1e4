//! Matches the pairs of a folder of Middlebury's first sets, and compares with their truth:
//! `cargo run --release -p mapwright-stereo --example middlebury -- ../shared/data/stereo_middlebury`.
#![allow(clippy::print_stdout, clippy::unwrap_used, clippy::panic, reason = "an example says what it finds, and stops where files are missing")]

use mapwright_stereo::*;
use std::path::Path;

type Sets = [(&'static str, [&'static str; 2], &'static str, f32, u32); 3];
const SETS: Sets = [
    ("teddy", ["im2.png", "im6.png"], "disp2.png", 4.0, 64),
    ("venus", ["im2.png", "im6.png"], "disp2.pgm", 8.0, 32),
    ("tsukuba", ["im3.png", "im4.png"], "disp3.pgm", 16.0, 16),
];

fn read_png(path: &Path) -> ([u32; 2], Vec<[u8; 3]>) {
    let mut decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).unwrap()));
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    let n = info.color_type.samples();
    let pixels = bytes.chunks_exact(n).map(|p| if n >= 3 { [p[0], p[1], p[2]] } else { [p[0]; 3] }).collect();
    ([info.width, info.height], pixels)
}

fn read_truth(path: &Path) -> Vec<u8> {
    if path.extension().is_some_and(|e| e == "png") {
        return read_png(path).1.iter().map(|p| p[0]).collect();
    }
    let bytes = std::fs::read(path).unwrap();
    let mut at = 0;
    for _ in 0..4 {
        while !bytes[at].is_ascii_whitespace() { at += 1; }
        at += 1;
    }
    bytes[at..].to_vec()
}

fn env<T: std::str::FromStr>(key: &str, default: T) -> T {
    std::env::var(key).ok().and_then(|v| v.parse().ok()).unwrap_or(default)
}

/// Milliseconds that this thread ran.
fn cpu_ms() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    text.split(' ').next().unwrap().parse::<f64>().unwrap() / 1e6
}

fn main() {
    match env("WINDOW", 0u8) {
        0 | 6 | 7 => go::<4>(),
        1 => go::<3>(),
        2 => go::<8>(),
        3 => go::<3>(),
        4 => go::<5>(),
        _ => go::<6>(),
    }
}
fn go<const P: usize>() {
    let folder = std::env::args().nth(1).unwrap();
    for (name, images, truth, scale, disparities) in SETS {
        let folder = Path::new(&folder).join(name);
        let mut pair = [GreyImage::default(), GreyImage::default()];
        let noise: f32 = env("NOISE", 0.0);
        let mut seed = 1u64;
        for (i, (image, file)) in pair.iter_mut().zip(images).enumerate() {
            let ([w, h], mut pixels) = read_png(&folder.join(file));
            for p in pixels.iter_mut().flatten() {
                let mut v = f32::from(*p);
                if i == 1 { v = v * env("GAIN", 1.0) + env("OFFSET", 0.0); }
                if noise > 0.0 {
                    let mut g = -6.0;
                    for _ in 0..12 { seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407); g += (seed >> 40) as f32 / (1u64 << 24) as f32; }
                    v += g * noise;
                }
                *p = v.round().clamp(0.0, 255.0) as u8;
            }
            image.set_rgb8(w, h, &pixels).unwrap();
        }
        let truth = read_truth(&folder.join(truth));
        let d = MatcherSettings::default();
        let settings = MatcherSettings {
            disparities: Some(disparities), small: env("P1", d.small), large: env("P2", d.large), large_least: env("P2MIN", d.large_least),
            unique: env("UNIQ", d.unique), patch: env("PATCH", d.patch), outside: env("OUTSIDE", d.outside), fit: env("FIT", d.fit), window: env("WINDOW", 0), lr: env("LR", d.lr), median: env("MEDIAN", d.median), lrmode: env("LRMODE", 0), smooth: env("SMOOTH", 0), dead: env("DEAD", 0),
        };
        let mut matcher = MatcherOf::<P>::new(settings).unwrap();
        let mut map = DisparityMap::default();
        let [left, right] = &pair;
        let mut times: Vec<f64> = (0..env("RUNS", 5)).map(|_| {
            let start = cpu_ms();
            matcher.match_pair(left, right, &mut map).unwrap();
            cpu_ms() - start
        }).collect();
        times.sort_by(f64::total_cmp);
        let (mut known, mut matched, mut bad, mut one, mut two, mut good, mut sq) = (0, 0, 0, 0, 0, 0, 0.0);
        for ((t, d), s) in truth.iter().zip(map.disparity()).zip(map.sigma()) {
            if *t == 0 { continue; }
            known += 1;
            if d.is_nan() { continue; }
            matched += 1;
            let e = (d - f32::from(*t) / scale).abs();
            if e > 1.0 { bad += 1 } else { good += 1; sq += e * e; }
            if e < *s { one += 1 }
            if e < 2.0 * s { two += 1 }
        }
        if let Ok(dump) = std::env::var("DUMP") { std::fs::write(format!("{dump}/{name}.f32"), map.disparity().iter().flat_map(|d| d.to_le_bytes()).collect::<Vec<u8>>()).unwrap(); }
        let pc = |a: i32, b: i32| 100.0 * f64::from(a) / f64::from(b);
        println!("{name:8} density {:5.1} %  bad {:5.2} %  rms of good {:.3}  within 1 sigma {:4.1} %, 2 {:4.1} %  {:.1} ms (least {:.1})",
            pc(matched, known), pc(bad, matched), (sq / good as f32).sqrt(), pc(one, matched), pc(two, matched), times[times.len() / 2], times[0]);
    }
}
