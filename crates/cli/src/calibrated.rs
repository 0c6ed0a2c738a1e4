//! What `calibrate --apply` writes and `--calibration` reads.

use crate::calibration::Calibration;
use mapwright::Pose2;
use mapwright_logs::{MountChoice, OdometryCalibration};
use serde::Deserialize;
use std::fs;
use std::path::Path;

/// The file, as TOML.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Calibrated {
    laser: Laser,
    odometry: Wheels,
}

/// Where the planar laser sits on the robot.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Laser {
    x_m: f64,
    y_m: f64,
    yaw_rad: f64,
    upside_down: bool,
}

/// True distance and turn per reported ones, true turn a metre that is not reported, and how far odometry lags behind.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Wheels {
    translation_scale: f64,
    rotation_scale: f64,
    drift_rad_per_m: f64,
    lag_s: f64,
}

/// The most that a calibration may say: metres, factors about one, radians a metre and seconds.
const FARTHEST_M: f64 = 100.0;
const SCALES: std::ops::RangeInclusive<f64> = 0.1..=10.0;
const DRIFT_MOST: f64 = 10.0;
const LAG_MOST_S: f64 = 10.0;

impl Calibrated {
    pub(crate) fn of(found: &Calibration, upside_down: bool) -> Self {
        Self {
            laser: Laser { x_m: found.x_m.value, y_m: found.y_m.value, yaw_rad: found.yaw_rad.value, upside_down },
            odometry: Wheels {
                translation_scale: found.translation_scale.value,
                rotation_scale: found.rotation_scale.value,
                drift_rad_per_m: found.drift_rad_per_m.value,
                lag_s: found.lag_s.map_or(0.0, |lag| lag.value),
            },
        }
    }

    /// The file's text.
    pub(crate) fn to_text(self, log: &str) -> String {
        let log: String = log.chars().filter(|c| !c.is_control()).collect();
        let Laser { x_m, y_m, yaw_rad, upside_down } = self.laser;
        let Wheels { translation_scale, rotation_scale, drift_rad_per_m, lag_s } = self.odometry;
        format!(
            "# of {log}, by mapwright calibrate\n[laser]\nx_m = {x_m:?}\ny_m = {y_m:?}\nyaw_rad = {yaw_rad:?}\nupside_down = \
             {upside_down}\n\n[odometry]\ntranslation_scale = {translation_scale:?}\nrotation_scale = {rotation_scale:?}\n\
             drift_rad_per_m = {drift_rad_per_m:?}\nlag_s = {lag_s:?}\n"
        )
    }

    /// All that it says, in a line.
    pub(crate) fn in_words(self) -> String {
        let Laser { x_m, y_m, yaw_rad, upside_down } = self.laser;
        let Wheels { translation_scale, rotation_scale, drift_rad_per_m, lag_s } = self.odometry;
        let flipped = if upside_down { ",flipped" } else { "" };
        format!(
            "laser {x_m},{y_m},{yaw_rad}{flipped}; odometry scales {translation_scale}, {rotation_scale}, drift {drift_rad_per_m} rad/m, \
             lag {lag_s} s"
        )
    }

    /// What a file says; what is wrong with it, in words.
    pub(crate) fn read(path: &str) -> Result<Self, String> {
        let text = fs::read_to_string(Path::new(path)).map_err(|error| format!("cannot read it: {error}"))?;
        let read: Self = toml::from_str(&text).map_err(|error| error.to_string())?;
        let Self { laser, odometry } = read;
        let is_sound = [laser.x_m, laser.y_m].iter().all(|m| m.abs() <= FARTHEST_M)
            && laser.yaw_rad.abs() <= 10.0
            && [odometry.translation_scale, odometry.rotation_scale].iter().all(|scale| SCALES.contains(scale))
            && odometry.drift_rad_per_m.abs() <= DRIFT_MOST
            && odometry.lag_s.abs() <= LAG_MOST_S;
        let expected =
            "expected places within 100 m, scales from 0.1 to 10, a drift within 10 rad/m and a lag within 10 s";
        if is_sound { Ok(read) } else { Err(expected.to_owned()) }
    }

    pub(crate) fn mount(&self) -> MountChoice {
        let Laser { x_m, y_m, yaw_rad, upside_down } = self.laser;
        MountChoice { robot_from_laser: Pose2::new(x_m, y_m, yaw_rad), inverted: upside_down }
    }

    pub(crate) fn odometry(&self) -> OdometryCalibration {
        let Wheels { translation_scale, rotation_scale, drift_rad_per_m, lag_s } = self.odometry;
        OdometryCalibration { translation_scale, rotation_scale, drift_rad_per_m, lag_s }
    }
}
