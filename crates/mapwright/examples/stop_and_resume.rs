//! A log that is mapped in two goes: saved in the middle, read back and gone on with. How far the end of the way then lies from
//! where a run that was never stopped has it; "killed" leaves the checkpoint out, as a run that could not stop by itself.
//!
//! `cargo run --release -p mapwright --example stop_and_resume -- LOG [PLACES] [killed]`
#![allow(clippy::print_stdout, reason = "an example's result")]

use mapwright::{LaserScan, Mapper, Pose2, Session, Settings};
use mapwright_formats::{CarmenReader, LogEvent, open_log};
use mapwright_record::LogWriter;
use std::error::Error;
use std::time::{Duration, Instant};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let scans = scans_of(&arguments.next().ok_or("which log?")?)?;
    let places = arguments.next().map_or(Ok(10), |places| places.parse::<usize>())?;
    let killed = arguments.next().is_some_and(|how| how == "killed");
    let mut whole = Mapper::new(Settings::default())?;
    scans.iter().for_each(|scan| drop(whole.add_scan(scan)));
    let (mut worst_m, mut worst_rad, mut same) = (0.0_f64, 0.0_f64, 0);
    for place in 1..=places {
        let stop = scans.len() * place / (places + 1);
        let Stopped { log, state_bytes, took } = until(&scans[..stop], killed)?;
        let since = Instant::now();
        let mut resumed = Mapper::resume(Settings::default(), Session::read(&log)?.0)?;
        let back = since.elapsed();
        scans[stop..].iter().for_each(|scan| drop(resumed.add_scan(scan)));
        let apart = last(&whole).between(last(&resumed));
        let [m, rad] = [apart.x.hypot(apart.y), apart.theta.abs()];
        let is_same = whole.trajectory().eq(resumed.trajectory());
        println!(
            "stopped after {stop} scans: {:.1} mm, {:.3} deg apart at the end, {} of {} bytes and {took:.1?} for the checkpoint, \
             {back:.0?} to resume",
            1e3 * m,
            rad.to_degrees(),
            state_bytes,
            log.len()
        );
        (worst_m, worst_rad, same) = (worst_m.max(m), worst_rad.max(rad), same + usize::from(is_same));
    }
    println!(
        "worst of {places}: {:.1} mm, {:.3} deg; the same to the bit, all the way: {same}",
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

/// A run that has ended.
struct Stopped {
    log: Vec<u8>,
    state_bytes: usize,
    took: Duration,
}

/// Maps these scans into a log.
fn until(scans: &[LaserScan], killed: bool) -> Result<Stopped, Box<dyn Error>> {
    let mut mapper = Mapper::new(Settings::default())?;
    let (mut writer, mut log) = (LogWriter::new(), Vec::new());
    for entry in scans.iter().flat_map(|scan| mapper.add_scan(scan).entries) {
        writer.append(&mut log, &entry)?;
    }
    let (since, before) = (Instant::now(), log.len());
    let entries = if killed { Vec::new() } else { mapper.checkpoint().entries };
    let took = since.elapsed();
    entries.iter().try_for_each(|entry| writer.append(&mut log, entry))?;
    let state_bytes = log.len() - before;
    writer.finish(&mut log);
    Ok(Stopped { log, state_bytes, took })
}

fn last(mapper: &Mapper) -> Pose2 {
    mapper.trajectory().last().map_or(Pose2::IDENTITY, |pose| pose.map_from_robot)
}
