//! A log that is mapped in two goes: saved in the middle, read back and gone on with. How far the end of the way then lies from
//! where a run that was never stopped has it.
//!
//! `cargo run --release -p mapwright --example stop_and_resume -- LOG [PLACES]`
#![allow(clippy::print_stdout, reason = "an example's result")]

use mapwright::{LaserScan, Mapper, Pose2, Session, Settings};
use mapwright_formats::{CarmenReader, LogEvent, open_log};
use mapwright_record::LogWriter;
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let scans = scans_of(&arguments.next().ok_or("which log?")?)?;
    let places = arguments.next().map_or(Ok(10), |places| places.parse::<usize>())?;
    let whole = mapped(Mapper::new(Settings::default())?, &scans, None)?;
    let (mut worst_m, mut worst_rad, mut same) = (0.0_f64, 0.0_f64, 0);
    for place in 1..=places {
        let stop = scans.len() * place / (places + 1);
        let resumed = mapped(Mapper::new(Settings::default())?, &scans, Some(stop))?;
        let apart = last(&whole).between(last(&resumed));
        let [m, rad] = [apart.x.hypot(apart.y), apart.theta.abs()];
        println!("stopped after {stop} scans: {:.1} mm, {:.3} deg apart at the end", 1e3 * m, rad.to_degrees());
        (worst_m, worst_rad, same) = (worst_m.max(m), worst_rad.max(rad), same + usize::from(m == 0.0));
    }
    println!(
        "worst of {places}: {:.1} mm, {:.3} deg; the same to the bit: {same}",
        1e3 * worst_m,
        worst_rad.to_degrees()
    );
    Ok(())
}

fn scans_of(path: &str) -> Result<Vec<LaserScan>, Box<dyn Error>> {
    let mut log = CarmenReader::new(open_log(std::fs::File::open(path)?)?);
    let mut scans = Vec::new();
    while let Some(event) = log.next_event()? {
        if let LogEvent::Scan(scan) = event {
            scans.push(scan.clone());
        }
    }
    Ok(scans)
}

/// Maps all scans; after so many the mapper is saved as the bytes of a log, and another one goes on with these.
fn mapped(mut mapper: Mapper, scans: &[LaserScan], stop: Option<usize>) -> Result<Mapper, Box<dyn Error>> {
    let (mut writer, mut bytes) = (LogWriter::new(), Vec::new());
    for (number, scan) in scans.iter().enumerate() {
        if stop == Some(number) {
            writer.finish(&mut bytes);
            mapper = Mapper::resume(*mapper.settings(), Session::read(&bytes)?.0)?;
        }
        for entry in mapper.add_scan(scan).entries {
            if stop.is_some_and(|stop| number < stop) {
                writer.append(&mut bytes, &entry)?;
            }
        }
    }
    Ok(mapper)
}

fn last(mapper: &Mapper) -> Pose2 {
    mapper.trajectory().last().map_or(Pose2::IDENTITY, |pose| pose.map_from_robot)
}
