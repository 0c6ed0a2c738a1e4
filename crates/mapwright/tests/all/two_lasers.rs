//! Front and rear scanners of one robot: both are mapped, each at its stamp and mount.
#![allow(clippy::expect_used, clippy::print_stdout, reason = "a test may fail loudly and show what it measured")]

use crate::support;

use mapwright::{LaserModel, LaserScan, Mapper, Pose2, Stamp};
use mapwright_sim::{Drive, DriveSettings, LaserSettings, Site, TrueScan, worlds};
use std::f64::consts::{FRAC_PI_4, PI};
use std::sync::Arc;
use support::{ate_m, map_all};

/// A scanner of a robot: its name, where it sits, degrees that it sees, scans a second.
struct Scanner {
    name: &'static str,
    robot_from_laser: Pose2,
    degrees: usize,
    rate_hz: f64,
}

/// On opposite corners, three quarters of a turn each, as a warehouse's robot has them.
fn corners(degrees: usize) -> [Scanner; 2] {
    let turn = if degrees > 180 { FRAC_PI_4 } else { 0.0 };
    let front = Scanner { name: "front", robot_from_laser: Pose2::new(0.4, 0.25, turn), degrees, rate_hz: 12.0 };
    [front, Scanner { name: "rear", robot_from_laser: Pose2::new(-0.4, -0.25, turn - PI), degrees, rate_hz: 8.0 }]
}

/// What one scanner records of a drive that is the same with each.
fn recorded(site: &Arc<Site>, scanner: &Scanner, seed: u64) -> Vec<TrueScan> {
    let mut laser = LaserSettings::with_field_of_view((scanner.degrees as f64).to_radians(), scanner.degrees);
    let model = LaserModel::clone(&laser.model);
    let (name, robot_from_laser) = (scanner.name.to_owned(), scanner.robot_from_laser);
    laser.model = Arc::new(LaserModel { name, robot_from_laser, range_max_m: 15.0, ..model });
    let duration_s = 160.0;
    let settings = DriveSettings { scan_rate_hz: scanner.rate_hz, laser, seed, duration_s, ..DriveSettings::default() };
    Drive::new(Arc::clone(site), settings).scans().collect()
}

/// Scans of several in the order of their stamps.
fn merged(each: &[&[TrueScan]]) -> Vec<TrueScan> {
    let mut all: Vec<TrueScan> = each.iter().flat_map(|scans| scans.iter().cloned()).collect();
    all.sort_by_key(|scan| scan.scan.stamp);
    all
}

fn mapped(recorded: &[TrueScan], has_odometry: bool) -> (Mapper, f64) {
    let said = |scan: &TrueScan| scan.scan.odom_from_robot.filter(|_| has_odometry);
    let scans: Vec<LaserScan> =
        recorded.iter().map(|s| LaserScan { odom_from_robot: said(s), ..s.scan.clone() }).collect();
    let truth: Vec<Pose2> = recorded.iter().map(|s| s.world_from_robot).collect();
    let mapper = map_all(&scans).0;
    let error_m = ate_m(&mapper, &truth);
    (mapper, error_m)
}

/// Errors with the front laser, the rear one, and both, metres.
fn errors(degrees: usize, seed: u64, has_odometry: bool) -> [f64; 3] {
    let site = Arc::new(worlds::office_floor(seed));
    let [front, rear] = corners(degrees).map(|scanner| recorded(&site, &scanner, seed));
    let errors = [&front, &rear, &merged(&[&front, &rear])].map(|scans| mapped(scans, has_odometry).1);
    println!("{degrees} deg, seed {seed}, odometry {has_odometry}: front, rear, both {errors:.4?} m");
    errors
}

#[test]
fn with_both_lasers_a_robot_is_where_it_is_with_the_better_one_at_least() {
    for (degrees, has_odometry) in [(270, true), (270, false), (180, true)] {
        let (mut alone, mut both) = (0.0, 0.0);
        for seed in 1..=2 {
            let [front_m, rear_m, both_m] = errors(degrees, seed, has_odometry);
            (alone, both) = (alone + front_m.min(rear_m), both + both_m);
            assert!(both_m < 0.03, "{both_m} m");
        }
        // as good as one alone, but for a millimetre of noise
        assert!(both <= alone + 2e-3, "{both} m, with the better one alone {alone} m");
    }
}

#[test]
fn what_the_rear_laser_sees_is_drawn() {
    let site = Arc::new(worlds::office_floor(3));
    let [front, rear] = corners(180).map(|scanner| {
        let seen = recorded(&site, &scanner, 3);
        seen.into_iter().take_while(|scan| scan.scan.stamp < Stamp::from_secs_f64(4.0)).collect::<Vec<_>>()
    });
    let known = |scans: &[TrueScan]| mapped(scans, true).0.render().known_cells().count();
    let (ahead, all) = (known(&front), known(&merged(&[&front, &rear])));
    assert!(3 * all > 4 * ahead, "{all} cells are known with both, {ahead} with the front one");
}

/// Both sweep at once: their stamps are the same, and between them the robot has not moved.
#[test]
fn lasers_may_sweep_at_the_same_time() {
    let site = Arc::new(worlds::office_floor(2));
    let both = corners(270).map(|scanner| recorded(&site, &Scanner { rate_hz: 10.0, ..scanner }, 2));
    let (_, error_m) = mapped(&merged(&[&both[0], &both[1]]), false);
    println!("at once, without odometry: {error_m:.4} m");
    assert!(error_m < 0.03, "{error_m} m");
}
