//! Open3D's samples and the folders that its reconstruction reads (Zhou et al. 2018).

use super::depth::{IMAGES_PER_S, first_there, note_missing_colours, read_noted, size, stamp_of_number};
use crate::camera::{self, INTRINSICS_KEY};
use crate::error::CloudError;
use crate::folder::{Listing, ends_with, natural_key, number, parts};
use crate::image::Size;
use crate::notes::Notes;
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
/// What Open3D takes for a camera of this size unless it is told otherwise: `PrimeSenseDefault`.
const DEFAULT_CAMERA: [f64; 4] = [525.0, 525.0, 319.5, 239.5];
const DEFAULT_SIZE: Size = [640, 480];
/// Where such lie beside a folder of depth, it is a part of another recording; models made of it lie there as well, but fewer.
const OTHER_RECORDINGS: [&str; 6] = [".bag", ".mcap", ".db3", ".bin", ".bin.zst", ".pcap"];
const MODELS: [&str; 2] = [".pcd", ".ply"];

pub(super) fn find(listing: &Listing<'_>) -> Result<Option<Plan>, CloudError> {
    let names = match listing.in_one_folder(|name| numbered_depth(name).is_some())? {
        names if names.is_empty() => in_folder_of_depth(listing),
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
        .map(|(file, number)| Frame {
            file: file.clone(),
            stamp: Some(stamp_of_number(*number)),
            colour: colour(listing, file),
            right: None,
        })
        .collect();
    let size = size(listing, &frames)?;
    let mut decisions = vec![
        "the robot's frame is the camera's: z ahead, x to the right".to_owned(),
        format!("stamps are the frames' numbers, taken to be at {IMAGES_PER_S} Hz"),
    ];
    note_missing_colours(&frames, &mut decisions, &mut notes);
    let calibrations = CALIBRATIONS.map(|name| format!("{folder}{name}")).to_vec();
    let (found, scale) = calibration(listing, &calibrations, size, &mut decisions, &mut notes);
    let (intrinsics, camera_words) = match found {
        Some((file, camera)) => (Some(camera), Ok(format!("the camera is that of {file}"))),
        None if size == DEFAULT_SIZE && !calibrations.iter().any(|name| listing.has(name)) => {
            (Some(DEFAULT_CAMERA), Err(default_words()))
        }
        None => (None, Ok("no calibration that can be used".to_owned())),
    };
    let references = reference(listing, folder, &mut decisions, &mut notes).into_iter().collect();
    Ok(Some(Plan {
        kind: Kind::Open3d,
        frames,
        sensor: SpaceSensor::depth_camera("depth"),
        decode: Decode::Depth(DepthPlan {
            size,
            intrinsics,
            camera_words,
            depth_per_m: scale.unwrap_or(DEPTH_PER_M),
            scale_words: if scale.is_some() { "as the folder has it" } else { "as Open3D takes it" },
            calibrations,
        }),
        references,
        decisions,
        notes,
    }))
}

fn default_words() -> String {
    let ([fx, fy, cx, cy], [width, height]) = (DEFAULT_CAMERA, DEFAULT_SIZE);
    format!(
        "nothing says what the camera is: assumed to be Open3D's default for {width} x {height} pixels, {fx},{fy},{cx},{cy}; \
         `{INTRINSICS_KEY}` says what it is"
    )
}

/// Whether numbered images in `depth/` are a recording: beside a calibration, or beside nothing else that is one.
fn is_recording(listing: &Listing<'_>, images: usize) -> bool {
    let ends_so = |name: &str, endings: &[&str]| endings.iter().any(|ending| ends_with(name, ending));
    let models = listing.names().filter(|name| ends_so(name, &MODELS)).count();
    let is_alone = models < images && !listing.names().any(|name| ends_so(name, &OTHER_RECORDINGS));
    CALIBRATIONS.iter().any(|name| listing.has(name)) || is_alone
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
    if !is_recording(listing, names.len()) {
        return Vec::new();
    }
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
    names: &[String],
    size: Size,
    decisions: &mut Vec<String>,
    notes: &mut Notes,
) -> (Option<(String, [f64; 4])>, Option<f64>) {
    let mut found: Option<(String, [f64; 4], Option<f64>)> = None;
    for name in names {
        let camera = read_noted(listing, name, notes).and_then(|bytes| camera::of_json(name, &bytes, size, notes));
        match (camera, &found) {
            (Some((camera, scale)), None) => found = Some((name.clone(), camera, scale)),
            (Some((other, _)), Some((first, camera, _))) if other != *camera => {
                decisions.push(format!("{name} has another camera than {first} and is not used"));
            }
            _ => {}
        }
    }
    found.map_or((None, None), |(name, camera, scale)| (Some((name, camera)), scale))
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
