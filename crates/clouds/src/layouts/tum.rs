//! The TUM RGB-D benchmark (Sturm et al. 2012).

use super::depth::{read_noted, size};
use crate::error::CloudError;
use crate::folder::Listing;
use crate::notes::{NoteKind, Notes};
use crate::plan::{Decode, DepthPlan, Frame, Kind, Plan};
use crate::poses::{PoseRows, Reference, ReferenceFrame, pose_rows, stamp_of_text};
use crate::text::{excerpt, rows};
use mapwright_geom::Stamp;
use mapwright_sensor::SpaceSensor;

/// What the benchmark's images have for a metre.
const DEPTH_PER_M: f64 = 5000.0;
/// A colour image belongs to an image of depth that is nearer in time, nanoseconds (the benchmark's own tool has it so).
const TOGETHER_NS: u64 = 20_000_000;
/// What the benchmark recommends for depth of all its recordings, which is registered to colour: ROS' default camera, without
/// distortion (<https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats>). Nine images of fr1/desk fit better by it than by
/// fr1's calibrated colour camera (517.3, 516.5, 318.6, 255.3): 7.2 mm, not 7.7.
const CAMERA: [f64; 4] = [525.0, 525.0, 319.5, 239.5];
/// Recordings of the benchmark are called so.
const BENCHMARK: &str = "rgbd_dataset_";

pub(super) fn find(listing: &Listing<'_>) -> Result<Option<Plan>, CloudError> {
    if !listing.has("depth.txt") {
        return Ok(None);
    }
    let mut notes = Notes::default();
    let text = listing.read("depth.txt")?;
    let depths = named_images(listing, "depth.txt", &text, Some(NoteKind::MissingFrame), &mut notes);
    if depths.is_empty() {
        let expected = "rows of a stamp and the name of an image that is there";
        return Err(CloudError::content("depth.txt", 0, expected, excerpt(&text)));
    }
    let mut decisions = vec!["the robot's frame is the camera's: z ahead, x to the right".to_owned()];
    let colours = read_noted(listing, "rgb.txt", &mut notes);
    if colours.is_none() {
        decisions.push("no rgb.txt: no colours".to_owned());
    }
    let mut colours = colours.map(|text| named_images(listing, "rgb.txt", &text, None, &mut notes));
    if let Some(colours) = &mut colours {
        colours.sort();
    }
    let frames: Vec<Frame> = depths
        .into_iter()
        .map(|(stamp, file)| {
            let colour = colours.as_ref().and_then(|colours| nearest(colours, stamp));
            if colour.is_none() && colours.is_some() {
                notes.note(NoteKind::MissingColour, &file, 0, || ("a colour image within 20 ms", "none"));
            }
            Frame { file, stamp: Some(stamp), colour }
        })
        .collect();
    let intrinsics = is_of_benchmark(&text).then_some(CAMERA);
    decisions.push(match intrinsics {
        Some([fx, fy, cx, cy]) => {
            format!("depth.txt names a recording of the benchmark: the camera that it recommends, {fx},{fy},{cx},{cy}")
        }
        None => format!("depth.txt names no recording of the benchmark ({BENCHMARK}...): its camera is not known"),
    });
    decisions.push(format!("{DEPTH_PER_M} is a metre of depth, as the benchmark documents"));
    let size = size(listing, &frames)?;
    let depth = DepthPlan { size, intrinsics, depth_per_m: DEPTH_PER_M, calibrations: Vec::new() };
    Ok(Some(Plan {
        kind: Kind::Tum,
        frames,
        sensor: SpaceSensor::depth_camera("depth"),
        decode: Decode::Depth(depth),
        references: reference(listing, &mut notes).into_iter().collect(),
        decisions,
        notes,
    }))
}

/// Stamps and names of images in the order of the file; only those that are there, others being noted if they are missed.
fn named_images(
    listing: &Listing<'_>,
    file: &str,
    text: &[u8],
    missed: Option<NoteKind>,
    notes: &mut Notes,
) -> Vec<(Stamp, String)> {
    let mut images = Vec::new();
    for row in rows(text) {
        let fields: Vec<&str> = row.fields().take(3).collect();
        let named = match fields.as_slice() {
            [stamp, name] => stamp_of_text(stamp).map(|stamp| (stamp, *name)),
            _ => None,
        };
        match (named, missed) {
            (Some((stamp, name)), _) if listing.has(name) => images.push((stamp, name.to_owned())),
            (Some((_, name)), Some(missed)) => notes.note(missed, file, row.offset_bytes, || (name, "no such file")),
            (Some(_), None) => {}
            (None, _) => {
                notes.note(NoteKind::BadRow, file, row.offset_bytes, || {
                    ("a stamp and the name of an image", row.excerpt())
                });
            }
        }
    }
    images
}

/// The image of sorted ones that is nearest in time, if it is near enough.
fn nearest(images: &[(Stamp, String)], stamp: Stamp) -> Option<String> {
    let after = images.partition_point(|(other, _)| *other < stamp);
    let around = [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|at| images.get(at));
    let apart = |image: &&(Stamp, String)| image.0.0.abs_diff(stamp.0);
    around.min_by_key(apart).filter(|image| apart(image) <= TOGETHER_NS).map(|(_, name)| name.clone())
}

/// Whether a comment says so (`# file: 'rgbd_dataset_freiburg1_desk.bag'`).
fn is_of_benchmark(text: &[u8]) -> bool {
    let text = String::from_utf8_lossy(text);
    text.lines().take_while(|line| line.starts_with('#')).any(|line| line.contains(BENCHMARK))
}

fn reference(listing: &Listing<'_>, notes: &mut Notes) -> Option<Reference> {
    let file = "groundtruth.txt";
    let bytes = read_noted(listing, file, notes)?;
    match pose_rows(file, &bytes, notes) {
        Some(PoseRows::Tum(poses)) => Some(Reference { file: file.to_owned(), frame: ReferenceFrame::Sensor, poses }),
        _ => {
            notes.note(NoteKind::FileNotUsed, file, 0, || ("rows of 8 numbers", excerpt(&bytes)));
            None
        }
    }
}
