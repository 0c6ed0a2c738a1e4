//! Depth out of images, and the cameras that took them.

use crate::error::{RosError, excerpt};
use crate::messages::{CameraInfo, DepthCompression, Image};
use crate::wire::Scalar;
use mapwright_sensor::PinholeCamera;

/// What the numbers of an image of depth are (REP 118).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DepthNumbers {
    /// 16 bits without a sign, millimetres; zero where nothing was seen.
    Millimetres,
    /// 32-bit floats, metres; NaN where nothing was seen.
    Metres,
}

/// The largest number of 16 bits stands for nothing, too.
const NOTHING: u16 = u16::MAX;

impl DepthNumbers {
    /// By the encoding of an image; none for images of anything else.
    #[must_use]
    pub fn of(encoding: &str) -> Option<Self> {
        match encoding.trim() {
            // the last is what librealsense calls the first
            "16UC1" | "mono16" | "Z16" | "z16" => Some(Self::Millimetres),
            "32FC1" => Some(Self::Metres),
            _ => None,
        }
    }

    /// By the format of a compressed image, such as `16UC1; compressedDepth png`; none where it does not say.
    #[must_use]
    pub fn of_format(format: &str) -> Option<Self> {
        Self::of(format.split(';').next().unwrap_or_default())
    }

    /// The number that stands for a metre.
    #[must_use]
    pub fn per_m(self) -> f64 {
        match self {
            Self::Millimetres => 1000.0,
            Self::Metres => 1.0,
        }
    }

    fn size(self) -> usize {
        match self {
            Self::Millimetres => 2,
            Self::Metres => 4,
        }
    }
}

/// Depth by a number of 16 bits, metres; 0 where there is none.
fn metres(number: u16, m_per_step: f32) -> f32 {
    if number == NOTHING { 0.0 } else { f32::from(number) * m_per_step }
}

impl Image<'_> {
    /// The encodings of images of depth, in words.
    pub const ENCODINGS_OF_DEPTH: &'static str = "16UC1, mono16, Z16 or 32FC1";

    /// Depth of all pixels, metres, row by row; not above zero or NaN where there is none. `depth_per_m` is the number
    /// that stands for a metre, where it is not the usual one.
    ///
    /// # Errors
    /// [`RosError::Image`] for another encoding, and where the data is not as long as height, width and step say.
    pub fn depth_m(&self, depth_per_m: Option<f64>) -> Result<Vec<f32>, RosError> {
        let numbers = DepthNumbers::of(&self.encoding).ok_or_else(|| RosError::Image {
            what: "encoding",
            expected: format!("one of depth: {}", Self::ENCODINGS_OF_DEPTH),
            found: excerpt(&self.encoding),
        })?;
        let (width, height) = (self.width as usize, self.height as usize);
        let row_bytes = width.saturating_mul(numbers.size());
        let given = self.step as usize;
        let step = if height <= 1 || given < row_bytes { row_bytes } else { given };
        let needed = step.saturating_mul(height.saturating_sub(1)).saturating_add(row_bytes);
        if height == 0 || width == 0 || needed > self.data.len() {
            return Err(RosError::Image {
                what: "data",
                expected: format!("{width} x {height} pixels of {} bytes ({needed} bytes)", numbers.size()),
                found: format!("{} bytes", self.data.len()),
            });
        }
        let big = self.is_bigendian != 0;
        let m_per_step = (1.0 / depth_per_m.unwrap_or(numbers.per_m())) as f32;
        let depth = |pixel: &[u8]| match numbers {
            DepthNumbers::Millimetres => metres(u16::decode(pixel, big), m_per_step),
            DepthNumbers::Metres => f32::decode(pixel, big) * m_per_step,
        };
        let rows = self.data.chunks(step).take(height);
        Ok(rows
            .flat_map(|row| row.get(..row_bytes).unwrap_or_default().chunks_exact(numbers.size()))
            .map(depth)
            .collect())
    }
}

impl DepthCompression<'_> {
    /// Depth by the numbers of the picture's file, metres.
    #[must_use]
    pub fn depth_m(&self, numbers: DepthNumbers, stored: &[u16], depth_per_m: Option<f64>) -> Vec<f32> {
        let m_per_step = (1.0 / depth_per_m.unwrap_or(numbers.per_m())) as f32;
        match numbers {
            DepthNumbers::Millimetres => stored.iter().map(|number| metres(*number, m_per_step)).collect(),
            DepthNumbers::Metres => {
                let depth = |number: u16| self.quant_a / (f32::from(number) - self.quant_b) * m_per_step;
                stored.iter().map(|number| if *number == 0 { 0.0 } else { depth(*number) }).collect()
            }
        }
    }
}

/// A distortion that is none of a [`PinholeCamera`]'s: its model's name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DistortionLeftOut(pub String);

impl CameraInfo<'_> {
    /// The camera of the raw pictures, by `K` and `D`; beside it what of the distortion had to be left out.
    ///
    /// # Errors
    /// [`RosError::Image`] where it is not calibrated.
    pub fn pinhole(&self) -> Result<(PinholeCamera, Option<DistortionLeftOut>), RosError> {
        let k = &self.k.0;
        let camera = self.checked([k[0], k[4]], [k[2], k[5]])?;
        let given: Vec<f64> = self.d.iter().take(14).collect();
        if given.iter().all(|v| *v == 0.0) {
            return Ok((camera, None));
        }
        let is_brown = matches!(&*self.distortion_model, "plumb_bob" | "");
        let beyond_is_zero = given.iter().skip(5).all(|v| *v == 0.0);
        let is_rational = matches!(&*self.distortion_model, "rational_polynomial" | "rational");
        if !((is_brown || is_rational) && beyond_is_zero && given.iter().all(|v| v.is_finite())) {
            return Ok((camera, Some(DistortionLeftOut(excerpt(&self.distortion_model)))));
        }
        let distortion = std::array::from_fn(|k| given.get(k).copied().unwrap_or(0.0));
        Ok((PinholeCamera { distortion, ..camera }, None))
    }

    /// The camera of the rectified pictures, by `P`; by `K` where there is no `P`.
    ///
    /// # Errors
    /// As of [`CameraInfo::pinhole`].
    pub fn rectified(&self) -> Result<PinholeCamera, RosError> {
        let (p, k) = (&self.p.0, &self.k.0);
        let is_given = p[0] > 0.0 && p[5] > 0.0;
        let (focal_px, centre_px) = if is_given { ([p[0], p[5]], [p[2], p[6]]) } else { ([k[0], k[4]], [k[2], k[5]]) };
        self.checked(focal_px, centre_px)
    }

    fn checked(&self, focal_px: [f64; 2], centre_px: [f64; 2]) -> Result<PinholeCamera, RosError> {
        let (width, height) = (self.width, self.height);
        let camera = PinholeCamera { width, height, focal_px, centre_px, distortion: [0.0; 5] };
        camera.check().map(|()| camera).map_err(|reason| RosError::Image {
            what: "camera",
            expected: "a calibration (K of CameraInfo)".to_owned(),
            found: format!("{focal_px:?} and {centre_px:?}: {reason}"),
        })
    }
}

#[cfg(test)]
mod tests;
