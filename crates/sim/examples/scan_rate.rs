//! How fast scans of a 2,000 m loop are simulated: `scan_rate [length_m] [seed]`.
#![allow(clippy::print_stdout, reason = "an example")]

use mapwright_sim::{Drive, DriveSettings, worlds};
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let length_m = arguments.first().map_or(Ok(2_000.0), |text| text.parse())?;
    let seed = arguments.get(1).map_or(Ok(1), |text| text.parse())?;
    let start = Instant::now();
    let site = worlds::loop_of(seed, length_m);
    println!("world: {:.3} s", start.elapsed().as_secs_f64());
    let start = Instant::now();
    let scans = Drive::new(site.into(), DriveSettings::long_drive(seed)).scans().count();
    let seconds = start.elapsed().as_secs_f64();
    println!("{scans} scans of 180 beams in {seconds:.2} s: {:.0} scans/s", scans as f64 / seconds);
    Ok(())
}
