//! A pair of cameras as they are, before rectification.

use crate::error::StereoError;
use crate::image::SIDE_MAX;
use mapwright_geom::Pose3;
use nalgebra::Vector3;

/// Cameras that lie further apart are not looked through as a pair: a focal length in pixels taken for a baseline, or millimetres for metres.
const BASELINE_MOST_M: f64 = 100.0;

/// One camera: a pinhole with the radial and tangential distortion of Brown, as OpenCV and Bouguet's toolbox have it.
///
/// With `a = x/z`, `b = y/z` and `r^2 = a^2 + b^2` a point is seen at column `fx a' + cx` and row `fy b' + cy`, where
/// `a' = a (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 a b + p2 (r^2 + 2 a^2)` and
/// `b' = b (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 b^2) + 2 p2 a b`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Focal lengths across and down, pixels.
    pub focal_px: [f64; 2],
    /// Column and row of the optical axis; the centre of the first pixel is 0.
    pub centre_px: [f64; 2],
    /// `k1, k2, p1, p2, k3`.
    pub distortion: [f64; 5],
}

impl Lens {
    /// Where the camera sees the direction `(a, b, 1)` of its optical frame: column and row.
    #[must_use]
    pub fn project(&self, [a, b]: [f64; 2]) -> [f64; 2] {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let r2 = a * a + b * b;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let across = a * radial + 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a);
        let down = b * radial + p1 * (r2 + 2.0 * b * b) + 2.0 * p2 * a * b;
        [self.focal_px[0] * across + self.centre_px[0], self.focal_px[1] * down + self.centre_px[1]]
    }

    /// Whether a direction is one that the distortion was measured for: further out a polynomial may turn back, and what lies outside
    /// the image is told to be in it.
    #[must_use]
    pub fn is_straight_at(&self, [a, b]: [f64; 2]) -> bool {
        let [k1, k2, _, _, k3] = self.distortion;
        let r2 = a * a + b * b;
        // the derivative of r (1 + k1 r^2 + k2 r^4 + k3 r^6), at some places between the axis and there
        (1..=8).all(|part| {
            let r2 = r2 * f64::from(part * part) / 64.0;
            1.0 + r2 * (3.0 * k1 + r2 * (5.0 * k2 + r2 * 7.0 * k3)) > 0.0
        })
    }

    /// The direction `(a, b, 1)` that is seen at a column and row: the fixed point of the distortion's equation.
    pub(crate) fn direction(&self, [column, row]: [f64; 2]) -> Option<[f64; 2]> {
        let seen = [(column - self.centre_px[0]) / self.focal_px[0], (row - self.centre_px[1]) / self.focal_px[1]];
        let plain = Self { focal_px: [1.0; 2], centre_px: [0.0; 2], ..*self };
        let mut direction = seen;
        // Newton's steps with the distortion's slope left out halve the error at least, where it is no more than a half
        for _ in 0..50 {
            let [a, b] = plain.project(direction);
            direction = [direction[0] + seen[0] - a, direction[1] + seen[1] - b];
        }
        let [a, b] = plain.project(direction);
        ((a - seen[0]).hypot(b - seen[1]) < 1e-6).then_some(direction)
    }

    fn check(&self, whose: &str) -> Result<(), StereoError> {
        let fail = |of: &str, expected, found: f64| {
            let of = format!("{of} of the {whose} camera");
            Err(StereoError::Calibration { of, expected, found: found.to_string() })
        };
        for (of, side) in [("width", self.width), ("height", self.height)] {
            if !(2..=SIDE_MAX).contains(&side) {
                return fail(of, "2 to 16384 pixels", f64::from(side));
            }
        }
        for (of, focal) in ["focal length fx", "focal length fy"].into_iter().zip(self.focal_px) {
            if !(focal.is_finite() && focal > 0.0) {
                return fail(of, "a finite number of pixels above zero", focal);
            }
        }
        for (of, centre, side) in [("cx", self.centre_px[0], self.width), ("cy", self.centre_px[1], self.height)] {
            if !(centre > 0.0 && centre < f64::from(side)) {
                return fail(of, "a place within the image", centre);
            }
        }
        for (of, number) in ["k1", "k2", "p1", "p2", "k3"].into_iter().zip(self.distortion) {
            if !number.is_finite() {
                return fail(of, "a finite number", number);
            }
        }
        Ok(())
    }
}

/// Both cameras and where they are to each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// The left camera.
    pub left: Lens,
    /// The right camera.
    pub right: Lens,
    /// From the left camera's optical frame to the right one's; metres.
    pub right_from_left: Pose3,
}

impl Calibration {
    /// Where the right camera is in the left one's optical frame, metres.
    #[must_use]
    pub fn right_camera_m(&self) -> Vector3<f64> {
        self.right_from_left.inverse().translation
    }

    /// Whether the numbers can be those of a pair that can be rectified.
    ///
    /// # Errors
    /// [`StereoError::Calibration`] or [`StereoError::Size`] name the first that cannot be.
    pub fn check(&self) -> Result<(), StereoError> {
        self.left.check("left")?;
        self.right.check("right")?;
        let [expected, found] = [self.left, self.right].map(|lens| [lens.width, lens.height]);
        if expected != found {
            return Err(StereoError::Size { what: "right camera", expected, found });
        }
        let fail = |expected, found: String| {
            let of = "place of the right camera in the left one's frame (x right, y down, z ahead)".to_owned();
            Err(StereoError::Calibration { of, expected, found })
        };
        let at = self.right_camera_m();
        let metres = format!("({:.4}, {:.4}, {:.4}) m", at.x, at.y, at.z);
        let apart = at.norm();
        if !(self.right_from_left.is_finite() && apart > 0.0 && apart < BASELINE_MOST_M) {
            return fail("a finite place above 0 and below 100 m away", metres);
        }
        if at.x <= 0.0 && -at.x >= at.y.abs() {
            return fail("it to the right (are left and right swapped?)", metres);
        }
        if at.x < at.y.abs() || at.x < at.z.abs() {
            return fail("it beside the left one, not above, below, ahead or behind", metres);
        }
        Ok(())
    }
}
