//! What a folder holds and how it is read: the result of recognising it.

use crate::bins::Columns;
use crate::folder::parts;
use crate::image::Size;
use crate::notes::{NoteKind, Notes};
use crate::packets::flows::Survey;
use crate::points::UNIX_S;
use crate::poses::{Reference, stamp_of_text};
use crate::stereo::StereoPairPlan;
use mapwright_geom::Stamp;
use mapwright_sensor::{ImuReading, SpaceSensor};
use std::fmt;

/// From one frame to the next where nothing says when they were taken, nanoseconds: lidars turn at 10 Hz.
pub(crate) const FRAME_NS: i64 = 100_000_000;

/// A kind of recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Kind {
    /// KITTI's odometry benchmark: `velodyne/000000.bin` and so on.
    Kitti,
    /// nuScenes' lidar sweeps: `...__1532402927647951.pcd.bin` and so on.
    NuScenes,
    /// PCD and PLY files, or one of them.
    Files,
    /// The TUM RGB-D benchmark: `depth.txt`.
    Tum,
    /// Microsoft's 7-Scenes: `frame-000000.depth.png` and so on.
    SevenScenes,
    /// Open3D's samples: `depth0.png` and so on, `camera.json`.
    Open3d,
    /// A stereo camera in the layout of KITTI: `image_0`, `image_1`, `calib.txt`.
    KittiStereo,
    /// A stereo camera in the layout of EuRoC: `mav0/cam0`, `mav0/cam1`.
    EurocStereo,
    /// A pair of images in the layout of Middlebury's: `im0.png` and `im1.png` with `calib.txt`, or two that are numbered.
    Middlebury,
    /// Packets of a lidar as they came from the network: Velodyne, Ouster, Hesai.
    Packets,
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Kitti => "clouds in the layout of KITTI's odometry benchmark",
            Self::NuScenes => "clouds in the layout of nuScenes",
            Self::Files => "clouds as PCD or PLY files",
            Self::Tum => "a depth camera in the layout of the TUM RGB-D benchmark",
            Self::SevenScenes => "a depth camera in the layout of 7-Scenes",
            Self::Open3d => "a depth camera in the layout of Open3D's samples",
            Self::KittiStereo => "a stereo camera in the layout of KITTI",
            Self::EurocStereo => "a stereo camera in the layout of EuRoC",
            Self::Middlebury => "a stereo pair in the layout of Middlebury's",
            Self::Packets => "packets of a lidar",
        })
    }
}

/// A file with a cloud or image.
#[derive(Debug, Clone)]
pub(crate) struct Frame {
    pub(crate) file: String,
    /// None where only the file's points may say.
    pub(crate) stamp: Option<Stamp>,
    pub(crate) colour: Option<String>,
    /// Of a pair, the image of the right camera.
    pub(crate) right: Option<String>,
}

/// What a folder says of its depth camera.
#[derive(Debug, Clone)]
pub(crate) struct DepthPlan {
    pub(crate) size: Size,
    /// `fx fy cx cy`.
    pub(crate) intrinsics: Option<[f64; 4]>,
    /// Where they are from, in words; or what casts doubt on them.
    pub(crate) camera_words: Result<String, String>,
    /// What a metre is in the images.
    pub(crate) depth_per_m: f64,
    /// Who has it so: `as Open3D takes it`.
    pub(crate) scale_words: &'static str,
    /// Files that may say the intrinsics.
    pub(crate) calibrations: Vec<String>,
}

/// What a folder says of its pair of cameras.
#[derive(Debug, Clone)]
pub(crate) struct StereoPlan {
    pub(crate) size: Size,
    /// None where only the caller may say it.
    pub(crate) pair: Option<StereoPairPlan>,
    /// Where it is from, in words; or why there is none.
    pub(crate) pair_words: String,
    /// Disparities to look at, where the folder says it.
    pub(crate) disparities: Option<u32>,
    /// Readings of the inertial sensor beside it, in the robot's frame, by their stamps.
    pub(crate) readings: Vec<ImuReading>,
}

/// How frames are read.
#[derive(Debug, Clone)]
pub(crate) enum Decode {
    /// Floats alone.
    Bins(Columns),
    /// PCD or PLY.
    Files,
    Depth(DepthPlan),
    Stereo(Box<StereoPlan>),
    /// Revolutions of the packets of one file.
    Packets(Survey),
}

/// What is to be done.
#[derive(Debug, Clone)]
pub(crate) struct Plan {
    pub(crate) kind: Kind,
    pub(crate) frames: Vec<Frame>,
    pub(crate) sensor: SpaceSensor,
    pub(crate) decode: Decode,
    pub(crate) references: Vec<Reference>,
    /// Decisions and what was taken for granted, in words.
    pub(crate) decisions: Vec<String>,
    pub(crate) notes: Notes,
}

/// Stamps of files that are named after them, in seconds with a point or as a time between 2001 and 2049 in whole seconds,
/// milli-, micro- or nanoseconds; none where one of them is not.
pub(crate) fn stamps_of_names(stems: &[&str]) -> Option<Vec<Stamp>> {
    if stems.iter().all(|stem| stem.contains('.')) {
        return stems.iter().map(|stem| is_plain(stem).then(|| stamp_of_text(stem)).flatten()).collect();
    }
    let numbers: Vec<i64> =
        stems.iter().map(|stem| stem.parse().ok().filter(|_| is_plain(stem))).collect::<Option<_>>()?;
    let is_unix = |unit_ns: &i64| numbers.iter().all(|n| UNIX_S.contains(&(*n as f64 * *unit_ns as f64 * 1e-9)));
    let unit_ns = [1_000_000_000, 1_000_000, 1000, 1].into_iter().find(is_unix)?;
    numbers.iter().map(|number| number.checked_mul(unit_ns).map(Stamp)).collect()
}

fn is_plain(stem: &str) -> bool {
    stem.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.') && stem.bytes().any(|byte| byte.is_ascii_digit())
}

/// A file's name without its folder and ending.
pub(crate) fn stem(name: &str) -> &str {
    let file = parts(name).1;
    let file = file.strip_suffix(".zst").unwrap_or(file);
    file.rfind('.').map_or(file, |dot| &file[..dot])
}

/// Which row of a file of times or poses each frame has.
pub(crate) enum RowOf {
    /// By the frame's number.
    Number,
    /// By its place in order.
    Order,
}

impl RowOf {
    /// How `rows` belong to the numbered frames; none where they cannot.
    pub(crate) fn find(rows: usize, numbers: &[u64]) -> Option<Self> {
        let last = numbers.last().copied().unwrap_or(0);
        let is_counted = numbers.iter().enumerate().all(|(place, number)| place as u64 == *number);
        if (rows as u64) > last || is_counted {
            Some(Self::Number)
        } else {
            (rows == numbers.len()).then_some(Self::Order)
        }
    }

    pub(crate) fn row(&self, place: usize, number: u64) -> usize {
        match self {
            Self::Number => usize::try_from(number).unwrap_or(usize::MAX),
            Self::Order => place,
        }
    }
}

/// Notes the gaps in the numbers of frames.
pub(crate) fn note_gaps<'a>(frames: impl Iterator<Item = (u64, &'a str)>, notes: &mut Notes) {
    let mut last: Option<u64> = None;
    for (number, file) in frames {
        if let Some(expected) = last.and_then(|last| last.checked_add(1)).filter(|expected| number > *expected) {
            notes.note(NoteKind::MissingFrame, file, 0, || (format!("frame {expected}"), format!("frame {number}")));
        }
        last = Some(number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_stand_in_names_only_where_they_must_be_stamps() {
        let of = |stems: &[&str]| stamps_of_names(stems).map(|stamps| stamps.iter().map(|s| s.0).collect::<Vec<_>>());
        assert_eq!(of(&["1305031453.374112", "2.5"]), Some(vec![1_305_031_453_374_112_000, 2_500_000_000]));
        assert_eq!(of(&["1305031453374112000"]), Some(vec![1_305_031_453_374_112_000]));
        assert_eq!(of(&["1305031453374"]), Some(vec![1_305_031_453_374_000_000]));
        assert_eq!(of(&["1305031453"]), Some(vec![1_305_031_453_000_000_000]));
        assert_eq!(
            [of(&["000001", "000002"]), of(&["1305031453", "2"]), of(&["a"]), of(&["1.2.3"])],
            [None, None, None, None]
        );
    }

    #[test]
    fn rows_belong_to_frames_by_number_or_by_order() {
        assert_eq!(RowOf::find(200, &[94, 95]).unwrap().row(0, 94), 94);
        assert_eq!(RowOf::find(2, &[94, 95]).unwrap().row(0, 94), 0);
        assert!(RowOf::find(3, &[94, 95]).is_none());
        assert_eq!(RowOf::find(1, &[0, 1]).unwrap().row(1, 1), 1);
    }
}
