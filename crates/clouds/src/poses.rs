//! Poses that come with a recording.

use crate::error::CloudError;
use crate::notes::{NoteKind, Notes};
use crate::text::{Row, rows, seconds_of_date};
use mapwright_geom::{Pose3, Stamp};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Rows and columns of a rotation may differ so far from being orthonormal; what is written with six digits stays well below.
const ORTHONORMAL_TOLERANCE: f64 = 0.01;

/// Poses that came with a recording, by whatever made them.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// The file that they stand in, or what its files are called.
    pub file: String,
    /// What they are poses of, in words.
    pub frame: ReferenceFrame,
    /// Stamps and `world_from_frame`, in the file's order.
    pub poses: Vec<(Stamp, Pose3)>,
}

impl Reference {
    /// Poses of the sensor as `stamp x y z qx qy qz qw`, one a row; none where the first row is not that. Bad rows are noted.
    #[must_use]
    pub fn of_tum(file: &str, bytes: &[u8], notes: &mut Notes) -> Option<Self> {
        match pose_rows(file, bytes, notes)? {
            PoseRows::Tum(poses) => Some(Self { file: file.to_owned(), frame: ReferenceFrame::Sensor, poses }),
            PoseRows::Kitti(_) => None,
        }
    }
}

/// What poses are poses of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ReferenceFrame {
    /// Of the sensor whose clouds are read; where the folder does not say otherwise this is taken for granted.
    Sensor,
    /// Of the sensor: the file has them of a camera, and the folder's calibration says where the sensor is on it.
    FromCamera,
    /// Of KITTI's camera 0, of which nothing says where the lidar is on it: z forward, x right.
    Camera,
}

impl std::fmt::Display for ReferenceFrame {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Sensor => "the sensor",
            Self::FromCamera => "the sensor, by the camera's poses and Tr of calib.txt",
            Self::Camera => "camera 0 (no Tr in calib.txt says where the lidar is)",
        })
    }
}

/// A pose by the first three rows of its matrix; none where they are no motion.
pub(crate) fn pose_of_rows(rows: &[f64]) -> Option<Pose3> {
    let rows: &[f64; 12] = rows.first_chunk()?;
    let rotation = Matrix3::from_fn(|row, column| rows[4 * row + column]);
    let error = (rotation * rotation.transpose() - Matrix3::identity()).amax();
    let is_rotation = error <= ORTHONORMAL_TOLERANCE && rotation.determinant() > 0.0;
    let mut quaternion = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    quaternion.renormalize();
    let pose = Pose3 { translation: Vector3::new(rows[3], rows[7], rows[11]), rotation: quaternion };
    (is_rotation && pose.is_finite()).then_some(pose)
}

/// What the rows of a file of poses are.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum PoseRows {
    /// `stamp x y z qx qy qz qw`, of Sturm et al. 2012.
    Tum(Vec<(Stamp, Pose3)>),
    /// Three rows of a matrix a row, of Geiger et al. 2012; none where a row is not that.
    Kitti(Vec<Option<Pose3>>),
}

/// The poses of a text; none where its first row is neither kind.
pub(crate) fn pose_rows(file: &str, bytes: &[u8], notes: &mut Notes) -> Option<PoseRows> {
    let columns = rows(bytes).next()?.numbers()?.len();
    let mut bad = |row: Row<'_>| {
        notes
            .note(NoteKind::BadRow, file, row.offset_bytes, || (format!("a pose of {columns} numbers"), row.excerpt()));
    };
    match columns {
        8 => {
            let read = |row: Row<'_>| {
                let pose = row.numbers().and_then(|numbers| tum_pose(&numbers));
                pose.or_else(|| {
                    bad(row);
                    None
                })
            };
            Some(PoseRows::Tum(rows(bytes).filter_map(read).collect()))
        }
        12 => {
            let read = |row: Row<'_>| {
                let pose = row.numbers().filter(|n| n.len() == 12).and_then(|numbers| pose_of_rows(&numbers));
                pose.or_else(|| {
                    bad(row);
                    None
                })
            };
            Some(PoseRows::Kitti(rows(bytes).map(read).collect()))
        }
        _ => None,
    }
}

fn tum_pose(numbers: &[f64]) -> Option<(Stamp, Pose3)> {
    let &[stamp, x, y, z, qx, qy, qz, qw] = numbers else { return None };
    let pose = Pose3::from_quaternion([x, y, z], [qx, qy, qz, qw]).filter(|pose| pose.is_finite())?;
    stamp_of_seconds(stamp).map(|stamp| (stamp, pose))
}

/// A stamp of seconds that a stamp can hold.
pub(crate) fn stamp_of_seconds(seconds: f64) -> Option<Stamp> {
    (seconds.abs() < 9e9).then(|| Stamp::from_secs_f64(seconds))
}

/// Seconds as they are written, exact to the nanosecond where they have no exponent.
pub(crate) fn stamp_of_text(text: &str) -> Option<Stamp> {
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    let is_plain = [whole, fraction].iter().all(|part| part.bytes().all(|byte| byte.is_ascii_digit()));
    if !is_plain || whole.is_empty() || whole.len() > 10 {
        return text.parse().ok().and_then(stamp_of_seconds);
    }
    let digits = |at: usize| fraction.as_bytes().get(at).map_or(0, |digit| i64::from(digit - b'0'));
    let nanoseconds = (0..9).fold(0, |sum, at| 10 * sum + digits(at));
    let seconds: i64 = whole.parse().ok().filter(|seconds| *seconds < 9_000_000_000)?;
    Some(Stamp(seconds * 1_000_000_000 + nanoseconds))
}

/// A date and a time of day as KITTI writes them, `2011-09-26 13:02:25.964389445`, as if of UTC.
pub(crate) fn stamp_of_date(date: &str, time: &str) -> Option<Stamp> {
    let whole = |text: &str, most: i64| text.parse().ok().filter(|number: &i64| (0..=most).contains(number));
    let mut parts = date.splitn(3, '-');
    let [year, month, day] = [9999, 12, 31].map(|most| parts.next().and_then(|part| whole(part, most)));
    let mut parts = time.splitn(3, ':');
    let [hour, minute] = [23, 59].map(|most| parts.next().and_then(|part| whole(part, most)));
    let second = stamp_of_text(parts.next()?).filter(|second| (0..=60).contains(&(second.0 / 1_000_000_000)))?;
    let seconds = seconds_of_date([year?, month?, day?, hour?, minute?, 0]);
    Some(Stamp(seconds.checked_mul(1_000_000_000)?.checked_add(second.0)?))
}

/// A pose as a matrix of four rows, as 7-Scenes has one a file.
pub(crate) fn pose_of_matrix(file: &str, bytes: &[u8]) -> Result<Pose3, CloudError> {
    let numbers: Option<Vec<f64>> =
        rows(bytes).take(5).map(Row::numbers).collect::<Option<Vec<_>>>().map(|all| all.concat());
    let pose = numbers.filter(|numbers| numbers.len() == 16).and_then(|numbers| pose_of_rows(&numbers));
    pose.ok_or_else(|| CloudError::content(file, 0, "a rigid motion as a matrix of 4 x 4", crate::text::excerpt(bytes)))
}

/// Open3D's log: a row of three numbers, of which the first is the frame's, and a matrix of four rows, again and again.
pub(crate) fn open3d_log(file: &str, bytes: &[u8], notes: &mut Notes) -> Vec<(u64, Pose3)> {
    let all: Vec<Row<'_>> = rows(bytes).collect();
    let mut found = Vec::new();
    for block in all.chunks(5) {
        let numbers: Option<Vec<Vec<f64>>> = block.iter().map(|row| row.numbers()).collect();
        let pose = numbers.as_deref().and_then(|numbers| match numbers {
            [head, matrix @ ..] if head.len() == 3 && matrix.len() == 4 && matrix.iter().all(|row| row.len() == 4) => {
                let number = (head[0] >= 0.0 && head[0] < 1e9).then_some(head[0] as u64)?;
                Some((number, pose_of_rows(&matrix.concat())?))
            }
            _ => None,
        });
        match pose {
            Some(pose) => found.push(pose),
            None => {
                let words = || ("three numbers and a rigid motion in four rows", block[0].excerpt());
                notes.note(NoteKind::BadRow, file, block[0].offset_bytes, words);
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn stamps_are_exact() {
        assert_eq!(stamp_of_text("1305031453.374112"), Some(Stamp(1_305_031_453_374_112_000)));
        assert_eq!(stamp_of_text("1.036224e-01"), Some(Stamp(103_622_400)));
        assert_eq!(stamp_of_text("7"), Some(Stamp(7_000_000_000)));
        assert_eq!(["", "x", "1e300", "nan", "99999999999"].map(stamp_of_text), [None; 5]);
    }

    #[test]
    fn rows_that_are_no_poses_are_noted() {
        let mut notes = Notes::default();
        let text = b"# c\n1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 0\n3 1 2 nan 0 0 0 1\nx\n4 1 2 3 0 0 0 1\n";
        let Some(PoseRows::Tum(poses)) = pose_rows("p.txt", text, &mut notes) else { panic!("no TUM rows") };
        assert_eq!((poses.len(), notes.count(NoteKind::BadRow)), (2, 3));
        assert_eq!(notes.kinds[&NoteKind::BadRow].first[0].offset_bytes, 20);
        let text = b"1 0 0 5 0 1 0 6 0 0 1 7\n2 0 0 0 0 2 0 0 0 0 2 0\n";
        let Some(PoseRows::Kitti(poses)) = pose_rows("p.txt", text, &mut notes) else { panic!("no KITTI rows") };
        assert_eq!(poses[0].unwrap().translation, Vector3::new(5.0, 6.0, 7.0));
        assert_eq!(poses[1], None);
        let log = b"0 0 1\n1 0 0 2\n0 1 0 3\n0 0 1 4\n0 0 0 1\n1 1 2\n1 0 0 2\n";
        let poses = open3d_log("t.log", log, &mut notes);
        assert_eq!((poses.len(), poses[0].1.translation.z), (1, 4.0));
    }

    proptest! {
        #[test]
        fn any_text(text in "[-0-9. naifex\n#]{0,300}", bytes: Vec<u8>) {
            for bytes in [text.as_bytes(), &bytes] {
                let mut notes = Notes::default();
                let _ = pose_rows("p", bytes, &mut notes);
                let _ = pose_of_matrix("p", bytes);
                let _ = open3d_log("p", bytes, &mut notes);
            }
            let _ = stamp_of_text(&text);
        }

        #[test]
        fn matrices_give_the_motion(t in prop::array::uniform3(-50.0..50.0f64), r in prop::array::uniform3(-1.7..1.7f64)) {
            let pose = Pose3 { translation: t.into(), rotation: UnitQuaternion::from_scaled_axis(Vector3::from(r)) };
            let m = pose.rotation.to_rotation_matrix();
            let rows: Vec<f64> = (0..3).flat_map(|k| [m[(k, 0)], m[(k, 1)], m[(k, 2)], t[k]]).collect();
            let back = pose_of_rows(&rows).unwrap();
            prop_assert!(back.distance(pose) < 1e-9 && back.rotation.angle_to(&pose.rotation) < 1e-7);
        }
    }
}
