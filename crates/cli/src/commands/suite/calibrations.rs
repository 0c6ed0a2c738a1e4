//! `mapwright suite calibrations`

use super::Measure;
use super::floors::Floor;
use crate::calibration::{Calibration, Estimate};
use crate::commands::calibrate::{Collector, Mounts};
use crate::failure::Failure;
use crate::simulated::{PEOPLE, office};
use mapwright::{LaserModel, LaserScan, Mapper, Pose2, Settings};
use mapwright_eval::ErrorStats;
use mapwright_sim::{Drive, DriveSettings, Rng, TrueScan, worlds};
use serde::Serialize;
use serde_json::{Value, json};
use std::sync::Arc;

/// What `mapwright calibrate` says of drives whose mounts are known.
pub(super) struct Calibrations {
    pub(super) settings: Settings,
}

/// An estimate lies within so many of its standard deviations.
const WITHIN_SIGMAS: f64 = 3.0;
/// So many of them.
const LEAST_WITHIN: f64 = 0.95;
/// Mounts reach so far ahead and to the side, metres, turned by so much, radians; odometry lags or leads by so much, seconds.
const AHEAD_M: f64 = 0.3;
const ASIDE_M: f64 = 0.1;
const TURNED_RAD: f64 = 0.2;
const LAG_S: f64 = 0.15;
/// Of the random numbers that say where the laser sits.
const MOUNTS_KEY: u64 = 0x006d_6f75_6e74;

/// One drive.
#[derive(Debug, Serialize)]
pub(super) struct World {
    seed: u64,
    site: &'static str,
    /// Where the laser sits, and by how much odometry lags.
    truth: [f64; NUMBERS],
    /// Nothing where the drive does not show it, and why.
    found: Result<[Found; NUMBERS], String>,
}

#[derive(Debug, Clone, Copy, Serialize)]
struct Found {
    value: f64,
    sigma: f64,
    /// How far off, in standard deviations.
    sigmas: f64,
}

const NUMBERS: usize = 4;
const NAMES: [&str; NUMBERS] = ["x", "y", "yaw", "lag"];
const UNITS: [(&str, f64); NUMBERS] = [("mm", 1e3), ("mm", 1e3), ("mrad", 1e3), ("ms", 1e3)];
const FLOORS: [&str; NUMBERS] = [
    "x within 3 standard deviations in 95 of 100",
    "y within 3 standard deviations in 95 of 100",
    "yaw within 3 standard deviations in 95 of 100",
    "lag within 3 standard deviations in 95 of 100",
];

impl Found {
    fn of(estimate: Estimate, truth: f64) -> Self {
        let Estimate { value, sigma } = estimate;
        Self { value, sigma, sigmas: (value - truth).abs() / sigma.max(f64::MIN_POSITIVE) }
    }
}

impl Measure for Calibrations {
    type World = World;
    const NAME: &'static str = "calibrations";
    const FILES: [&'static str; 2] = ["calibrations.jsonl", "calibrations.json"];

    fn world(&self, seed: u64) -> Result<World, Failure> {
        let mut rng = Rng::keyed(seed, MOUNTS_KEY);
        let mut around = |reach: f64| rng.uniform(-reach, reach);
        let truth = [around(AHEAD_M), around(ASIDE_M), around(TURNED_RAD), around(LAG_S)];
        let [x, y, yaw, lag_s] = truth;
        let (site, drive) = match seed % 3 {
            0 => ("office", office(seed, PEOPLE)),
            1 => ("loop", Drive::new(worlds::loop_of(seed, 250.0).into(), DriveSettings::long_drive(seed))),
            _ => ("corridors", Drive::new(worlds::corridor_grid(seed, 400.0).into(), DriveSettings::long_drive(seed))),
        };
        let scans = drive.with_mount(Pose2::new(x, y, yaw)).scans();
        let (scans, mut laser) = (scans.collect::<Vec<_>>(), None);
        let mut pass = |mounts| {
            let mut collector = Collector::new(Mapper::new(self.settings)?, mounts);
            for scan in lagging(&scans, lag_s) {
                collector.add(&as_if_at_the_centre(scan, &mut laser));
            }
            Ok::<_, Failure>(collector.found())
        };
        let found = match pass(None)? {
            Ok(first) => pass(Some(Mounts::of(Pose2::IDENTITY, &first)))?.or(Ok(first)),
            Err(why) => Err(why),
        };
        let found = found.and_then(|found| {
            let Calibration { x_m, y_m, yaw_rad, lag_s, .. } = found;
            let lag_s = lag_s.ok_or("expected stamps that tell time, found bursts")?;
            let estimates = [x_m, y_m, yaw_rad, lag_s];
            Ok(std::array::from_fn(|k| Found::of(estimates[k], truth[k])))
        });
        Ok(World { seed, site, truth, found })
    }

    fn line(world: &World) -> String {
        let head = format!("{:6} {:9}", world.seed, world.site);
        match &world.found {
            Err(why) => format!("{head} {why}"),
            Ok(found) => {
                let words = |k: usize| {
                    let (Found { value, sigma, sigmas }, (unit, per)) = (found[k], UNITS[k]);
                    let off = per * (value - world.truth[k]);
                    format!("  {} {off:+6.1} +- {:.1} {unit} ({sigmas:.1})", NAMES[k], per * sigma)
                };
                head + &(0..NUMBERS).map(words).collect::<String>()
            }
        }
    }

    fn summary(&self, worlds: &[World]) -> (String, Value, Vec<Floor>) {
        let found: Vec<_> = worlds.iter().filter_map(|w| Some((w.truth, w.found.as_ref().ok()?))).collect();
        let mut words = "         off in the mean    root mean square    stated    within 3\n".to_owned();
        let (mut floors, mut values) = (Vec::new(), Vec::new());
        for (k, ((name, (unit, per)), floor)) in NAMES.iter().zip(UNITS).zip(FLOORS).enumerate() {
            let off: Vec<f64> = found.iter().map(|(truth, found)| found[k].value - truth[k]).collect();
            let stated: Vec<f64> = found.iter().map(|(_, found)| found[k].sigma).collect();
            let within = found.iter().filter(|(_, found)| found[k].sigmas <= WITHIN_SIGMAS).count();
            let (off, stated) = (ErrorStats::of(&off), ErrorStats::of(&stated));
            let [mean, rmse, stated] =
                [off.map(|o| o.mean), off.map(|o| o.rmse), stated.map(|s| s.rmse)].map(|v| per * v.unwrap_or(0.0));
            words += &format!("{name:8} {mean:+10.2} {unit:4} {rmse:13.2} {unit:4} {stated:6.2} {unit:4} {within:6}\n");
            values.push(json!({ "what": name, "within": within, "off_mean": mean, "rmse": rmse, "stated": stated }));
            floors.push(Floor::share(floor, LEAST_WITHIN, within, found.len()));
        }
        (words, json!({ "calibrated": found.len(), "numbers": values }), floors)
    }
}

/// Scans with the odometry of so long before; those at the ends, for which that is not known, are left out.
fn lagging(scans: &[TrueScan], lag_s: f64) -> impl Iterator<Item = LaserScan> {
    scans.iter().filter_map(move |taken| {
        let mut scan = taken.scan.clone();
        scan.odom_from_robot = Some(odometry_at(scans, scan.stamp.as_secs_f64() - lag_s)?);
        Some(scan)
    })
}

/// Between the two scans around a time.
fn odometry_at(scans: &[TrueScan], at_s: f64) -> Option<Pose2> {
    let stamp_s = |taken: &TrueScan| taken.scan.stamp.as_secs_f64();
    let next = scans.partition_point(|taken| stamp_s(taken) <= at_s);
    let (from, to) = (scans.get(next.checked_sub(1)?)?, scans.get(next)?);
    let share = (at_s - stamp_s(from)) / (stamp_s(to) - stamp_s(from));
    let [from, to] = [from.scan.odom_from_robot?, to.scan.odom_from_robot?];
    Some(from * Pose2::exp(from.between(to).log().map(|part| part * share)))
}

/// A log that does not know where its laser sits.
fn as_if_at_the_centre(scan: LaserScan, laser: &mut Option<Arc<LaserModel>>) -> LaserScan {
    let centred = || Arc::new(LaserModel { robot_from_laser: Pose2::IDENTITY, ..(*scan.laser).clone() });
    LaserScan { laser: Arc::clone(laser.get_or_insert_with(centred)), ..scan }
}
