//! Any bytes as scans: no panic, a finite pose, and nothing already mapped is lost.
//! `cargo +nightly fuzz run mapper -- -max_total_time=60`
#![no_main]

use libfuzzer_sys::fuzz_target;
use mapwright::{LaserModel, LaserScan, Mapper, Pose2, Settings, Stamp};
use std::sync::Arc;

/// Takes a number's bytes off the front; zeros where there are none left.
fn take<const N: usize>(bytes: &mut &[u8]) -> [u8; N] {
    let mut taken = [0; N];
    let (front, rest) = bytes.split_at(N.min(bytes.len()));
    taken[..front.len()].copy_from_slice(front);
    *bytes = rest;
    taken
}

/// A stamp, odometry (or none), and up to 255 ranges.
fn scan(bytes: &mut &[u8], laser: &Arc<LaserModel>) -> LaserScan {
    let [beams, odometry] = take(bytes);
    let stamp = Stamp(i64::from_le_bytes(take(bytes)));
    let [x, y, theta] = [(); 3].map(|()| f64::from(f32::from_le_bytes(take(bytes))));
    let odom_from_robot = (odometry < 200).then_some(Pose2 { x, y, theta });
    let ranges_m = (0..beams).map(|_| f32::from_le_bytes(take(bytes))).collect();
    LaserScan { stamp, laser: Arc::clone(laser), ranges_m, odom_from_robot }
}

fuzz_target!(|bytes: &[u8]| {
    let mut bytes = bytes;
    let mut mapper = Mapper::new(Settings::default()).expect("defaults are valid");
    let laser = Arc::new(LaserModel::half_circle("fuzzed", 255));
    while !bytes.is_empty() {
        let keyframes = mapper.keyframes().len();
        let pose = mapper.add_scan(&scan(&mut bytes, &laser)).map_from_robot;
        assert!(pose.is_finite() && pose.x.abs() <= 1e6 && pose.y.abs() <= 1e6, "{pose:?}");
        assert!(mapper.keyframes().len() >= keyframes);
    }
});
