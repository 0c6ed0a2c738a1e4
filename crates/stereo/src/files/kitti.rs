//! KITTI: Geiger et al., "Vision meets robotics: the KITTI dataset", IJRR 32(11), 2013.

use super::{keyed, missing, numbers, pose, side, wrong};
use crate::calibration::{Calibration, Lens};
use crate::camera::StereoCamera;
use crate::error::StereoError;
use mapwright_geom::Pose3;

const PROJECTIONS: &str = "KITTI's calib.txt";
const CAMERAS: &str = "KITTI's calib_cam_to_cam.txt";
/// Grey cameras 0 and 1, colour cameras 2 and 3.
const COUNT: usize = 4;

/// The projections `P0` to `P3` of the rectified cameras, as `calib.txt` of the odometry benchmark has them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KittiProjections([Option<[f64; 12]>; COUNT]);

impl KittiProjections {
    /// Reads a file's text.
    ///
    /// # Errors
    /// [`StereoError::File`] where a line `P0` to `P3` has other than twelve numbers, or there is none.
    pub fn parse(text: &str) -> Result<Self, StereoError> {
        let mut found = [None; COUNT];
        for (line, key, value) in keyed(text, ':') {
            if let Some(camera) = ["P0", "P1", "P2", "P3"].iter().position(|name| *name == key) {
                found[camera] = Some(numbers(value).ok_or_else(|| wrong(PROJECTIONS, line, "12 numbers", value))?);
            }
        }
        if found.iter().all(Option::is_none) {
            return Err(missing(PROJECTIONS, "lines `P0:` to `P3:`"));
        }
        Ok(Self(found))
    }

    /// Two of the cameras as a pair, whose images have that many pixels across and down: 0 and 1 are grey, 2 and 3 of colour.
    ///
    /// # Errors
    /// [`StereoError::File`] where one of them is not in the file, [`StereoError::Calibration`] where they are no pair.
    pub fn pair(&self, left: usize, right: usize, size: [u32; 2]) -> Result<StereoCamera, StereoError> {
        let of = |camera: usize| {
            self.0.get(camera).copied().flatten().ok_or_else(|| missing(PROJECTIONS, format!("a line `P{camera}:`")))
        };
        rectified(of(left)?, of(right)?, size)
    }

    /// How far a camera is to the right of camera 0, metres; none where it is not in the file.
    #[must_use]
    pub fn offset_m(&self, camera: usize) -> Option<f64> {
        let [fx, _, _, shift, ..] = self.0.get(camera).copied().flatten()?;
        Some(-shift / fx).filter(|metres| metres.is_finite())
    }
}

/// `P = K [I | t]`: `P[3] = fx t_x`, where the camera is at `-t_x` along the rows.
fn rectified(left: [f64; 12], right: [f64; 12], [width, height]: [u32; 2]) -> Result<StereoCamera, StereoError> {
    let [fx, _, cx, _, _, fy, cy] = [left[0], left[1], left[2], left[3], left[4], left[5], left[6]];
    let same = [(fx, right[0]), (fy, right[5]), (cy, right[6])];
    if let Some((of_left, of_right)) = same.into_iter().find(|(l, r)| (l - r).abs() > 1e-3 * l.abs()) {
        return Err(StereoError::Calibration {
            of: "projections of the left and the right camera".to_owned(),
            expected: "the same focal lengths and row of the axis, for images are rectified",
            found: format!("{of_left} and {of_right}"),
        });
    }
    let baseline_m = left[3] / fx - right[3] / right[0];
    let camera = StereoCamera { width, height, fx, fy, cx, cx_right: right[2], cy, baseline_m };
    camera.check()?;
    Ok(camera)
}

/// The cameras of a recording, as they are and as they are rectified: `calib_cam_to_cam.txt` of the raw data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KittiCameras([KittiCamera; COUNT]);

#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct KittiCamera {
    size: Option<[f64; 2]>,
    matrix: Option<[f64; 9]>,
    distortion: Option<[f64; 5]>,
    rotation: Option<[f64; 9]>,
    translation: Option<[f64; 3]>,
    size_rectified: Option<[f64; 2]>,
    projection: Option<[f64; 12]>,
}

impl KittiCameras {
    /// Reads a file's text.
    ///
    /// # Errors
    /// [`StereoError::File`] where a line has too few or too many numbers, or there are none of cameras.
    pub fn parse(text: &str) -> Result<Self, StereoError> {
        fn put<const N: usize>(to: &mut Option<[f64; N]>, line: usize, value: &str) -> Result<(), StereoError> {
            *to = Some(numbers(value).ok_or_else(|| wrong(CAMERAS, line, format!("{N} numbers"), value))?);
            Ok(())
        }
        let mut cameras = [KittiCamera::default(); COUNT];
        for (line, key, value) in keyed(text, ':') {
            let Some((name, number)) = key.rsplit_once('_') else { continue };
            let Some(camera) = number.parse().ok().and_then(|number: usize| cameras.get_mut(number)) else { continue };
            match name {
                "S" => put(&mut camera.size, line, value)?,
                "K" => put(&mut camera.matrix, line, value)?,
                "D" => put(&mut camera.distortion, line, value)?,
                "R" => put(&mut camera.rotation, line, value)?,
                "T" => put(&mut camera.translation, line, value)?,
                "S_rect" => put(&mut camera.size_rectified, line, value)?,
                "P_rect" => put(&mut camera.projection, line, value)?,
                _ => {}
            }
        }
        if cameras.iter().all(|camera| *camera == KittiCamera::default()) {
            return Err(missing(CAMERAS, "lines such as `K_00:` and `P_rect_00:`"));
        }
        Ok(Self(cameras))
    }

    /// Two of the cameras as they are, for images that are not rectified (`unsync` and `extract` of the raw data).
    ///
    /// # Errors
    /// [`StereoError::File`] where the file does not have all of them, [`StereoError::Calibration`] where they are no pair.
    pub fn raw(&self, left: usize, right: usize) -> Result<Calibration, StereoError> {
        let [(left, left_from_first), (right, right_from_first)] = [self.lens(left)?, self.lens(right)?];
        let right_from_left = right_from_first * left_from_first.inverse();
        let calibration = Calibration { left, right, right_from_left };
        calibration.check()?;
        Ok(calibration)
    }

    /// Two of the cameras as they are rectified (`sync` of the raw data).
    ///
    /// # Errors
    /// As [`raw`](Self::raw).
    pub fn rectified(&self, left: usize, right: usize) -> Result<StereoCamera, StereoError> {
        let of = |number: usize| {
            let camera = self.0.get(number).copied().unwrap_or_default();
            camera.projection.ok_or_else(|| missing(CAMERAS, format!("a line `P_rect_{number:02}:`")))
        };
        let size = self.0.get(left).and_then(|camera| camera.size_rectified);
        let size = size.ok_or_else(|| missing(CAMERAS, format!("a line `S_rect_{left:02}:`")))?;
        rectified(of(left)?, of(right)?, sides(size)?)
    }

    /// A camera, and the pose to its frame from that of the first.
    fn lens(&self, number: usize) -> Result<(Lens, Pose3), StereoError> {
        let camera = self.0.get(number).copied().unwrap_or_default();
        let no = |name: &str| missing(CAMERAS, format!("a line `{name}_{number:02}:`"));
        let [width, height] = sides(camera.size.ok_or_else(|| no("S"))?)?;
        let [fx, _, cx, _, fy, cy, ..] = camera.matrix.ok_or_else(|| no("K"))?;
        let distortion = camera.distortion.ok_or_else(|| no("D"))?;
        let rotation = camera.rotation.ok_or_else(|| no("R"))?;
        let translation = camera.translation.ok_or_else(|| no("T"))?;
        let pose = pose(rotation, translation)
            .ok_or_else(|| wrong(CAMERAS, 0, format!("a rotation in `R_{number:02}:`"), &format!("{rotation:?}")))?;
        Ok((Lens { width, height, focal_px: [fx, fy], centre_px: [cx, cy], distortion }, pose))
    }
}

fn sides(size: [f64; 2]) -> Result<[u32; 2], StereoError> {
    match size.map(side) {
        [Some(width), Some(height)] => Ok([width, height]),
        _ => Err(wrong(CAMERAS, 0, "pixels across and down in `S_..:`", &format!("{size:?}"))),
    }
}

#[cfg(test)]
pub(super) const ODOMETRY: &str = "\
P0: 7.188560e+02 0.0 6.071928e+02 0.0 0.0 7.188560e+02 1.852157e+02 0.0 0.0 0.0 1.0 0.0
P1: 7.188560e+02 0.0 6.071928e+02 -3.861448e+02 0.0 7.188560e+02 1.852157e+02 0.0 0.0 0.0 1.0 0.0
Tr: 4.27 -9.99 -8.08 -1.19 -7.21 8.08 -9.99 -5.40 9.99 4.85 -7.20 -2.92
";
#[cfg(test)]
pub(super) const CAM_TO_CAM: &str = "\
calib_time: 09-Jan-2012 13:57:47
corner_dist: 9.950000e-02
S_00: 1.392000e+03 5.120000e+02
K_00: 9.842439e+02 0.000000e+00 6.900000e+02 0.000000e+00 9.808141e+02 2.331966e+02 0.000000e+00 0.000000e+00 1.000000e+00
D_00: -3.728755e-01 2.037299e-01 2.219027e-03 1.383707e-03 -7.233722e-02
R_00: 1.000000e+00 0.000000e+00 0.000000e+00 0.000000e+00 1.000000e+00 0.000000e+00 0.000000e+00 0.000000e+00 1.000000e+00
T_00: 2.573699e-16 -1.059758e-16 1.614870e-16
S_rect_00: 1.242000e+03 3.750000e+02
P_rect_00: 7.215377e+02 0.000000e+00 6.095593e+02 0.000000e+00 0.000000e+00 7.215377e+02 1.728540e+02 0.000000e+00 0.000000e+00 0.000000e+00 1.000000e+00 0.000000e+00
S_01: 1.392000e+03 5.120000e+02
K_01: 9.895267e+02 0.000000e+00 7.020000e+02 0.000000e+00 9.878386e+02 2.455590e+02 0.000000e+00 0.000000e+00 1.000000e+00
D_01: -3.644661e-01 1.790019e-01 1.148107e-03 -6.298563e-04 -5.314062e-02
R_01: 9.993513e-01 1.860866e-02 -3.083487e-02 -1.887662e-02 9.997863e-01 -8.421873e-03 3.067156e-02 8.998467e-03 9.994890e-01
T_01: -5.370000e-01 4.822061e-03 -1.252488e-02
S_rect_01: 1.242000e+03 3.750000e+02
P_rect_01: 7.215377e+02 0.000000e+00 6.095593e+02 -3.875744e+02 0.000000e+00 7.215377e+02 1.728540e+02 0.000000e+00 0.000000e+00 0.000000e+00 1.000000e+00 0.000000e+00
";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_odometry_benchmark() {
        let projections = KittiProjections::parse(ODOMETRY).unwrap();
        let camera = projections.pair(0, 1, [1241, 376]).unwrap();
        assert!((camera.baseline_m - 0.537_166).abs() < 1e-5, "{}", camera.baseline_m);
        assert_eq!((camera.fx, camera.cx, camera.cx_right, camera.cy), (718.856, 607.1928, 607.1928, 185.2157));
        let told = |result: Result<StereoCamera, StereoError>| result.unwrap_err().to_string();
        assert!(told(projections.pair(1, 0, [1241, 376])).contains("are left and right swapped?"));
        assert!(told(projections.pair(2, 3, [1241, 376])).contains("expected a line `P2:`, found no such line"));
        let error = KittiProjections::parse("\nP0: 1 2 x").unwrap_err().to_string();
        assert_eq!(error, "KITTI's calib.txt, line 2: expected 12 numbers, found `1 2 x`");
        assert!(KittiProjections::parse("P9: 1").is_err());
        let nan = ODOMETRY.replace("7.188560e+02", "NaN");
        assert!(KittiProjections::parse(&nan).is_err());
        let zero = KittiProjections::parse(&ODOMETRY.replace("7.188560e+02", "0")).unwrap();
        assert!(told(zero.pair(0, 1, [1241, 376])).contains("focal length fx"));
    }

    #[test]
    fn the_raw_data() {
        let cameras = KittiCameras::parse(CAM_TO_CAM).unwrap();
        let camera = cameras.rectified(0, 1).unwrap();
        assert_eq!([camera.width, camera.height], [1242, 375]);
        assert!((camera.baseline_m - 0.537_15).abs() < 1e-4);
        let raw = cameras.raw(0, 1).unwrap();
        assert_eq!([raw.left.width, raw.left.height], [1392, 512]);
        assert!((raw.right_camera_m().norm() - 0.5372).abs() < 1e-3);
        // rectified by us: the same baseline, and about the same focal length as KITTI's own
        let rectifier = crate::Rectifier::new(&raw).unwrap();
        assert!((rectifier.camera().baseline_m - camera.baseline_m).abs() < 1e-3);
        assert!((rectifier.camera().fx - 900.0).abs() < 200.0, "{:?}", rectifier.camera());
        assert!(cameras.raw(0, 2).unwrap_err().to_string().contains("`S_02:`"));
        let error =
            KittiCameras::parse(&CAM_TO_CAM.replace("R_01: 9.99", "R_01: 5.99")).unwrap().raw(0, 1).unwrap_err();
        assert!(error.to_string().contains("a rotation in `R_01:`"), "{error}");
    }
}
