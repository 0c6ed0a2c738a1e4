//! Trajectories and relations as text.
//!
//! | format | columns |
//! |---|---|
//! | TUM (Sturm et al. 2012) | stamp x y z qx qy qz qw |
//! | planar | stamp x y theta |
//! | KITTI (Geiger et al. 2012) | the first three rows of the pose's matrix, 12 numbers; stamps elsewhere |
//! | relations (Kümmerle et al. 2009) | stamp1 stamp2 x y z roll pitch yaw |

use crate::error::FormatError;
use crate::number::{FIXED_LIMIT, write_fixed, write_stamp};
use crate::text_rows::{Row, RowReader};
use mapwright_geom::{Pose2, Pose3, Stamp};
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion};
use std::io::{Read, Write};

/// Decimals written: nanometres.
const DECIMALS: usize = 9;

/// Bytes collected before the stream below is called.
const WRITE_BYTES: usize = 1 << 16;

/// A pose in the plane at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampedPose2 {
    /// When.
    pub stamp: Stamp,
    /// Where, in the frame of the trajectory.
    pub world_from_robot: Pose2,
}

/// A pose in space at a time, as TUM files have it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampedPose3 {
    /// When.
    pub stamp: Stamp,
    /// Where, metres.
    pub position_m: [f64; 3],
    /// Orientation as a unit quaternion x y z w.
    pub quaternion_xyzw: [f64; 4],
}

impl StampedPose3 {
    /// The pose in the plane z = 0.
    #[must_use]
    pub fn from_planar(pose: StampedPose2) -> Self {
        let (qz, qw) = mapwright_geom::sin_cos(0.5 * pose.world_from_robot.theta);
        Self {
            stamp: pose.stamp,
            position_m: [pose.world_from_robot.x, pose.world_from_robot.y, 0.0],
            quaternion_xyzw: [0.0, 0.0, qz, qw],
        }
    }

    /// The pose at a time.
    #[must_use]
    pub fn of_pose(stamp: Stamp, pose: Pose3) -> Self {
        let quaternion_xyzw = pose.rotation.coords.into();
        Self { stamp, position_m: pose.translation.into(), quaternion_xyzw }
    }

    /// Seen from above: position without height, and yaw.
    #[must_use]
    pub fn to_planar(&self) -> StampedPose2 {
        let [x, y, z, w] = self.quaternion_xyzw;
        // First column of the rotation matrix; scaling the quaternion scales both components alike.
        let yaw = (2.0 * (w * z + x * y)).atan2(w * w + x * x - y * y - z * z);
        let [px, py, _] = self.position_m;
        StampedPose2 { stamp: self.stamp, world_from_robot: Pose2::new(px, py, yaw) }
    }
}

/// Writes TUM trajectories: stamps exact to the nanosecond, positions and quaternions with nine decimals, rounded
/// correctly.
#[derive(Debug)]
pub struct TumWriter<W> {
    writer: W,
    pending: Vec<u8>,
}

impl<W: Write> TumWriter<W> {
    /// Writes to `writer`, in large pieces; [`finish`](Self::finish) writes the last one.
    pub fn new(writer: W) -> Self {
        Self { writer, pending: Vec::with_capacity(WRITE_BYTES + 256) }
    }

    /// Writes a pose in the plane as one in space.
    ///
    /// # Errors
    ///
    /// As [`write`](Self::write).
    pub fn write_planar(&mut self, stamp: Stamp, world_from_robot: Pose2) -> Result<(), FormatError> {
        check("a pose's heading", world_from_robot.theta)?;
        self.write(&StampedPose3::from_planar(StampedPose2 { stamp, world_from_robot }))
    }

    /// Writes a pose.
    ///
    /// # Errors
    ///
    /// [`FormatError::OutOfRange`] where a number is not finite or beyond 10^15, and nothing of the pose is written;
    /// [`FormatError::Io`].
    pub fn write(&mut self, pose: &StampedPose3) -> Result<(), FormatError> {
        pose.position_m.iter().try_for_each(|&v| check("a pose's position", v))?;
        pose.quaternion_xyzw.iter().try_for_each(|&v| check("a pose's quaternion", v))?;
        write_stamp(&mut self.pending, pose.stamp);
        for &value in pose.position_m.iter().chain(&pose.quaternion_xyzw) {
            self.pending.push(b' ');
            write_fixed(&mut self.pending, value, DECIMALS);
        }
        self.pending.push(b'\n');
        if self.pending.len() >= WRITE_BYTES { self.write_pending() } else { Ok(()) }
    }

    /// Writes what is pending, flushes and hands the stream back.
    ///
    /// # Errors
    ///
    /// [`FormatError::Io`].
    pub fn finish(mut self) -> Result<W, FormatError> {
        self.write_pending()?;
        self.writer.flush()?;
        Ok(self.writer)
    }

    fn write_pending(&mut self) -> Result<(), FormatError> {
        let written = self.writer.write_all(&self.pending);
        self.pending.clear();
        Ok(written?)
    }
}

fn check(what: &'static str, value: f64) -> Result<(), FormatError> {
    let limit = FIXED_LIMIT;
    if value.abs() <= limit { Ok(()) } else { Err(FormatError::OutOfRange { what, value, limit }) }
}

/// Reads trajectories row by row, TUM and planar rows alike.
///
/// ```
/// use mapwright_formats::TrajectoryReader;
/// let text = "# stamp x y theta\n12.5 1 2 0.5\n12.75 1 2 0 0 0 0 1\n";
/// let mut reader = TrajectoryReader::new(text.as_bytes());
/// let first = reader.next_planar()?.ok_or("no pose")?;
/// assert_eq!((first.stamp.0, first.world_from_robot.theta), (12_500_000_000, 0.5));
/// assert_eq!(reader.next_pose()?.ok_or("no second pose")?.position_m, [1.0, 2.0, 0.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct TrajectoryReader<R> {
    rows: RowReader<R>,
}

impl<R: Read> TrajectoryReader<R> {
    /// Reads from `reader`, which needs no buffering.
    pub fn new(reader: R) -> Self {
        Self { rows: RowReader::new(reader) }
    }

    /// The next pose in the plane: a TUM row seen from above, or a planar row as it is.
    ///
    /// # Errors
    ///
    /// [`FormatError::Line`] for a row that is neither, [`FormatError::Torn`] at the end of a torn compressed stream,
    /// [`FormatError::Io`].
    pub fn next_planar(&mut self) -> Result<Option<StampedPose2>, FormatError> {
        match self.next_row()? {
            Some(row) if row.width == 4 => planar(&row).map(Some),
            Some(row) => spatial(&row).map(|pose| Some(pose.to_planar())),
            None => Ok(None),
        }
    }

    /// The next pose in space; a planar row lies in z = 0.
    ///
    /// # Errors
    ///
    /// As [`next_planar`](Self::next_planar).
    pub fn next_pose(&mut self) -> Result<Option<StampedPose3>, FormatError> {
        match self.next_row()? {
            Some(row) if row.width == 4 => planar(&row).map(|pose| Some(StampedPose3::from_planar(pose))),
            Some(row) => spatial(&row).map(Some),
            None => Ok(None),
        }
    }

    fn next_row(&mut self) -> Result<Option<Row<'_>>, FormatError> {
        self.rows.next_row(&[8, 4], "stamp x y z qx qy qz qw, or stamp x y theta")
    }
}

fn planar(row: &Row<'_>) -> Result<StampedPose2, FormatError> {
    let [x, y, theta] = row.numbers(1)?;
    Ok(StampedPose2 { stamp: row.stamp(0)?, world_from_robot: Pose2::new(x, y, theta) })
}

fn spatial(row: &Row<'_>) -> Result<StampedPose3, FormatError> {
    let quaternion_xyzw: [f64; 4] = row.numbers(4)?;
    let norm = quaternion_xyzw.iter().map(|v| v * v).sum::<f64>().sqrt();
    if !(0.9..1.1).contains(&norm) {
        return Err(row.bad(4, &format!("a unit quaternion (its norm is {norm:.3})")));
    }
    Ok(StampedPose3 { stamp: row.stamp(0)?, position_m: row.numbers(1)?, quaternion_xyzw })
}

/// Reads a whole trajectory in the plane.
///
/// # Errors
///
/// As [`TrajectoryReader::next_planar`].
pub fn read_trajectory(reader: impl Read) -> Result<Vec<StampedPose2>, FormatError> {
    let mut reader = TrajectoryReader::new(reader);
    let mut poses = Vec::new();
    while let Some(pose) = reader.next_planar()? {
        poses.push(pose);
    }
    Ok(poses)
}

/// A trajectory in space, read whole.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SpaceTrajectory {
    /// Stamps and `world_from_robot`, in the file's order.
    pub poses: Vec<(Stamp, Pose3)>,
    /// Whether the file has no stamps, as KITTI's have none: the poses bear their numbers as seconds, from 0.
    pub is_numbered: bool,
}

impl SpaceTrajectory {
    /// Whether it lies in the plane z = 0 and only yaw turns.
    #[must_use]
    pub fn is_planar(&self) -> bool {
        let is_flat = |pose: &Pose3| pose.translation.z == 0.0 && pose.rotation.i == 0.0 && pose.rotation.j == 0.0;
        self.poses.iter().all(|(_, pose)| is_flat(pose))
    }
}

/// Reads a whole trajectory in space: TUM, planar or KITTI rows.
///
/// # Errors
///
/// [`FormatError::Line`] for a row that is none of these, or is no motion; [`FormatError::Torn`], [`FormatError::Io`].
pub fn read_space_trajectory(reader: impl Read) -> Result<SpaceTrajectory, FormatError> {
    let mut rows = RowReader::new(reader);
    let mut read = SpaceTrajectory::default();
    let expected = "stamp x y z qx qy qz qw, stamp x y theta, or the 12 numbers of a KITTI pose";
    while let Some(row) = rows.next_row(&[8, 4, 12], expected)? {
        let pose = match row.width {
            12 => {
                read.is_numbered = true;
                (Stamp((read.poses.len() as i64).saturating_mul(1_000_000_000)), of_matrix(&row)?)
            }
            4 => of_stamped(&StampedPose3::from_planar(planar(&row)?)),
            _ => of_stamped(&spatial(&row)?),
        };
        read.poses.push(pose);
    }
    Ok(read)
}

fn of_stamped(pose: &StampedPose3) -> (Stamp, Pose3) {
    let rotation = UnitQuaternion::from_quaternion(Quaternion::from(pose.quaternion_xyzw));
    (pose.stamp, Pose3 { translation: pose.position_m.into(), rotation })
}

/// Rows and columns of a rotation may be so far from orthonormal; what is written with six digits stays well below.
const ORTHONORMAL_TOLERANCE: f64 = 0.01;

fn of_matrix(row: &Row<'_>) -> Result<Pose3, FormatError> {
    let numbers: [f64; 12] = row.numbers(0)?;
    let rotation = Matrix3::from_fn(|i, j| numbers[4 * i + j]);
    let error = (rotation * rotation.transpose() - Matrix3::identity()).amax();
    if error > ORTHONORMAL_TOLERANCE || rotation.determinant() < 0.0 {
        return Err(row.bad(0, &format!("three rows of a rotation and a place (off by {error:.3}), from")));
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Ok(Pose3 { translation: [numbers[3], numbers[7], numbers[11]].into(), rotation })
}

/// Reads stamps, one a row, as KITTI's `times.txt` has them.
///
/// # Errors
///
/// [`FormatError::Line`] for a row that is none, [`FormatError::Torn`], [`FormatError::Io`].
pub fn read_stamps(reader: impl Read) -> Result<Vec<Stamp>, FormatError> {
    let mut rows = RowReader::new(reader);
    let mut stamps = Vec::new();
    while let Some(row) = rows.next_row(&[1], "a stamp in seconds")? {
        stamps.push(row.stamp(0)?);
    }
    Ok(stamps)
}

/// Where the robot was at one stamp, seen from where it was at another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relation {
    /// The time of frame `a`.
    pub stamp_a: Stamp,
    /// The time of frame `b`.
    pub stamp_b: Stamp,
    /// Position of `b` in `a`, metres.
    pub position_m: [f64; 3],
    /// Roll, pitch and yaw of `b` in `a`, radians.
    pub roll_pitch_yaw_rad: [f64; 3],
}

impl Relation {
    /// The relation in the plane.
    #[must_use]
    pub fn a_from_b(&self) -> Pose2 {
        Pose2::new(self.position_m[0], self.position_m[1], self.roll_pitch_yaw_rad[2])
    }
}

/// Reads a file of relations (Kümmerle et al. 2009): `t1 t2 x y z roll pitch yaw`, the pose at t2 seen from t1.
///
/// # Errors
///
/// [`FormatError::Line`] for a row that is none, [`FormatError::Torn`], [`FormatError::Io`].
pub fn read_relations(reader: impl Read) -> Result<Vec<Relation>, FormatError> {
    let mut rows = RowReader::new(reader);
    let mut relations = Vec::new();
    while let Some(row) = rows.next_row(&[8], "t1 t2 x y z roll pitch yaw")? {
        relations.push(Relation {
            stamp_a: row.stamp(0)?,
            stamp_b: row.stamp(1)?,
            position_m: row.numbers(2)?,
            roll_pitch_yaw_rad: row.numbers(5)?,
        });
    }
    Ok(relations)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn fails(text: &str) -> String {
        read_trajectory(text.as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn errors_name_the_line_what_was_expected_and_what_was_found() {
        let columns = "stamp x y z qx qy qz qw, or stamp x y theta";
        assert_eq!(fails("1 2 3 4\n\n1 2 3\n"), format!("line 3: expected {columns}, found 3 columns: `1 2 3`"));
        assert_eq!(fails("1 2 x 4"), "line 1: expected a finite number in column 3, found `x`");
        assert_eq!(fails("# c\r\n1 2 nan 4\r\n"), "line 2: expected a finite number in column 3, found `nan`");
        assert_eq!(fails("soon 2 3 4"), "line 1: expected a stamp in seconds in column 1, found `soon`");
        assert!(fails("1 0 0 0 0 0 0 0").contains("its norm is 0.000"));
        assert!(fails(&"9 ".repeat(500_000)).contains("500000 columns"));
    }

    #[test]
    fn relations_are_read_in_their_order() {
        let text = "1216.630413 1217.490267 0.407950 -0.016330 0.000000 0.000000 0.000000 -0.069620\n";
        let relations = read_relations(text.as_bytes()).unwrap();
        assert_eq!(relations[0].stamp_b, Stamp(1_217_490_267_000));
        assert_eq!(relations[0].a_from_b(), Pose2::new(0.40795, -0.01633, -0.06962));
        assert!(read_relations(&b"1 2 3\n"[..]).is_err());
    }

    #[test]
    fn trajectories_in_space_are_read_from_either_kind_of_row() {
        let read = |text: &str| read_space_trajectory(text.as_bytes());
        let tum = read("1.5 1 2 3 0 0 0.6 0.8\n2 1 2 0.5\n").unwrap();
        assert!(!tum.is_numbered && !tum.is_planar() && tum.poses[0].0 == Stamp(1_500_000_000));
        let kitti = read("0 -1 0 4  1 0 0 5  0 0 1 6\n1 0 0 0 0 1 0 0 0 0 1 0\n").unwrap();
        assert!(kitti.is_numbered && kitti.poses[1].0 == Stamp(1_000_000_000));
        assert!((kitti.poses[0].1.rotation * nalgebra::Vector3::x() - nalgebra::Vector3::y()).norm() < 1e-12);
        assert!(read("0 1 2 0.5\n1 1 2 0 0 0 1 0\n").unwrap().is_planar());
        let mirrored = read("1 0 0 4  0 1 0 5  0 0 -1 6").unwrap_err().to_string();
        assert!(mirrored.starts_with("line 1: expected three rows of a rotation and a place"), "{mirrored}");
        assert!(read("1 2 3").unwrap_err().to_string().contains("12 numbers"));
        assert_eq!(read_stamps(&b"0.5\n# x\n0.75\n"[..]).unwrap(), [Stamp(500_000_000), Stamp(750_000_000)]);
    }

    #[test]
    fn what_is_not_finite_is_refused_and_leaves_no_trace() {
        let mut writer = TumWriter::new(Vec::new());
        for bad in [f64::NAN, f64::INFINITY, -1e300] {
            for pose in [Pose2 { x: bad, y: 0.0, theta: 0.0 }, Pose2 { x: 0.0, y: 0.0, theta: bad }] {
                assert!(matches!(writer.write_planar(Stamp(0), pose), Err(FormatError::OutOfRange { .. })));
            }
        }
        writer.write_planar(Stamp(-1), Pose2::new(-0.5, 0.0, 0.0)).unwrap();
        let text = String::from_utf8(writer.finish().unwrap()).unwrap();
        assert!(text.starts_with("-0.000000001 -0.500000000 0.000000000 "));
    }

    proptest! {
        #[test]
        fn trajectories_read_back(poses in prop::collection::vec((any::<i64>(), -1e5..1e5_f64, -1e5..1e5_f64, -3.1..3.1_f64), 0..50)) {
            let mut writer = TumWriter::new(Vec::new());
            for &(stamp, x, y, theta) in &poses {
                writer.write_planar(Stamp(stamp), Pose2::new(x, y, theta)).unwrap();
            }
            let read = read_trajectory(writer.finish().unwrap().as_slice()).unwrap();
            prop_assert_eq!(read.len(), poses.len());
            for (found, &(stamp, x, y, theta)) in read.iter().zip(&poses) {
                prop_assert_eq!(found.stamp, Stamp(stamp));
                let expected = Pose2::new(x, y, theta);
                prop_assert!(found.world_from_robot.distance(expected) < 1e-9);
                prop_assert!((found.world_from_robot.theta - theta).abs() < 3e-9);
            }
        }

        #[test]
        fn garbage_is_an_error_and_no_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = read_trajectory(bytes.as_slice());
            let _ = read_space_trajectory(bytes.as_slice());
            let _ = read_relations(bytes.as_slice());
        }
    }
}
