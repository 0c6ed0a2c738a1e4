//! Trajectories for other tools: KITTI and CSV. Both are written only.

use crate::error::FormatError;
use crate::number::{FIXED_LIMIT, write_fixed, write_stamp};
use mapwright_geom::{Pose2, Stamp, sin_cos};
use std::io::Write;

/// Decimals of metres and radians: nanometres.
const DECIMALS: usize = 9;
/// Decimals of a rotation matrix: as good as nanometres within a kilometre.
const ROTATION_DECIMALS: usize = 12;
/// Bytes collected before the stream below is called.
const WRITE_BYTES: usize = 1 << 16;

/// A row of a trajectory as CSV.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CsvPose {
    /// When.
    pub stamp: Stamp,
    /// Pose of the robot in the map.
    pub map_from_robot: Pose2,
    /// Pose of the robot by odometry alone.
    pub odom_from_robot: Pose2,
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
        check(pose)?;
        let (s, c) = sin_cos(pose.theta);
        lines.numbers(&[c, 0.0 - s, 0.0], ROTATION_DECIMALS);
        lines.numbers(&[pose.x], DECIMALS);
        lines.numbers(&[s, c, 0.0], ROTATION_DECIMALS);
        lines.numbers(&[pose.y], DECIMALS);
        lines.pending.extend_from_slice(b"0 0 1 0");
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
            check(part)?;
            for value in [part.x, part.y, part.theta] {
                lines.pending.push(b',');
                write_fixed(&mut lines.pending, value, DECIMALS);
            }
        }
        lines.end()?;
    }
    lines.finish()
}

struct Lines<W> {
    writer: W,
    pending: Vec<u8>,
}

impl<W: Write> Lines<W> {
    fn numbers(&mut self, values: &[f64], decimals: usize) {
        for &value in values {
            write_fixed(&mut self.pending, value, decimals);
            self.pending.push(b' ');
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

fn check(pose: Pose2) -> Result<(), FormatError> {
    let (what, limit) = ("a number of a pose", FIXED_LIMIT);
    match [pose.x, pose.y, pose.theta].into_iter().find(|value| value.is_nan() || value.abs() > limit) {
        Some(value) => Err(FormatError::OutOfRange { what, value, limit }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
