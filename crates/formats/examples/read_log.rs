//! Reads a CARMEN log from standard input and says what is in it and how long reading took.
//!
//! `cargo run --release --example read_log < intel.clf`
#![allow(clippy::print_stdout)]

use mapwright_formats::{CarmenReader, FormatError, LogEvent, open_log};
use std::time::Instant;

fn main() -> Result<(), FormatError> {
    let started = Instant::now();
    let mut reader = CarmenReader::new(open_log(std::io::stdin().lock())?);
    let (mut path_m, mut last, mut beams) = (0.0, None, 0);
    while let Some(event) = reader.next_event()? {
        if let LogEvent::Scan(scan) = event {
            beams += scan.ranges_m.len();
            path_m += last.zip(scan.odom_from_robot).map_or(0.0, |(a, b): (mapwright_geom::Pose2, _)| a.distance(b));
            last = scan.odom_from_robot.or(last);
        }
    }
    let elapsed = started.elapsed();
    println!("{:#?}", reader.report());
    println!("{beams} beams, {path_m:.1} m by odometry, read in {:.1} ms", elapsed.as_secs_f64() * 1e3);
    Ok(())
}
