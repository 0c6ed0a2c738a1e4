//! What a recording of clouds tells of the sensors: `--imu-mount`, `calibrate`, and `--calibration` of what that has found.

use crate::space_imu::Recorder;
use crate::support::{assert_code, assert_refused, folder, json, run, text};
use mapwright_geom::{Pose3, Stamp};
use mapwright_sim::RobotSettings;
use mapwright_sim::space::{LidarSettings, SpaceDrive, SpaceDriveSettings, worlds};
use serde_json::Value;
use std::path::Path;

/// How late the readings' stamps are, seconds.
const LATE_S: f64 = 0.04;

/// What a recording has besides clouds.
struct Has {
    imu: bool,
    wheels: bool,
}

/// As roll, pitch and yaw, and where.
fn placed(at_m: [f64; 3], roll: f64, pitch: f64, yaw: f64) -> Pose3 {
    let mut pose = Pose3::exp([0.0, 0.0, 0.0, 0.0, 0.0, yaw].into())
        * Pose3::exp([0.0, 0.0, 0.0, 0.0, pitch, 0.0].into())
        * Pose3::exp([0.0, 0.0, 0.0, roll, 0.0, 0.0].into());
    pose.translation = at_m.into();
    pose
}

/// Where the inertial sensor really sits; its transform says that it sits as the robot does.
fn robot_from_imu() -> Pose3 {
    placed([0.0; 3], 3.0, 0.2, -1.2)
}

/// Every second cloud of a drive that turns fast. The transforms have the lidar beside where it is, and the inertial sensor turned otherwise;
/// its stamps are late. Returned is where the lidar really sits.
fn record(path: &Path, has: &Has) -> Pose3 {
    let usual = SpaceDriveSettings::default();
    let settings = SpaceDriveSettings {
        lidar: LidarSettings { columns: 240, ..LidarSettings::spinning(16) },
        robot: RobotSettings { turn_rate_rad_per_s: 1.5, ..usual.robot.clone() },
        seed: 1,
        duration_s: 30.0,
        ..usual
    };
    let drive = SpaceDrive::new(worlds::two_storey(1).into(), settings.clone());
    let robot_from_lidar = settings.lidar.sensor.robot_from_sensor;
    let mut recorder = Recorder::new(path);
    let mut told = robot_from_lidar;
    told.translation += beside_m();
    recorder.mount("lidar", told);
    recorder.mount("imu", Pose3::identity());
    let mut readings = drive.imu_readings().peekable();
    let mut counted = (0..).map(|k| Stamp(20_000_000 * k)).peekable();
    for taken in drive.clouds().step_by(2) {
        let end = Stamp(taken.cloud.stamp.0 + 100_000_000);
        while let Some(reading) = readings.next_if(|reading| has.imu && reading.stamp <= end) {
            recorder.late_imu(&reading, robot_from_imu(), LATE_S);
        }
        while let Some(stamp) = counted.next_if(|stamp| has.wheels && *stamp <= end) {
            drive.odom_from_robot(stamp).into_iter().for_each(|odom| recorder.wheels(stamp, odom));
        }
        recorder.cloud(&taken.cloud);
    }
    recorder.finish();
    robot_from_lidar
}

/// How far beside the lidar the transforms have it, metres.
fn beside_m() -> nalgebra::Vector3<f64> {
    nalgebra::Vector3::new(0.12, -0.08, 0.0)
}

fn estimate(value: &Value) -> [f64; 2] {
    ["value", "sigma"].map(|part| value[part].as_f64().unwrap())
}

#[test]
fn an_inertial_sensor_and_a_lidar_are_found_where_they_sit() {
    let folder = folder("space_calibrate");
    let path = |name: &str| folder.join(name).display().to_string();
    let (log, file) = (path("drive.mcap"), path("found.toml"));
    let robot_from_lidar = record(Path::new(&log), &Has { imu: true, wheels: true });
    let output = run(&["calibrate", &log, "--json", "--apply", &file]);
    assert_code(&output, 0);
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    println!("{found:#}");
    let imu = &found["imu"];
    // a floor that is all but flat says little of the yaw
    for (angle, truth, within) in [("roll_rad", 3.0, 0.005), ("pitch_rad", 0.2, 0.005), ("yaw_rad", -1.2, 0.05)] {
        let [found, sigma] = estimate(&imu["robot_from_imu"][angle]);
        let off_rad = (found - truth).abs();
        assert!(off_rad < within && off_rad < 3.0 * sigma && sigma < 0.05, "{angle} {found} +- {sigma}, not {truth}");
    }
    let [lag_s, sigma_s] = estimate(&imu["lag_s"]);
    assert!((lag_s - LATE_S).abs() < 0.005 && (lag_s - LATE_S).abs() < 4.0 * sigma_s, "{lag_s} +- {sigma_s}");
    let lidar = &found["lidar"];
    for (key, truth) in
        [("x_m", robot_from_lidar.translation.x), ("y_m", robot_from_lidar.translation.y), ("yaw_rad", 0.0)]
    {
        let [found, sigma] = estimate(&lidar[key]);
        assert!(
            (found - truth).abs() < 0.03 && (found - truth).abs() < 4.0 * sigma,
            "{key} {found} +- {sigma}, not {truth}"
        );
    }

    // what was found is used, and nothing is left to be put right
    let [plain, applied] = [&[][..], &["--calibration", &file]].map(|more: &[&str]| {
        let out = path(if more.is_empty() { "plain" } else { "applied" });
        let output = run(&[&["map", &log, "-o", &out], more].concat());
        println!("{}", text(&output.stdout));
        json(&Path::new(&out).join("report.json"))
    });
    let count = |report: &Value, what: &str| report["imu"][what].as_u64().unwrap();
    let [predicted, contradicted] =
        ["clouds_predicted", "clouds_that_contradict"].map(|what| move |report: &Value| count(report, what));
    assert!(predicted(&applied) > 100 && predicted(&plain) < 50, "{}\n{}", plain["imu"], applied["imu"]);
    assert!(contradicted(&applied) <= 2 && contradicted(&plain) > 20, "{}\n{}", plain["imu"], applied["imu"]);
    let turned = |report: &Value| report["imu"]["turned_beside_what_is_told_rad"] != serde_json::json!([0.0, 0.0, 0.0]);
    assert!(!turned(&applied), "{}", applied["imu"]);
    let info = text(&run(&["info", &log, "--calibration", &file]).stdout).to_owned();
    assert!(info.contains("s late, as calibrated") && info.contains("x, y and yaw as calibrated"), "{info}");

    // the mount by hand
    let by_hand = ["map", &log, "--imu-mount", "3,0.2,-1.2", "--quiet", "-o", &path("by_hand")];
    assert_code(&run(&by_hand), 0);
    assert!(!turned(&json(&folder.join("by_hand/report.json"))));
    let info = text(&run(&["info", &log, "--imu-mount", "3,0.2,-1.2"]).stdout).to_owned();
    assert!(info.contains("mounted as asked for: roll 171.9, pitch 11.5, yaw -68.8 deg"), "{info}");
    for wrong in ["1,2", "1,2,x", "0,0,NaN", "0,0,90", ""] {
        assert_refused(&run(&["info", &log, "--imu-mount", wrong]), 2, &["expected roll, pitch and yaw in radians"]);
    }

    // a calibration of clouds is none of a planar laser, and the other way round
    let planar = path("planar.clf");
    std::fs::write(&planar, crate::support::small_log()).unwrap();
    assert_refused(&run(&["map", &planar, "-o", &path("x"), "--calibration", &file]), 1, &["calibration of a lidar"]);
    std::fs::write(&file, "[laser]\nx_m = 0.0\ny_m = 0.0\nyaw_rad = 0.0\nupside_down = false\n\n[odometry]\ntranslation_scale = 1.0\nrotation_scale = 1.0\ndrift_rad_per_m = 0.0\nlag_s = 0.0\n").unwrap();
    assert_refused(&run(&["map", &log, "-o", &path("x"), "--calibration", &file]), 2, &["planar lasers"]);
    for wrong in [
        "",
        "[imu]\nrobot_from_imu_rad = [0.0, 1.0]\n",
        "[imu]\nlag_s = 100.0\n",
        "[laser]\nx_m = 0.0\ny_m = 0.0\nyaw_rad = 0.0\nupside_down = false\n",
    ] {
        std::fs::write(&file, wrong).unwrap();
        assert_refused(&run(&["map", &log, "-o", &path("x"), "--calibration", &file]), 2, &["found.toml"]);
    }
}

#[test]
fn where_there_is_nothing_to_calibrate_that_is_said_and_nothing_is_written() {
    let folder = folder("space_calibrate_nothing");
    let path = |name: &str| folder.join(name).display().to_string();
    let (log, file) = (path("clouds.mcap"), path("found.toml"));
    record(Path::new(&log), &Has { imu: false, wheels: false });
    let output = run(&["calibrate", &log, "--apply", &file]);
    assert_refused(&output, 1, &["nothing to calibrate", "no odometry", "none that can be used"]);
    assert!(!Path::new(&file).exists());
}
