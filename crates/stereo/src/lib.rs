//! Stereo cameras: from two images to disparities, and to points with their uncertainty.
//!
//! A pair that is not rectified has a [`Calibration`], and a [`Rectifier`] by it; a rectified one is a [`StereoCamera`]. A [`Matcher`]
//! finds the disparity of each pixel of the left image by semi-global matching (Hirschmueller, "Stereo processing by semiglobal matching
//! and mutual information", PAMI 30(2), 2008) of the census, and says how far it may be off. [`Pairing`] tells of two images whether they
//! are a pair at all, in the right order. Calibrations of KITTI, EuRoC and Middlebury are read from text; nothing here opens a file.
//!
//! Lengths are metres and pixels, as names say; the centre of the first pixel is (0, 0). Optical frames have x to the right, y down and z
//! ahead.
//!
//! ```
//! use mapwright_stereo::{DisparityMap, GreyImage, Matcher, MatcherSettings, StereoCamera};
//! # fn main() -> Result<(), mapwright_stereo::StereoError> {
//! // a texture that the right camera sees 4 pixels further left
//! let value = |x: u32, y: u32| ((x * 7919 + y * 104_729) % 251) as u16;
//! let image = |shift| GreyImage::new(64, 48, (0..64 * 48).map(|k| value(k % 64 + shift, k / 64)).collect());
//! let (left, right) = (image(0)?, image(4)?);
//!
//! let (width, height, fx, fy, cy) = (64, 48, 50.0, 50.0, 23.5);
//! let camera = StereoCamera { width, height, fx, fy, cx: 31.5, cx_right: 31.5, cy, baseline_m: 0.12 };
//! let disparities = Some(camera.disparities_for(0.5)?);
//! let mut matcher = Matcher::new(MatcherSettings { disparities, ..MatcherSettings::default() })?;
//! let mut map = DisparityMap::default();
//! matcher.match_pair(&left, &right, &mut map)?;
//! let ahead = map.points(&camera).find(|point| point.pixel == [40, 24]);
//! assert!(ahead.is_some_and(|point| (point.point_m[2] - 1.5).abs() < point.sigma_m));
//! # Ok(())
//! # }
//! ```

mod calibration;
mod camera;
mod census;
mod clean;
mod disparity;
mod error;
mod files;
mod image;
mod lanes;
mod matcher;
mod pairing;
mod paths;
mod penalties;
mod rectify;
mod refine;
mod winners;

pub use calibration::{Calibration, Lens};
pub use camera::{StereoCamera, StereoPoint};
pub use disparity::DisparityMap;
pub use error::StereoError;
pub use files::{EurocCamera, EurocImu, KittiCameras, KittiProjections, MiddleburyPair};
pub use image::{GreyImage, SIDE_MAX};
pub use matcher::{Matcher, MatcherSettings};
pub use pairing::Pairing;
pub use rectify::{Rectifier, Side};
