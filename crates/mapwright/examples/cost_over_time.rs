//! Whether a scan costs the same in hour three as in minute one: times of the first and the last tenth of 100,000 scans.
//! Of three runs each scan's least time counts: what else the computer does is none of the mapper's business.
//!
//! `cargo run --release -p mapwright --example cost_over_time [SCANS]`

#![allow(clippy::print_stdout)]

use mapwright::{Mapper, Settings};
use mapwright_sim::{Drive, DriveSettings, Site, worlds};
use std::sync::Arc;
use std::time::Instant;

const RUNS: usize = 3;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let scans: usize = std::env::args().nth(1).map_or(Ok(100_000), |text| text.parse())?;
    for policy in ["gated", "everything"] {
        report(policy, "a growing building", worlds::growing_building(1, scans as f64 * 0.05 + 100.0), scans)?;
        report(policy, "the same three rooms", worlds::three_rooms(1), scans)?;
    }
    Ok(())
}

fn report(policy: &str, name: &str, site: Site, scans: usize) -> Result<(), Box<dyn std::error::Error>> {
    let mut settings = Settings::default();
    settings.set("live.policy", policy)?;
    let site = Arc::new(site);
    let mut times_us = vec![f64::INFINITY; scans];
    for _ in 0..RUNS {
        let mut mapper = Mapper::new(settings)?;
        let drive = Drive::new(Arc::clone(&site), DriveSettings { seed: 1, ..DriveSettings::default() });
        for (scan, least_us) in drive.scans().zip(&mut times_us) {
            let start = Instant::now();
            mapper.add_scan(&scan.scan);
            *least_us = least_us.min(start.elapsed().as_secs_f64() * 1e6);
        }
    }
    let tenth = times_us.len() / 10;
    let [first, last] = [&times_us[..tenth], &times_us[times_us.len() - tenth..]].map(|part| {
        let mut sorted = part.to_vec();
        sorted.sort_by(f64::total_cmp);
        (sorted[sorted.len() * 95 / 100], part.iter().sum::<f64>() / part.len() as f64)
    });
    println!(
        "{policy}, {name}: {} scans; 95th percentile {:.0} us in the first tenth, {:.0} us in the last ({:+.0} %); mean {:.0} and {:.0} us",
        times_us.len(),
        first.0,
        last.0,
        100.0 * (last.0 / first.0 - 1.0),
        first.1,
        last.1
    );
    Ok(())
}
