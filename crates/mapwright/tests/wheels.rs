//! Wheels that do not tell forwards from backwards.
#![allow(clippy::expect_used, reason = "a test may fail loudly")]

mod support;

use mapwright::Pose2;
use mapwright_sim::{Drive, DriveSettings, PerturbScans, worlds};
use support::{ate_m, in_parallel, map_all};

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
