//! Recordings in which matching a scan to the map is bound to go wrong: food for a mapper's guard.

use crate::drive::{Drive, DriveSettings, stamp_ns};
use crate::laser::LaserSettings;
use crate::odometry::OdometryNoise;
use crate::rng::Rng;
use crate::robot::Incident;
use crate::route::Site;
use crate::worlds::office_floor;
use mapwright_geom::Stamp;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_3, PI};
use std::sync::Arc;

/// How many cases a seed has.
pub const FAILED_MATCH_CASES: usize = 200;

/// What goes wrong in a case.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FailureKind {
    /// Nothing was recorded for 3 s, in which the robot turned by 90 degrees.
    GapWithTurn {
        /// Share of the turn that odometry reports.
        odometry_share: f64,
    },
    /// The robot turned by 60 degrees between one scan and the next.
    FastTurn {
        /// Share of the turn that odometry reports.
        odometry_share: f64,
    },
    /// A person filled half of the view.
    HalfView {
        /// For how long, seconds.
        duration_s: f64,
    },
}

/// A short recording on an office floor in which one thing goes wrong.
#[derive(Debug, Clone)]
pub struct FailedMatchCase {
    /// What goes wrong.
    pub kind: FailureKind,
    /// Index of the first scan that is hard to match: after the gap or turn, or with the person in view.
    pub event_scan: usize,
    /// Its stamp.
    pub event_stamp: Stamp,
    /// Where.
    pub site: Arc<Site>,
    /// The drive, some 20 s before the event and 15 s after.
    pub settings: DriveSettings,
}

impl FailedMatchCase {
    /// The recording, with its truth.
    #[must_use]
    pub fn drive(&self) -> Drive {
        Drive::new(Arc::clone(&self.site), self.settings.clone())
    }
}

/// The cases of a seed on ten office floors: a third of each kind, the turns with odometry that reports all, some or
/// nothing of them. The floors are shared; recordings are made when asked for.
#[must_use]
pub fn failed_match_cases(seed: u64) -> Vec<FailedMatchCase> {
    let mut rng = Rng::keyed(seed, 0x6661_696c);
    let sites: Vec<Arc<Site>> = (0..10).map(|_| Arc::new(office_floor(rng.next_u64()))).collect();
    (0..FAILED_MATCH_CASES).map(|k| case(k, Arc::clone(&sites[k % sites.len()]), &mut rng)).collect()
}

fn case(number: usize, site: Arc<Site>, rng: &mut Rng) -> FailedMatchCase {
    let scan_rate_hz = if number % 3 == 1 { 5.0 } else { 10.0 };
    let before = (rng.uniform(18.0, 24.0) * scan_rate_hz) as u64;
    let last_s = stamp_ns(before, scan_rate_hz) as f64 * 1e-9;
    let sign = if rng.chance(0.5) { 1.0 } else { -1.0 };
    let odometry_share = [1.0, 0.0, rng.uniform(0.2, 0.8)][number / 3 % 3];
    let (kind, incidents, lost_scans) = match number % 3 {
        0 => gap_with_turn(last_s, sign, odometry_share, scan_rate_hz),
        1 => fast_turn(last_s, sign, odometry_share, scan_rate_hz),
        _ => half_view(last_s, sign, rng.uniform(2.0, 6.0)),
    };
    let settings = DriveSettings {
        laser: LaserSettings { range_sigma_m: rng.uniform(0.01, 0.02), ..LaserSettings::default() },
        odometry: OdometryNoise::default(),
        scan_rate_hz,
        incidents,
        start_waypoint: rng.below(site.route.waypoints.len() * 4 / 5),
        duration_s: last_s + 18.0,
        seed: rng.next_u64(),
        ..DriveSettings::default()
    };
    let event_stamp = Stamp(stamp_ns(before + 1 + lost_scans, scan_rate_hz));
    FailedMatchCase { kind, event_scan: before as usize + 1, event_stamp, site, settings }
}

/// The last scan before the event was at `last_s`.
fn gap_with_turn(last_s: f64, sign: f64, odometry_share: f64, rate_hz: f64) -> (FailureKind, Vec<Incident>, u64) {
    let lost_scans = (3.0 * rate_hz) as u64;
    let from_s = last_s + 0.5 / rate_hz;
    let turn = Incident::Turn { from_s, duration_s: 3.0, angle_rad: sign * FRAC_PI_2, odometry_share };
    let outage = Incident::Outage { from_s, to_s: from_s + 3.0, odometry_lost: odometry_share == 0.0 };
    (FailureKind::GapWithTurn { odometry_share }, vec![turn, outage], lost_scans)
}

fn fast_turn(last_s: f64, sign: f64, odometry_share: f64, rate_hz: f64) -> (FailureKind, Vec<Incident>, u64) {
    let (from_s, duration_s) = (last_s + 0.1 / rate_hz, 0.8 / rate_hz);
    let turn = Incident::Turn { from_s, duration_s, angle_rad: sign * FRAC_PI_3, odometry_share };
    (FailureKind::FastTurn { odometry_share }, vec![turn], 0)
}

/// A person who covers a quarter turn of the half turn that the laser sees, its left or right half.
fn half_view(last_s: f64, sign: f64, duration_s: f64) -> (FailureKind, Vec<Incident>, u64) {
    let (radius_m, half_angle_rad) = (0.25, 0.25 * PI);
    let from_s = last_s + 0.01;
    let blocked = Incident::Blocked {
        from_s,
        to_s: from_s + duration_s,
        bearing_rad: sign * half_angle_rad,
        distance_m: radius_m / half_angle_rad.sin(),
        radius_m,
    };
    (FailureKind::HalfView { duration_s }, vec![blocked], 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::TrueScan;
    use mapwright_geom::wrap_angle;

    fn check(case: &FailedMatchCase) {
        let scans: Vec<TrueScan> = case.drive().scans().collect();
        let (last, event) = (&scans[case.event_scan - 1], &scans[case.event_scan]);
        assert_eq!(event.scan.stamp, case.event_stamp);
        assert!(scans.len() > case.event_scan + 30, "{} of {}", case.event_scan, scans.len());
        let turned = wrap_angle(event.world_from_robot.theta - last.world_from_robot.theta).abs();
        let gap_s = event.scan.stamp.secs_since(last.scan.stamp);
        match case.kind {
            FailureKind::GapWithTurn { .. } => assert!((turned - FRAC_PI_2).abs() < 0.2 && (gap_s - 3.1).abs() < 1e-6),
            FailureKind::FastTurn { .. } => assert!((turned - FRAC_PI_3).abs() < 0.2 && (gap_s - 0.2).abs() < 1e-6),
            FailureKind::HalfView { .. } => {
                let near = event.scan.ranges_m.iter().filter(|&&r| r < 0.4).count();
                assert!((80..=110).contains(&near), "{near}");
            }
        }
    }

    #[test]
    fn every_case_does_what_it_says() {
        let cases = failed_match_cases(1);
        assert_eq!(cases.len(), FAILED_MATCH_CASES);
        cases.iter().for_each(check);
    }
}
