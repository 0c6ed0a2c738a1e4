//! How long reading a CARMEN log takes: `cargo bench -p mapwright-formats --bench carmen`. Reads the Intel log where
//! the real data lies at `../shared/data`, and a made-up log of the same size otherwise.
#![allow(missing_docs)]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use mapwright_formats::{CarmenReader, FormatError, open_log};
use std::hint::black_box;
use std::io::Read;
use std::path::Path;

fn log() -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/2d_benchmark/intel.clf.bz2");
    let mut log = Vec::new();
    let read = std::fs::File::open(path).map_err(FormatError::from).and_then(open_log);
    match read.and_then(|mut stream| Ok(stream.read_to_end(&mut log)?)) {
        Ok(_) => log,
        Err(_) => made_up(),
    }
}

fn made_up() -> Vec<u8> {
    let mut log = String::new();
    for scan in 0..13_631_u64 {
        log += &format!("ODOM 1.234567 {scan}.5 0.1 0 0 0 {scan}.123456 host 0.1\nFLASER 180");
        (0..180).for_each(|beam| log += &format!(" {}.{:02}", (scan + beam) % 12, (scan * beam) % 100));
        log += &format!(" 1.234567 2.345678 0.1 1.234567 2.345678 0.1 {scan}.234567 host 0.1\n");
    }
    log.into_bytes()
}

fn events(log: &[u8]) -> Result<u64, FormatError> {
    let mut reader = CarmenReader::new(log);
    while reader.next_event()?.is_some() {}
    Ok(reader.report().scans)
}

fn read(c: &mut Criterion) {
    let log = log();
    let mut group = c.benchmark_group("carmen");
    group.throughput(Throughput::Bytes(log.len() as u64));
    group.bench_function("read", |b| b.iter(|| events(black_box(&log))));
    group.finish();
}

criterion_group!(benches, read);
criterion_main!(benches);
