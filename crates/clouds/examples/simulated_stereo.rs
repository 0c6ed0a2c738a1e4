//! How far points of simulated pairs are off, beside what is said of each.
//! `cargo run --release -p mapwright-clouds --example simulated_stereo -- 5 20 6`: seed, pairs, every so many-th of thirty a second.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "an example")]

use mapwright_clouds::{StereoDepth, StereoPairPlan};
use mapwright_sensor::{PinholeCamera, SpaceSensor};
use mapwright_sim::space::{DepthSettings, SpaceDrive, SpaceDriveSettings, StereoSettings, worlds};
use mapwright_stereo::{GreyImage, StereoCamera};
use std::sync::Arc;

/// Nearest and farthest of what is told apart, metres.
const RANGES_M: [[f64; 2]; 5] = [[0.0, 1.0], [1.0, 2.0], [2.0, 3.0], [3.0, 5.0], [5.0, 99.0]];

fn main() {
    let number = |at: usize, usual: u64| std::env::args().nth(at).map_or(usual, |word| word.parse().unwrap());
    let (seed, pairs, every) = (number(1, 5), number(2, 20), number(3, 6));
    let exact = SpaceSensor {
        range_sigma_m: 0.0,
        range_sigma_per_m: 0.0,
        range_max_m: 200.0,
        range_min_m: 0.0,
        ..(*DepthSettings::default().sensor).clone()
    };
    let depth = DepthSettings {
        sensor: Arc::new(exact),
        dropout_probability: 0.0,
        edge_dropout_probability: 1.0,
        ..DepthSettings::default()
    };
    let drive = SpaceDrive::new(
        worlds::two_storey(seed).into(),
        SpaceDriveSettings { seed, depth, ..SpaceDriveSettings::default() },
    );
    let StereoSettings { camera, baseline_m, .. } = drive.stereo_camera().clone();
    let PinholeCamera { width, height, focal_px: [fx, fy], centre_px: [cx, cy], .. } = *camera;
    let pair = StereoCamera { width, height, fx, fy, cx, cx_right: cx, cy, baseline_m };
    let mut stereo = StereoDepth::new(&StereoPairPlan::Rectified(pair), None).unwrap();
    let sensor = Arc::new(stereo.sensor("stereo"));
    let mut found: Vec<[f64; 3]> = Vec::new();
    let mut pixels = 0;
    for k in (0..pairs).map(|k| k * every) {
        let (Some(taken), Some(truth)) = (drive.stereo_pair(k), drive.depth_image(k)) else { break };
        let image = |values: &[u8]| {
            let mut image = GreyImage::default();
            image.set_grey8(width, height, values).unwrap();
            image
        };
        let (left, right) = (image(&taken.left), image(&taken.right));
        let cloud = stereo.cloud((&left, &right), (taken.stamp, &sensor), Vec::new()).unwrap();
        pixels += cloud.points_m.len();
        for ((point, sigma_m), true_m) in cloud.points_m.iter().zip(&cloud.sigmas_m).zip(&truth.image.depth_m) {
            if point[2].is_finite() && *true_m > 0.0 {
                // along the ray, as the standard deviation is
                let ray = point.iter().map(|v| v * v).sum::<f32>().sqrt() / point[2];
                found.push([f64::from(*true_m), f64::from((point[2] - true_m) * ray), f64::from(*sigma_m)]);
            }
        }
    }
    println!("{} of {pixels} pixels have a depth", found.len());
    for [least_m, most_m] in RANGES_M {
        let of: Vec<_> = found.iter().filter(|[true_m, ..]| (least_m..most_m).contains(true_m)).collect();
        let share = |is: &dyn Fn(f64, f64) -> bool| {
            100.0 * of.iter().filter(|[_, off, sigma]| is(*off, *sigma)).count() as f64 / of.len().max(1) as f64
        };
        let mut sigmas: Vec<f64> = of.iter().map(|[_, _, sigma]| *sigma).collect();
        let mut offs: Vec<f64> = of.iter().map(|[_, off, _]| off.abs()).collect();
        sigmas.sort_by(f64::total_cmp);
        offs.sort_by(f64::total_cmp);
        let mean = of.iter().map(|[_, off, _]| off).filter(|off| off.abs() < 0.5).sum::<f64>() / of.len().max(1) as f64;
        let at =
            |values: &[f64], share: f64| values.get((share * values.len() as f64) as usize).copied().unwrap_or(0.0);
        println!(
            "{least_m} to {most_m} m: {} points; sigma median {:.3} m, off median {:.3}, 90 % {:.3}, mean {mean:.4}; within 1 sigma {:.0} %, 2 {:.0} %, 3 {:.0} %, beyond 6 {:.1} %",
            of.len(),
            at(&sigmas, 0.5),
            at(&offs, 0.5),
            at(&offs, 0.9),
            share(&|off, sigma| off.abs() <= sigma),
            share(&|off, sigma| off.abs() <= 2.0 * sigma),
            share(&|off, sigma| off.abs() <= 3.0 * sigma),
            share(&|off, sigma| off.abs() > 6.0 * sigma),
        );
    }
}
