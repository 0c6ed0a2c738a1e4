//! What the kernels cost on a simulated office: `cargo bench -p mapwright-grid`.
#![allow(missing_docs, reason = "criterion's macros make public functions without docs")]

#[path = "../tests/common/mod.rs"]
mod common;

use common::{View, map_of, views};
use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use mapwright_geom::Pose2;
use mapwright_grid::{Change, CorrelativeSearch, DistanceField, LocalMap, Matcher, Prior, SearchWindow, Separation};
use mapwright_sim::worlds;
use std::f64::consts::PI;
use std::hint::black_box;
use std::sync::Arc;

/// A map of 100 scans of 180 beams over 50 s of driving, and what to match: five others of the same stretch.
fn office() -> (LocalMap, Vec<View>) {
    let site = Arc::new(worlds::office_floor(1));
    let queries = views(&site, 2, 5, 100);
    (map_of(&views(&site, 1, 5, 100)), queries.into_iter().skip(15).step_by(17).collect())
}

fn matching(criterion: &mut Criterion) {
    let (map, queries) = office();
    let matcher = Matcher::default();
    let starts: Vec<_> = queries.iter().map(|v| v.world_from_robot * Pose2::new(0.06, -0.04, 0.03)).collect();
    criterion.bench_function("match: 5 scans by Gauss-Newton from 7 cm and 1.7 deg away", |b| {
        b.iter(|| {
            for (view, &start) in queries.iter().zip(&starts) {
                let prior = Prior { world_from_robot: start, variances: [0.01, 0.01, 0.01], tail: 1e8 };
                black_box(matcher.gauss_newton(&map, &view.points.hits, &prior, start));
            }
        });
    });
}

fn insert(criterion: &mut Criterion) {
    let (map, queries) = office();
    let (first, rest) = queries.split_at(1);
    criterion.bench_function("insert: add and remove one scan, lines and field included", |b| {
        let mut map = map.clone();
        b.iter(|| {
            for change in [Change::Add, Change::Remove] {
                map.change(&first[0].points, first[0].world_from_robot, change, 1_000);
            }
        });
    });
    criterion.bench_function("insert: 4 scans into a map of 100", |b| {
        let add = |mut map: LocalMap| {
            for view in rest {
                map.change(&view.points, view.world_from_robot, Change::Add, 1_000);
            }
            map
        };
        b.iter_batched(|| map.clone(), add, BatchSize::LargeInput);
    });
}

fn field_update(criterion: &mut Criterion) {
    let (map, _) = office();
    let obstacles: Vec<_> = map.field().obstacles().collect();
    let mut field = DistanceField::new(10);
    for (handle, &(x, y)) in obstacles.iter().enumerate() {
        field.insert(x, y, handle as u32);
    }
    let some: Vec<_> = obstacles.iter().copied().enumerate().step_by(obstacles.len() / 100).take(100).collect();
    criterion.bench_function("field update: 100 obstacles removed and inserted again", |b| {
        b.iter(|| {
            some.iter().for_each(|&(_, (x, y))| field.remove(x, y));
            some.iter().for_each(|&(handle, (x, y))| field.insert(x, y, handle as u32));
        });
    });
}

fn search(criterion: &mut Criterion) {
    let (map, queries) = office();
    let mut searcher = CorrelativeSearch::default();
    let windows = [("0.5 m and 20 deg", 0.5, 20_f64.to_radians()), ("3 m and a full turn", 3.0, PI)];
    for (name, half_width_m, half_width_rad) in windows {
        for (with, separation) in [("", None), (", with rival", Some(Separation::default()))] {
            criterion.bench_function(&format!("correlative search: 5 scans within {name}{with}"), |b| {
                b.iter(|| {
                    for view in &queries {
                        let world_from_robot = view.world_from_robot * Pose2::new(0.3, -0.2, 0.2);
                        let window = SearchWindow { world_from_robot, half_width_m, half_width_rad };
                        black_box(searcher.search(&map, &view.points.hits, &window, separation));
                    }
                });
            });
        }
    }
}

criterion_group!(benches, matching, insert, field_update, search);
criterion_main!(benches);
