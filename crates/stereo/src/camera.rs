//! A pair of cameras whose images are rectified, and depth by it.

use crate::disparity::DisparityMap;
use crate::error::StereoError;
use crate::image::SIDE_MAX;

/// A rectified pair: two pinhole cameras without distortion that look the same way, the right one beside the left one,
/// so that a point lies in the same row of both images. Coordinates are those of the left camera's optical frame: x to
/// the right, y down, z ahead.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StereoCamera {
    /// Pixels across, of either image.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Focal length across, pixels.
    pub fx: f64,
    /// Focal length down, pixels.
    pub fy: f64,
    /// Column of the left camera's optical axis; the centre of the first pixel is 0.
    pub cx: f64,
    /// Column of the right camera's axis: a point at infinity has the disparity `cx - cx_right`.
    pub cx_right: f64,
    /// Row of both axes.
    pub cy: f64,
    /// From the left camera to the right one, metres.
    pub baseline_m: f64,
}

/// A point of a disparity map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StereoPoint {
    /// Column and row in the left image.
    pub pixel: [u32; 2],
    /// Where it is in the left camera's optical frame, metres.
    pub point_m: [f32; 3],
    /// Standard deviation along the ray from the camera, metres.
    pub sigma_m: f32,
}

impl StereoCamera {
    /// Whether the numbers can be those of a pair.
    ///
    /// # Errors
    /// [`StereoError::Calibration`] names the first number that cannot be.
    pub fn check(&self) -> Result<(), StereoError> {
        let fail = |of: &str, expected, found: f64| {
            Err(StereoError::Calibration { of: of.to_owned(), expected, found: found.to_string() })
        };
        for (of, side) in [("width", self.width), ("height", self.height)] {
            if !(1..=SIDE_MAX).contains(&side) {
                return fail(of, "1 to 16384 pixels", f64::from(side));
            }
        }
        for (of, focal) in [("focal length fx", self.fx), ("focal length fy", self.fy)] {
            if !(focal.is_finite() && focal > 0.0) {
                return fail(of, "a finite number of pixels above zero", focal);
            }
        }
        for (of, centre) in [("cx", self.cx), ("cy", self.cy), ("cx of the right camera", self.cx_right)] {
            if !centre.is_finite() {
                return fail(of, "a finite number of pixels", centre);
            }
        }
        if self.baseline_m.is_finite() && self.baseline_m < 0.0 {
            return fail("baseline", "metres above zero (are left and right swapped?)", self.baseline_m);
        }
        if !(self.baseline_m.is_finite() && self.baseline_m > 0.0) {
            return fail("baseline", "a finite number of metres above zero", self.baseline_m);
        }
        Ok(())
    }

    /// Depth of a disparity, `z = f b / (d + cx_right - cx)`, metres; `None` for what lies at infinity or beyond.
    #[must_use]
    pub fn depth_m(&self, disparity: f64) -> Option<f64> {
        let parallax = disparity + self.cx_right - self.cx;
        Some(self.fx * self.baseline_m / parallax).filter(|depth| parallax > 0.0 && depth.is_finite())
    }

    /// The disparity at a depth, pixels.
    #[must_use]
    pub fn disparity(&self, depth_m: f64) -> f64 {
        self.fx * self.baseline_m / depth_m - (self.cx_right - self.cx)
    }

    /// Disparities that are needed to see what is so near, at most as many as the image is wide.
    ///
    /// # Errors
    /// [`StereoError::Settings`] where that distance is none, or nothing at it is seen by both cameras.
    pub fn disparities_for(&self, nearest_m: f64) -> Result<u32, StereoError> {
        let most = f64::from(self.width);
        let needed = self.disparity(nearest_m).ceil() + 2.0;
        if nearest_m.is_finite() && nearest_m > 0.0 && needed >= 2.0 && needed < most {
            return Ok(needed as u32);
        }
        let least_m = self.depth_m(most - 2.0).unwrap_or(0.0);
        let expected = format!("a distance that both cameras see, above {least_m:.3} m");
        Err(StereoError::Settings { setting: "nearest distance", expected, found: format!("{nearest_m} m") })
    }
}

impl DisparityMap {
    /// The points of all pixels whose depth is known, row by row. First-order propagation gives the standard deviation:
    /// `sigma_z = z^2 sigma_d / (f b)`, which lies along the ray; where it is as large as the depth itself, nothing is known.
    pub fn points(&self, camera: &StereoCamera) -> impl Iterator<Item = StereoPoint> + '_ {
        let camera = *camera;
        let width = self.width().max(1) as usize;
        self.disparity().iter().zip(self.sigma()).enumerate().filter_map(move |(at, (disparity, sigma))| {
            let pixel = [(at % width) as u32, (at / width) as u32];
            point(&camera, pixel, f64::from(*disparity), f64::from(*sigma))
        })
    }
}

fn point(camera: &StereoCamera, pixel: [u32; 2], disparity: f64, sigma: f64) -> Option<StereoPoint> {
    let depth = camera.depth_m(disparity)?;
    let sigma_depth = depth * depth * sigma / (camera.fx * camera.baseline_m);
    if sigma_depth >= depth || sigma_depth.is_nan() {
        return None;
    }
    let across = (f64::from(pixel[0]) - camera.cx) / camera.fx;
    let down = (f64::from(pixel[1]) - camera.cy) / camera.fy;
    let ray = (1.0 + across * across + down * down).sqrt();
    Some(StereoPoint {
        pixel,
        point_m: [across * depth, down * depth, depth].map(|v| v as f32),
        sigma_m: (sigma_depth * ray) as f32,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> StereoCamera {
        let (fx, fy) = (500.0, 500.0);
        StereoCamera { width: 100, height: 80, fx, fy, cx: 50.0, cx_right: 52.0, cy: 40.0, baseline_m: 0.2 }
    }

    #[test]
    fn numbers_that_are_none_of_a_camera() {
        camera().check().unwrap();
        let told = |camera: StereoCamera| camera.check().unwrap_err().to_string();
        let error = told(StereoCamera { fx: 0.0, ..camera() });
        assert_eq!(error, "focal length fx: expected a finite number of pixels above zero, found 0");
        assert!(told(StereoCamera { cy: f64::NAN, ..camera() }).contains("found NaN"));
        assert!(told(StereoCamera { width: 0, ..camera() }).contains("width"));
        assert!(told(StereoCamera { baseline_m: -0.2, ..camera() }).contains("swapped"));
        assert!(told(StereoCamera { baseline_m: 0.0, ..camera() }).contains("above zero, found 0"));
        assert!(told(StereoCamera { baseline_m: f64::INFINITY, ..camera() }).contains("inf"));
    }

    #[test]
    fn depth_and_how_far_it_is_off() {
        let camera = camera();
        assert_eq!(camera.depth_m(8.0), Some(10.0));
        assert_eq!(camera.depth_m(-2.0), None);
        assert!((camera.disparity(10.0) - 8.0).abs() < 1e-12);
        let mut map = DisparityMap::default();
        map.reset([100, 80]);
        (map.disparity[0], map.sigma[0]) = (8.0, 0.1);
        (map.disparity[4050], map.sigma[4050]) = (8.0, 0.1);
        (map.disparity[5], map.sigma[5]) = (-1.5, 0.6);
        let points: Vec<_> = map.points(&camera).collect();
        // what lies at 200 m with 240 m of sigma is not known
        assert_eq!(points.len(), 2);
        assert_eq!(points[1].pixel, [50, 40]);
        assert_eq!(points[1].point_m, [0.0, 0.0, 10.0]);
        assert!((points[1].sigma_m - 0.1).abs() < 1e-6);
        assert_eq!(points[0].point_m, [-1.0, -0.8, 10.0]);
        assert!((points[0].sigma_m / 0.1 - 1.0164_f32.sqrt()).abs() < 1e-6);
    }

    #[test]
    fn disparities_for_what_is_near() {
        assert_eq!(camera().disparities_for(10.0), Ok(10));
        assert_eq!(camera().disparities_for(3.0), Ok(34));
        let error = camera().disparities_for(0.5).unwrap_err().to_string();
        assert_eq!(error, "nearest distance: expected a distance that both cameras see, above 1.000 m, found 0.5 m");
        assert!(camera().disparities_for(f64::NAN).is_err());
    }
}
