//! Which camera took the images of a topic.

use crate::camera::CameraSurvey;
use crate::links::bare;
use crate::survey::{Survey, TopicSurvey};
use mapwright_clouds::{CameraOptions, DEPTH_SCALE_KEY, INTRINSICS_KEY};
use mapwright_sensor::PinholeCamera;

/// How images of depth become clouds.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct CameraPlan {
    /// Without a size where only the caller says what it is: that of the first image.
    pub(crate) camera: PinholeCamera,
    /// The number that stands for a metre, where it is not the encoding's.
    pub(crate) depth_per_m: Option<f64>,
}

/// Found, with its reason and what had to be assumed.
pub(crate) struct Found {
    pub(crate) plan: CameraPlan,
    pub(crate) reason: String,
    pub(crate) assumed: Option<String>,
}

/// The camera of a topic of images of depth.
///
/// # Errors
/// Where nothing says what it is, or it cannot be: what to type.
pub(crate) fn find(survey: &Survey, topic: &TopicSurvey, options: &CameraOptions) -> Result<Found, String> {
    options.check_scale().map_err(|error| error.to_string())?;
    let scale = options.depth_scale.map_or_else(String::new, |scale| format!(", {scale} a metre as asked for"));
    if let Some([fx, fy, cx, cy]) = options.intrinsics {
        let camera =
            PinholeCamera { width: 0, height: 0, focal_px: [fx, fy], centre_px: [cx, cy], distortion: [0.0; 5] };
        camera.check().map_err(|reason| format!("{INTRINSICS_KEY}: {reason}"))?;
        let plan = CameraPlan { camera, depth_per_m: options.depth_scale };
        return Ok(Found { plan, reason: format!("as asked for{scale}"), assumed: None });
    }
    let Some((info, camera)) = info_of(survey, topic) else {
        return Err(format!(
            "images of depth ({}), and no CameraInfo says what the camera is: give {INTRINSICS_KEY} {DEPTH_SCALE_KEY}",
            topic.shape
        ));
    };
    let is_rectified = base_name(&topic.name).rsplit('/').next().is_some_and(|name| name.contains("rect"));
    let (chosen, which) = if is_rectified { (camera.rectified, "P") } else { (camera.raw, "K and D") };
    let is_undone = is_rectified || camera.left_out.is_none();
    let assumed = camera.left_out.as_ref().filter(|_| !is_undone).map(|model| {
        format!("{}: its distortion {model} is not undone: images are taken for rectified ones", info.name)
    });
    let reason = format!(
        "{which} of {}: {} x {}, fx {:.1}, fy {:.1}{scale}",
        info.name, chosen.width, chosen.height, chosen.focal_px[0], chosen.focal_px[1]
    );
    Ok(Found { plan: CameraPlan { camera: chosen, depth_per_m: options.depth_scale }, reason, assumed })
}

/// By its name beside the images; else the only one, or the one in the images' frame.
fn info_of<'a>(survey: &'a Survey, topic: &TopicSurvey) -> Option<(&'a TopicSurvey, &'a CameraSurvey)> {
    let named = beside(&topic.name);
    let all = survey.topics.iter().filter_map(|info| Some((info, info.camera.as_ref()?)));
    let all: Vec<_> = all.collect();
    let by_name = all.iter().find(|(info, _)| bare(&info.name) == bare(&named));
    let fits = |(info, _): &&(&TopicSurvey, &CameraSurvey)| info.frame() == topic.frame();
    by_name.or_else(|| all.iter().find(fits)).copied()
}

/// The name without that of a transport.
fn base_name(topic: &str) -> &str {
    ["/compressedDepth", "/compressed"].iter().find_map(|transport| topic.strip_suffix(transport)).unwrap_or(topic)
}

/// Where image_transport has the `CameraInfo` of a topic of images.
fn beside(topic: &str) -> String {
    let base = base_name(topic);
    let namespace = base.rfind('/').map_or("", |slash| &base[..slash]);
    format!("{namespace}/camera_info")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cameras_info_stands_beside_its_images() {
        for (images, info) in [
            ("/camera/depth/image_rect_raw", "/camera/depth/camera_info"),
            ("/camera/depth/image_raw/compressedDepth", "/camera/depth/camera_info"),
            ("depth", "/camera_info"),
        ] {
            assert_eq!(beside(images), info);
        }
    }
}
