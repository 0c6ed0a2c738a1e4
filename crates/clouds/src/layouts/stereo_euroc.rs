//! EuRoC's pairs of cameras, and what is written like them (Burri et al. 2016).

use super::stereo_pair::{Said, folders_with, frames, images_in, note_alone, plan, size, text_of};
use crate::error::CloudError;
use crate::folder::{Listing, parts};
use crate::notes::{NoteKind, Notes};
use crate::plan::{Kind, Plan, stamps_of_names, stem};
use crate::poses::{Reference, ReferenceFrame};
use crate::stereo::StereoPairPlan;
use crate::text::rows;
use mapwright_geom::{Pose3, Stamp};
use mapwright_sensor::ImuReading;
use mapwright_stereo::{EurocCamera, EurocImu};
use nalgebra::{UnitQuaternion, Vector3};

const IMAGES: [&str; 2] = ["cam0/data/", "cam1/data/"];
/// Cameras that are triggered together stamp their images alike; those of other recorders differ by transport. Within this nothing moves by
/// a pixel of a robot that turns by half a radian a second, nanoseconds.
const TOGETHER_NS: u64 = 5_000_000;
/// Where the poses of the body are.
const TRUTH: &str = "state_groundtruth_estimate0/data.csv";
/// Readings of the inertial sensor, and how it sits.
const IMU: [&str; 2] = ["imu0/data.csv", "imu0/sensor.yaml"];

pub(super) fn find(listing: &Listing<'_>) -> Result<Option<Plan>, CloudError> {
    let rights = folders_with(listing, IMAGES[1]);
    let folders: Vec<String> =
        folders_with(listing, IMAGES[0]).into_iter().filter(|folder| rights.contains(folder)).collect();
    let folder = match &folders[..] {
        [] => return Ok(None),
        [folder] => folder,
        several => {
            let folders = several.iter().take(10).map(|folder| folder.trim_end_matches('/').to_owned()).collect();
            return Err(CloudError::Several { folders });
        }
    };
    let mut notes = Notes::default();
    let [left, right] =
        ["cam0/", "cam1/"].map(|camera| stamped_images(listing, &format!("{folder}{camera}"), &mut notes));
    let (pairs, stamps) = together(left?, right?, &mut notes);
    let frames = frames(pairs, stamps);
    let size = size(listing, &frames)?;
    let files = ["cam0/sensor.yaml", "cam1/sensor.yaml"].map(|name| format!("{folder}{name}"));
    let mut decisions = vec!["the robot's frame is the body's, by T_BS of the left camera".to_owned()];
    let (said, body_from_left) = match cameras(listing, &files) {
        Ok((pair, body_from_left)) => {
            let words = format!("the pair is that of {} and {}", files[0], files[1]);
            let readings = readings(listing, folder, &mut decisions, &mut notes);
            (Said { pair: Some(pair), words, disparities: None, readings }, body_from_left)
        }
        Err(reason) => (Said::nothing(reason), Pose3::identity()),
    };
    let references = reference(listing, &format!("{folder}{TRUTH}"), body_from_left, &mut notes);
    let references = references.into_iter().collect();
    Ok(Some(plan(Kind::EurocStereo, (frames, size), said, body_from_left, (references, decisions, notes))))
}

fn cameras(listing: &Listing<'_>, files: &[String; 2]) -> Result<(StereoPairPlan, Pose3), String> {
    let camera = |file: &String| {
        let text = if listing.has(file) { text_of(listing, file) } else { return Err(format!("there is no {file}")) };
        let text = text.map_err(|error| error.to_string())?;
        EurocCamera::parse(&text).map_err(|error| format!("{file}: {error}"))
    };
    let [left, right] = [camera(&files[0])?, camera(&files[1])?];
    let pair = EurocCamera::pair(&left, &right).map_err(|error| format!("{} and {}: {error}", files[0], files[1]))?;
    Ok((StereoPairPlan::AsTaken(Box::new(pair)), left.body_from_camera))
}

/// The readings of `imu0` in the body's frame, by its `T_BS`; none where that is there and cannot be read.
fn readings(listing: &Listing<'_>, folder: &str, decisions: &mut Vec<String>, notes: &mut Notes) -> Vec<ImuReading> {
    let [list, mount] = IMU.map(|name| format!("{folder}{name}"));
    if !listing.has(&list) {
        return Vec::new();
    }
    let body_from_imu = match listing.has(&mount).then(|| text_of(listing, &mount).map(|text| EurocImu::parse(&text))) {
        None => {
            decisions.push(format!("there is no {mount}: the inertial sensor is taken to have the body's axes"));
            UnitQuaternion::identity()
        }
        Some(Ok(Ok(imu))) => imu.body_from_imu.rotation,
        Some(Ok(Err(error))) => {
            decisions.push(format!("{list} is not used: {error}"));
            return Vec::new();
        }
        Some(Err(error)) => {
            notes.note_error(NoteKind::FileNotUsed, &mount, error);
            return Vec::new();
        }
    };
    let bytes = match listing.read(&list) {
        Ok(bytes) => bytes,
        Err(error) => {
            notes.note_error(NoteKind::FileNotUsed, &list, error);
            return Vec::new();
        }
    };
    let mut found = Vec::new();
    for row in rows(&bytes) {
        match reading(&row.fields().collect::<Vec<_>>(), body_from_imu) {
            Some(reading) => found.push(reading),
            None => notes.note(NoteKind::BadRow, &list, row.offset_bytes, || {
                ("nanoseconds, a turn rate and a specific force", row.excerpt())
            }),
        }
    }
    found.sort_by_key(|reading| reading.stamp);
    if !found.is_empty() {
        decisions.push(format!("{list} is used: {} readings of an inertial sensor", found.len()));
    }
    found
}

/// Nanoseconds, radians a second about each axis and metres per second squared along it.
fn reading(fields: &[&str], body_from_imu: UnitQuaternion<f64>) -> Option<ImuReading> {
    let stamp = Stamp(fields.first()?.parse().ok()?);
    let numbers: Vec<f64> = fields.get(1..7)?.iter().map(|field| field.parse().ok()).collect::<Option<_>>()?;
    let [turn, force] = [0, 3].map(|first| body_from_imu * Vector3::from_row_slice(&numbers[first..first + 3]));
    Some(ImuReading { stamp, turn_rate_rad_per_s: turn, specific_force_m_per_s2: Some(force) })
}

/// The images of a camera with their stamps: by data.csv, or by their names.
fn stamped_images(listing: &Listing<'_>, camera: &str, notes: &mut Notes) -> Result<Vec<(Stamp, String)>, CloudError> {
    let (list, folder) = (format!("{camera}data.csv"), format!("{camera}data/"));
    if listing.has(&list) {
        let bytes = listing.read(&list)?;
        let mut found = Vec::new();
        for row in rows(&bytes) {
            let fields: Vec<&str> = row.fields().collect();
            let stamp = fields.first().and_then(|field| field.parse().ok()).map(Stamp);
            match (stamp, fields.get(1)) {
                (Some(stamp), Some(name)) if listing.has(&format!("{folder}{name}")) => {
                    found.push((stamp, format!("{folder}{name}")));
                }
                (Some(_), Some(name)) => notes.note(NoteKind::MissingFrame, &list, row.offset_bytes, || {
                    (format!("an image {folder}{name}"), "none")
                }),
                _ => notes.note(NoteKind::BadRow, &list, row.offset_bytes, || {
                    ("nanoseconds and the name of an image", row.excerpt())
                }),
            }
        }
        if !found.is_empty() {
            found.sort();
            return Ok(found);
        }
    }
    let names = images_in(listing, &folder);
    let stems: Vec<&str> = names.iter().map(|name| stem(name)).collect();
    let stamps = stamps_of_names(&stems).ok_or_else(|| {
        let first = names.first().map_or("none", |name| parts(name).1);
        CloudError::content(&list, 0, "rows of nanoseconds and images, or images called by their nanoseconds", first)
    })?;
    let mut found: Vec<(Stamp, String)> = stamps.into_iter().zip(names).collect();
    found.sort();
    Ok(found)
}

/// Each left image with the right one nearest in time; those without are noted.
fn together(
    left: Vec<(Stamp, String)>,
    right: Vec<(Stamp, String)>,
    notes: &mut Notes,
) -> (Vec<(String, String)>, Vec<Stamp>) {
    let (mut pairs, mut stamps) = (Vec::new(), Vec::new());
    let mut others = right.into_iter().peekable();
    for (stamp, name) in left {
        while let Some((_, alone)) =
            others.next_if(|(other, _)| *other < stamp && other.0.abs_diff(stamp.0) > TOGETHER_NS)
        {
            note_alone(&alone, "left", notes);
        }
        match others.next_if(|(other, _)| other.0.abs_diff(stamp.0) <= TOGETHER_NS) {
            Some((_, other)) => {
                pairs.push((name, other));
                stamps.push(stamp);
            }
            None => note_alone(&name, "right", notes),
        }
    }
    others.for_each(|(_, alone)| note_alone(&alone, "left", notes));
    (pairs, stamps)
}

/// Poses of the body, as those of the left camera.
fn reference(listing: &Listing<'_>, file: &str, body_from_left: Pose3, notes: &mut Notes) -> Option<Reference> {
    if !listing.has(file) {
        return None;
    }
    let bytes = listing.read(file).map_err(|error| notes.note_error(NoteKind::FileNotUsed, file, error)).ok()?;
    let mut poses = Vec::new();
    for row in rows(&bytes) {
        match body_pose(&row.fields().collect::<Vec<_>>()) {
            Some((stamp, pose)) => poses.push((stamp, pose * body_from_left)),
            None => notes.note(NoteKind::BadRow, file, row.offset_bytes, || {
                ("nanoseconds, a place and a quaternion, w first", row.excerpt())
            }),
        }
    }
    (!poses.is_empty()).then(|| Reference { file: file.to_owned(), frame: ReferenceFrame::Sensor, poses })
}

fn body_pose(fields: &[&str]) -> Option<(Stamp, Pose3)> {
    let stamp = Stamp(fields.first()?.parse().ok()?);
    let numbers: Vec<f64> = fields.get(1..8)?.iter().map(|field| field.parse().ok()).collect::<Option<_>>()?;
    let &[x, y, z, qw, qx, qy, qz] = &numbers[..] else { return None };
    let pose = Pose3::from_quaternion([x, y, z], [qx, qy, qz, qw]).filter(|pose| pose.is_finite())?;
    Some((stamp, pose))
}
