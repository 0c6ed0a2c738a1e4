//! How fast frames are read, the median: `cargo run --release -p mapwright-clouds --example speed -- FOLDER`.

#![allow(clippy::print_stdout, reason = "it is there to print")]

#[path = "../tests/common/disk.rs"]
mod disk;

use disk::Disk;
use mapwright_clouds::{CameraOptions, Folder, recognise};
use std::error::Error;
use std::time::Instant;

/// A folder without its images of colour.
struct WithoutColour<'a>(&'a Disk);

impl Folder for WithoutColour<'_> {
    fn names(&self) -> Vec<String> {
        let is_colour = |name: &String| name.contains("color") || name.contains("rgb");
        self.0.names().into_iter().filter(|name| !is_colour(name)).collect()
    }
    fn read(&self, name: &str) -> std::io::Result<Vec<u8>> {
        self.0.read(name)
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("expected a folder or file")?;
    let disk = Disk::open(path.as_ref())?;
    time("all", &disk)?;
    time("without colours", &WithoutColour(&disk))
}

fn time(what: &str, folder: &dyn Folder) -> Result<(), Box<dyn Error>> {
    let recording = recognise(folder)?.ok_or("no recording that is read here")?;
    let mut milliseconds = Vec::new();
    let mut points = 0;
    for _ in 0..5 {
        let mut clouds = recording.clouds(&CameraOptions::default())?;
        loop {
            let begin = Instant::now();
            let Some(cloud) = clouds.next_cloud()? else { break };
            milliseconds.push(1e3 * begin.elapsed().as_secs_f64());
            points += cloud.points_m.len();
        }
    }
    let mean_points = points as f64 / milliseconds.len() as f64;
    milliseconds.sort_by(f64::total_cmp);
    let median = milliseconds[milliseconds.len() / 2];
    println!("{what}: {median:.2} ms a frame, {:.0} MB/s at 16 bytes a point", mean_points * 16.0 / median * 1e-3);
    Ok(())
}
