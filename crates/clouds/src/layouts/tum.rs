//! The TUM RGB-D benchmark (Sturm et al. 2012), and ICL-NUIM (Handa et al. 2014), which has one list of both kinds of images.

use super::depth::{IMAGES_PER_S, note_missing_colours, read_noted, size, stamp_of_number};
use crate::error::CloudError;
use crate::folder::{Listing, number};
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

/// What lists of images of both kinds are called: a stamp and a name, and once more.
const ASSOCIATIONS: [&str; 4] = ["associations.txt", "associate.txt", "assoc.txt", "association.txt"];

pub(super) fn find(listing: &Listing<'_>) -> Result<Option<Plan>, CloudError> {
    if !listing.has("depth.txt") {
        let file = ASSOCIATIONS.into_iter().find(|name| listing.has(name));
        return file.map_or(Ok(None), |file| associated(listing, file));
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
            Frame { file, stamp: Some(stamp), colour, right: None }
        })
        .collect();
    if colours.is_some() {
        note_missing_colours(&frames, &mut decisions, &mut notes);
    }
    let intrinsics = is_of_benchmark(&text).then_some(CAMERA);
    let camera_words = match intrinsics {
        Some([fx, fy, cx, cy]) => {
            format!("depth.txt names a recording of the benchmark: the camera that it recommends, {fx},{fy},{cx},{cy}")
        }
        None => format!("depth.txt names no recording of the benchmark ({BENCHMARK}...): its camera is not known"),
    };
    plan(listing, frames, (intrinsics, camera_words), decisions, notes).map(Some)
}

/// A folder with one list of both kinds of images; none where its rows name no images of depth that are there.
fn associated(listing: &Listing<'_>, file: &str) -> Result<Option<Plan>, CloudError> {
    let mut notes = Notes::default();
    let text = listing.read(file)?;
    let mut pairs: Vec<[&str; 3]> = Vec::new();
    for row in rows(&text) {
        match row.fields().collect::<Vec<_>>()[..] {
            [of_depth, depth, _, colour] if depth.contains("depth") => pairs.push([of_depth, depth, colour]),
            [_, colour, of_depth, depth] if depth.contains("depth") => pairs.push([of_depth, depth, colour]),
            _ => notes.note(NoteKind::BadRow, file, row.offset_bytes, || {
                ("a stamp and the name of an image of depth, and of one in colour", row.excerpt())
            }),
        }
    }
    let are_numbers = pairs.iter().all(|[stamp, ..]| number(stamp).is_some());
    let stamp_of = |text: &str| if are_numbers { number(text).map(stamp_of_number) } else { stamp_of_text(text) };
    let mut frames = Vec::new();
    for [stamp, depth, colour] in pairs {
        match stamp_of(stamp) {
            Some(stamp) if listing.has(depth) => {
                let colour = Some(colour.to_owned()).filter(|colour| listing.has(colour));
                frames.push(Frame { file: depth.to_owned(), stamp: Some(stamp), colour, right: None });
            }
            Some(_) => notes.note(NoteKind::MissingFrame, file, 0, || (depth, "no such file")),
            None => notes.note(NoteKind::BadRow, file, 0, || ("a stamp", stamp)),
        }
    }
    if frames.is_empty() {
        return Ok(None);
    }
    let mut decisions = vec!["the robot's frame is the camera's: z ahead, x to the right".to_owned()];
    decisions.push(if are_numbers {
        format!("{file} has the images; stamps are their numbers, taken to be at {IMAGES_PER_S} Hz")
    } else {
        format!("{file} has the images and their stamps")
    });
    note_missing_colours(&frames, &mut decisions, &mut notes);
    plan(listing, frames, (None, format!("{file} does not say what the camera is")), decisions, notes).map(Some)
}

fn plan(
    listing: &Listing<'_>,
    frames: Vec<Frame>,
    (intrinsics, camera_words): (Option<[f64; 4]>, String),
    decisions: Vec<String>,
    mut notes: Notes,
) -> Result<Plan, CloudError> {
    let depth = DepthPlan {
        size: size(listing, &frames)?,
        intrinsics,
        camera_words: Ok(camera_words),
        depth_per_m: DEPTH_PER_M,
        scale_words: "as the benchmark documents",
        calibrations: Vec::new(),
    };
    Ok(Plan {
        kind: Kind::Tum,
        frames,
        sensor: SpaceSensor::depth_camera("depth"),
        decode: Decode::Depth(depth),
        references: reference(listing, &mut notes).into_iter().collect(),
        decisions,
        notes,
    })
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
