//! What is said of the calibration of a recording of clouds.

use super::{Found, FoundImu, Told};
use crate::calibration::Estimate;
use crate::calibration::words::{
    CLEAR_SIGMAS, DEGREES, lines, of_estimate, place_in_words, plus_minus, to_json as wheels_json,
};
use mapwright_logs::ImuFit;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use serde_json::{Value, json};

/// Step for the derivatives of angles, radians: they are smooth on this scale.
const STEP_RAD: f64 = 1e-6;

pub(super) fn to_words(name: &str, found: &Found, told: &Told) -> String {
    let imu = match &found.imu {
        Ok(imu) => imu_words(imu, told),
        Err(why) => format!("imu      not calibrated: {why}\n"),
    };
    let wheels = match &found.wheels {
        Ok(wheels) => lines("lidar", wheels, told.planar()),
        Err(why) => format!("lidar    not calibrated: {why}\n"),
    };
    format!("{name}: {}\n{imu}{wheels}", headline(found, told))
}

/// What was found, in a line.
fn headline(found: &Found, told: &Told) -> String {
    let mut parts = Vec::new();
    if let Ok(wheels) = &found.wheels {
        parts.push(format!("your lidar sits {}", place_in_words(wheels)));
    }
    if let (Ok(imu), Some(source)) = (&found.imu, &told.imu) {
        if imu.fit.knows_rotation() {
            let off = imu.robot_from_imu().value * source.robot_from_imu.inverse();
            let sigma_rad = imu.fit.least_known().1;
            parts.push(if off.angle() > CLEAR_SIGMAS * sigma_rad {
                format!("your inertial sensor is turned by {:.1} deg beside what is told", DEGREES * off.angle())
            } else {
                "your inertial sensor sits as told".to_owned()
            });
        }
        if imu.fit.knows_lag() {
            let lag_ms = 1000.0 * imu.lag_s();
            let is_clear = imu.lag_s().abs() > CLEAR_SIGMAS * imu.fit.lag_sigma_s;
            let side = if lag_ms > 0.0 { "late" } else { "early" };
            parts.push(if is_clear {
                format!("its stamps are {:.0} ms {side}", lag_ms.abs())
            } else {
                "its stamps are in time".to_owned()
            });
        }
    }
    parts.join(", ")
}

fn imu_words(imu: &FoundImu, told: &Told) -> String {
    let fit = &imu.fit;
    let said = told.imu.as_ref().map_or(UnitQuaternion::identity(), |source| source.robot_from_imu);
    let said = <[f64; 3]>::from(said.euler_angles()).map(|rad| DEGREES * rad + 0.0);
    let mount = if fit.knows_rotation() {
        let [roll, pitch, yaw] = imu.robot_from_imu().angles().map(|angle| plus_minus(angle, DEGREES, 2));
        format!("roll {roll}, pitch {pitch}, yaw {yaw} deg (told {:.2}, {:.2}, {:.2})", said[0], said[1], said[2])
    } else {
        let axis = fit.least_known().0;
        let axis = if axis.sum() < 0.0 { -axis } else { axis };
        let off_deg = DEGREES * axis_off_rad(fit, axis);
        format!(
            "the robot has turned about one axis alone, {:.2} {:.2} {:.2} or near it: how the sensor is turned about that axis is not told; the \
             axis itself is read {off_deg:.1} deg beside what is told",
            axis.x + 0.0,
            axis.y + 0.0,
            axis.z + 0.0
        )
    };
    let lag = if fit.knows_lag() {
        format!("its stamps are late by {} ms", plus_minus(imu.lag(), 1000.0, 1))
    } else {
        "the robot has turned too evenly to tell by how much its stamps are late".to_owned()
    };
    let [x, y, z] = imu.bias().map(|bias| plus_minus(bias, 1.0, 4));
    format!(
        "imu      {}: {mount}; {lag}\n\
         bias     {x}, {y}, {z} rad/s about the robot's axes\n\
         from     {} turns, {:.0} deg in all; turns as read and as matched differ by {:.2} deg about each axis; +- is one standard deviation\n",
        imu.told.name,
        fit.turns,
        DEGREES * fit.turned_rad,
        DEGREES * fit.residual_rad
    )
}

/// How far the axis about which nothing is known is read from where it is told, radians.
fn axis_off_rad(fit: &ImuFit, axis: Vector3<f64>) -> f64 {
    (fit.robot_from_told.inverse() * axis).angle(&axis)
}

/// A rotation and its covariance about the robot's axes.
pub(super) struct Turned {
    pub(super) value: UnitQuaternion<f64>,
    covariance_rad2: Matrix3<f64>,
}

impl Turned {
    /// Roll, pitch and yaw, radians.
    pub(super) fn angles(&self) -> [Estimate; 3] {
        let angles = |rotation: UnitQuaternion<f64>| Vector3::from(<[f64; 3]>::from(rotation.euler_angles()));
        let here = angles(self.value);
        let slopes = Matrix3::from_columns(&[0, 1, 2].map(|axis| {
            let beside = angles(UnitQuaternion::from_scaled_axis(Vector3::ith(axis, STEP_RAD)) * self.value);
            (beside - here).map(|rad| rad.sin() / STEP_RAD)
        }));
        let covariance = slopes * self.covariance_rad2 * slopes.transpose();
        [0, 1, 2].map(|k| Estimate { value: here[k], sigma: covariance[(k, k)].max(0.0).sqrt() })
    }
}

impl FoundImu {
    pub(super) fn robot_from_imu(&self) -> Turned {
        let value = self.fit.robot_from_told * self.told.robot_from_imu;
        Turned { value, covariance_rad2: self.fit.rotation_covariance_rad2 }
    }

    fn lag(&self) -> Estimate {
        Estimate { value: self.lag_s(), sigma: self.fit.lag_sigma_s }
    }

    /// About the robot's axes, radians a second; as uncertain as about the axis about which it is known least.
    fn bias(&self) -> [Estimate; 3] {
        let bias = self.fit.robot_from_told * Vector3::from(self.fit.bias_rad_per_s);
        let sigma = self.fit.bias_sigma_rad_per_s.iter().copied().fold(0.0, f64::max);
        [bias.x, bias.y, bias.z].map(|value| Estimate { value, sigma })
    }
}

pub(super) fn to_json(name: &str, found: &Found, told: &Told) -> Value {
    let (imu, why_no_imu) = match &found.imu {
        Ok(imu) => (imu_json(imu, told), None),
        Err(why) => (Value::Null, Some(why)),
    };
    let (lidar, why_no_lidar) = match &found.wheels {
        Ok(wheels) => (wheels_json(name, wheels, told.planar()), None),
        Err(why) => (Value::Null, Some(why)),
    };
    json!({ "log": name, "imu": imu, "imu_not_calibrated": why_no_imu, "lidar": lidar, "lidar_not_calibrated": why_no_lidar })
}

fn imu_json(imu: &FoundImu, told: &Told) -> Value {
    let fit = &imu.fit;
    let [roll, pitch, yaw] = imu.robot_from_imu().angles();
    let angles = json!({ "roll_rad": of_estimate(roll), "pitch_rad": of_estimate(pitch), "yaw_rad": of_estimate(yaw) });
    let unknown_axis = (!fit.knows_rotation()).then(|| <[f64; 3]>::from(fit.least_known().0));
    let presumed = told.imu.as_ref().map(|source| <[f64; 3]>::from(source.robot_from_imu.euler_angles()));
    json!({
        "topic": imu.told.name,
        "presumed": presumed,
        "robot_from_imu": fit.knows_rotation().then_some(angles),
        "not_told_about_axis": unknown_axis,
        "lag_s": fit.knows_lag().then(|| of_estimate(imu.lag())),
        "gyroscope_bias_rad_per_s": imu.bias().map(of_estimate),
        "turns": fit.turns,
        "turned_rad": fit.turned_rad,
        "residual_rad": fit.residual_rad,
    })
}
