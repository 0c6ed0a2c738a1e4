//! What a recording holds: `cargo run --release -p mapwright-clouds --example list -- FOLDER [FX,FY,CX,CY [SCALE]]`.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "it is there to print")]

#[path = "../tests/common/disk.rs"]
mod disk;

use disk::Disk;
use mapwright_clouds::{CameraOptions, Notes, recognise};
use std::error::Error;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("expected a folder or file")?;
    let numbers = arguments.next().map(|text| text.split(',').map(str::parse).collect::<Result<Vec<f64>, _>>());
    let intrinsics = numbers.transpose()?.map(<[f64; 4]>::try_from).transpose().map_err(|_| "expected FX,FY,CX,CY")?;
    let depth_scale = arguments.next().map(|text| text.parse()).transpose()?;
    list(&Disk::open(path.as_ref())?, &CameraOptions { intrinsics, depth_scale, range_unit_m: None, baseline_m: None })
}

fn list(disk: &Disk, options: &CameraOptions) -> Result<(), Box<dyn Error>> {
    let begin = Instant::now();
    let recording = recognise(disk)?.ok_or("no recording that is read here")?;
    println!("{}: {} frames ({:.1} ms)", recording.kind(), recording.frames(), 1e3 * begin.elapsed().as_secs_f64());
    println!(
        "sensor {}: {} to {} m",
        recording.sensor().name,
        recording.sensor().range_min_m,
        recording.sensor().range_max_m
    );
    for reference in recording.references() {
        println!("reference {}: {} poses of {}", reference.file, reference.poses.len(), reference.frame);
    }
    if let Some(camera) = recording.camera(options)? {
        println!("camera {} x {}: {:?} {:?}", camera.width, camera.height, camera.focal_px, camera.centre_px);
    }
    print_notes(recording.notes());
    let mut clouds = recording.clouds(options)?;
    clouds.decisions().iter().for_each(|decision| println!("- {decision}"));
    let mut number = 0;
    loop {
        let begin = Instant::now();
        let Some(cloud) = clouds.next_cloud()? else { break };
        let milliseconds = 1e3 * begin.elapsed().as_secs_f64();
        let points = cloud.points_m.iter().filter(|point| point.iter().all(|v| v.is_finite())).count();
        let last_s = cloud.times_s.iter().copied().fold(0.0, f32::max);
        println!(
            "{number:6} {:20.9} s {points:8} points, {last_s:.4} s long, {} colours, read in {milliseconds:.1} ms",
            cloud.stamp.as_secs_f64(),
            cloud.colours.len()
        );
        number += 1;
    }
    print_notes(clouds.notes());
    Ok(())
}

fn print_notes(notes: &Notes) {
    for (kind, noted) in &notes.kinds {
        println!("note: {kind}: {} times", noted.count);
        noted.first.iter().take(3).for_each(|note| println!("    {note}"));
    }
}
