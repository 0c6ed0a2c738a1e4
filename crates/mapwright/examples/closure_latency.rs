//! How long a scan has to wait where loops are closed by a worker: a simulated loop of 2 km, 10,000 keyframes.
//!
//! ```sh
//! cargo run --release -p mapwright --example closure_latency [BREAKS]
//! ```
//!
//! With breaks so many stretches of the recording are missing, 3 to 120 s long, evenly spread; after every second one the robot
//! was switched off, so that nothing says where it is.
#![allow(clippy::print_stdout, clippy::expect_used, reason = "an example prints what it measures")]

use mapwright::{EdgeKind, Jobs, Mapper, RunId, Settings};
use mapwright_sim::{Drive, DriveSettings, worlds};
use std::time::{Duration, Instant};

/// Of the breaks in turn.
const LENGTHS_S: [f64; 5] = [3.0, 10.0, 30.0, 60.0, 120.0];

fn main() {
    let breaks: usize = std::env::args().nth(1).map_or(0, |text| text.parse().expect("a number of breaks"));
    let mut settings = Settings::default();
    settings.loops.jobs = Jobs::HandedOut;
    let mut mapper = Mapper::new(settings).expect("valid");
    let drive = Drive::new(worlds::loop_of(1, 2000.0).into(), DriveSettings::long_drive(1));
    let (mut waits, mut at_closures, mut work) = (Vec::new(), Vec::new(), Duration::ZERO);
    let scans = drive.clone().scans().count();
    let mut recorded = drive.scans();
    let mut number = 0;
    while let Some(mut scan) = recorded.next() {
        number += 1;
        let every = scans / (breaks + 1);
        let which = number / every.max(1);
        if number.is_multiple_of(every) && which > 0 && which <= breaks {
            let (from, lasts_s) = (scan.scan.stamp, LENGTHS_S[which / 2 % LENGTHS_S.len()]);
            let after = recorded.find(|scan| {
                number += 1;
                scan.scan.stamp.secs_since(from) >= lasts_s
            });
            let Some(after) = after else { break };
            scan = after;
            if which.is_multiple_of(2) {
                mapper.switch_on(RunId::default());
            }
        }
        let mut wait = Duration::ZERO;
        let closures = mapper.edges().filter(|edge| edge.kind == EdgeKind::Closure).count();
        while let Some(job) = mapper.next_job() {
            let before = Instant::now();
            let result = job.run();
            work = work.max(before.elapsed());
            let before = Instant::now();
            mapper.apply(result);
            wait += before.elapsed();
        }
        let closed = mapper.edges().filter(|edge| edge.kind == EdgeKind::Closure).count() > closures;
        let before = Instant::now();
        mapper.add_scan(&scan.scan);
        wait += before.elapsed();
        if closed {
            at_closures.push(wait);
        }
        waits.push(wait);
    }
    waits.sort();
    let ms = |wait: Duration| wait.as_secs_f64() * 1e3;
    let at = |share: f64| ms(waits[((waits.len() - 1) as f64 * share) as usize]);
    let maps = mapper.session().maps().len();
    println!("{} keyframes, {} scans, {} closing scans", mapper.keyframes().len(), waits.len(), at_closures.len());
    println!("{breaks} breaks, {maps} map(s)");
    println!(
        "scan with results taken in: median {:.2} ms, 99.9 % {:.2} ms, worst {:.2} ms",
        at(0.5),
        at(0.999),
        at(1.0)
    );
    println!("scans with a closure: worst {:.2} ms", ms(at_closures.into_iter().max().unwrap_or_default()));
    println!("longest job: {:.0} ms", ms(work));
}
