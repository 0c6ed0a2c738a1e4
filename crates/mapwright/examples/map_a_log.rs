//! Maps a CARMEN log, plain or compressed: `cargo run --release -p mapwright --example map_a_log -- intel.log.gz`
#![allow(clippy::print_stdout, reason = "an example's result")]

use mapwright::{Mapper, Settings};
use mapwright_formats::{CarmenReader, LogEvent, open_log};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("which log?")?;
    let mut log = CarmenReader::new(open_log(std::fs::File::open(path)?)?);
    let mut mapper = Mapper::new(Settings::default())?;
    while let Some(event) = log.next_event()? {
        match event {
            LogEvent::Scan(scan) => drop(mapper.add_scan(scan)),
            LogEvent::Odometry(odometry) => mapper.add_odometry(odometry),
            _ => {}
        }
    }
    println!("{} keyframes; the robot ended at {:?}", mapper.keyframes().len(), mapper.trajectory().last());
    Ok(())
}
