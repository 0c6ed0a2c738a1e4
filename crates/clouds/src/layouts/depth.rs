//! What all folders of depth cameras have in common.

use crate::error::CloudError;
use crate::folder::Listing;
use crate::image::{Size, depth_size};
use crate::notes::{NoteKind, Notes};
use crate::plan::Frame;
use mapwright_geom::Stamp;

/// From one image to the next where only their numbers are known: 30 Hz, as the sensors of those recordings have it.
pub(super) const IMAGES_PER_S: i64 = 30;

/// The stamp of a numbered image.
pub(super) fn stamp_of_number(number: u64) -> Stamp {
    Stamp(i64::try_from(i128::from(number) * 1_000_000_000 / i128::from(IMAGES_PER_S)).unwrap_or(i64::MAX))
}

/// The size of the first image that can be read.
///
/// # Errors
/// [`CloudError::NoFrames`] where none can.
pub(super) fn size(listing: &Listing<'_>, frames: &[Frame]) -> Result<Size, CloudError> {
    let mut first = None;
    for frame in frames {
        match listing.read(&frame.file).and_then(|bytes| depth_size(&frame.file, &bytes)) {
            Ok(size) => return Ok(size),
            Err(error) => first = first.or(Some(error)),
        }
    }
    let first = first.map_or_else(|| "there is none".to_owned(), |error| error.to_string());
    Err(CloudError::NoFrames { frames: frames.len(), first })
}

/// Images without one in colour: depth alone is mapped, so nothing is lost. Where none has one, that is a layout.
pub(super) fn note_missing_colours(frames: &[Frame], decisions: &mut Vec<String>, notes: &mut Notes) {
    let without = || frames.iter().filter(|frame| frame.colour.is_none());
    if without().count() == frames.len() {
        decisions.push("no images in colour: depth alone".to_owned());
        return;
    }
    for frame in without() {
        notes.note(NoteKind::MissingColour, &frame.file, 0, || {
            ("an image in colour of the same number or time", "none")
        });
    }
}

/// Reads a file that is there, or notes why it cannot be.
pub(super) fn read_noted(listing: &Listing<'_>, file: &str, notes: &mut Notes) -> Option<Vec<u8>> {
    if !listing.has(file) {
        return None;
    }
    listing.read(file).map_err(|error| notes.note_error(NoteKind::FileNotUsed, file, error)).ok()
}

/// The first of some files that is there.
pub(super) fn first_there(listing: &Listing<'_>, names: impl IntoIterator<Item = String>) -> Option<String> {
    names.into_iter().find(|name| listing.has(name))
}
