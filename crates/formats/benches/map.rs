//! How long pictures take: `cargo bench -p mapwright-formats --bench map`.
#![allow(missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use mapwright_formats::{GridImage, Picture, TumWriter, UNKNOWN, dominant_wall_angle, write_pgm, write_png};
use mapwright_geom::{Pose2, Stamp};
use std::hint::black_box;

const SIDE: usize = 600;

/// Rooms along corridors, slightly speckled.
fn map() -> GridImage {
    let cell = |i: usize| {
        let (x, y) = (i % SIDE, i / SIDE);
        match (x, y) {
            _ if x < 40 || y < 40 || x > SIDE - 40 || y > SIDE - 40 => UNKNOWN,
            _ if x % 90 < 2 || y % 70 < 2 => 70 + (i * 7919 % 31) as u8,
            _ => (i * 104_729 % 11) as u8,
        }
    };
    let cells = (0..SIDE * SIDE).map(cell).collect();
    GridImage { width: SIDE, height: SIDE, resolution_m: 0.05, world_from_map: Pose2::new(0.0, 0.0, 0.0), cells }
}

/// A way of as many poses as the Intel log has scans.
fn way() -> Vec<Pose2> {
    let pose = |i: i32| {
        let t = f64::from(i) * 1e-3;
        Pose2::new(15.0 + 9.0 * (1.3 * t).sin(), 15.0 + 9.0 * (1.7 * t).cos(), t)
    };
    (0..13_631).map(pose).collect()
}

fn pictures(c: &mut Criterion) {
    let (map, way) = (map(), way());
    let once = Picture { world_from_robot: &way, min_side_px: 0, ..Picture::default() };
    let drawn = |picture: Picture<'_>| {
        let mut out = Vec::with_capacity(1 << 20);
        write_png(black_box(&map), &picture, &mut out).map(|()| out.len())
    };
    c.bench_function("png 600x600 at 1x", |b| b.iter(|| drawn(once)));
    c.bench_function("png 600x600 at 1x, turned", |b| b.iter(|| drawn(Picture { level_rad: 0.2, ..once })));
    c.bench_function("png 600x600 at 2x, turned", |b| {
        b.iter(|| drawn(Picture { level_rad: 0.2, min_side_px: 800, ..once }));
    });
    c.bench_function("dominant wall angle", |b| {
        let points = map.wall_points_map();
        b.iter(|| dominant_wall_angle(black_box(&points), 0.05));
    });
    c.bench_function("pgm 600x600", |b| {
        b.iter(|| {
            let mut out = Vec::with_capacity(1 << 20);
            write_pgm(black_box(&map), &mut out).map(|()| out)
        });
    });
}

fn trajectories(c: &mut Criterion) {
    let way = way();
    c.bench_function("tum, 13631 poses", |b| {
        b.iter(|| {
            let mut writer = TumWriter::new(Vec::with_capacity(1 << 21));
            for (index, &pose) in way.iter().enumerate() {
                writer.write_planar(Stamp(976_052_857_337_530_000 + index as i64 * 198_765_432), pose)?;
            }
            writer.finish()
        });
    });
}

criterion_group!(benches, pictures, trajectories);
criterion_main!(benches);
