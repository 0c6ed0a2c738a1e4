//! What a recording says of a camera.

use mapwright_ros::RosError;
use mapwright_ros::messages::CameraInfo;
use mapwright_sensor::PinholeCamera;

/// What a `CameraInfo` says.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraSurvey {
    /// Of the pictures as they are taken.
    pub raw: PinholeCamera,
    /// Of pictures that were rectified.
    pub rectified: PinholeCamera,
    /// The model of a distortion that is not undone.
    pub left_out: Option<String>,
    /// From the camera to the rectified pictures' frame: `R`, row by row.
    pub rectification: [f64; 9],
    /// `P`, row by row: of a pair's right camera its fourth number is less the focal length times the baseline.
    pub projection: [f64; 12],
}

impl CameraSurvey {
    pub(crate) fn of(info: &CameraInfo<'_>) -> Result<Self, RosError> {
        let (raw, left_out) = info.pinhole()?;
        let (rectification, projection) = (info.r.0, info.p.0);
        let left_out = left_out.map(|model| model.0);
        Ok(Self { raw, rectified: info.rectified()?, left_out, rectification, projection })
    }
}
