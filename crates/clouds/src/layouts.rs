//! How recordings lie in folders: each kind says what it finds there.

mod depth;
mod files;
mod kitti;
mod nuscenes;
mod open3d;
mod packets;
mod seven_scenes;
mod stereo_euroc;
mod stereo_kitti;
mod stereo_middlebury;
mod stereo_pair;
mod tum;

use crate::error::CloudError;
use crate::folder::{Listing, ends_with};
use crate::notes::NoteKind;
use crate::plan::{Kind, Plan};
use std::collections::BTreeSet;

/// How files with clouds end.
const CLOUDS: [&str; 5] = [".bin", ".bin.zst", ".pcd", ".ply", ".pcap"];

/// The first kind that the folder is of: kinds that need more to be there come first.
pub(crate) fn find(listing: &Listing<'_>) -> Result<Option<Plan>, CloudError> {
    let kinds = [
        tum::find,
        seven_scenes::find,
        open3d::find,
        nuscenes::find,
        kitti::find,
        packets::find,
        stereo_kitti::find,
        stereo_euroc::find,
        stereo_middlebury::find,
        files::find,
    ];
    for kind in kinds {
        if let Some(mut plan) = kind(listing)? {
            note_others(listing, &mut plan);
            return Ok(Some(plan));
        }
    }
    Ok(None)
}

/// Notes files with clouds that are not of this kind: one kind is read of a folder.
fn note_others(listing: &Listing<'_>, plan: &mut Plan) {
    let used: BTreeSet<&str> = plan.frames.iter().map(|frame| frame.file.as_str()).collect();
    let is_packets = |name: &str| plan.kind == Kind::Packets && ends_with(name, ".pcap");
    let is_other =
        |name: &&str| CLOUDS.iter().any(|end| ends_with(name, end)) && !used.contains(name) && !is_packets(name);
    for name in listing.names().filter(is_other) {
        plan.notes.note(NoteKind::OtherClouds, name, 0, || {
            ("one kind of clouds, in one folder", "a file with clouds beside those")
        });
    }
}
