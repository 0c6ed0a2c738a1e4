//! How long it takes to draw the map of a log anew, and to follow a small correction; the best of several runs, ms.
//!
//! `cargo run --release -p mapwright --example render [LOG]`; without a log `2d_benchmark/intel.clf.bz2` from
//! `../shared/data`.

#![allow(clippy::print_stdout, reason = "an example's result")]

use mapwright::{Entry, EntryError, GlobalMap, Mapper, Pose2, Session, Settings, Snapshot};
use mapwright_formats::{CarmenReader, LogEvent, open_log};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Instant;

const RUNS: usize = 20;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let intel = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/2d_benchmark/intel.clf.bz2");
    let mapper = mapped(std::env::args_os().nth(1).map_or_else(intel, PathBuf::from))?;
    let scratch = mapper.render_with(1);
    println!("{} keyframes, {} tiles", mapper.keyframes().len(), scratch.tile_count());
    for threads in [1, 2] {
        let all_ms = best_ms(|| mapper.render_with(threads));
        println!("{threads} threads: {all_ms:.1} ms from scratch");
        for share in [0.02, 0.1, 0.5] {
            follow(&mapper, threads, share)?;
        }
    }
    let same = (1..=4).all(|threads| mapper.render_with(threads).to_bytes() == scratch.to_bytes());
    println!("the same bytes on 1 to 4 threads: {same}");
    Ok(())
}

/// The newest `share` of the keyframes is moved by 3 cm, the rest by 3 mm, which does not show; then it is undone.
fn follow(mapper: &Mapper, threads: usize, share: f64) -> Result<(), EntryError> {
    let before = mapper.session();
    let after = corrected(before, share)?;
    let mut map = GlobalMap::new(mapper.settings());
    map.follow(before, threads);
    let (mut ways, mut redrawn) = ([&after, before].into_iter().cycle(), 0);
    let ms = best_ms(|| {
        redrawn = ways.next().map_or(0, |session| map.follow(session, threads));
    });
    println!("{threads} threads: {ms:.1} ms to follow a correction that moves {redrawn} keyframes visibly");
    Ok(())
}

fn corrected(session: &Session, share: f64) -> Result<Session, EntryError> {
    let first = (session.keyframes().len() as f64 * (1.0 - share)) as usize;
    let moved = session.keyframes().iter().zip(session.map_from_keyframe()).enumerate().map(|(k, (keyframe, pose))| {
        let by_m = if k < first { 0.003 } else { 0.03 };
        (keyframe.id, Pose2 { x: pose.x + by_m, ..*pose })
    });
    let snapshot = Snapshot { number: session.corrections() + 1, map_from_keyframe: moved.collect() };
    let mut corrected = session.clone();
    corrected.add(Entry::Snapshot(snapshot))?;
    Ok(corrected)
}

fn best_ms<T>(mut run: impl FnMut() -> T) -> f64 {
    let mut timed = || {
        let start = Instant::now();
        let _kept_until_here = run();
        start.elapsed().as_secs_f64() * 1e3
    };
    (0..RUNS).map(|_| timed()).fold(f64::INFINITY, f64::min)
}

fn mapped(log: PathBuf) -> Result<Mapper, Box<dyn std::error::Error>> {
    let mut log = CarmenReader::new(open_log(File::open(log)?)?);
    let mut mapper = Mapper::new(Settings::default())?;
    while let Some(event) = log.next_event()? {
        match event {
            LogEvent::Odometry(odometry) => mapper.add_odometry(odometry),
            LogEvent::Scan(scan) => {
                mapper.add_scan(scan);
            }
            _ => {}
        }
    }
    Ok(mapper)
}
