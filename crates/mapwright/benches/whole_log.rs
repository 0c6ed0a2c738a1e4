//! What a whole log costs, scan by scan: `cargo bench -p mapwright --bench whole_log`. A simulated drive, and the Intel
//! log where it lies at `../shared/data` or in `MAPWRIGHT_DATA`.
#![allow(missing_docs, reason = "criterion's macros make public functions without docs")]
#![allow(clippy::expect_used, reason = "a benchmark may fail loudly")]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use mapwright::{LaserScan, Mapper, Odometry, Settings};
use mapwright_formats::{CarmenReader, FormatError, LogEvent, open_log};
use mapwright_sim::{Drive, DriveSettings, Event, worlds};
use std::fs::File;
use std::hint::black_box;
use std::path::{Path, PathBuf};

enum Reading {
    Odometry(Odometry),
    Scan(LaserScan),
}

/// Two minutes on an office floor with people.
fn simulated() -> Vec<Reading> {
    let site = worlds::office_floor(5).with_people(6, 5);
    let settings = DriveSettings { seed: 5, duration_s: 120.0, ..DriveSettings::default() };
    let reading = |event: Event| match event {
        Event::Odometry(odometry) => Reading::Odometry(odometry),
        Event::Scan(taken) => Reading::Scan(taken.scan),
    };
    Drive::new(site.into(), settings).map(reading).collect()
}

fn intel() -> Result<Vec<Reading>, FormatError> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let root = std::env::var_os("MAPWRIGHT_DATA").map_or_else(beside, PathBuf::from);
    let mut log = CarmenReader::new(open_log(File::open(root.join("2d_benchmark/intel.clf.bz2"))?)?);
    let mut readings = Vec::new();
    while let Some(event) = log.next_event()? {
        match event {
            LogEvent::Odometry(odometry) => readings.push(Reading::Odometry(*odometry)),
            LogEvent::Scan(scan) => readings.push(Reading::Scan(scan.clone())),
            _ => {}
        }
    }
    Ok(readings)
}

fn mapped(readings: &[Reading]) -> Mapper {
    let mut mapper = Mapper::new(Settings::default()).expect("defaults are valid");
    for reading in readings {
        match reading {
            Reading::Odometry(odometry) => mapper.add_odometry(odometry),
            Reading::Scan(scan) => {
                black_box(mapper.add_scan(scan));
            }
        }
    }
    mapper
}

fn whole_log(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("whole log");
    group.sample_size(10);
    let logs = [("simulated office, 2 min", Ok(simulated())), ("intel, 45 min", intel())];
    for (name, readings) in logs.iter().filter_map(|(name, log)| Some((name, log.as_ref().ok()?))) {
        let scans = readings.iter().filter(|reading| matches!(reading, Reading::Scan(_))).count();
        group.throughput(Throughput::Elements(scans as u64));
        group.bench_function(*name, |bencher| bencher.iter(|| mapped(readings)));
    }
    group.finish();
}

criterion_group!(benches, whole_log);
criterion_main!(benches);
