//! Scans metres apart: how often a match is wrong, and what it does to the map.
//!
//! `cargo run --release -p mapwright --example sparse` drives through simulated buildings with a scan every three seconds.
//! `... --example sparse -- LOG REFERENCE [STARTS [FIRST [NOISE]]]` maps a CARMEN log from STARTS start poses, from number
//! FIRST on, odometry's increments perturbed by NOISE, and prints each run's distance (rms) from the reference's poses,
//! lines of stamp, x, y and heading.
#![allow(clippy::print_stdout, reason = "an example's result")]

use mapwright::{LaserScan, Mapper, Pose2, Settings, Status};
use mapwright_eval::{Alignment, PosePair, ate_of_pairs};
use mapwright_formats::{CarmenReader, LogEvent, open_log};
use mapwright_sim::{Drive, DriveSettings, PerturbScans, Site, TrueScan, worlds};
use std::collections::BTreeMap;
use std::error::Error;

/// Simulated buildings of each kind.
const WORLDS: u64 = 12;
const SCANS_PER_S: f64 = 0.3;
/// A step that is off by more is a wrong match.
const WRONG_M: f64 = 0.3;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [log, reference, numbers @ ..] = arguments.as_slice() else {
        for (kind, noise) in [("loop", 0.0), ("loop", 0.15), ("office", 0.0), ("rooms", 0.0)] {
            println!("{kind}, odometry noise {noise}: {}", drives(kind, noise)?);
        }
        return Ok(());
    };
    let number = |k: usize, default: f64| numbers.get(k).map_or(Ok(default), |text| text.parse());
    let (starts, first, noise) = (number(0, 8.0)?, number(1, 0.0)?, number(2, 0.0)?);
    let (scans, reference) = (read_log(log)?, read_reference(reference)?);
    for k in 0..starts as u64 {
        println!("{:.3}", rms_m(&scans, &reference, first as u64 + k, noise)?);
    }
    Ok(())
}

/// Wrong matches, the silent ones among them, and the final maps' errors.
fn drives(kind: &str, noise: f64) -> Result<String, Box<dyn Error>> {
    let (mut steps, mut wrong, mut silent) = (0, 0, 0);
    let mut errors = Vec::new();
    for seed in 0..WORLDS {
        let scans = recording(site(kind, seed), noise, seed);
        let mut mapper = Mapper::new(Settings::default())?;
        let mut last: Option<(Pose2, Pose2)> = None;
        for TrueScan { scan, world_from_robot } in &scans {
            let update = mapper.add_scan(scan);
            if let Some((world_from_last, map_from_last)) = last {
                let step = world_from_last.between(*world_from_robot);
                let off = step.distance(map_from_last.between(update.map_from_robot)) > WRONG_M;
                steps += 1;
                wrong += u32::from(off);
                silent += u32::from(off && update.status == Status::Tracking);
            }
            last = Some((*world_from_robot, update.map_from_robot));
        }
        errors.push(ate_m(&mapper, |k, _| Some(scans[k].world_from_robot))?);
    }
    errors.sort_by(f64::total_cmp);
    let (median, worst) = (errors[errors.len() / 2], errors[errors.len() - 1]);
    Ok(format!("{wrong} of {steps} steps wrong, {silent} silently; rms {median:.3} m, worst {worst:.3} m"))
}

fn site(kind: &str, seed: u64) -> Site {
    match kind {
        "loop" => worlds::loop_of(seed, 150.0),
        "office" => worlds::office_floor(seed),
        _ => worlds::rooms(seed),
    }
}

fn recording(site: Site, noise: f64, seed: u64) -> Vec<TrueScan> {
    let settings = DriveSettings { scan_rate_hz: SCANS_PER_S, duration_s: 600.0, ..DriveSettings::long_drive(seed) };
    let scans = Drive::new(site.into(), settings).scans();
    if noise > 0.0 { scans.perturb_odometry(noise, seed).collect() } else { scans.collect() }
}

fn rms_m(
    scans: &[LaserScan],
    reference: &BTreeMap<i64, Pose2>,
    number: u64,
    noise: f64,
) -> Result<f64, Box<dyn Error>> {
    // Evenly spread over five centimetres and a full turn.
    let spread = |ratio: f64| (number as f64 * ratio).fract() - 0.5;
    let start = Pose2::new(0.05 * spread(0.618), 0.05 * spread(0.414), std::f64::consts::TAU * spread(0.732));
    let mut mapper = Mapper::starting_at(Settings::default(), start)?;
    let add = |scan: LaserScan| {
        mapper.add_scan(&scan);
    };
    let scans = scans.iter().cloned();
    if noise > 0.0 {
        scans.perturb_odometry(noise, number).for_each(add)
    } else {
        scans.for_each(add)
    }
    ate_m(&mapper, |_, stamp_ns| reference.get(&milliseconds(stamp_ns as f64 * 1e-9)).copied())
}

fn ate_m(mapper: &Mapper, truth: impl Fn(usize, i64) -> Option<Pose2>) -> Result<f64, Box<dyn Error>> {
    let pairs: Vec<PosePair> = mapper
        .trajectory()
        .enumerate()
        .filter_map(|(k, pose)| {
            let world_from_robot = truth(k, pose.stamp.0)?;
            Some(PosePair { stamp: pose.stamp, world_from_robot, map_from_robot: pose.map_from_robot })
        })
        .collect();
    Ok(ate_of_pairs(&pairs, Alignment::Rigid)?.translation_m.rmse)
}

fn milliseconds(seconds: f64) -> i64 {
    (seconds * 1e3).round() as i64
}

fn read_log(path: &str) -> Result<Vec<LaserScan>, Box<dyn Error>> {
    let mut log = CarmenReader::new(open_log(std::fs::File::open(path)?)?);
    let mut scans = Vec::new();
    while let Some(event) = log.next_event()? {
        if let LogEvent::Scan(scan) = event {
            scans.push(scan.clone());
        }
    }
    Ok(scans)
}

fn read_reference(path: &str) -> Result<BTreeMap<i64, Pose2>, Box<dyn Error>> {
    let mut poses = BTreeMap::new();
    for line in std::fs::read_to_string(path)?.lines().filter(|line| !line.starts_with('#')) {
        let fields: Vec<f64> = line.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
        if let [stamp_s, x, y, theta, ..] = fields[..] {
            poses.insert(milliseconds(stamp_s), Pose2::new(x, y, theta));
        }
    }
    Ok(poses)
}
