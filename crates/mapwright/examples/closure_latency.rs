//! How long a scan has to wait where loops are closed by a worker: a simulated loop of 2 km, 10,000 keyframes.
//!
//! ```sh
//! cargo run --release -p mapwright --example closure_latency
//! ```
#![allow(clippy::print_stdout, clippy::expect_used, reason = "an example prints what it measures")]

use mapwright::{EdgeKind, Jobs, Mapper, Settings};
use mapwright_sim::{Drive, DriveSettings, worlds};
use std::time::{Duration, Instant};

fn main() {
    let mut settings = Settings::default();
    settings.loops.jobs = Jobs::HandedOut;
    let mut mapper = Mapper::new(settings).expect("valid");
    let drive = Drive::new(worlds::loop_of(1, 2000.0).into(), DriveSettings::long_drive(1));
    let (mut waits, mut at_closures, mut work) = (Vec::new(), Vec::new(), Duration::ZERO);
    for scan in drive.scans() {
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
    println!("{} keyframes, {} scans, {} closing scans", mapper.keyframes().len(), waits.len(), at_closures.len());
    println!(
        "scan with results taken in: median {:.2} ms, 99.9 % {:.2} ms, worst {:.2} ms",
        at(0.5),
        at(0.999),
        at(1.0)
    );
    println!("scans with a closure: worst {:.2} ms", ms(at_closures.into_iter().max().unwrap_or_default()));
    println!("longest job: {:.0} ms", ms(work));
}
