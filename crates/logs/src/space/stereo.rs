//! Which topics of images are those of a pair of cameras, and what these are.

use super::camera::info_of;
use crate::choice::Choice;
use crate::survey::{Survey, TopicSurvey};
use mapwright_clouds::{BASELINE_KEY, CameraOptions, INTRINSICS_KEY, StereoDepth, StereoPairPlan};
use mapwright_geom::Pose3;
use mapwright_sensor::{PinholeCamera, SpaceSensor};
use mapwright_stereo::{Calibration, Lens, StereoCamera};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// What the left camera is called, and the right one: stereo_image_proc, RealSense, EuRoC, KITTI.
const NAMES: [[&str; 2]; 6] = [
    ["left", "right"],
    ["infra1", "infra2"],
    ["cam0", "cam1"],
    ["camera0", "camera1"],
    ["image_00", "image_01"],
    ["image_02", "image_03"],
];
/// A rotation's matrix times its transpose is the identity up to so much.
const ROTATION_SLACK: f64 = 1e-3;

/// Two topics of images.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pair<'a> {
    pub(super) left: &'a TopicSurvey,
    pub(super) right: &'a TopicSurvey,
}

/// How pairs of images become clouds.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct StereoTopics {
    pub(super) right: String,
    pub(super) right_kind: crate::channel::TopicKind,
    pub(super) pair: StereoPairPlan,
    /// Ranges and noise that follow from the pair.
    pub(super) sensor: SpaceSensor,
}

/// Found, with its reason.
pub(super) struct Found {
    pub(super) topics: StereoTopics,
    pub(super) reason: String,
}

/// The pairs of topics of a recording: those that are asked for, or those that are named as pairs are; rectified ones first.
pub(super) fn pairs<'a>(survey: &'a Survey, choice: &Choice) -> Vec<Pair<'a>> {
    let images: Vec<&TopicSurvey> = survey.topics.iter().filter(|topic| is_picture(topic)).collect();
    let asked: Vec<&TopicSurvey> = choice
        .topics
        .iter()
        .filter_map(|name| images.iter().find(|topic| crate::survey::same_name(&topic.name, name)).copied())
        .collect();
    if let [left, right] = asked[..] {
        return vec![Pair { left, right }];
    }
    let mut found: Vec<Pair<'a>> = Vec::new();
    for left in &images {
        let partner = NAMES.iter().find_map(|[of_left, of_right]| {
            let at = left.name.rfind(of_left)?;
            let name = format!("{}{of_right}{}", &left.name[..at], &left.name[at + of_left.len()..]);
            images.iter().find(|topic| topic.name == name && topic.kind == left.kind)
        });
        found.extend(partner.map(|right| Pair { left, right }));
    }
    if let [asked] = asked[..] {
        found.retain(|pair| pair.left.name == asked.name || pair.right.name == asked.name);
    }
    found.sort_by_key(|pair| (!is_rectified(pair.left), pair.left.name.contains("compressed"), pair.left.name.clone()));
    found
}

/// Whether a topic has pictures, not depth.
fn is_picture(topic: &TopicSurvey) -> bool {
    topic.is_picture && !topic.is_depth && topic.usable() > 0
}

fn is_rectified(topic: &TopicSurvey) -> bool {
    topic.name.contains("rect")
}

/// The cameras of a pair.
///
/// # Errors
/// Where nothing says what they are, or they cannot be: what to type.
pub(super) fn find(survey: &Survey, pair: Pair<'_>, options: &CameraOptions) -> Result<Found, String> {
    options.check_scale().map_err(|error| error.to_string())?;
    let Pair { left, right } = pair;
    let (plan, which) = match (options.intrinsics, options.baseline_m) {
        (Some([fx, fy, cx, cy]), Some(baseline_m)) => {
            let [width, height] = size_of(survey, left).ok_or_else(|| {
                format!("{}: nothing says how large its images are, and {INTRINSICS_KEY} are of one size", left.name)
            })?;
            let camera = StereoCamera { width, height, fx, fy, cx, cx_right: cx, cy, baseline_m };
            (StereoPairPlan::Rectified(camera), "as asked for".to_owned())
        }
        (None, None) => by_info(survey, pair)?,
        _ => {
            return Err(format!("a pair of cameras takes both {INTRINSICS_KEY} and {BASELINE_KEY}, found one of them"));
        }
    };
    let depth =
        StereoDepth::new(&plan, None).map_err(|cause| format!("{} and {}, {which}: {cause}", left.name, right.name))?;
    let reason = format!("{which}; right {}; {}", right.name, depth.words());
    let sensor = depth.sensor(&left.name);
    let topics = StereoTopics { right: right.name.clone(), right_kind: right.kind, pair: plan, sensor };
    Ok(Found { topics, reason })
}

fn size_of(survey: &Survey, topic: &TopicSurvey) -> Option<[u32; 2]> {
    let by_info = || info_of(survey, topic).map(|info| [info.camera.raw.width, info.camera.raw.height]);
    topic.size().or_else(by_info).filter(|[width, height]| *width > 0 && *height > 0)
}

/// By the `CameraInfo` of both.
fn by_info(survey: &Survey, Pair { left, right }: Pair<'_>) -> Result<(StereoPairPlan, String), String> {
    let missing = |topic: &TopicSurvey| {
        format!("{}: no CameraInfo says what its camera is: give {INTRINSICS_KEY} {BASELINE_KEY}", topic.name)
    };
    let of_left = info_of(survey, left).ok_or_else(|| missing(left))?;
    let of_right = info_of(survey, right).ok_or_else(|| missing(right))?;
    if of_left.topic.name == of_right.topic.name {
        return Err(format!("{} is the only CameraInfo of {} and {}", of_left.topic.name, left.name, right.name));
    }
    for (topic, info) in [(left, &of_left), (right, &of_right)] {
        let [width, height] = [info.camera.raw.width, info.camera.raw.height];
        if let Some([wide, high]) = topic.size().filter(|size| *size != [width, height]) {
            return Err(format!(
                "{}: images of {wide} x {high} pixels, and {} has a camera of {width} x {height}",
                topic.name, info.topic.name
            ));
        }
    }
    let names = format!("{} and {}", of_left.topic.name, of_right.topic.name);
    let [p_left, p_right] = [&of_left.camera.projection, &of_right.camera.projection];
    if !(p_left[0] > 0.0 && p_right[0] > 0.0) {
        return Err(format!("{names}: expected focal lengths above zero in P, found {} and {}", p_left[0], p_right[0]));
    }
    let baseline_m = p_left[3] / p_left[0] - p_right[3] / p_right[0];
    let PinholeCamera { width, height, .. } = of_left.camera.raw;
    if is_rectified(left) {
        for (what, a, b) in [("focal lengths", p_left[0], p_right[0]), ("rows of the axis", p_left[6], p_right[6])] {
            if (a - b).abs() > 1e-3 * a.abs() {
                return Err(format!("{names}: expected the same {what} in both P, found {a} and {b}"));
            }
        }
        let [fx, fy, cx, cy] = [p_left[0], p_left[5], p_left[2], p_left[6]];
        let camera = StereoCamera { width, height, fx, fy, cx, cx_right: p_right[2], cy, baseline_m };
        return Ok((StereoPairPlan::Rectified(camera), format!("P of {names}")));
    }
    let mut lenses = Vec::new();
    for info in [&of_left, &of_right] {
        if let Some(model) = &info.camera.left_out {
            return Err(format!(
                "{}: its distortion {model} is none that is undone here (plumb_bob): record rectified images (image_rect)",
                info.topic.name
            ));
        }
        let PinholeCamera { width, height, focal_px, centre_px, distortion } = info.camera.raw;
        lenses.push(Lens { width, height, focal_px, centre_px, distortion });
    }
    let turn = |rows: &[f64; 9], name: &str| {
        rotation(rows).ok_or_else(|| format!("{name}: expected a rotation in R, found {rows:?}"))
    };
    let rectified_from_left = turn(&of_left.camera.rectification, &of_left.topic.name)?;
    let rectified_from_right = turn(&of_right.camera.rectification, &of_right.topic.name)?;
    let right_from_left = Pose3 {
        rotation: UnitQuaternion::from_rotation_matrix(&(rectified_from_right.inverse() * rectified_from_left)),
        translation: rectified_from_right.inverse() * Vector3::new(-baseline_m, 0.0, 0.0),
    };
    let [left, right] = lenses[..] else { return Err("expected two cameras".to_owned()) };
    let calibration = Calibration { left, right, right_from_left };
    Ok((StereoPairPlan::AsTaken(Box::new(calibration)), format!("K, D, R and P of {names}")))
}

/// Row by row; zeros, as of a camera that was never rectified, are none.
fn rotation(rows: &[f64; 9]) -> Option<Rotation3<f64>> {
    let matrix = Matrix3::from_row_slice(rows);
    let apart = (matrix * matrix.transpose() - Matrix3::identity()).amax();
    (apart <= ROTATION_SLACK && matrix.determinant() > 0.0).then(|| {
        let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
        turn.to_rotation_matrix()
    })
}
