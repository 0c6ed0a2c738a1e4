//! Any bytes as a ring of sonars, its readings and odometry: no panic, every reading counted once, and scans that can be mapped.
//! `cargo +nightly fuzz run sonar -- -max_total_time=60`
#![no_main]

use libfuzzer_sys::fuzz_target;
use mapwright_geom::{Pose2, Stamp};
use mapwright_sensor::{Odometry, Sonar, SonarReading, SonarRing};
use mapwright_sonar::{Gatherer, GathererSettings};
use std::sync::Arc;

/// Takes a number's bytes off the front; zeros where there are none left.
fn take<const N: usize>(bytes: &mut &[u8]) -> [u8; N] {
    let mut taken = [0; N];
    let (front, rest) = bytes.split_at(N.min(bytes.len()));
    taken[..front.len()].copy_from_slice(front);
    *bytes = rest;
    taken
}

fn number(bytes: &mut &[u8]) -> f64 {
    f64::from(f32::from_le_bytes(take(bytes)))
}

fn pose(bytes: &mut &[u8]) -> Pose2 {
    let [x, y, theta] = [(); 3].map(|()| number(bytes));
    Pose2 { x, y, theta }
}

/// Up to 15 sonars; those that readers would refuse are left out.
fn ring(bytes: &mut &[u8]) -> Arc<SonarRing> {
    let [count] = take(bytes);
    let sonars = (0..count % 16).map(|_| {
        let (robot_from_sonar, [opening_rad, range_min_m, range_max_m]) = (pose(bytes), [(); 3].map(|()| number(bytes)));
        Sonar { robot_from_sonar, opening_rad, range_min_m, range_max_m }
    });
    let sonars = sonars.filter(|sonar| sonar.check().is_ok()).collect();
    Arc::new(SonarRing { name: "fuzzed".to_owned(), sonars })
}

fuzz_target!(|bytes: &[u8]| {
    let mut bytes = bytes;
    let ring = ring(&mut bytes);
    let mut gatherer = Gatherer::new(GathererSettings::default());
    let mut given = 0;
    while !bytes.is_empty() {
        let [kind] = take(&mut bytes);
        let stamp = Stamp(i64::from_le_bytes(take(&mut bytes)));
        let at = pose(&mut bytes);
        if kind & 1 == 0 {
            gatherer.add_odometry(&Odometry { stamp, odom_from_robot: at });
            continue;
        }
        let ranges_m: Vec<f32> = ring.sonars.iter().map(|_| f32::from_le_bytes(take(&mut bytes))).collect();
        given += ranges_m.len() as u64;
        let odom_from_robot = (kind & 2 == 0).then_some(at);
        gatherer.add(&SonarReading { stamp, ring: Arc::clone(&ring), ranges_m, odom_from_robot });
    }
    gatherer.end();
    while let Some(stretch) = gatherer.next_stretch() {
        assert!(stretch.scan.laser.check(stretch.scan.ranges_m.len()).is_ok());
        assert!(stretch.scan.ranges_m.iter().all(|range_m| range_m.is_nan() || *range_m >= 0.0));
    }
    assert_eq!(gatherer.counts().total(), given);
});
