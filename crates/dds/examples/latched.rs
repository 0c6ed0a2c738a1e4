//! Tells a map of so many million cells on `/map`, kept for who comes later, until its input ends: for measuring how long those wait
//! (`scripts/live_late.py`).
//!
//! ```sh
//! cargo run --release -p mapwright-dds --features cyclone --example latched 4
//! ```
#![allow(clippy::print_stdout, reason = "an example says that it has begun")]

use mapwright_dds::{Configuration, Dds};
use mapwright_live::outgoing::Grid;
use mapwright_live::wire::{Delivery, Topic, Wire};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let millions: f64 = std::env::args().nth(1).map_or(Ok(4.0), |text| text.parse())?;
    let side = (millions * 1e6).sqrt() as u32;
    let cells = (0..side * side).map(|cell| (cell % 101) as i8).collect();
    let stamp = mapwright_geom::Stamp(1_000_000_000);
    let grid = Grid { stamp, resolution_m: 0.05, size: [side; 2], origin: mapwright_geom::Pose2::IDENTITY, cells };
    let mut wire = Dds::join(&Configuration::from_environment()?, "/", "latched")?;
    let map = wire.advertise(&Topic::new("/map", "nav_msgs/msg/OccupancyGrid", Delivery::Latched { depth: 1 }))?;
    map.publish(&grid.message("map")?)?;
    println!("{side} x {side}");
    std::io::copy(&mut std::io::stdin(), &mut std::io::sink())?;
    Ok(())
}
