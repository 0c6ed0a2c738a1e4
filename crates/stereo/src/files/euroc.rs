//! EuRoC and what is written like it (ASL format): Burri et al., "The EuRoC micro aerial vehicle datasets", IJRR 35(10), 2016.

use super::{pose, wrong};
use crate::calibration::{Calibration, Lens};
use crate::error::StereoError;
use mapwright_geom::Pose3;
use serde::Deserialize;

const FILE: &str = "EuRoC's sensor.yaml";

/// One camera: its `sensor.yaml`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EurocCamera {
    /// The camera.
    pub lens: Lens,
    /// From the camera's optical frame to the body's (`T_BS`), metres.
    pub body_from_camera: Pose3,
}

/// An inertial sensor: its `sensor.yaml`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EurocImu {
    /// From its frame to the body's (`T_BS`), metres.
    pub body_from_imu: Pose3,
}

impl EurocImu {
    /// Reads a file's text.
    ///
    /// # Errors
    /// [`StereoError::File`] where it has no mount.
    pub fn parse(text: &str) -> Result<Self, StereoError> {
        let Mounted { body_from_sensor } = of_yaml(text, "an inertial sensor in YAML")?;
        Ok(Self { body_from_imu: body_from_sensor.pose()? })
    }
}

#[derive(Deserialize)]
struct Mounted {
    #[serde(rename = "T_BS")]
    body_from_sensor: Matrix,
}

#[derive(Deserialize)]
struct Sensor {
    #[serde(rename = "T_BS")]
    body_from_camera: Matrix,
    resolution: Vec<u32>,
    camera_model: Option<String>,
    intrinsics: Vec<f64>,
    distortion_model: Option<String>,
    #[serde(default)]
    distortion_coefficients: Vec<f64>,
}

#[derive(Deserialize)]
struct Matrix {
    data: Vec<f64>,
}

impl EurocCamera {
    /// Reads a file's text.
    ///
    /// # Errors
    /// [`StereoError::File`] where it is no camera, or not a pinhole with radial and tangential distortion.
    pub fn parse(text: &str) -> Result<Self, StereoError> {
        let sensor: Sensor = of_yaml(text, "a camera in YAML")?;
        for (model, expected) in [(&sensor.camera_model, "pinhole"), (&sensor.distortion_model, "radial-tangential")] {
            let other =
                model.as_deref().filter(|model| *model != expected && !(expected != "pinhole" && *model == "radtan"));
            if let Some(found) = other {
                return Err(wrong(FILE, 0, format!("a {expected} model"), found));
            }
        }
        let &[width, height] = &sensor.resolution[..] else {
            return Err(wrong(FILE, 0, "2 numbers in `resolution`", &format!("{:?}", sensor.resolution)));
        };
        let &[fx, fy, cx, cy] = &sensor.intrinsics[..] else {
            return Err(wrong(FILE, 0, "4 numbers in `intrinsics`", &format!("{:?}", sensor.intrinsics)));
        };
        let distortion = match sensor.distortion_coefficients[..] {
            [] => [0.0; 5],
            [k1, k2, p1, p2] => [k1, k2, p1, p2, 0.0],
            [k1, k2, p1, p2, k3] => [k1, k2, p1, p2, k3],
            _ => {
                let found = format!("{:?}", sensor.distortion_coefficients);
                return Err(wrong(FILE, 0, "4 or 5 numbers in `distortion_coefficients`", &found));
            }
        };
        let body_from_camera = sensor.body_from_camera.pose()?;
        let lens = Lens { width, height, focal_px: [fx, fy], centre_px: [cx, cy], distortion };
        Ok(Self { lens, body_from_camera })
    }

    /// Two cameras of one body as a pair.
    ///
    /// # Errors
    /// Those of [`Calibration::check`].
    pub fn pair(left: &Self, right: &Self) -> Result<Calibration, StereoError> {
        let right_from_left = right.body_from_camera.inverse() * left.body_from_camera;
        let calibration = Calibration { left: left.lens, right: right.lens, right_from_left };
        calibration.check()?;
        Ok(calibration)
    }
}

fn of_yaml<T: serde::de::DeserializeOwned>(text: &str, expected: &str) -> Result<T, StereoError> {
    serde_saphyr::from_str(text).map_err(|error| {
        let text = error.to_string();
        wrong(FILE, 0, expected, text.lines().next().unwrap_or("none"))
    })
}

impl Matrix {
    fn pose(&self) -> Result<Pose3, StereoError> {
        let found = match *self.data {
            [a, b, c, x, d, e, f, y, g, h, i, z, 0.0, 0.0, 0.0, 1.0] => pose([a, b, c, d, e, f, g, h, i], [x, y, z]),
            _ => None,
        };
        found.ok_or_else(|| wrong(FILE, 0, "a rigid motion of 4 x 4 in `T_BS`", &format!("{:?}", self.data)))
    }
}

#[cfg(test)]
pub(super) const LEFT: &str = "\
# General sensor definitions.
sensor_type: camera
comment: VI-Sensor cam0 (MT9M034)

# Sensor extrinsics wrt. the body-frame.
T_BS:
  cols: 4
  rows: 4
  data: [0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975,
         0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768,
        -0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949,
         0.0, 0.0, 0.0, 1.0]

# Camera specific definitions.
rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.654, 457.296, 367.215, 248.375] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
";

#[cfg(test)]
mod tests {
    use super::*;

    const RIGHT: &str = "\
T_BS:
  cols: 4
  rows: 4
  data: [0.0125552670891, -0.999755099723, 0.0182237714554, -0.0198435579556,
         0.999598781151, 0.0130119051815, 0.0251588363115, 0.0453689425024,
        -0.0253898008918, 0.0179005838253, 0.999517347078, 0.00786212447038,
         0.0, 0.0, 0.0, 1.0]
resolution: [752, 480]
camera_model: pinhole
intrinsics: [457.587, 456.134, 379.999, 255.238]
distortion_model: radial-tangential
distortion_coefficients: [-0.28368365,  0.07451284, -0.00010473, -3.55590700e-05]
";

    #[test]
    fn both_cameras() {
        let [left, right] = [LEFT, RIGHT].map(|text| EurocCamera::parse(text).unwrap());
        let pair = EurocCamera::pair(&left, &right).unwrap();
        assert!((pair.right_camera_m().norm() - 0.110_07).abs() < 1e-4, "{}", pair.right_camera_m());
        let rectifier = crate::Rectifier::new(&pair).unwrap();
        let camera = rectifier.camera();
        assert!((camera.baseline_m - 0.110_07).abs() < 1e-4);
        assert!((camera.fx - 450.0).abs() < 60.0, "{camera:?}");
        let swapped = EurocCamera::pair(&right, &left).unwrap_err().to_string();
        assert!(swapped.contains("are left and right swapped?"), "{swapped}");
    }

    #[test]
    fn what_is_none() {
        let told = |from: &str, to: &str| EurocCamera::parse(&LEFT.replace(from, to)).unwrap_err().to_string();
        assert!(told("radial-tangential", "equidistant").contains("found `equidistant`"));
        assert!(told("[752, 480]", "[752]").contains("2 numbers in `resolution`"));
        assert!(told("0.999557249008", "0.5").contains("`T_BS`"));
        assert!(told("resolution", "resolutions").contains("a camera in YAML"));
        assert!(told("458.654, ", "").contains("4 numbers in `intrinsics`"));
        let zero = EurocCamera::parse(&LEFT.replace("458.654", "0.0")).unwrap();
        let right = EurocCamera::parse(RIGHT).unwrap();
        let error = EurocCamera::pair(&zero, &right).unwrap_err().to_string();
        assert!(error.starts_with("focal length fx of the left camera"), "{error}");
    }
}
