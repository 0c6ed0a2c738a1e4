//! Open3D's samples and the folders that its reconstruction reads (Zhou et al. 2018).

use super::depth::{IMAGES_PER_S, first_there, read_noted, size, stamp_of_number};
use crate::camera;
use crate::error::CloudError;
use crate::folder::{Listing, natural_key, number, parts};
use crate::image::Size;
use crate::notes::{NoteKind, Notes};
use crate::plan::{Decode, DepthPlan, Frame, Kind, Plan, note_gaps};
use crate::poses::{Reference, ReferenceFrame, open3d_log};
use mapwright_sensor::SpaceSensor;

/// What calibrations are called; the first that can be used is. Open3D's five sample images come with the first two, and fit together
/// by the first: their depths are 6 mm apart in the median, 10 mm by the second.
const CALIBRATIONS: [&str; 4] = ["camera_primesense.json", "camera.json", "camera_intrinsic.json", "intrinsic.json"];
/// What trajectories are called; the first that is there is the reference.
const TRAJECTORIES: [&str; 2] = ["trajectory.log", "odometry.log"];
/// What Open3D takes for a metre unless it is told otherwise.
const DEPTH_PER_M: f64 = 1000.0;

pub(super) fn find(listing: &Listing<'_>) -> Result<Option<Plan>, CloudError> {
    let names = match listing.in_one_folder(|name| numbered_depth(name).is_some())? {
        names if names.is_empty() && CALIBRATIONS.iter().any(|name| listing.has(name)) => in_folder_of_depth(listing),
        names => names,
    };
    let Some(first) = names.first() else { return Ok(None) };
    let folder = parts(first).0.strip_suffix("depth/").unwrap_or(parts(first).0);
    let mut notes = Notes::default();
    let numbers: Vec<u64> = names.iter().map(|name| frame_number(name)).collect();
    note_gaps(numbers.iter().copied().zip(names.iter().map(String::as_str)), &mut notes);
    let frames: Vec<Frame> = names
        .iter()
        .zip(&numbers)
        .map(|(file, number)| {
            let colour = colour(listing, file);
            if colour.is_none() {
                notes.note(NoteKind::MissingColour, file, 0, || ("a colour image of the same number", "none"));
            }
            Frame { file: file.clone(), stamp: Some(stamp_of_number(*number)), colour }
        })
        .collect();
    let size = size(listing, &frames)?;
    let mut decisions = vec![
        "the robot's frame is the camera's: z ahead, x to the right".to_owned(),
        format!("stamps are the frames' numbers, taken to be at {IMAGES_PER_S} Hz"),
    ];
    let (intrinsics, scale) = calibration(listing, folder, size, &mut decisions, &mut notes);
    let depth_per_m = scale.unwrap_or(DEPTH_PER_M);
    decisions.push(format!(
        "{depth_per_m} is a metre of depth, as {} it",
        if scale.is_some() { "the folder has" } else { "Open3D takes" }
    ));
    let references = reference(listing, folder, &mut decisions, &mut notes).into_iter().collect();
    Ok(Some(Plan {
        kind: Kind::Open3d,
        frames,
        sensor: SpaceSensor::depth_camera("depth"),
        decode: Decode::Depth(DepthPlan {
            size,
            intrinsics,
            depth_per_m,
            calibrations: CALIBRATIONS.map(|name| format!("{folder}{name}")).to_vec(),
        }),
        references,
        decisions,
        notes,
    }))
}

/// The digits of `depth12.png`.
fn numbered_depth(name: &str) -> Option<&str> {
    let digits = name.strip_prefix("depth")?.strip_suffix(".png")?;
    let digits = digits.trim_start_matches(['_', '-']);
    number(digits).map(|_| digits)
}

/// `depth/000012.png`.
fn in_folder_of_depth(listing: &Listing<'_>) -> Vec<String> {
    let is_numbered = |name: &&str| {
        let digits = name.strip_prefix("depth/").and_then(|name| name.strip_suffix(".png"));
        digits.is_some_and(|digits| number(digits).is_some())
    };
    let mut names: Vec<String> = listing.names().filter(is_numbered).map(str::to_owned).collect();
    names.sort_by_cached_key(|name| natural_key(name));
    names
}

fn frame_number(name: &str) -> u64 {
    let digits: String = parts(name).1.chars().filter(char::is_ascii_digit).collect();
    digits.parse().unwrap_or(0)
}

/// The image of the same number in colour.
fn colour(listing: &Listing<'_>, depth: &str) -> Option<String> {
    let (folder, file) = parts(depth);
    let base = depth.strip_suffix(".png").unwrap_or(depth);
    let names: Vec<String> = match file.strip_prefix("depth") {
        Some(_) => {
            let rest = &base[folder.len() + "depth".len()..];
            ["color", "colour", "rgb"].iter().map(|word| format!("{folder}{word}{rest}")).collect()
        }
        None => {
            let above = folder.strip_suffix("depth/").unwrap_or(folder);
            let rest = &base[folder.len()..];
            ["color", "image", "rgb"].iter().map(|word| format!("{above}{word}/{rest}")).collect()
        }
    };
    first_there(listing, names.iter().flat_map(|name| ["jpg", "png", "jpeg"].map(|ending| format!("{name}.{ending}"))))
}

/// The camera of the first calibration that can be used, and its scale of depth.
fn calibration(
    listing: &Listing<'_>,
    folder: &str,
    size: Size,
    decisions: &mut Vec<String>,
    notes: &mut Notes,
) -> (Option<[f64; 4]>, Option<f64>) {
    let mut found: Option<(String, [f64; 4], Option<f64>)> = None;
    for name in CALIBRATIONS.map(|name| format!("{folder}{name}")) {
        let camera = read_noted(listing, &name, notes).and_then(|bytes| camera::of_json(&name, &bytes, size, notes));
        match (camera, &found) {
            (Some((camera, scale)), None) => {
                decisions.push(format!("the camera is that of {name}"));
                found = Some((name, camera, scale));
            }
            (Some((other, _)), Some((first, camera, _))) if other != *camera => {
                decisions.push(format!("{name} has another camera than {first} and is not used"));
            }
            _ => {}
        }
    }
    found.map_or((None, None), |(_, camera, scale)| (Some(camera), scale))
}

fn reference(listing: &Listing<'_>, folder: &str, decisions: &mut Vec<String>, notes: &mut Notes) -> Option<Reference> {
    let there: Vec<String> =
        TRAJECTORIES.iter().map(|name| format!("{folder}{name}")).filter(|name| listing.has(name)).collect();
    let file = there.first()?.clone();
    if let Some(other) = there.get(1) {
        decisions.push(format!("the reference is {file}; {other} is not used"));
    }
    let bytes = read_noted(listing, &file, notes)?;
    let poses = open3d_log(&file, &bytes, notes);
    let poses = poses.into_iter().map(|(number, pose)| (stamp_of_number(number), pose)).collect();
    Some(Reference { file, frame: ReferenceFrame::Sensor, poses })
}
