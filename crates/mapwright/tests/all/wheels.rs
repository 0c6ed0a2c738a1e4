//! Wheels that do not tell forwards from backwards, and no wheels.
#![allow(clippy::expect_used, reason = "a test may fail loudly")]

use crate::support;

use mapwright::{Mapper, Pose2, Settings};
use mapwright_sim::{Drive, DriveSettings, LaserSettings, PerturbScans, worlds};
use support::{ate_m, in_parallel, map_all, recording};

/// The map's error where the wheels count twelve metres, a scan every 0.4 m, the wrong way.
fn error_m(seed: u64) -> f64 {
    let settings = DriveSettings { scan_rate_hz: 1.25, duration_s: 180.0, seed, ..DriveSettings::default() };
    let mut steps = 0;
    let recording: Vec<_> = Drive::new(worlds::office_floor(seed).into(), settings)
        .scans()
        .reintegrate_odometry(|step| {
            steps += 1;
            if (60..90).contains(&steps) { Pose2::new(-step.x, -step.y, step.theta) } else { step }
        })
        .collect();
    let (mapper, _) = map_all(recording.iter().map(|recorded| &recorded.scan));
    let truth: Vec<Pose2> = recording.iter().map(|recorded| recorded.world_from_robot).collect();
    ate_m(&mapper, &truth)
}

/// Without starts from a reversed motion the median is above 4 m.
#[test]
fn most_maps_survive_wheels_that_count_the_wrong_way() {
    let mut errors = in_parallel(10, |seed| error_m(seed as u64));
    errors.sort_by(f64::total_cmp);
    assert!(errors[5] < 1.0, "{errors:.2?}");
}

/// The map's error on an office floor of `mapwright suite offices` that is driven through without odometry.
fn error_without_odometry_m(seed: u64) -> f64 {
    let laser = LaserSettings {
        range_sigma_m: 0.015,
        no_return_probability: 0.001,
        random_reading_probability: 1e-4,
        quantum_m: 0.01,
        ..LaserSettings::default()
    };
    let site = worlds::office_floor(seed).with_people(6, seed);
    let scans = recording(site, DriveSettings { laser, seed, ..DriveSettings::default() });
    let mut settings = Settings::default();
    settings.motion.use_odometry = false;
    let mut mapper = Mapper::new(settings).expect("valid settings");
    for recorded in &scans {
        mapper.add_scan(&recorded.scan);
    }
    let truth: Vec<Pose2> = scans.iter().map(|recorded| recorded.world_from_robot).collect();
    ate_m(&mapper, &truth)
}

/// Where each match was the velocity, 0.6 to 4.6 m.
#[test]
fn without_odometry_a_robot_neither_stands_in_corridors_nor_runs_ahead() {
    let seeds = [306, 307, 309, 314];
    let errors_m = in_parallel(seeds.len(), |k| error_without_odometry_m(seeds[k]));
    let sound = errors_m.iter().filter(|error_m| **error_m < 0.05).count();
    assert!(sound >= 3, "{errors_m:?}");
}
