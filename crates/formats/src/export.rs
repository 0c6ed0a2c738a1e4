//! Trajectories for other tools: KITTI and CSV. Both are written only.

use crate::error::FormatError;
use crate::number::{FIXED_LIMIT, write_fixed, write_stamp};
use mapwright_geom::{Pose2, Pose3, Stamp, sin_cos};
use std::io::Write;

/// Decimals of metres, radians, quaternions and rotation matrices: nanometres.
const DECIMALS: usize = 9;
/// Bytes collected before the stream below is called.
const WRITE_BYTES: usize = 1 << 16;

/// A row of a trajectory as CSV, in the plane or in space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CsvPose<P = Pose2> {
    /// When.
    pub stamp: Stamp,
    /// Pose of the robot in the map.
    pub map_from_robot: P,
    /// Pose of the robot by odometry alone.
    pub odom_from_robot: P,
}

/// Writes a trajectory as KITTI's odometry benchmark has them (Geiger et al. 2012): a pose a line, no stamps, twelve
/// numbers, the upper three rows of `world_from_robot` row after row. Axes are the robot's: x forward, z up.
///
/// # Errors
///
/// [`FormatError::OutOfRange`] where a number is not finite or beyond 10^15; [`FormatError::Io`].
pub fn write_kitti(world_from_robot: impl IntoIterator<Item = Pose2>, writer: impl Write) -> Result<(), FormatError> {
    let mut lines = Lines { writer, pending: Vec::with_capacity(WRITE_BYTES + 512) };
    for pose in world_from_robot {
        check(&[pose.x, pose.y, pose.theta])?;
        let (s, c) = sin_cos(pose.theta);
        lines.numbers(&[c, 0.0 - s, 0.0, pose.x, s, c, 0.0, pose.y]);
        lines.pending.extend_from_slice(b"0 0 1 0");
        lines.end()?;
    }
    lines.finish()
}

/// Writes stamps as KITTI's `times.txt` has them, one a line, seconds.
///
/// # Errors
///
/// [`FormatError::Io`].
pub fn write_stamps(stamps: impl IntoIterator<Item = Stamp>, writer: impl Write) -> Result<(), FormatError> {
    let mut lines = Lines { writer, pending: Vec::with_capacity(WRITE_BYTES + 512) };
    for stamp in stamps {
        write_stamp(&mut lines.pending, stamp);
        lines.end()?;
    }
    lines.finish()
}

/// Writes a trajectory as CSV with a line of names: `stamp_s,x_m,y_m,theta_rad,odom_x_m,odom_y_m,odom_theta_rad`.
///
/// # Errors
///
/// As [`write_kitti`].
pub fn write_csv(poses: impl IntoIterator<Item = CsvPose>, writer: impl Write) -> Result<(), FormatError> {
    let mut lines = Lines { writer, pending: Vec::with_capacity(WRITE_BYTES + 512) };
    lines.pending.extend_from_slice(b"stamp_s,x_m,y_m,theta_rad,odom_x_m,odom_y_m,odom_theta_rad");
    lines.end()?;
    for pose in poses {
        write_stamp(&mut lines.pending, pose.stamp);
        for part in [pose.map_from_robot, pose.odom_from_robot] {
            let columns = [part.x, part.y, part.theta];
            check(&columns)?;
            lines.columns(&columns);
        }
        lines.end()?;
    }
    lines.finish()
}

/// Writes a trajectory in space as [`write_kitti`] does one of the plane.
///
/// # Errors
///
/// As [`write_kitti`].
pub fn write_space_kitti(
    world_from_robot: impl IntoIterator<Item = Pose3>,
    writer: impl Write,
) -> Result<(), FormatError> {
    let mut lines = Lines { writer, pending: Vec::with_capacity(WRITE_BYTES + 512) };
    for pose in world_from_robot {
        check(&numbers_of(pose))?;
        let rotation = pose.rotation.to_rotation_matrix();
        for row in 0..3 {
            let [x, y, z] = [0, 1, 2].map(|column| rotation[(row, column)]);
            lines.numbers(&[x, y, z, pose.translation[row]]);
        }
        lines.pending.pop(); // the blank after the last number
        lines.end()?;
    }
    lines.finish()
}

/// Writes a trajectory in space as CSV with a line of names:
/// `stamp_s,x_m,y_m,z_m,qx,qy,qz,qw,odom_x_m,odom_y_m,odom_z_m,odom_qx,odom_qy,odom_qz,odom_qw`. The first eight are a row of TUM's.
///
/// # Errors
///
/// As [`write_kitti`].
pub fn write_space_csv(poses: impl IntoIterator<Item = CsvPose<Pose3>>, writer: impl Write) -> Result<(), FormatError> {
    let mut lines = Lines { writer, pending: Vec::with_capacity(WRITE_BYTES + 512) };
    lines.pending.extend_from_slice(b"stamp_s,x_m,y_m,z_m,qx,qy,qz,qw,");
    lines.pending.extend_from_slice(b"odom_x_m,odom_y_m,odom_z_m,odom_qx,odom_qy,odom_qz,odom_qw");
    lines.end()?;
    for pose in poses {
        write_stamp(&mut lines.pending, pose.stamp);
        for part in [pose.map_from_robot, pose.odom_from_robot] {
            let columns = numbers_of(part);
            check(&columns)?;
            lines.columns(&columns);
        }
        lines.end()?;
    }
    lines.finish()
}

/// x y z qx qy qz qw.
fn numbers_of(pose: Pose3) -> [f64; 7] {
    let (at, q) = (pose.translation, pose.rotation);
    [at.x, at.y, at.z, q.i, q.j, q.k, q.w]
}

struct Lines<W> {
    writer: W,
    pending: Vec<u8>,
}

impl<W: Write> Lines<W> {
    /// Each followed by a blank.
    fn numbers(&mut self, values: &[f64]) {
        for &value in values {
            write_fixed(&mut self.pending, value, DECIMALS);
            self.pending.push(b' ');
        }
    }

    /// Each after a comma.
    fn columns(&mut self, values: &[f64]) {
        for &value in values {
            self.pending.push(b',');
            write_fixed(&mut self.pending, value, DECIMALS);
        }
    }

    fn end(&mut self) -> Result<(), FormatError> {
        self.pending.push(b'\n');
        if self.pending.len() >= WRITE_BYTES {
            self.writer.write_all(&self.pending)?;
            self.pending.clear();
        }
        Ok(())
    }

    fn finish(mut self) -> Result<(), FormatError> {
        self.writer.write_all(&self.pending)?;
        Ok(self.writer.flush()?)
    }
}

fn check(numbers: &[f64]) -> Result<(), FormatError> {
    let (what, limit) = ("a number of a pose", FIXED_LIMIT);
    match numbers.iter().find(|value| value.is_nan() || value.abs() > limit) {
        Some(&value) => Err(FormatError::OutOfRange { what, value, limit }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trajectory::read_space_trajectory;
    use nalgebra::UnitQuaternion;

    #[test]
    fn kitti_has_twelve_numbers_row_after_row() {
        let mut out = Vec::new();
        write_kitti([Pose2::new(1.0, -2.5, std::f64::consts::FRAC_PI_2)], &mut out).unwrap();
        let text = String::from_utf8(out).unwrap();
        let numbers: Vec<f64> = text.split_whitespace().map(|word| word.parse().unwrap()).collect();
        assert_eq!(numbers, [0.0, -1.0, 0.0, 1.0, 1.0, 0.0, 0.0, -2.5, 0.0, 0.0, 1.0, 0.0]);
        assert!(write_kitti([Pose2 { x: f64::NAN, ..Pose2::IDENTITY }], Vec::new()).is_err());
    }

    #[test]
    fn csv_names_its_columns() {
        let pose = CsvPose {
            stamp: Stamp(1_500_000_000),
            map_from_robot: Pose2::new(1.0, 2.0, 0.5),
            odom_from_robot: Pose2::IDENTITY,
        };
        let mut out = Vec::new();
        write_csv([pose], &mut out).unwrap();
        let text = String::from_utf8(out).unwrap();
        let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
        assert_eq!(rows[0][..4], ["stamp_s", "x_m", "y_m", "theta_rad"]);
        let numbers: Vec<f64> = rows[1].iter().map(|word| word.parse().unwrap()).collect();
        assert_eq!(numbers, [1.5, 1.0, 2.0, 0.5, 0.0, 0.0, 0.0]);
    }
    #[test]
    fn poses_in_space_are_read_back_from_either_format() {
        let turned = UnitQuaternion::from_euler_angles(0.3, -1.1, 2.5);
        let pose = Pose3 { translation: [1.25, -2.5, 1000.125].into(), rotation: turned };
        let row = CsvPose { stamp: Stamp(-1), map_from_robot: pose, odom_from_robot: Pose3::identity() };
        let (mut kitti, mut csv) = (Vec::new(), Vec::new());
        write_space_kitti([pose, pose], &mut kitti).unwrap();
        write_space_csv([row], &mut csv).unwrap();
        assert!(kitti.split(|&b| b == b'\n').take(2).all(|line| line.split(|&b| b == b' ').count() == 12));
        let csv = String::from_utf8(csv).unwrap();
        let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
        assert_eq!((rows[0].len(), rows[0][3], rows[1].len()), (15, "z_m", 15));
        assert_eq!(rows[1][8..].iter().map(|word| word.parse::<f64>().unwrap()).sum::<f64>(), 1.0);
        for text in [String::from_utf8(kitti).unwrap(), rows[1][..8].join(" ")] {
            let read = read_space_trajectory(text.as_bytes()).unwrap();
            let off = pose.between(read.poses[0].1).log();
            assert!(off.amax() < 5e-9, "{off}");
        }
        for bad in [f64::NAN, f64::NEG_INFINITY, 2e15] {
            let pose = Pose3 { translation: [0.0, 0.0, bad].into(), ..Pose3::identity() };
            assert!(write_space_kitti([pose], Vec::new()).is_err());
            assert!(write_space_csv([CsvPose { odom_from_robot: pose, ..row }], Vec::new()).is_err());
        }
    }
}
