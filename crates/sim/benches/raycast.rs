//! What a simulated scan costs.
#![allow(missing_docs, reason = "criterion's macros make public functions without docs")]

use criterion::{Criterion, criterion_group, criterion_main};
use mapwright_sim::space::{self, SpaceDrive, SpaceDriveSettings, SpaceSite};
use mapwright_sim::{Drive, DriveSettings, Site, worlds};
use std::hint::black_box;
use std::sync::Arc;

/// A thousand casts along rays spread over a drive.
fn rays(site: &Site) -> f64 {
    let mut sum_m = 0.0;
    for (k, leg) in site.route.legs().take(100).enumerate() {
        let moment = site.world.at(0.0, leg.a, 30.0);
        for ray in 0..10u32 {
            let angle_rad = f64::from(ray) * 0.628 + k as f64;
            sum_m += moment.cast(leg.a, [angle_rad.cos(), angle_rad.sin()]).min(30.0);
        }
    }
    sum_m
}

fn raycast(criterion: &mut Criterion) {
    let office = Arc::new(worlds::office_floor(1).with_people(4, 1));
    let growing = Arc::new(worlds::growing_building(1, 5_000.0));
    for (name, site) in [("office", office), ("growing 5 km", growing)] {
        criterion.bench_function(&format!("{name}: 1000 rays"), |b| b.iter(|| black_box(rays(&site))));
        criterion.bench_function(&format!("{name}: 1000 scans of 180 beams, drive and wheels included"), |b| {
            b.iter(|| Drive::new(Arc::clone(&site), DriveSettings::default()).scans().take(1000).count());
        });
    }
}

/// About a thousand rays in space, all around from each of some waypoints.
fn space_rays(site: &SpaceSite) -> f64 {
    let mut sum_m = 0.0;
    for [x, y, z] in site.waypoints.iter().take(20) {
        for ray in 0..50u32 {
            let (sin, cos) = (f64::from(ray) * 0.1257).sin_cos();
            let direction = [cos, sin, 0.02 * f64::from(ray % 32) - 0.3];
            sum_m += site.world.cast([*x, *y, z + 0.9], direction, 100.0).map_or(0.0, |hit| hit.at);
        }
    }
    sum_m
}

fn raycast_in_space(criterion: &mut Criterion) {
    for (name, site) in [("two storeys", space::worlds::two_storey(1)), ("loops 1 km", space::worlds::loops_1km(1))] {
        criterion.bench_function(&format!("{name}: 1000 rays"), |b| b.iter(|| black_box(space_rays(&site))));
        let drive = SpaceDrive::new(Arc::new(site), SpaceDriveSettings::default());
        criterion.bench_function(&format!("{name}: a cloud of 32 x 1024"), |b| b.iter(|| black_box(drive.cloud(100))));
    }
}

criterion_group!(benches, raycast, raycast_in_space);
criterion_main!(benches);
