//! Whether a scan costs the same in hour three as in minute one: times of the first and the last tenth of 100,000 scans.
//! Of three runs each scan's least time counts: what else the computer does is none of the mapper's business.
//!
//! `cargo run --release -p mapwright --example cost_over_time [SCANS [BREAKS]]`
//!
//! With breaks so many stretches of the recording are missing, 3 to 120 s long, evenly spread; after every second one the robot
//! was switched off, so that nothing says where it is.

#![allow(clippy::print_stdout)]

use mapwright::{Mapper, RunId, Settings};
use mapwright_sim::{Drive, DriveSettings, Site, worlds};
use std::sync::Arc;
use std::time::Instant;

const RUNS: usize = 3;
/// Of the breaks in turn.
const LENGTHS_S: [f64; 5] = [3.0, 10.0, 30.0, 60.0, 120.0];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let scans: usize = std::env::args().nth(1).map_or(Ok(100_000), |text| text.parse())?;
    let breaks: usize = std::env::args().nth(2).map_or(Ok(0), |text| text.parse())?;
    for policy in ["gated", "everything"] {
        // The robot drives on at up to a metre a second in what is missing.
        let missing_m: f64 =
            (0..scans).filter_map(|scan| break_before(scan, scans, breaks)).map(|(lasts_s, _)| lasts_s).sum();
        let growing = worlds::growing_building(1, scans as f64 * 0.05 + 100.0 + missing_m);
        report(policy, "a growing building", growing, scans, breaks)?;
        report(policy, "the same three rooms", worlds::three_rooms(1), scans, breaks)?;
    }
    Ok(())
}

/// How long a break before a scan lasts, and whether the robot was switched off in it.
fn break_before(scan: usize, scans: usize, breaks: usize) -> Option<(f64, bool)> {
    let every = scans / (breaks + 1);
    let which = scan / every.max(1);
    (which > 0 && which <= breaks && scan.is_multiple_of(every))
        .then(|| (LENGTHS_S[which / 2 % LENGTHS_S.len()], which.is_multiple_of(2)))
}

fn report(policy: &str, name: &str, site: Site, scans: usize, breaks: usize) -> Result<(), Box<dyn std::error::Error>> {
    let mut settings = Settings::default();
    settings.set("live.policy", policy)?;
    let site = Arc::new(site);
    let mut times_us = vec![f64::INFINITY; scans];
    let mut maps = 0;
    for _ in 0..RUNS {
        let mut mapper = Mapper::new(settings)?;
        let drive = Drive::new(Arc::clone(&site), DriveSettings { seed: 1, ..DriveSettings::default() });
        let mut recorded = drive.scans();
        for (number, least_us) in times_us.iter_mut().enumerate() {
            let mut scan = recorded.next().ok_or("the drive ends too soon")?;
            let pause = break_before(number, scans, breaks);
            if let Some((lasts_s, _)) = pause {
                let from = scan.scan.stamp;
                scan = recorded.find(|scan| scan.scan.stamp.secs_since(from) >= lasts_s).unwrap_or(scan);
            }
            let start = Instant::now();
            if pause.is_some_and(|(_, switched_off)| switched_off) {
                mapper.switch_on(RunId::default());
            }
            mapper.add_scan(&scan.scan);
            *least_us = least_us.min(start.elapsed().as_secs_f64() * 1e6);
        }
        maps = mapper.session().maps().len();
    }
    let tenth = (times_us.len() / 10).max(1);
    let [first, last] = [&times_us[..tenth], &times_us[times_us.len() - tenth..]].map(|part| {
        let mut sorted = part.to_vec();
        sorted.sort_by(f64::total_cmp);
        (sorted[sorted.len() * 95 / 100], part.iter().sum::<f64>() / part.len() as f64)
    });
    let means: Vec<String> =
        times_us.chunks(tenth).map(|part| format!("{:.0}", part.iter().sum::<f64>() / part.len() as f64)).collect();
    println!("{policy}, {name}: means of the tenths {} us", means.join(", "));
    println!(
        "{policy}, {name}: {} scans; 95th percentile {:.0} us in the first tenth, {:.0} us in the last ({:+.0} %); mean {:.0} and {:.0} us; {breaks} breaks, {maps} map(s)",
        times_us.len(),
        first.0,
        last.0,
        100.0 * (last.0 / first.0 - 1.0),
        first.1,
        last.1
    );
    Ok(())
}
