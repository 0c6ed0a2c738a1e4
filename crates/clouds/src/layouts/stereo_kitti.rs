//! KITTI's pairs of cameras: the odometry benchmark and the raw recordings (Geiger et al. 2013).

use super::kitti;
use super::stereo_pair::{CAMERAS_FRAME, Said, by_name, folders_with, frames, images_in, plan, size, text_of};
use crate::error::CloudError;
use crate::folder::{Listing, number, parts};
use crate::image::Size;
use crate::notes::Notes;
use crate::plan::{Kind, Plan, stem};
use crate::poses::{Reference, ReferenceFrame};
use crate::stereo::StereoPairPlan;
use mapwright_geom::{Pose3, Stamp};
use mapwright_stereo::{KittiCameras, KittiProjections};
use nalgebra::Vector3;

/// Where both images are, and the numbers of their cameras: the grey ones first, whose baseline is the same.
const PAIRS: [([&str; 2], usize); 4] = [
    (["image_0/", "image_1/"], 0),
    (["image_2/", "image_3/"], 2),
    (["image_00/data/", "image_01/data/"], 0),
    (["image_02/data/", "image_03/data/"], 2),
];

pub(super) fn find(listing: &Listing<'_>) -> Result<Option<Plan>, CloudError> {
    let found = PAIRS.iter().map(|([left, right], camera)| {
        let rights = folders_with(listing, right);
        let both = folders_with(listing, left).into_iter().filter(|folder| rights.contains(folder));
        (both.collect::<Vec<_>>(), [*left, *right], *camera)
    });
    let mut found = found.filter(|(folders, ..)| !folders.is_empty());
    let Some((folders, [left, right], camera)) = found.next() else { return Ok(None) };
    let [folder] = &folders[..] else {
        let folders = folders.iter().take(10).map(|folder| folder.trim_end_matches('/').to_owned()).collect();
        return Err(CloudError::Several { folders });
    };
    let mut notes = Notes::default();
    let mut decisions = vec![CAMERAS_FRAME.to_owned()];
    if let Some((_, [other, _], _)) = found.next() {
        decisions.push(format!("{left} and {right} are used, {other} is not"));
    }
    let [in_left, in_right] = [left, right].map(|inner| format!("{folder}{inner}"));
    let pairs = by_name(images_in(listing, &in_left), &images_in(listing, &in_right), &mut notes);
    let names: Vec<String> = pairs.iter().map(|(left, _)| left.clone()).collect();
    let numbers: Option<Vec<u64>> = names.iter().map(|name| number(stem(name))).collect();
    let beside = format!("{folder}{}", first_part(left));
    let stamps = kitti::stamps(listing, &beside, &names, numbers.as_deref(), &mut decisions, &mut notes);
    let frames = frames(pairs, stamps.clone());
    let size = size(listing, &frames)?;
    let (said, camera_m) = cameras(listing, folder, size, camera);
    let references = references(listing, folder, (numbers.as_deref(), &stamps), camera_m, &mut notes);
    let robot_from_left = Pose3::identity();
    Ok(Some(plan(Kind::KittiStereo, (frames, size), said, robot_from_left, (references, decisions, notes))))
}

/// `image_00/` of `image_00/data/`: times stand beside that.
fn first_part(inner: &str) -> &str {
    inner.split_inclusive('/').next().unwrap_or(inner)
}

/// The pair, and where its left camera is from camera 0, metres to the right.
fn cameras(listing: &Listing<'_>, folder: &str, size: Size, camera: usize) -> (Said, f64) {
    let above = parts(folder.trim_end_matches('/')).0;
    let there = |name: &str| {
        let mut places = [format!("{folder}{name}"), format!("{above}{name}")].into_iter();
        places.find(|file| listing.has(file))
    };
    if let Some(file) = there("calib.txt") {
        let read = || -> Result<_, String> {
            let projections = KittiProjections::parse(&text_of(listing, &file).map_err(words)?).map_err(words)?;
            Ok((
                projections.pair(camera, camera + 1, size).map_err(words)?,
                projections.offset_m(camera).unwrap_or(0.0),
            ))
        };
        let found = read();
        let offset_m = found.as_ref().map_or(0.0, |(_, offset_m)| *offset_m);
        return (Said::of(&file, found.map(|(pair, _)| StereoPairPlan::Rectified(pair))), offset_m);
    }
    if let Some(file) = there("calib_cam_to_cam.txt") {
        return (Said::of(&file, of_raw(listing, &file, size, camera)), 0.0);
    }
    (Said::nothing("there is no calib.txt"), 0.0)
}

/// Of the raw recordings: by their size, images are rectified (`sync`) or as they were taken (`extract`).
fn of_raw(listing: &Listing<'_>, file: &str, size: Size, camera: usize) -> Result<StereoPairPlan, String> {
    let cameras = KittiCameras::parse(&text_of(listing, file).map_err(words)?).map_err(words)?;
    let rectified = cameras.rectified(camera, camera + 1).map(StereoPairPlan::Rectified).map_err(words);
    match rectified {
        Ok(pair) if pair.size() == size => Ok(pair),
        other => match cameras.raw(camera, camera + 1).map(|raw| StereoPairPlan::AsTaken(Box::new(raw))) {
            Ok(pair) if pair.size() == size => Ok(pair),
            _ => other.and_then(|pair| {
                let [width, height] = pair.size();
                Err(format!("expected images of {width} x {height} pixels, found {} x {}", size[0], size[1]))
            }),
        },
    }
}

/// Poses of camera 0, as those of the left camera.
fn references(
    listing: &Listing<'_>,
    folder: &str,
    of_frames: (Option<&[u64]>, &[Stamp]),
    camera_m: f64,
    notes: &mut Notes,
) -> Vec<Reference> {
    let camera_0_from_left = Pose3 { translation: Vector3::new(camera_m, 0.0, 0.0), ..Pose3::identity() };
    let mut references =
        kitti::references_in(listing, &[folder], of_frames, notes, |_, poses| (ReferenceFrame::Sensor, poses));
    for (_, pose) in references.iter_mut().flat_map(|reference| &mut reference.poses) {
        *pose = *pose * camera_0_from_left;
    }
    references
}

fn words(error: impl ToString) -> String {
    error.to_string()
}
