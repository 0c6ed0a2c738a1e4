//! What all folders of two cameras have in common.

use crate::error::CloudError;
use crate::folder::{Listing, ends_with, natural_key, parts};
use crate::image::{Size, camera_image_size};
use crate::notes::{NoteKind, Notes};
use crate::plan::{Decode, Frame, Kind, Plan, StereoPlan, stem};
use crate::poses::Reference;
use crate::stereo::StereoPairPlan;
use mapwright_geom::{Pose3, Stamp};
use mapwright_sensor::{ImuReading, SpaceSensor};
use std::collections::BTreeMap;

/// How images of cameras end.
const IMAGES: [&str; 5] = [".png", ".jpg", ".jpeg", ".pgm", ".ppm"];

/// Whether a file is an image that is read, by its name.
pub(super) fn is_image(name: &str) -> bool {
    IMAGES.iter().any(|ending| ends_with(name, ending))
}

/// The folders, each with a last `/`, of which the paths of two files begin so: `before` of `before + inner + file`, of images.
pub(super) fn folders_with(listing: &Listing<'_>, inner: &str) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    for name in listing.names().filter(|name| is_image(name)) {
        let before = parts(name).0.strip_suffix(inner).filter(|before| before.is_empty() || before.ends_with('/'));
        if let Some(before) = before.filter(|before| !found.iter().any(|known| known == before)) {
            found.push(before.to_owned());
        }
    }
    found
}

/// The images of one folder, as people count.
pub(super) fn images_in(listing: &Listing<'_>, folder: &str) -> Vec<String> {
    let mut names: Vec<String> =
        listing.names().filter(|name| parts(name).0 == folder && is_image(name)).map(str::to_owned).collect();
    names.sort_by_cached_key(|name| natural_key(name));
    names
}

/// Images of the left folder with those of the same name in the right one; those without are noted.
pub(super) fn by_name(left: Vec<String>, right: &[String], notes: &mut Notes) -> Vec<(String, String)> {
    let mut of_right: BTreeMap<&str, &String> = right.iter().map(|name| (stem(name), name)).collect();
    let mut pairs = Vec::new();
    for name in left {
        match of_right.remove(stem(&name)) {
            Some(other) => pairs.push((name, other.clone())),
            None => note_alone(&name, "right", notes),
        }
    }
    of_right.into_values().for_each(|name| note_alone(name, "left", notes));
    pairs
}

pub(super) fn note_alone(name: &str, missing: &str, notes: &mut Notes) {
    notes.note(NoteKind::WithoutPartner, name, 0, || (format!("an image of the {missing} camera with it"), "none"));
}

/// The size of the first image that can be read.
///
/// # Errors
/// [`CloudError::NoFrames`] where none can.
pub(super) fn size(listing: &Listing<'_>, frames: &[Frame]) -> Result<Size, CloudError> {
    let mut first = None;
    for frame in frames {
        match listing.read(&frame.file).and_then(|bytes| camera_image_size(&frame.file, &bytes)) {
            Ok(size) => return Ok(size),
            Err(error) => first = first.or(Some(error)),
        }
    }
    let first = first.map_or_else(|| "there is no image of both cameras".to_owned(), |error| error.to_string());
    Err(CloudError::NoFrames { frames: frames.len(), first })
}

/// Frames of pairs and their stamps.
pub(super) fn frames(pairs: Vec<(String, String)>, stamps: Vec<Stamp>) -> Vec<Frame> {
    let frame = |((file, right), stamp)| Frame { file, stamp: Some(stamp), colour: None, right: Some(right) };
    pairs.into_iter().zip(stamps).map(frame).collect()
}

/// What a folder says of its cameras: the pair, or why there is none, and where that is from.
pub(super) struct Said {
    pub(super) pair: Option<StereoPairPlan>,
    pub(super) words: String,
    pub(super) disparities: Option<u32>,
    /// Readings of an inertial sensor beside it, in the robot's frame.
    pub(super) readings: Vec<ImuReading>,
}

impl Said {
    pub(super) fn nothing(words: impl Into<String>) -> Self {
        Self { pair: None, words: words.into(), disparities: None, readings: Vec::new() }
    }

    /// Of a file that was read.
    pub(super) fn of(file: &str, pair: Result<StereoPairPlan, impl std::fmt::Display>) -> Self {
        match pair {
            Ok(pair) => Self {
                pair: Some(pair),
                words: format!("the pair is that of {file}"),
                disparities: None,
                readings: Vec::new(),
            },
            Err(reason) => Self::nothing(format!("{file}: {reason}")),
        }
    }
}

/// The text of a file that is there.
pub(super) fn text_of(listing: &Listing<'_>, file: &str) -> Result<String, CloudError> {
    listing.read(file).map(|bytes| String::from_utf8_lossy(&bytes).into_owned())
}

/// The plan of a folder of pairs.
pub(super) fn plan(
    kind: Kind,
    (frames, size): (Vec<Frame>, Size),
    said: Said,
    robot_from_left: Pose3,
    (references, decisions, notes): (Vec<Reference>, Vec<String>, Notes),
) -> Plan {
    let Said { pair, words, disparities, readings } = said;
    // its ranges and noise follow from the pair, once it is known
    let sensor = SpaceSensor { robot_from_sensor: robot_from_left, ..SpaceSensor::lidar("stereo") };
    let decode = Decode::Stereo(Box::new(StereoPlan { size, pair, pair_words: words, disparities, readings }));
    Plan { kind, frames, sensor, decode, references, decisions, notes }
}

/// What is taken for granted where nothing says how the camera sits.
pub(super) const CAMERAS_FRAME: &str = "the robot's frame is the left camera's: z ahead, x to the right";
