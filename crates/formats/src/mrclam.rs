//! Logs of the UTIAS Multi-Robot Cooperative Localization and Mapping data sets (Leung, Halpern, Barfoot, Liu 2011): one text
//! file a robot and kind, rows of numbers below lines that begin with `#`.
//!
//! A row that is not what it should be is an error; numbers that are not finite, and stamps earlier than one before them, are counted.

use crate::error::FormatError;
use crate::text_rows::{Row, RowReader};
use mapwright_geom::{Pose2, Stamp};
use std::io::Read;

/// Rows of one file in its order.
#[derive(Debug, Clone, PartialEq)]
pub struct MrclamRows<T> {
    /// The rows with finite numbers.
    pub rows: Vec<T>,
    /// Rows left out for a number that is not finite.
    pub not_finite: usize,
    /// Rows whose stamp is earlier than one before them.
    pub unsorted: usize,
}

/// A row of `Robot*_Odometry.dat`: a velocity that was commanded, and holds until the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MrclamVelocity {
    /// From when on.
    pub stamp: Stamp,
    /// Along the robot's x axis.
    pub forward_m_per_s: f64,
    /// To the left positive.
    pub turn_rad_per_s: f64,
}

/// A row of `Robot*_Measurement.dat`: a barcode was seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MrclamSighting {
    /// When.
    pub stamp: Stamp,
    /// What the barcode says; `Barcodes.dat` says whose it is.
    pub barcode: u32,
    /// Distance from the robot.
    pub range_m: f64,
    /// Direction in the robot's frame, to the left positive.
    pub bearing_rad: f64,
}

/// A row of `Robot*_Groundtruth.dat`: where the motion capture saw the robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MrclamPose {
    /// When.
    pub stamp: Stamp,
    /// Where.
    pub world_from_robot: Pose2,
}

/// Velocities out of `Robot*_Odometry.dat`.
///
/// # Errors
/// The first row that is none.
pub fn read_mrclam_odometry(reader: impl Read) -> Result<MrclamRows<MrclamVelocity>, FormatError> {
    read(reader, &[3], "stamp, forward velocity, angular velocity", |row| {
        let (stamp, [forward_m_per_s, turn_rad_per_s]) = (row.stamp(0)?, row.any_numbers(1)?);
        let is_finite = forward_m_per_s.is_finite() && turn_rad_per_s.is_finite();
        Ok((stamp, is_finite.then_some(MrclamVelocity { stamp, forward_m_per_s, turn_rad_per_s })))
    })
}

/// Sightings out of `Robot*_Measurement.dat`.
///
/// # Errors
/// The first row that is none.
pub fn read_mrclam_measurements(reader: impl Read) -> Result<MrclamRows<MrclamSighting>, FormatError> {
    read(reader, &[4], "stamp, barcode, range, bearing", |row| {
        let (stamp, barcode, [range_m, bearing_rad]) = (row.stamp(0)?, whole(row, 1)?, row.any_numbers(2)?);
        let is_finite = range_m.is_finite() && bearing_rad.is_finite();
        Ok((stamp, is_finite.then_some(MrclamSighting { stamp, barcode, range_m, bearing_rad })))
    })
}

/// Poses out of `Robot*_Groundtruth.dat`.
///
/// # Errors
/// The first row that is none.
pub fn read_mrclam_truth(reader: impl Read) -> Result<MrclamRows<MrclamPose>, FormatError> {
    read(reader, &[4], "stamp, x, y, orientation", |row| {
        let (stamp, [x, y, theta]) = (row.stamp(0)?, row.any_numbers(1)?);
        let is_finite = [x, y, theta].iter().all(|v| v.is_finite());
        Ok((stamp, is_finite.then(|| MrclamPose { stamp, world_from_robot: Pose2::new(x, y, theta) })))
    })
}

/// Subject and barcode, row by row, out of `Barcodes.dat`.
///
/// # Errors
/// The first row that is none.
pub fn read_mrclam_barcodes(reader: impl Read) -> Result<Vec<[u32; 2]>, FormatError> {
    let (mut reader, mut pairs) = (RowReader::new(reader), Vec::new());
    while let Some(row) = reader.next_row(&[2], "subject, barcode")? {
        pairs.push([whole(&row, 0)?, whole(&row, 1)?]);
    }
    Ok(pairs)
}

fn read<T>(
    reader: impl Read,
    widths: &[usize],
    expected: &'static str,
    parse: impl Fn(&Row<'_>) -> Result<(Stamp, Option<T>), FormatError>,
) -> Result<MrclamRows<T>, FormatError> {
    let mut reader = RowReader::new(reader);
    let mut read = MrclamRows { rows: Vec::new(), not_finite: 0, unsorted: 0 };
    let mut latest = Stamp(i64::MIN);
    while let Some(row) = reader.next_row(widths, expected)? {
        let (stamp, value) = parse(&row)?;
        read.unsorted += usize::from(stamp < latest);
        latest = latest.max(stamp);
        match value {
            Some(value) => read.rows.push(value),
            None => read.not_finite += 1,
        }
    }
    Ok(read)
}

/// A whole number that is not negative.
fn whole(row: &Row<'_>, column: usize) -> Result<u32, FormatError> {
    let [number] = row.any_numbers(column)?;
    let is_whole = number.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&number);
    is_whole.then_some(number as u32).ok_or_else(|| row.bad(column, "a whole number"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_read_and_what_is_odd_is_counted() {
        let text =
            "# Time [s]    Subject #\n1248444189.599 \t  14 \t  3.787 \t -0.257\n5 14 nan 0\n1248444190.5 5 1 0.5\n";
        let read = read_mrclam_measurements(text.as_bytes()).unwrap();
        let first = MrclamSighting {
            stamp: Stamp(1_248_444_189_599_000_000),
            barcode: 14,
            range_m: 3.787,
            bearing_rad: -0.257,
        };
        assert_eq!(read.rows[0], first);
        assert_eq!((read.rows.len(), read.not_finite, read.unsorted), (2, 1, 1));
        assert_eq!(read_mrclam_barcodes(&b"# x\n  1 \t   5\n  2 14\n"[..]).unwrap(), [[1, 5], [2, 14]]);
    }

    #[test]
    fn errors_say_the_line_what_was_expected_and_what_was_found() {
        let fails = |text: &str| read_mrclam_odometry(text.as_bytes()).unwrap_err().to_string();
        assert_eq!(
            fails("1 2 3\n1 2\n"),
            "line 2: expected stamp, forward velocity, angular velocity, found 2 columns: `1 2`"
        );
        assert_eq!(fails("1 2 3\n1 x 3\n"), "line 2: expected a number in column 2, found `x`");
        let barcode = read_mrclam_measurements(&b"1 2.5 3 4\n"[..]).unwrap_err().to_string();
        assert_eq!(barcode, "line 1: expected a whole number in column 2, found `2.5`");
    }
}
