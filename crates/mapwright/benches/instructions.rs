//! How many instructions the kernels and a whole log take, counted by valgrind, and how many they may take.
//!
//! `just instructions` fails where a count is more than a tenth above the one written here. Counts are the same on every
//! run; they depend on the compiler (these are of Rust 1.95 on x86-64) and a little on the C library. A change that is
//! worth its instructions writes the new counts here.
#![allow(missing_docs, reason = "the macros make public functions without docs")]
#![allow(clippy::expect_used, reason = "a benchmark may fail loudly")]

#[path = "../../grid/tests/common/mod.rs"]
mod common;

use common::{View, map_of, views};
use gungraun::prelude::*;
use gungraun::{Callgrind, EventKind};
use mapwright::{LaserScan, LocalMap, Mapper, Pose2, Settings};
use mapwright_grid::{Change, CorrelativeSearch, DistanceField, Matcher, Prior, SearchWindow};
use mapwright_sim::{Drive, DriveSettings, worlds};
use std::hint::black_box;
use std::sync::Arc;

/// Instructions in thousands.
const MATCH: u64 = 312;
const INSERT: u64 = 1_951;
const FIELD_UPDATE: u64 = 1_839;
const SEARCH: u64 = 25_483;
const WHOLE_LOG: u64 = 90_934;
/// More than this times as many are too many.
const TOLERANCE: f64 = 1.1;

fn at_most(thousands: u64) -> LibraryBenchmarkConfig {
    let limit = (thousands as f64 * 1000.0 * TOLERANCE) as u64;
    let mut callgrind = Callgrind::with_args(["--cache-sim=no"]);
    callgrind.hard_limits([(EventKind::Ir, limit)]);
    LibraryBenchmarkConfig::default().tool(callgrind).clone()
}

/// A map of 40 scans over 20 s of driving, and three others of the same stretch to match.
fn office() -> (LocalMap, Vec<View>) {
    let site = Arc::new(worlds::office_floor(1));
    let queries = views(&site, 2, 5, 40);
    (map_of(&views(&site, 1, 5, 40)), queries.into_iter().skip(5).step_by(12).collect())
}

#[library_benchmark(config = at_most(MATCH))]
#[bench::office(office())]
fn match_scans((map, queries): (LocalMap, Vec<View>)) {
    let matcher = Matcher::default();
    for view in &queries {
        let start = view.world_from_robot * Pose2::new(0.06, -0.04, 0.03);
        let prior = Prior { world_from_robot: start, variances: [0.01; 3], tail: 1e8 };
        black_box(matcher.gauss_newton(&map, &view.points.hits, &prior, start));
    }
}

#[library_benchmark(config = at_most(INSERT))]
#[bench::office(office())]
fn insert((mut map, queries): (LocalMap, Vec<View>)) -> LocalMap {
    for (number, view) in queries.iter().enumerate() {
        map.change(&view.points, view.world_from_robot, Change::Add, 1_000 + number as u32);
    }
    map
}

/// A field of an office's obstacles, and a hundred of them.
fn field() -> (DistanceField, Vec<(i32, i32)>) {
    let obstacles: Vec<_> = office().0.field().obstacles().collect();
    let mut field = DistanceField::new(10);
    for (handle, &(x, y)) in obstacles.iter().enumerate() {
        field.insert(x, y, handle as u32);
    }
    let some = obstacles.iter().copied().step_by(obstacles.len() / 100).take(100).collect();
    (field, some)
}

#[library_benchmark(config = at_most(FIELD_UPDATE))]
#[bench::office(field())]
fn update_field((mut field, some): (DistanceField, Vec<(i32, i32)>)) -> DistanceField {
    some.iter().for_each(|&(x, y)| field.remove(x, y));
    some.iter().for_each(|&(x, y)| field.insert(x, y, 0));
    field
}

#[library_benchmark(config = at_most(SEARCH))]
#[bench::office(office())]
fn search((map, queries): (LocalMap, Vec<View>)) {
    let mut searcher = CorrelativeSearch::default();
    for view in &queries {
        let world_from_robot = view.world_from_robot * Pose2::new(0.3, -0.2, 0.2);
        let window = SearchWindow { world_from_robot, half_width_m: 0.5, half_width_rad: 0.35 };
        black_box(searcher.search(&map, &view.points.hits, &window, None));
    }
}

/// Thirty seconds of a drive through an office.
fn drive() -> Vec<LaserScan> {
    let settings = DriveSettings { seed: 1, duration_s: 30.0, ..DriveSettings::default() };
    Drive::new(worlds::office_floor(1).into(), settings).scans().map(|taken| taken.scan).collect()
}

#[library_benchmark(config = at_most(WHOLE_LOG))]
#[bench::office(drive())]
fn whole_log(scans: Vec<LaserScan>) -> Mapper {
    let mut mapper = Mapper::new(Settings::default()).expect("defaults are valid");
    for scan in &scans {
        black_box(mapper.add_scan(scan));
    }
    mapper
}

library_benchmark_group!(name = kernels, benchmarks = [match_scans, insert, update_field, search, whole_log]);
gungraun::main!(library_benchmark_groups = kernels);
