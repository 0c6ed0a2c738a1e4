//! Calibrations as data sets write them: functions of a file's text, which open nothing.

mod euroc;
mod kitti;
mod middlebury;

pub use euroc::{EurocCamera, EurocImu};
pub use kitti::{KittiCameras, KittiProjections};
pub use middlebury::MiddleburyPair;

use crate::error::StereoError;
use mapwright_geom::Pose3;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Errors show so much of what was found.
const EXCERPT_CHARS: usize = 60;
/// Entries of a rotation's matrix times its transpose are those of the identity up to so much: files have at least four digits.
const ROTATION_SLACK: f64 = 1e-3;

/// Lines of a key and what follows its separator, with their numbers from 1 on.
fn keyed(text: &str, separator: char) -> impl Iterator<Item = (usize, &str, &str)> {
    text.lines().enumerate().filter_map(move |(line, text)| {
        let (key, value) = text.split_once(separator)?;
        Some((line + 1, key.trim(), value.trim()))
    })
}

/// As many finite numbers as asked for, and nothing else.
fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let mut numbers = [0.0; N];
    let mut words = text.split_whitespace();
    for number in &mut numbers {
        *number = words.next()?.parse().ok().filter(|number: &f64| number.is_finite())?;
    }
    words.next().is_none().then_some(numbers)
}

/// A pose, where its first nine numbers are a rotation row by row.
fn pose(rotation: [f64; 9], translation: [f64; 3]) -> Option<Pose3> {
    let matrix = Matrix3::from_row_slice(&rotation);
    let apart = (matrix * matrix.transpose() - Matrix3::identity()).abs().max();
    if apart.is_nan() || apart > ROTATION_SLACK || matrix.determinant() < 0.0 {
        return None;
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
    Some(Pose3 { translation: Vector3::from(translation), rotation }).filter(|pose| pose.is_finite())
}

/// A side of an image, if a number is one.
fn side(number: f64) -> Option<u32> {
    let fits = number.fract() == 0.0 && (1.0..=f64::from(crate::image::SIDE_MAX)).contains(&number);
    fits.then_some(number as u32)
}

fn wrong(file: &'static str, line: usize, expected: impl Into<String>, found: &str) -> StereoError {
    let first: String = found.chars().take(EXCERPT_CHARS).collect();
    StereoError::File { file, line, expected: expected.into(), found: format!("`{}`", first.escape_debug()) }
}

fn missing(file: &'static str, what: impl std::fmt::Display) -> StereoError {
    StereoError::File { file, line: 0, expected: what.to_string(), found: "no such line".to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Runs every parser, and all that can be asked of what it found.
    fn all(text: &str) {
        if let Ok(found) = KittiProjections::parse(text) {
            let _ = found.pair(0, 1, [10, 10]);
            let _ = found.pair(9, usize::MAX, [10, 10]);
        }
        if let Ok(found) = KittiCameras::parse(text) {
            let _ = (found.raw(0, 1), found.rectified(0, 1), found.raw(7, 8));
        }
        let _ = MiddleburyPair::parse(text);
        if let Ok(found) = EurocCamera::parse(text) {
            let _ = EurocCamera::pair(&found, &found);
        }
    }

    proptest! {
        #[test]
        fn any_text(text: String) {
            all(&text);
        }

        #[test]
        fn any_bytes(bytes: Vec<u8>) {
            all(&String::from_utf8_lossy(&bytes));
        }

        #[test]
        fn damaged_files(which in 0..4_usize, at: prop::sample::Index, with in "[ -~\n]{0,8}", cut in 0..40_usize) {
            let file = [kitti::ODOMETRY, kitti::CAM_TO_CAM, euroc::LEFT, middlebury::PIANO][which];
            let at = at.index(file.len());
            let end = (at + cut).min(file.len());
            if file.is_char_boundary(at) && file.is_char_boundary(end) {
                all(&format!("{}{with}{}", &file[..at], &file[end..]));
            }
        }
    }
}
