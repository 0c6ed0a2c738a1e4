//! Lasers of every kind map a simulated room.
#![allow(clippy::expect_used, clippy::print_stdout, reason = "a test may fail loudly and show what it measured")]

use crate::support;

use mapwright::{LaserModel, LaserScan, Pose2};
use mapwright_sim::{DriveSettings, LaserSettings, TrueScan, worlds};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;
use support::{ate_m, map_all, recording};

fn drive(laser: LaserSettings, duration_s: f64) -> Vec<TrueScan> {
    recording(worlds::rooms(5), DriveSettings { seed: 5, laser, duration_s, ..DriveSettings::default() })
}

fn check(what: &str, recorded: &[TrueScan], limit_m: f64) {
    let scans: Vec<&LaserScan> = recorded.iter().map(|s| &s.scan).collect();
    let truth: Vec<Pose2> = recorded.iter().map(|s| s.world_from_robot).collect();
    let error_m = ate_m(&map_all(scans).0, &truth);
    println!("{what}: ATE {:.1} mm in {} scans", error_m * 1e3, truth.len());
    assert!(error_m < limit_m, "{what}: {error_m} m");
}

fn changed(mut laser: LaserSettings, change: impl FnOnce(&mut LaserModel)) -> LaserSettings {
    change(Arc::make_mut(&mut laser.model));
    laser
}

#[test]
fn a_laser_may_sit_anywhere_and_upside_down() {
    let offset = Pose2::new(0.25, -0.1, 0.6);
    let aside = changed(LaserSettings::default(), |model| model.robot_from_laser = offset);
    check("offset", &drive(aside.clone(), 40.0), 0.02);
    let backwards = changed(LaserSettings::default(), |model| model.robot_from_laser = Pose2::new(-0.3, 0.0, PI));
    check("looking back", &drive(backwards, 40.0), 0.02);
    let inverted = changed(aside, |model| model.inverted = true);
    check("upside down", &drive(inverted, 40.0), 0.02);
    let clockwise = changed(LaserSettings::default(), |model| {
        model.angle_min_rad *= -1.0;
        model.angle_step_rad *= -1.0;
    });
    check("clockwise", &drive(clockwise, 40.0), 0.02);
}

#[test]
fn a_sweep_may_take_time() {
    let slow = changed(LaserSettings::default(), |model| model.beam_period_s = 0.08 / 180.0);
    check("80 ms a sweep", &drive(slow, 40.0), 0.02);
}

#[test]
fn a_laser_may_see_a_quarter_turn_or_all_around() {
    for degrees in [90.0_f64, 180.0, 270.0, 360.0] {
        let laser = LaserSettings::with_field_of_view(degrees.to_radians(), degrees as usize);
        check(&format!("{degrees} deg"), &drive(laser, 40.0), 0.02);
    }
    // The same view, numbered from the back.
    let from_zero = changed(LaserSettings::with_field_of_view(TAU, 360), |model| model.angle_min_rad = 0.0);
    check("0 to 360 deg", &drive(from_zero, 40.0), 0.02);
}

#[test]
fn a_laser_may_have_few_beams_or_many() {
    for (beams, limit_m) in [(60, 0.03), (90, 0.02), (500, 0.02), (2000, 0.02)] {
        let laser = LaserSettings::with_field_of_view(1.5 * PI, beams);
        check(&format!("{beams} beams"), &drive(laser, 40.0), limit_m);
    }
}

#[test]
fn scans_may_change_their_length_in_mid_log() {
    let mut cut = drive(LaserSettings::default(), 40.0);
    for recorded in cut.iter_mut().skip(100).step_by(3) {
        recorded.scan.ranges_m.truncate(120);
    }
    check("every third scan cut short", &cut, 0.02);
    // The path is the same with every laser.
    let coarse = drive(LaserSettings::default(), 40.0);
    let fine = drive(LaserSettings::with_field_of_view(FRAC_PI_2 * 3.0, 541), 40.0);
    let exchanged: Vec<TrueScan> = coarse.into_iter().take(200).chain(fine.into_iter().skip(200)).collect();
    check("another laser from scan 200 on", &exchanged, 0.02);
}
