#![allow(missing_docs)]
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
mod winners;

pub use calibration::{Calibration, Lens};
pub use camera::{StereoCamera, StereoPoint};
pub use disparity::DisparityMap;
pub use error::StereoError;
pub use files::{EurocCamera, KittiCameras, KittiProjections, MiddleburyPair};
pub use image::{GreyImage, SIDE_MAX};
pub use matcher::{Matcher, MatcherSettings};
pub use pairing::Pairing;
pub use rectify::{Rectifier, Side};
