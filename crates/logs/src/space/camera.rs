//! Which camera took the images of a topic.

use crate::camera::CameraSurvey;
use crate::links::bare;
use crate::survey::{Survey, TopicSurvey};
use mapwright_clouds::{CameraOptions, DEPTH_SCALE_KEY, INTRINSICS_KEY, off_axis_words};
use mapwright_sensor::PinholeCamera;

/// How images of depth become clouds.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct CameraPlan {
    /// Without a size where only the caller says what it is: that of the first image.
    pub(crate) camera: PinholeCamera,
    /// The number that stands for a metre, where it is not the encoding's.
    pub(crate) depth_per_m: Option<f64>,
}

/// Found, with its reason, what had to be assumed, and what casts doubt on it.
pub(crate) struct Found {
    pub(crate) plan: CameraPlan,
    pub(crate) reason: String,
    pub(crate) assumed: Vec<String>,
    pub(crate) doubt: Option<String>,
}

/// The camera of a topic of images of depth.
///
/// # Errors
/// Where nothing says what it is, or it cannot be: what to type.
pub(crate) fn find(survey: &Survey, topic: &TopicSurvey, options: &CameraOptions) -> Result<Found, String> {
    options.check_scale().map_err(|error| error.to_string())?;
    let (depth_per_m, scale) = scale_of(survey, topic, options);
    if let Some([fx, fy, cx, cy]) = options.intrinsics {
        let [width, height] = topic.size().unwrap_or_default();
        let camera =
            PinholeCamera { width: 0, height: 0, focal_px: [fx, fy], centre_px: [cx, cy], distortion: [0.0; 5] };
        camera.check().map_err(|reason| format!("{INTRINSICS_KEY}: {reason}"))?;
        let doubt = off_axis_words(&PinholeCamera { width, height, ..camera });
        let plan = CameraPlan { camera, depth_per_m };
        return Ok(Found { plan, reason: format!("as asked for{scale}"), assumed: Vec::new(), doubt });
    }
    let Some(Info { topic: info, camera, assumed: by_size }) = info_of(survey, topic) else {
        return Err(format!(
            "images of depth ({}), and no CameraInfo says what the camera is: give {INTRINSICS_KEY} {DEPTH_SCALE_KEY}",
            topic.shape
        ));
    };
    let is_rectified = base_name(&topic.name).rsplit('/').next().is_some_and(|name| name.contains("rect"));
    let (said, which) = if is_rectified { (camera.rectified, "P") } else { (camera.raw, "K and D") };
    let (chosen, scaled) = at_size_of(said, topic, &info.name)?;
    let is_undone = is_rectified || camera.left_out.is_none();
    let distortion = camera.left_out.as_ref().filter(|_| !is_undone).map(|model| {
        format!("{}: its distortion {model} is not undone: images are taken for rectified ones", info.name)
    });
    let reason = format!(
        "{which} of {}: {} x {}, fx {:.1}, fy {:.1}{scaled}{scale}",
        info.name, chosen.width, chosen.height, chosen.focal_px[0], chosen.focal_px[1]
    );
    let doubt = off_axis_words(&chosen);
    let assumed = by_size.into_iter().chain(distortion).collect();
    Ok(Found { plan: CameraPlan { camera: chosen, depth_per_m }, reason, assumed, doubt })
}

/// The camera as it is at the size of the images, and that in words.
fn at_size_of(said: PinholeCamera, topic: &TopicSurvey, info: &str) -> Result<(PinholeCamera, String), String> {
    let of_info = [said.width, said.height];
    let Some([width, height]) = topic.size().filter(|size| *size != of_info && of_info != [0, 0]) else {
        return Ok((said, String::new()));
    };
    let [wide, high] = of_info;
    match said.of_size([width, height]) {
        Some(camera) => Ok((camera, format!(", scaled from {wide} x {high}"))),
        None => Err(format!(
            "images of {width} x {height} pixels, and {info} has a camera of {wide} x {high}, of another shape: give \
             {INTRINSICS_KEY}, as they are for images of {width} x {height}"
        )),
    }
}

/// The number that stands for a metre, where it is not the encoding's, and that in words: as asked for, or by an option of the camera
/// that its driver has recorded.
fn scale_of(survey: &Survey, topic: &TopicSurvey, options: &CameraOptions) -> (Option<f64>, String) {
    if let Some(scale) = options.depth_scale {
        return (Some(scale), format!(", {scale} a metre as asked for"));
    }
    let option = survey.topics.iter().find_map(|option| {
        let name = option.name.strip_prefix(sensor_of(&topic.name)?)?;
        let is_units = name.ends_with("/value") && name.replace([' ', '_'], "").to_lowercase().contains("depthunits");
        Some((option, f64::from(option.number?))).filter(|(_, unit_m)| is_units && *unit_m > 0.0 && unit_m.is_finite())
    });
    option.map_or((None, String::new()), |(option, unit_m)| {
        // a float's thousandth is none of a double
        let per_m = (1e3 / unit_m).round() / 1e3;
        (Some(per_m), format!(", {per_m} a metre by {}", option.name))
    })
}

/// `/device_0/sensor_0` of `/device_0/sensor_0/Depth_0/image/data`, as librealsense records.
fn sensor_of(topic: &str) -> Option<&str> {
    let mut slashes = topic.match_indices('/').map(|(at, _)| at).skip(2);
    topic.get(..slashes.next()?).filter(|name| name.starts_with("/device_"))
}

/// What says what the camera is.
pub(super) struct Info<'a> {
    pub(super) topic: &'a TopicSurvey,
    pub(super) camera: &'a CameraSurvey,
    assumed: Option<String>,
}

/// By its name beside the images; else the one in the images' frame; else the only one of the images' size.
pub(super) fn info_of<'a>(survey: &'a Survey, topic: &TopicSurvey) -> Option<Info<'a>> {
    let named = beside(&topic.name);
    let all = survey.topics.iter().filter_map(|info| Some((info, info.camera.as_ref()?)));
    let all: Vec<_> = all.collect();
    let by_name = all.iter().find(|(info, _)| bare(&info.name) == bare(&named));
    let in_frame = |(info, _): &&(&TopicSurvey, &CameraSurvey)| info.frame() == topic.frame();
    if let Some((info, camera)) = by_name.or_else(|| all.iter().find(in_frame)) {
        return Some(Info { topic: info, camera, assumed: None });
    }
    let size = topic.size()?;
    let mut of_size = all.iter().filter(|(_, camera)| [camera.raw.width, camera.raw.height] == size);
    let (info, camera) = of_size.next().filter(|_| of_size.next().is_none())?;
    let assumed = format!("{} is of the camera of {}: the only CameraInfo of its size", info.name, topic.name);
    Some(Info { topic: info, camera, assumed: Some(assumed) })
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

    #[test]
    fn librealsense_has_a_camera_of_a_device() {
        assert_eq!(sensor_of("/device_0/sensor_1/Depth_0/image/data"), Some("/device_0/sensor_1"));
        assert_eq!([sensor_of("/camera/depth/image/data"), sensor_of("/device_0")], [None, None]);
    }
}
