//! KITTI's odometry benchmark (Geiger et al. 2012).

use crate::bins::{self, Columns};
use crate::error::CloudError;
use crate::folder::{Listing, ends_with, number, parts};
use crate::notes::{NoteKind, Notes};
use crate::plan::{Decode, FRAME_NS, Frame, Kind, Plan, RowOf, note_gaps, stamps_of_names, stem};
use crate::poses::{PoseRows, Reference, ReferenceFrame, pose_of_rows, pose_rows, stamp_of_date, stamp_of_text};
use crate::text::{excerpt, rows};
use mapwright_geom::{Pose3, Stamp};
use mapwright_sensor::SpaceSensor;

/// Names of the transform from the lidar to camera 0.
const TR: [&str; 3] = ["Tr:", "Tr_velo_to_cam:", "Tr_velo_cam:"];

/// Files of times: of the odometry benchmark, and of the raw recordings.
const TIMES: [&str; 2] = ["times.txt", "timestamps.txt"];

pub(super) fn find(listing: &Listing<'_>) -> Result<Option<Plan>, CloudError> {
    let names = match listing.only() {
        Some(name) if is_bin(name) => vec![name.to_owned()],
        _ => {
            listing.in_one_folder(|name| is_bin(name) && stem(name).bytes().all(|b| b.is_ascii_digit() || b == b'.'))?
        }
    };
    let Some(first) = names.first() else { return Ok(None) };
    listing.check_first(&names, |name| {
        let bytes = listing.read(name)?;
        bins::read_bin(name, &bytes, &mut Notes::default()).map(drop)
    })?;
    let folder = parts(first).0.to_owned();
    let mut notes = Notes::default();
    let mut decisions = vec!["the robot's frame is the lidar's".to_owned()];
    let numbers: Option<Vec<u64>> = names.iter().map(|name| number(stem(name))).collect();
    let stamps = stamps(listing, &folder, &names, numbers.as_deref(), &mut decisions, &mut notes);
    let references = references(listing, &folder, numbers.as_deref(), &stamps, &mut notes);
    let frames = names.into_iter().zip(stamps).map(|(file, stamp)| Frame {
        file,
        stamp: Some(stamp),
        colour: None,
        right: None,
    });
    Ok(Some(Plan {
        kind: Kind::Kitti,
        frames: frames.collect(),
        sensor: SpaceSensor::lidar(if folder.is_empty() { "lidar" } else { folder.trim_end_matches('/') }),
        decode: Decode::Bins(Columns::Four),
        references,
        decisions,
        notes,
    }))
}

fn is_bin(name: &str) -> bool {
    ends_with(name, ".bin") || ends_with(name, ".bin.zst")
}

/// A file that stands beside the folder of clouds, or in it.
fn beside(listing: &Listing<'_>, folder: &str, name: &str) -> Option<String> {
    let above = parts(folder.trim_end_matches('/')).0;
    [above, folder].iter().map(|place| format!("{place}{name}")).find(|name| listing.has(name))
}

pub(super) fn stamps(
    listing: &Listing<'_>,
    folder: &str,
    names: &[String],
    numbers: Option<&[u64]>,
    decisions: &mut Vec<String>,
    notes: &mut Notes,
) -> Vec<Stamp> {
    let stems: Vec<&str> = names.iter().map(|name| stem(name)).collect();
    let file = TIMES.iter().find_map(|name| beside(listing, folder, name));
    if let (Some(file), Some(numbers)) = (&file, numbers) {
        match times(listing, file, numbers, notes) {
            Ok(stamps) => {
                note_gaps(numbers.iter().copied().zip(names.iter().map(String::as_str)), notes);
                return stamps;
            }
            Err(error) => notes.note_error(NoteKind::FileNotUsed, file, error),
        }
    }
    if let Some(stamps) = stamps_of_names(&stems) {
        decisions.push("stamps are the names of the files".to_owned());
        return stamps;
    }
    decisions.push("no times.txt or timestamps.txt that fits: frames are taken to be 0.1 s apart".to_owned());
    let numbers = numbers.filter(|numbers| numbers.last().is_none_or(|last| *last < u64::from(u32::MAX)));
    if let Some(numbers) = numbers {
        note_gaps(numbers.iter().copied().zip(names.iter().map(String::as_str)), notes);
    }
    let number = |place: usize| numbers.map_or(place as i64, |numbers| numbers[place] as i64);
    (0..names.len()).map(|place| Stamp(number(place) * FRAME_NS)).collect()
}

/// Seconds, or a date and a time of day, one row a frame; what has none is 0.1 s after the frame before.
fn times(listing: &Listing<'_>, file: &str, numbers: &[u64], notes: &mut Notes) -> Result<Vec<Stamp>, CloudError> {
    let bytes = listing.read(file)?;
    let mut bad = Vec::new();
    let times: Vec<Option<Stamp>> = rows(&bytes)
        .map(|row| {
            let mut fields = row.fields();
            let [first, second] = [fields.next().unwrap_or_default(), fields.next().unwrap_or_default()];
            let stamp = stamp_of_text(first).or_else(|| stamp_of_date(first, second));
            bad.extend(stamp.is_none().then_some(row));
            stamp
        })
        .collect();
    let row_of = RowOf::find(times.len(), numbers).filter(|_| times.iter().any(Option::is_some)).ok_or_else(|| {
        let found = format!("{} rows: {}", times.len(), excerpt(&bytes));
        CloudError::content(file, 0, format!("seconds or dates for {} frames", numbers.len()), found)
    })?;
    bad.iter().for_each(|row| {
        notes.note(NoteKind::BadRow, file, row.offset_bytes, || ("seconds, or a date and a time", row.excerpt()))
    });
    let mut last = Stamp(-FRAME_NS);
    let stamp = |(place, number): (usize, &u64)| {
        let row = row_of.row(place, *number);
        last = times.get(row).copied().flatten().unwrap_or_else(|| {
            notes.note(NoteKind::Unstamped, file, bytes.len(), || (format!("a row for frame {number}"), "none"));
            Stamp(last.0.saturating_add(FRAME_NS))
        });
        last
    };
    Ok(numbers.iter().enumerate().map(stamp).collect())
}

fn references(
    listing: &Listing<'_>,
    folder: &str,
    numbers: Option<&[u64]>,
    stamps: &[Stamp],
    notes: &mut Notes,
) -> Vec<Reference> {
    let above = parts(folder.trim_end_matches('/')).0;
    let camera_from_lidar = beside(listing, folder, "calib.txt").and_then(|file| calibration(listing, &file, notes));
    references_in(listing, &[above, folder], (numbers, stamps), notes, |file, poses| {
        of_camera(parts(file).1, poses, camera_from_lidar)
    })
}

/// Poses in files `poses*.txt` of these folders; `of_camera` says what those are that are written as matrices, which KITTI has of camera 0.
pub(super) fn references_in(
    listing: &Listing<'_>,
    folders: &[&str],
    (numbers, stamps): (Option<&[u64]>, &[Stamp]),
    notes: &mut Notes,
    of_camera: impl Fn(&str, Vec<(Stamp, Pose3)>) -> (ReferenceFrame, Vec<(Stamp, Pose3)>),
) -> Vec<Reference> {
    let is_poses = |name: &&str| {
        let (place, file) = parts(name);
        folders.contains(&place) && file.starts_with("poses") && ends_with(file, ".txt")
    };
    let mut references = Vec::new();
    for file in listing.names().filter(is_poses) {
        let bytes = match listing.read(file) {
            Ok(bytes) => bytes,
            Err(error) => {
                notes.note_error(NoteKind::FileNotUsed, file, error);
                continue;
            }
        };
        let found = match pose_rows(file, &bytes, notes) {
            Some(PoseRows::Tum(poses)) => Some((ReferenceFrame::Sensor, poses)),
            Some(PoseRows::Kitti(poses)) => stamped(&poses, numbers, stamps).map(|poses| of_camera(file, poses)),
            None => None,
        };
        match found {
            Some((frame, poses)) => references.push(Reference { file: file.to_owned(), frame, poses }),
            None => {
                let words = || (format!("poses of {} frames", stamps.len()), excerpt(&bytes));
                notes.note(NoteKind::FileNotUsed, file, 0, words);
            }
        }
    }
    references
}

/// The poses of the frames that are there; none where rows do not belong to frames.
pub(super) fn stamped(
    poses: &[Option<Pose3>],
    numbers: Option<&[u64]>,
    stamps: &[Stamp],
) -> Option<Vec<(Stamp, Pose3)>> {
    let in_order: Vec<u64> = (0..stamps.len() as u64).collect();
    let numbers = numbers.unwrap_or(&in_order);
    let row_of = RowOf::find(poses.len(), numbers)?;
    let pose = |(place, (number, stamp)): (usize, (&u64, &Stamp))| {
        poses.get(row_of.row(place, *number)).copied().flatten().map(|pose| (*stamp, pose))
    };
    Some(numbers.iter().zip(stamps).enumerate().filter_map(pose).collect())
}

/// Poses of camera 0 become those of the lidar, relative to the lidar's first place, where its place on the camera is known. A file
/// that is called after the lidar has them already, as one has beside which there is no calibration and that is not called after a
/// camera.
fn of_camera(
    file: &str,
    poses: Vec<(Stamp, Pose3)>,
    camera_from_lidar: Option<Pose3>,
) -> (ReferenceFrame, Vec<(Stamp, Pose3)>) {
    let is_lidars = ["lidar", "velo"].iter().any(|word| file.contains(word));
    match camera_from_lidar.filter(|_| !is_lidars) {
        Some(camera_from_lidar) => {
            let lidar_from_camera = camera_from_lidar.inverse();
            let turned = |(stamp, pose)| (stamp, lidar_from_camera * pose * camera_from_lidar);
            (ReferenceFrame::FromCamera, poses.into_iter().map(turned).collect())
        }
        None if file.contains("cam") => (ReferenceFrame::Camera, poses),
        None => (ReferenceFrame::Sensor, poses),
    }
}

/// `camera_from_lidar` of calib.txt.
fn calibration(listing: &Listing<'_>, file: &str, notes: &mut Notes) -> Option<Pose3> {
    let bytes = match listing.read(file) {
        Ok(bytes) => bytes,
        Err(error) => {
            notes.note_error(NoteKind::FileNotUsed, file, error);
            return None;
        }
    };
    let tr = rows(&bytes).find(|row| row.fields().next().is_some_and(|key| TR.contains(&key)));
    let numbers: Option<Vec<f64>> = tr.and_then(|row| row.fields().skip(1).map(|word| word.parse().ok()).collect());
    let pose = numbers.filter(|numbers| numbers.len() == 12).and_then(|numbers| pose_of_rows(&numbers));
    if pose.is_none() {
        let (at, found) = tr.map_or((0, "no such row".to_owned()), |row| (row.offset_bytes, row.excerpt()));
        notes.note(NoteKind::FileNotUsed, file, at, || ("Tr: and a rigid motion in 12 numbers", found));
    }
    pose
}
