//! What `calibrate --apply` writes and `--calibration` reads.

use crate::calibration::Calibration;
use mapwright::Pose2;
use mapwright_logs::{MountChoice, OdometryCalibration, SpaceCalibration};
use nalgebra::UnitQuaternion;
use serde::Deserialize;
use std::fmt::Write;
use std::fs;
use std::path::Path;

/// The file, as TOML: of a planar laser both tables `laser` and `odometry`; of a recording of clouds what was found.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Calibrated {
    laser: Option<Laser>,
    lidar: Option<Lidar>,
    imu: Option<Imu>,
    odometry: Option<Wheels>,
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

/// Where the lidar or depth camera sits in the plane of the robot; height, roll and pitch are the recording's.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Lidar {
    x_m: f64,
    y_m: f64,
    yaw_rad: f64,
}

/// How the inertial sensor sits on the robot, as roll, pitch and yaw, and by how much its stamps are late.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Imu {
    robot_from_imu_rad: Option<[f64; 3]>,
    lag_s: Option<f64>,
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

/// The most that a calibration may say: metres, radians, factors about one, radians a metre and seconds.
const FARTHEST_M: f64 = 100.0;
const ANGLE_MOST_RAD: f64 = 10.0;
const SCALES: std::ops::RangeInclusive<f64> = 0.1..=10.0;
const DRIFT_MOST: f64 = 10.0;
const LAG_MOST_S: f64 = 10.0;

impl Wheels {
    fn of(found: &Calibration) -> Self {
        Self {
            translation_scale: found.translation_scale.value,
            rotation_scale: found.rotation_scale.value,
            drift_rad_per_m: found.drift_rad_per_m.value,
            lag_s: found.lag_s.map_or(0.0, |lag| lag.value),
        }
    }

    fn is_sound(&self) -> bool {
        [self.translation_scale, self.rotation_scale].iter().all(|scale| SCALES.contains(scale))
            && self.drift_rad_per_m.abs() <= DRIFT_MOST
            && self.lag_s.abs() <= LAG_MOST_S
    }
}

impl Calibrated {
    pub(crate) fn of(found: &Calibration, upside_down: bool) -> Self {
        let laser = Laser { x_m: found.x_m.value, y_m: found.y_m.value, yaw_rad: found.yaw_rad.value, upside_down };
        Self { laser: Some(laser), odometry: Some(Wheels::of(found)), ..Self::default() }
    }

    /// Of a recording of clouds: where its sensor sits, without what is wrong with odometry.
    pub(crate) fn lidar(found: &Calibration) -> Self {
        let lidar = Lidar { x_m: found.x_m.value, y_m: found.y_m.value, yaw_rad: found.yaw_rad.value };
        Self { lidar: Some(lidar), ..Self::default() }
    }

    /// The same with what is wrong with odometry.
    pub(crate) fn with_odometry(self, found: &Calibration) -> Self {
        Self { odometry: Some(Wheels::of(found)), ..self }
    }

    /// The same with what is known of the inertial sensor: how it sits, and by how much its stamps are late, seconds.
    pub(crate) fn with_imu(self, robot_from_imu: Option<UnitQuaternion<f64>>, lag_s: Option<f64>) -> Self {
        let robot_from_imu_rad = robot_from_imu.map(|rotation| <[f64; 3]>::from(rotation.euler_angles()));
        Self { imu: Some(Imu { robot_from_imu_rad, lag_s }), ..self }
    }

    /// What this says, and what an earlier one says besides.
    pub(crate) fn or(self, earlier: Self) -> Self {
        let (known, before) = (self.imu.unwrap_or_default(), earlier.imu.unwrap_or_default());
        let imu = Imu {
            robot_from_imu_rad: known.robot_from_imu_rad.or(before.robot_from_imu_rad),
            lag_s: known.lag_s.or(before.lag_s),
        };
        Self {
            laser: self.laser.or(earlier.laser),
            lidar: self.lidar.or(earlier.lidar),
            imu: self.imu.or(earlier.imu).map(|_| imu),
            odometry: self.odometry.or(earlier.odometry),
        }
    }

    /// The file's text.
    pub(crate) fn to_text(self, log: &str) -> String {
        let log: String = log.chars().filter(|c| !c.is_control()).collect();
        let mut tables = Vec::new();
        if let Some(Laser { x_m, y_m, yaw_rad, upside_down }) = self.laser {
            tables.push(format!(
                "[laser]\nx_m = {x_m:?}\ny_m = {y_m:?}\nyaw_rad = {yaw_rad:?}\nupside_down = {upside_down}\n"
            ));
        }
        if let Some(Lidar { x_m, y_m, yaw_rad }) = self.lidar {
            tables.push(format!("[lidar]\nx_m = {x_m:?}\ny_m = {y_m:?}\nyaw_rad = {yaw_rad:?}\n"));
        }
        if let Some(Imu { robot_from_imu_rad, lag_s }) = self.imu {
            let angles = robot_from_imu_rad.map_or_else(String::new, |rad| format!("robot_from_imu_rad = {rad:?}\n"));
            let lag = lag_s.map_or_else(String::new, |lag_s| format!("lag_s = {lag_s:?}\n"));
            tables.push(format!("[imu]\n{angles}{lag}"));
        }
        if let Some(Wheels { translation_scale, rotation_scale, drift_rad_per_m, lag_s }) = self.odometry {
            tables.push(format!(
                "[odometry]\ntranslation_scale = {translation_scale:?}\nrotation_scale = {rotation_scale:?}\ndrift_rad_per_m = \
                 {drift_rad_per_m:?}\nlag_s = {lag_s:?}\n"
            ));
        }
        format!("# of {log}, by mapwright calibrate\n{}", tables.join("\n"))
    }

    /// All that it says, in a line.
    pub(crate) fn in_words(self) -> String {
        let mut words = Vec::new();
        if let Some(Laser { x_m, y_m, yaw_rad, upside_down }) = self.laser {
            let flipped = if upside_down { ",flipped" } else { "" };
            words.push(format!("laser {x_m},{y_m},{yaw_rad}{flipped}"));
        }
        if let Some(Lidar { x_m, y_m, yaw_rad }) = self.lidar {
            words.push(format!("lidar {x_m},{y_m},{yaw_rad}"));
        }
        if let Some(Imu { robot_from_imu_rad, lag_s }) = self.imu {
            let mut imu = "imu".to_owned();
            if let Some([roll, pitch, yaw]) = robot_from_imu_rad {
                let _ = write!(imu, " {roll},{pitch},{yaw}");
            }
            words.push(imu + &lag_s.map_or_else(String::new, |lag_s| format!(" late by {lag_s} s")));
        }
        if let Some(Wheels { translation_scale, rotation_scale, drift_rad_per_m, lag_s }) = self.odometry {
            words.push(format!(
                "odometry scales {translation_scale}, {rotation_scale}, drift {drift_rad_per_m} rad/m, lag {lag_s} s"
            ));
        }
        words.join("; ")
    }

    /// What a file says; what is wrong with it, in words.
    pub(crate) fn read(path: &str) -> Result<Self, String> {
        let text = fs::read_to_string(Path::new(path)).map_err(|error| format!("cannot read it: {error}"))?;
        let read: Self = toml::from_str(&text).map_err(|error| error.to_string())?;
        let Self { laser, lidar, imu, odometry } = read;
        let of_plane = [laser.is_some(), odometry.is_some(), lidar.is_none() && imu.is_none()];
        if laser.is_some() != of_plane.iter().all(|is_so| *is_so) || read == Self::default() {
            let expected = "expected [laser] and [odometry] of a planar laser, or [lidar], [imu] or [odometry] of a recording of clouds";
            return Err(expected.to_owned());
        }
        let place = laser.map(|laser| [laser.x_m, laser.y_m, laser.yaw_rad]);
        let place = place.or_else(|| lidar.map(|lidar| [lidar.x_m, lidar.y_m, lidar.yaw_rad]));
        let is_place = |[x_m, y_m, yaw_rad]: [f64; 3]| {
            [x_m, y_m].iter().all(|m| m.abs() <= FARTHEST_M) && yaw_rad.abs() <= ANGLE_MOST_RAD
        };
        let Imu { robot_from_imu_rad, lag_s } = imu.unwrap_or_default();
        let is_sound = place.is_none_or(is_place)
            && robot_from_imu_rad.is_none_or(|angles| angles.iter().all(|rad| rad.abs() <= ANGLE_MOST_RAD))
            && lag_s.is_none_or(|lag_s| lag_s.abs() <= LAG_MOST_S)
            && odometry.is_none_or(|wheels| wheels.is_sound());
        let expected = "expected places within 100 m, angles within 10 rad, scales from 0.1 to 10, a drift within 10 rad/m and a lag within \
                        10 s";
        if is_sound { Ok(read) } else { Err(expected.to_owned()) }
    }

    /// Where the planar laser sits, if it is of one.
    pub(crate) fn mount(&self) -> Option<MountChoice> {
        let Laser { x_m, y_m, yaw_rad, upside_down } = self.laser?;
        Some(MountChoice { robot_from_laser: Pose2::new(x_m, y_m, yaw_rad), inverted: upside_down })
    }

    /// How the inertial sensor sits, if that is known.
    pub(crate) fn imu_mount(&self) -> Option<UnitQuaternion<f64>> {
        let [roll, pitch, yaw] = self.imu?.robot_from_imu_rad?;
        Some(UnitQuaternion::from_euler_angles(roll, pitch, yaw))
    }

    /// What it says of clouds, if it is of a recording of them.
    pub(crate) fn in_space(&self) -> Option<SpaceCalibration> {
        let robot_from_sensor = self.lidar.map(|Lidar { x_m, y_m, yaw_rad }| Pose2::new(x_m, y_m, yaw_rad));
        let imu_lag_s = self.imu.and_then(|imu| imu.lag_s).unwrap_or(0.0);
        self.laser.is_none().then_some(SpaceCalibration { robot_from_sensor, imu_lag_s })
    }

    pub(crate) fn odometry(&self) -> Option<OdometryCalibration> {
        let Wheels { translation_scale, rotation_scale, drift_rad_per_m, lag_s } = self.odometry?;
        Some(OdometryCalibration { translation_scale, rotation_scale, drift_rad_per_m, lag_s })
    }
}
