//! What the gate does where a corridor comes back to its start: small loops must stay in the local map, long ones leave.
//!
//! `cargo run --release -p mapwright --example gate_over_loops [KEY=VALUE ...]`

#![allow(clippy::print_stdout)]

use mapwright::{Mapper, Pose2, Settings};
use mapwright_sim::{Drive, DriveSettings, worlds};

const SEEDS: u64 = 6;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut settings = Settings::default();
    settings.set("live.policy", "gated")?;
    for argument in std::env::args().skip(1) {
        let (key, value) = argument.split_once('=').ok_or("expected KEY=VALUE")?;
        settings.set(key, value)?;
    }
    println!("length  seed  drift when back  end error  gated out  let in");
    for length_m in [60.0, 120.0, 240.0, 480.0, 960.0] {
        for seed in 1..=SEEDS {
            lap(settings, length_m, seed)?;
        }
    }
    Ok(())
}

fn lap(settings: Settings, length_m: f64, seed: u64) -> Result<(), Box<dyn std::error::Error>> {
    let mut mapper = Mapper::new(settings)?;
    let site = worlds::grand_loop(seed, length_m);
    let drive = Drive::new(site.into(), DriveSettings { seed, ..DriveSettings::default() });
    let (mut first, mut before, mut travelled_m) = (None, None::<Pose2>, 0.0);
    let (mut drift_m, mut error_m) = (f64::NAN, 0.0);
    for recorded in drive.scans() {
        let truth = recorded.world_from_robot;
        let start: Pose2 = *first.get_or_insert(truth);
        travelled_m += before.map_or(0.0, |before| before.distance(truth));
        before = Some(truth);
        let estimate = mapper.add_scan(&recorded.scan).map_from_robot;
        error_m = start.between(truth).distance(estimate);
        // Round the last corner the start comes into view.
        if travelled_m > 0.65 * length_m && drift_m.is_nan() {
            drift_m = error_m;
        }
    }
    let report = mapper.local_map_report();
    println!(
        "{length_m:4.0} m  {seed:4}  {drift_m:13.3} m  {error_m:7.3} m  {:9}  {:6}",
        report.gated_out, report.let_in
    );
    Ok(())
}
