//! What registration asks of trajectories through a simulated building.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use mapwright_eval::{EvalError, RevisitReport, RevisitScan, RevisitSettings, revisit_errors};
use mapwright_geom::{Pose3, Stamp};
use mapwright_sim::space::{LidarSettings, SpaceDrive, SpaceDriveSettings, SpaceSite, worlds};
use nalgebra::{Vector3, Vector6};
use std::sync::{Arc, OnceLock};

/// Of the drive's turns of the lidar every so many is a scan with a cloud.
const EVERY: u64 = 6;
/// Turns this far from the beginning belong to the way back.
const BACK: u64 = 150;

struct Visits {
    scans: Vec<RevisitScan>,
    clouds: Vec<Vec<[f32; 3]>>,
}

/// A drive along a corridor and back, with the true poses; clouds undistorted by the truth.
fn there_and_back() -> &'static Visits {
    static VISITS: OnceLock<Visits> = OnceLock::new();
    VISITS.get_or_init(|| {
        let site = worlds::two_storey(3);
        // A straight corridor of the lower storey.
        let [from, to] = [3, 2].map(|from_last| site.waypoints[site.waypoints.len() - from_last]);
        let waypoints = vec![from, to, from];
        let lidar = LidarSettings { columns: 360, ..LidarSettings::spinning(16) };
        let settings = SpaceDriveSettings { lidar, seed: 3, ..SpaceDriveSettings::default() };
        let drive = SpaceDrive::new(Arc::new(SpaceSite { waypoints, ..site }), settings);
        let (mut scans, mut clouds) = (Vec::new(), Vec::new());
        for number in (0..).step_by(EVERY as usize) {
            let Some(taken) = drive.cloud(number) else { break };
            let at = taken.world_from_robot;
            let undistorted = taken.cloud.points_m.iter().zip(&taken.cloud.times_s).filter_map(|(point, time_s)| {
                let stamp = Stamp(taken.cloud.stamp.0 + (f64::from(*time_s) * 1e9) as i64);
                let robot = drive.world_from_robot(stamp)? * taken.cloud.sensor.robot_from_sensor;
                let seen = at.inverse().transform(robot.transform(Vector3::from(point.map(f64::from))));
                seen.iter().all(|v| v.is_finite()).then(|| [seen.x as f32, seen.y as f32, seen.z as f32])
            });
            clouds.push(undistorted.collect());
            let stamp = taken.cloud.stamp;
            let sensor_m = taken.cloud.sensor.origin_m();
            scans.push(RevisitScan {
                stamp,
                number,
                map_from_robot: at,
                robot_from_cloud: Pose3::identity(),
                sensor_m,
            });
        }
        Visits { scans, clouds }
    })
}

fn settings() -> RevisitSettings {
    RevisitSettings { apart: 100, within_m: 2.0, ..RevisitSettings::for_range(6.0, 0.02) }
}

fn judged(poses: &[(Stamp, Pose3)]) -> RevisitReport {
    let Visits { scans, clouds } = there_and_back();
    revisit_errors(scans, Some(poses), |scan| &clouds[scan], &settings()).unwrap()
}

/// The truth, changed from the way back on.
fn truth_but(change: impl Fn(Pose3) -> Pose3) -> Vec<(Stamp, Pose3)> {
    let pose = |scan: &RevisitScan| if scan.number < BACK { scan.map_from_robot } else { change(scan.map_from_robot) };
    there_and_back().scans.iter().map(|scan| (scan.stamp, pose(scan))).collect()
}

#[test]
fn true_poses_are_hardly_corrected() {
    let Visits { scans, clouds } = there_and_back();
    let own = revisit_errors(scans, None, |scan| &clouds[scan], &settings()).unwrap();
    let corrections = own.corrections.unwrap();
    assert!(own.pairs >= 20 && own.pairs > 3 * (own.not_fitting + own.loose), "{own:?}");
    assert!(corrections.translation_m.median < 0.01 && corrections.rotation_deg.median < 0.2, "{own:?}");
    assert!(own.percentile_90.unwrap().0 < 0.02, "{own:?}");
    // In another frame, and paired by stamps, they say the same.
    let moved = Pose3::exp(Vector6::new(30.0, -20.0, 1.0, 0.2, -0.1, 2.0));
    let elsewhere: Vec<_> = scans.iter().map(|scan| (Stamp(scan.stamp.0 + 900), moved * scan.map_from_robot)).collect();
    let again = judged(&elsewhere);
    let difference = again.corrections.unwrap().translation_m.median - corrections.translation_m.median;
    assert!(again.pairs == own.pairs && difference.abs() < 1e-3, "{again:?}");
}

#[test]
fn an_error_between_visits_is_what_is_asked() {
    let errors = [[0.1, 0.05, 0.0, 0.0, 0.0, 0.0], [0.0, 0.3, 0.1, 0.0, 0.0, 0.05], [1.5, -1.0, 0.0, 0.0, 0.0, 0.4]];
    for numbers in errors {
        let error = Pose3::exp(Vector6::from(numbers));
        let found = judged(&truth_but(|pose| pose * error));
        let (corrections, inverse) = (found.corrections.unwrap(), error.inverse());
        let (metres, degrees) = (inverse.translation.norm(), inverse.rotation.angle().to_degrees());
        assert!((corrections.translation_m.median - metres).abs() < 0.01, "{metres} m: {found:?}");
        assert!((corrections.rotation_deg.median - degrees).abs() < 0.2, "{degrees} deg: {found:?}");
    }
}

#[test]
fn what_cannot_be_judged_is_counted_or_refused() {
    let Visits { scans, clouds } = there_and_back();
    let whole = truth_but(|pose| pose);
    let mut odd = whole.clone();
    odd[3].1.translation.x = f64::NAN;
    odd.remove(7);
    let found = judged(&odd);
    assert_eq!((found.scans, found.without_pose), (scans.len() - 2, 2));
    let points = |scan: usize| &clouds[scan];
    let once = revisit_errors(&scans[..10], None, points, &settings()).unwrap_err();
    assert!(matches!(once, EvalError::NoRevisits { scans: 10, nearest_m: None, .. }), "{once}");
    let narrow = RevisitSettings { within_m: 1e-6, ..settings() };
    let apart = revisit_errors(scans, None, points, &narrow).unwrap_err();
    assert!(apart.to_string().contains("the nearest are 0."), "{apart}");
    let other_day: Vec<_> = whole.iter().map(|(stamp, pose)| (Stamp(stamp.0 + 1_000_000_000_000), *pose)).collect();
    let unmatched = revisit_errors(scans, Some(&other_day), points, &settings()).unwrap_err();
    assert!(matches!(unmatched, EvalError::NoMatchingStamps { .. }), "{unmatched}");
    assert!(revisit_errors(&[], None, points, &settings()).is_err());
    // Clouds without points are registered nowhere.
    let empty = revisit_errors(scans, None, |_| Vec::<[f32; 3]>::new(), &settings()).unwrap();
    assert!(empty.pairs == 0 && empty.not_fitting > 0 && empty.corrections.is_none(), "{empty:?}");
}
