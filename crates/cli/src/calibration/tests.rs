//! Drives whose mounts, wheels and lags are known.

use super::*;
use mapwright_sim::Rng;

/// So many steps from scan to scan, each so long, seconds.
const STEPS: usize = 10;
const STEP_S: f64 = 0.01;
const SCANS: usize = 4000;

/// A drive with turns to both sides whose wheels scatter and lag by so many steps; along its way a match says what the wheels do,
/// if asked for, as in a corridor.
fn scattered(robot_from_laser: Pose2, lag_steps: usize, in_corridor: bool) -> Vec<Sample> {
    let mut rng = Rng::new(7);
    let steps: Vec<[Pose2; 2]> = (0..STEPS * SCANS)
        .map(|k| {
            let at_s = STEP_S * k as f64;
            let ahead_m = STEP_S * (0.3 + 0.2 * (0.9 * at_s).sin());
            let turn_rad = STEP_S * 0.8 * (0.3 * at_s).sin().powi(5);
            let said = Pose2::new(ahead_m * 1.02 + rng.normal(0.002), 0.0, turn_rad * 0.97 + rng.normal(0.0025));
            [Pose2::new(ahead_m, 0.0, turn_rad), said]
        })
        .collect();
    let [mut map_from_robot, mut odom_from_robot] = [Pose2::IDENTITY; 2];
    let mut samples = Vec::new();
    for (k, [moved, _]) in steps.iter().enumerate().skip(lag_steps) {
        let [_, said] = steps[k - lag_steps];
        if (k - lag_steps).is_multiple_of(STEPS) {
            let map_from_laser = map_from_robot * robot_from_laser;
            samples.push(Sample { stamp: Stamp::from_secs_f64(STEP_S * k as f64), odom_from_robot, map_from_laser });
        }
        let ahead_m = if in_corridor { said.x } else { moved.x };
        map_from_robot = map_from_robot * Pose2::new(ahead_m, 0.0, moved.theta);
        odom_from_robot = odom_from_robot * said;
    }
    samples
}

#[test]
fn scatter_of_the_wheels_makes_nothing_smaller() {
    let found = calibrate(&[scattered(Pose2::new(0.2, -0.1, 0.1), 12, false)], Pose2::IDENTITY).unwrap();
    let near = |what: &str, Estimate { value, sigma }: Estimate, truth: f64, within: f64| {
        let off = (value - truth).abs();
        assert!(off < within && off < 3.0 * sigma, "{what}: {value} +- {sigma} instead of {truth}");
    };
    near("lag", found.lag_s.unwrap(), 0.12, 0.01);
    near("x", found.x_m, 0.2, 0.01);
    near("y", found.y_m, -0.1, 0.02);
    near("yaw", found.yaw_rad, 0.1, 0.003);
    near("scale of turns", found.rotation_scale, 1.0 / 0.97, 0.006);
}

#[test]
fn a_match_that_follows_the_wheels_hides_no_lag() {
    let found = calibrate(&[scattered(Pose2::IDENTITY, 12, true)], Pose2::IDENTITY).unwrap();
    let Estimate { value, sigma } = found.lag_s.unwrap();
    assert!((value - 0.12).abs() < 0.01 && (value - 0.12).abs() < 3.0 * sigma, "{value} +- {sigma}");
}

#[test]
fn what_was_put_in_comes_out() {
    let robot_from_laser = Pose2::new(-0.04, 0.03, 0.02);
    let (mut world_from_robot, mut odom_from_robot) = (Pose2::IDENTITY, Pose2::IDENTITY);
    let mut run = Vec::new();
    for k in 0..2000 {
        let stamp = Stamp(i64::from(k) * 100_000_000);
        run.push(Sample { stamp, odom_from_robot, map_from_laser: world_from_robot * robot_from_laser });
        let (turn, ahead_m) = (0.06 * (f64::from(k) * 0.02).sin(), 0.05 + 0.03 * (f64::from(k) * 0.031).sin());
        world_from_robot = world_from_robot * Pose2::new(ahead_m, 0.0, turn);
        odom_from_robot = odom_from_robot * Pose2::new(ahead_m / 1.02, 0.0, (turn - 0.01 * ahead_m) / 0.97);
    }
    let found = calibrate(&[run], Pose2::IDENTITY).unwrap();
    let near = |estimate: Estimate, value: f64| assert!((estimate.value - value).abs() < 1e-3, "{estimate:?}");
    near(found.x_m, -0.04);
    near(found.y_m, 0.03);
    near(found.yaw_rad, 0.02);
    near(found.translation_scale, 1.02);
    near(found.rotation_scale, 0.97);
    near(found.drift_rad_per_m, 0.01 * 1.02);
    near(found.lag_s.unwrap(), 0.0);
}

#[test]
fn stamps_in_bursts_tell_no_lag() {
    let mut samples = scattered(Pose2::new(0.2, -0.1, 0.1), 0, false);
    for (k, sample) in samples.iter_mut().enumerate() {
        sample.stamp = Stamp((k / 4) as i64 * 400_000_000 + (k % 4) as i64 * 1_000_000);
    }
    let found = calibrate(&[samples], Pose2::IDENTITY).unwrap();
    assert_eq!(found.lag_s, None);
    assert!((found.x_m.value - 0.2).abs() < 3.0 * found.x_m.sigma, "{:?}", found.x_m);
}

#[test]
fn scans_seconds_apart_tell_no_lag() {
    let mut samples = scattered(Pose2::new(0.2, -0.1, 0.1), 0, false);
    // as a logger with stamps in whole seconds writes them
    for (k, sample) in samples.iter_mut().enumerate() {
        sample.stamp = Stamp((6 * k + usize::from(k % 3 == 0)) as i64 * 1_000_000_000);
    }
    let found = calibrate(&[samples], Pose2::IDENTITY).unwrap();
    assert_eq!(found.lag_s, None);
    assert!((found.x_m.value - 0.2).abs() < 3.0 * found.x_m.sigma, "{:?}", found.x_m);
}

#[test]
fn a_laser_turned_by_any_angle_is_found() {
    for turned_deg in [90.0_f64, 135.0, 175.0, 180.0, -120.0] {
        let mount = Pose2::new(0.2, -0.1, turned_deg.to_radians());
        let found = calibrate(&[scattered(mount, 12, false)], Pose2::IDENTITY).unwrap();
        let off = [found.x_m.value - 0.2, found.y_m.value + 0.1, wrapped(found.yaw_rad.value - mount.theta)];
        assert!(off.iter().all(|off| off.abs() < 0.02), "{turned_deg}: {off:?}");
    }
}

#[test]
fn half_a_minute_is_enough() {
    let drive = scattered(Pose2::new(0.2, -0.1, 0.1), 0, false);
    let (mut found, mut within) = (0, 0);
    for run in drive.chunks(300) {
        let Ok(calibration) = calibrate(&[run.to_vec()], Pose2::IDENTITY) else { continue };
        found += 1;
        let near = |Estimate { value, sigma }: Estimate, truth: f64| (value - truth).abs() < 3.0 * sigma;
        within +=
            usize::from(near(calibration.x_m, 0.2) && near(calibration.y_m, -0.1) && near(calibration.yaw_rad, 0.1));
    }
    assert!(found >= 9 && within + 1 >= found, "{found} found, {within} within their deviations");
}

#[test]
fn wheels_that_have_nothing_to_do_with_the_scans_are_refused() {
    let mut samples = scattered(Pose2::IDENTITY, 0, false);
    let mut rng = Rng::new(11);
    for sample in &mut samples {
        sample.odom_from_robot = Pose2::new(rng.normal(1.0), rng.normal(1.0), rng.normal(1.0));
    }
    let refused = calibrate(&[samples], Pose2::IDENTITY);
    assert!(refused.is_err(), "{refused:?}");
}

#[test]
fn a_drive_without_turns_is_refused_in_words() {
    let sample = |k: i32| Pose2::new(0.05 * f64::from(k), 0.0, 0.0);
    let stamp = |k: i32| Stamp(i64::from(k) * 100_000_000);
    let run =
        (0..2000).map(|k| Sample { stamp: stamp(k), odom_from_robot: sample(k), map_from_laser: sample(k) }).collect();
    assert!(calibrate(&[run], Pose2::IDENTITY).unwrap_err().contains("rad of turning"));
}
