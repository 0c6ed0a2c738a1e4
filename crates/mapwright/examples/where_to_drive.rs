//! A corridor that comes back to its start, before and after it is closed: how certain the map is, where to drive next,
//! and pictures of both.
//!
//! `cargo run --release -p mapwright --example where_to_drive -- FOLDER [LENGTH_M [SHARE]]`

#![allow(clippy::print_stdout)]

use mapwright::{Advice, Mapper, Pose2, Settings};
use mapwright_formats::{Confidence, GridImage, Picture, UNKNOWN, write_png};
use mapwright_sim::{Drive, DriveSettings, worlds};
use std::error::Error;
use std::fs::File;
use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().ok_or("expected a folder")?;
    let length_m: f64 = arguments.next().map_or(Ok(500.0), |text| text.parse())?;
    let share: f64 = arguments.next().map_or(Ok(0.72), |text| text.parse())?;
    let drive = Drive::new(worlds::grand_loop(1, length_m).into(), DriveSettings::default());
    let mut settings = Settings::default();
    settings.set("live.policy", "gated")?;
    let mut mapper = Mapper::new(settings)?;
    let (mut before, mut travelled_m, mut shown) = (None::<Pose2>, 0.0, false);
    for recorded in drive.scans() {
        let truth = recorded.world_from_robot;
        travelled_m += before.map_or(0.0, |before| before.distance(truth));
        before = Some(truth);
        mapper.add_scan(&recorded.scan);
        if travelled_m > share * length_m && !shown {
            shown = true;
            show(&mapper, &Path::new(&folder).join("open.png"))?;
        }
    }
    show(&mapper, &Path::new(&folder).join("closed.png"))
}

fn show(mapper: &Mapper, file: &Path) -> Result<(), Box<dyn Error>> {
    let start = Instant::now();
    let advice = Advice::of(mapper.session());
    let took_ms = 1e3 * start.elapsed().as_secs_f64();
    println!(
        "{}: {} keyframes, mean {:.3} m, worst {:.3} m, {took_ms:.0} ms",
        file.display(),
        mapper.keyframes().len(),
        advice.mean_sigma_m,
        advice.worst_sigma_m
    );
    for place in &advice.places {
        let ([x, y], way_m) = (place.at, place.way_m());
        println!("  ({x:.1}, {y:.1}), {:.0} m, way {way_m:.0?} m: to {:.3} m", place.away_m, place.mean_sigma_after_m);
    }
    let way: Vec<Pose2> = mapper.trajectory().map(|pose| pose.map_from_robot).collect();
    let seen_from: Vec<_> =
        mapper.keyframe_poses().iter().map(|pose| [pose.x, pose.y]).zip(advice.keyframe_sigmas_m).collect();
    let places: Vec<_> = advice.places.iter().map(|place| place.at).collect();
    let confidence = Some(Confidence { seen_from: &seen_from, places: &places });
    let picture = Picture { world_from_robot: &way, confidence, ..Picture::default() };
    Ok(write_png(&image(mapper), &picture, File::create(file)?)?)
}

fn image(mapper: &Mapper) -> GridImage {
    let counts = mapper.render();
    let known: Vec<_> = counts.known_cells().collect();
    let span = |along: fn(&(i32, i32, u32, u32)) -> i32| {
        let (low, high) =
            known.iter().map(along).fold((i32::MAX, i32::MIN), |(low, high), at| (low.min(at), high.max(at)));
        if known.is_empty() { (0, 1) } else { (low, (high - low + 1) as usize) }
    };
    let ((left, width), (bottom, height)) = (span(|cell| cell.0), span(|cell| cell.1));
    let mut cells = vec![UNKNOWN; width * height];
    for (x, y, hits, passes) in known {
        let percent = if 5 * hits >= passes { 100 } else { 0 };
        cells[(y - bottom) as usize * width + (x - left) as usize] = percent;
    }
    let resolution_m = counts.resolution_m();
    let world_from_map = Pose2::new(f64::from(left) * resolution_m, f64::from(bottom) * resolution_m, 0.0);
    GridImage { width, height, resolution_m, world_from_map, cells }
}
