//! Any bytes as settings, a laser and its scans: no panic, a finite pose, and nothing already mapped is lost.
//! `cargo +nightly fuzz run mapper -- -max_total_time=60`
#![no_main]

use libfuzzer_sys::fuzz_target;
use mapwright::{LaserModel, LaserScan, LivePolicy, Mapper, Optimizer, Pose2, Settings, Stamp};
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

fn settings(choices: u8) -> Settings {
    let mut settings = Settings::default();
    let chosen = |bit: u8| choices & (1 << bit) != 0;
    settings.motion.use_odometry = !chosen(0);
    settings.live.policy = if chosen(1) { LivePolicy::Gated } else { LivePolicy::Everything };
    settings.matching.optimizer = match choices >> 6 {
        0 | 1 => Optimizer::GaussNewton,
        2 => Optimizer::GradientAscent,
        _ => Optimizer::UnscaledGradientAscent,
    };
    settings
}

/// Half a circle, or whatever the bytes say.
fn laser(choices: u8, bytes: &mut &[u8]) -> LaserModel {
    let sound = LaserModel::half_circle("fuzzed", 255);
    if choices & 8 == 0 {
        return sound;
    }
    let [angle_min_rad, angle_step_rad, range_min_m, range_max_m] = [(); 4].map(|()| number(bytes));
    let [x, y, theta, beam_period_s] = [(); 4].map(|()| number(bytes));
    let (robot_from_laser, inverted) = (Pose2 { x, y, theta }, choices & 16 != 0);
    let angles = LaserModel { angle_min_rad, angle_step_rad, inverted, ..sound };
    LaserModel { range_min_m, range_max_m, robot_from_laser, beam_period_s, ..angles }
}

/// A stamp, odometry (or none), and up to 255 ranges.
fn scan(bytes: &mut &[u8], laser: &Arc<LaserModel>) -> LaserScan {
    let [beams, odometry] = take(bytes);
    let stamp = Stamp(i64::from_le_bytes(take(bytes)));
    let [x, y, theta] = [(); 3].map(|()| number(bytes));
    let odom_from_robot = (odometry < 200).then_some(Pose2 { x, y, theta });
    let ranges_m = (0..beams).map(|_| f32::from_le_bytes(take(bytes))).collect();
    LaserScan { stamp, laser: Arc::clone(laser), ranges_m, odom_from_robot }
}

fuzz_target!(|bytes: &[u8]| {
    let mut bytes = bytes;
    let [choices] = take(&mut bytes);
    let mut mapper = Mapper::new(settings(choices)).expect("all valid");
    let laser = Arc::new(laser(choices, &mut bytes));
    while !bytes.is_empty() {
        let keyframes = mapper.keyframes().len();
        let pose = mapper.add_scan(&scan(&mut bytes, &laser)).map_from_robot;
        assert!(pose.is_finite() && pose.x.abs() <= 1e6 && pose.y.abs() <= 1e6, "{pose:?}");
        assert!(mapper.keyframes().len() >= keyframes);
    }
});
