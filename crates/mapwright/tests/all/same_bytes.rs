//! Same input, same bytes.
#![allow(clippy::expect_used, clippy::print_stdout, reason = "a test may fail loudly and show what it measured")]

use crate::support;

use mapwright::Mapper;
use mapwright_sim::{DriveSettings, worlds};
use support::{map_all, recording};

fn trajectory_bits(mapper: &Mapper) -> Vec<(i64, [u64; 3])> {
    let bits = |pose: mapwright::Pose2| [pose.x, pose.y, pose.theta].map(f64::to_bits);
    mapper.trajectory().map(|p| (p.stamp.0, bits(p.map_from_robot))).collect()
}

fn mapped() -> Mapper {
    let settings = DriveSettings { seed: 3, duration_s: 40.0, ..DriveSettings::default() };
    map_all(recording(worlds::rooms(3), settings).iter().map(|s| &s.scan)).0
}

#[test]
fn the_same_log_gives_the_same_bits_twice_and_on_another_thread() {
    let first = mapped();
    for again in [mapped(), std::thread::spawn(mapped).join().expect("no panic")] {
        assert_eq!(trajectory_bits(&first), trajectory_bits(&again));
        assert!(first.local_map().counts().to_bytes() == again.local_map().counts().to_bytes());
        assert!(first.edges().eq(again.edges()));
        assert!(first.session() == again.session());
    }
}

#[test]
fn a_live_map_of_everything_is_the_exported_map() {
    let mapper = mapped();
    assert!(mapper.keyframes().len() > 20);
    assert!(mapper.local_map().counts().to_bytes() == mapper.render().to_bytes());
}
