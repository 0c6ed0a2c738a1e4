//! Microsoft's 7-Scenes (Shotton et al. 2013).

use super::depth::{IMAGES_PER_S, first_there, note_missing_colours, read_noted, size, stamp_of_number};
use crate::camera;
use crate::error::CloudError;
use crate::folder::{Listing, number, parts};
use crate::notes::{NoteKind, Notes};
use crate::plan::{Decode, DepthPlan, Frame, Kind, Plan, note_gaps};
use crate::poses::{Reference, ReferenceFrame, pose_of_matrix};
use mapwright_sensor::SpaceSensor;

const DEPTH: &str = ".depth.png";
const CALIBRATION: &str = "camera-intrinsics.txt";
/// Depth is documented to be in millimetres.
const DEPTH_PER_M: f64 = 1000.0;

pub(super) fn find(listing: &Listing<'_>) -> Result<Option<Plan>, CloudError> {
    let names = listing.in_one_folder(|name| frame_number(name).is_some())?;
    let Some(first) = names.first() else { return Ok(None) };
    let folder = parts(first).0;
    let numbered: Vec<(u64, &str)> =
        names.iter().filter_map(|name| Some((frame_number(parts(name).1)?, name.strip_suffix(DEPTH)?))).collect();
    let mut notes = Notes::default();
    let mut decisions = vec![
        "the robot's frame is the camera's: z ahead, x to the right".to_owned(),
        format!("stamps are the frames' numbers at {IMAGES_PER_S} Hz"),
    ];
    note_gaps(numbered.iter().copied(), &mut notes);
    let endings = [".color.jpg", ".color.png", ".color.jpeg"];
    let frames: Vec<Frame> = numbered
        .iter()
        .map(|(number, base)| {
            let colour = first_there(listing, endings.iter().map(|ending| format!("{base}{ending}")));
            let file = format!("{base}{DEPTH}");
            Frame { file, stamp: Some(stamp_of_number(*number)), colour, right: None }
        })
        .collect();
    note_missing_colours(&frames, &mut decisions, &mut notes);
    let size = size(listing, &frames)?;
    let calibration = first_there(listing, [format!("{folder}{CALIBRATION}"), CALIBRATION.to_owned()]);
    let intrinsics = calibration.as_ref().and_then(|file| {
        let bytes = read_noted(listing, file, &mut notes)?;
        camera::of_matrix(file, &bytes, &mut notes)
    });
    let camera_words = match (&calibration, intrinsics) {
        (Some(file), Some(_)) => format!("the camera is that of {file}"),
        _ => format!("no {CALIBRATION} that can be used"),
    };
    let references = reference(listing, folder, &numbered, &mut notes).into_iter().collect();
    Ok(Some(Plan {
        kind: Kind::SevenScenes,
        frames,
        sensor: SpaceSensor::depth_camera("depth"),
        decode: Decode::Depth(DepthPlan {
            size,
            intrinsics,
            camera_words: Ok(camera_words),
            depth_per_m: DEPTH_PER_M,
            scale_words: "as 7-Scenes documents",
            calibrations: calibration.into_iter().collect(),
        }),
        references,
        decisions,
        notes,
    }))
}

fn frame_number(name: &str) -> Option<u64> {
    number(name.strip_prefix("frame-")?.strip_suffix(DEPTH)?)
}

/// Where the camera was, one file a frame.
fn reference(listing: &Listing<'_>, folder: &str, frames: &[(u64, &str)], notes: &mut Notes) -> Option<Reference> {
    let mut poses = Vec::new();
    for (number, base) in frames {
        let file = format!("{base}.pose.txt");
        if let Some(bytes) = read_noted(listing, &file, notes) {
            match pose_of_matrix(&file, &bytes) {
                Ok(pose) => poses.push((stamp_of_number(*number), pose)),
                Err(error) => notes.note_error(NoteKind::BadRow, &file, error),
            }
        }
    }
    let file = format!("{folder}frame-*.pose.txt");
    (!poses.is_empty()).then_some(Reference { file, frame: ReferenceFrame::Sensor, poses })
}
