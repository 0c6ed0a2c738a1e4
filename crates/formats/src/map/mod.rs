//! Occupancy maps: for Nav2's `map_server`, and to look at.

mod canvas;
mod confidence;
mod description;
mod font;
mod footer;
mod frame;
mod options;
mod palette;
mod picture;
mod plain;
mod plot;
mod raster;
mod read;
mod runs;
mod space;
mod view;
mod walls;

pub use confidence::Confidence;
pub use description::{MapDescription, MapMode, read_map_yaml};
pub use frame::{Frame, ViewPlacement};
pub use options::Picture;
pub use picture::{PlanePlacement, write_bare_png, write_png, write_rgb_png};
pub use plain::{write_plain_png, write_tinted_png, write_world_file};
pub use plot::{Curve, RobotWay, write_curve_png, write_ways_png};
pub use read::{MAX_MAP_CELLS, read_map_image};
pub use runs::{RUN_COLOURS, RunWay, Runs, run_colour};
pub use space::{
    SpacePicture, SpacePlacement, SpaceView, height_colour, upward, write_bare_space_png, write_space_png,
};
pub use walls::{dominant_wall_angle, wall_direction};

use crate::error::FormatError;
use mapwright_geom::Pose2;
use std::io::Write;

/// The cell value for what has never been seen.
pub const UNKNOWN: u8 = 255;

/// From this probability on a cell is occupied, percent.
const OCCUPIED_FROM: u8 = 65;

/// Up to this probability a cell is free, percent.
const FREE_UP_TO: u8 = 19;

/// An occupancy grid, ready to be written.
#[derive(Debug, Clone, PartialEq)]
pub struct GridImage {
    /// Cells along x.
    pub width: usize,
    /// Cells along y.
    pub height: usize,
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// Pose of the map's lower left corner.
    pub world_from_map: Pose2,
    /// Probability of being occupied in percent (0 to 100), or [`UNKNOWN`]; row by row, that of the smallest y first.
    pub cells: Vec<u8>,
}

impl GridImage {
    /// Checks that the cells are as many as the sides say and that the geometry can be written.
    ///
    /// # Errors
    ///
    /// [`FormatError::CellCount`], [`FormatError::MapGeometry`].
    pub fn validate(&self) -> Result<(), FormatError> {
        let Self { width, height, .. } = *self;
        let (expected, found) = (width as u128 * height as u128, self.cells.len());
        if expected != found as u128 || found == 0 {
            return Err(FormatError::CellCount { width, height, expected: expected.max(1), found });
        }
        geometry("resolution", self.resolution_m, 1e-6..=1e6, "metres from 10^-6 to 10^6")?;
        geometry("origin x", self.world_from_map.x, -1e9..=1e9, "metres within 10^9")?;
        geometry("origin y", self.world_from_map.y, -1e9..=1e9, "metres within 10^9")?;
        geometry("origin yaw", self.world_from_map.theta, -7.0..=7.0, "radians within a turn")
    }

    /// The centres of the occupied cells in the map's own frame, metres.
    #[must_use]
    pub fn wall_points_map(&self) -> Vec<[f64; 2]> {
        let occupied = |&(_, &cell): &(usize, &u8)| (OCCUPIED_FROM..=100).contains(&cell);
        let centre = |at: usize| (at as f64 + 0.5) * self.resolution_m;
        let width = self.width.max(1);
        let point = |(at, _)| [centre(at % width), centre(at / width)];
        self.cells.iter().enumerate().filter(occupied).map(point).collect()
    }
}

fn geometry(
    what: &'static str,
    value: f64,
    range: std::ops::RangeInclusive<f64>,
    expected: &'static str,
) -> Result<(), FormatError> {
    if range.contains(&value) { Ok(()) } else { Err(FormatError::MapGeometry { what, value, expected }) }
}

/// Writes the map as binary PGM in the convention of Nav2's `map_server`: 0 occupied, 254 free, 205 unknown, the row of
/// the largest y on top. Occupied is from 65 percent on, free up to 19, so that the file means what its YAML says.
///
/// # Errors
///
/// As [`GridImage::validate`]; [`FormatError::Io`].
pub fn write_pgm(map: &GridImage, mut writer: impl Write) -> Result<(), FormatError> {
    map.validate()?;
    let shade = shades();
    write!(writer, "P5\n{} {}\n255\n", map.width, map.height)?;
    let mut pixels = Vec::with_capacity(map.width);
    for row in map.cells.chunks_exact(map.width).rev() {
        pixels.clear();
        pixels.extend(row.iter().map(|&cell| shade[usize::from(cell)]));
        writer.write_all(&pixels)?;
    }
    Ok(writer.flush()?)
}

/// The pixel of each cell.
fn shades() -> [u8; 256] {
    std::array::from_fn(|cell| match cell as u8 {
        0..=FREE_UP_TO => 254,
        OCCUPIED_FROM..=100 => 0,
        _ => 205,
    })
}

/// Writes the YAML that goes with [`write_pgm`]'s image, which lies beside it under `image_name`.
///
/// Nav2 reads a pixel `p` as occupied where `1 - p / 255 > occupied_thresh` and as free where it is `< free_thresh`;
/// 205 gives 0.19608, which the free threshold of 0.196 leaves unknown.
///
/// # Errors
///
/// As [`GridImage::validate`]; [`FormatError::Io`].
pub fn write_map_yaml(map: &GridImage, image_name: &str, mut writer: impl Write) -> Result<(), FormatError> {
    map.validate()?;
    let Pose2 { x, y, theta } = map.world_from_map;
    writeln!(writer, "image: {}", yaml_text(image_name))?;
    writeln!(writer, "mode: trinary")?;
    writeln!(writer, "resolution: {:?}", map.resolution_m)?;
    writeln!(writer, "origin: [{x:?}, {y:?}, {theta:?}]")?;
    writeln!(writer, "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196")?;
    Ok(writer.flush()?)
}

/// A name as a YAML scalar: as it is where nothing in it has a meaning of its own, and otherwise quoted.
fn yaml_text(name: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "._/-".contains(c);
    let starts_plainly = name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '/');
    if starts_plainly && name.chars().all(plain) {
        return name.to_owned();
    }
    let mut quoted = String::from("\"");
    for c in name.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            c if c.is_control() => quoted.push_str(&format!("\\u{:04x}", u32::from(c))),
            c => quoted.push(c),
        }
    }
    quoted + "\""
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map() -> GridImage {
        let cells = vec![0, 50, 100, UNKNOWN, 19, 65];
        GridImage { width: 3, height: 2, resolution_m: 0.05, world_from_map: Pose2::new(-1.5, 2.0, 0.0), cells }
    }

    #[test]
    fn the_image_has_the_largest_y_on_top() {
        let mut out = Vec::new();
        write_pgm(&map(), &mut out).unwrap();
        assert_eq!(out, [b"P5\n3 2\n255\n".as_slice(), &[205, 254, 0, 254, 205, 0]].concat());
    }

    /// What Nav2's `map_io.cpp` makes of a pixel in trinary mode.
    fn nav2(pixel: u8) -> i8 {
        let occupied = 1.0 - f64::from(pixel) / 255.0;
        if 0.65 < occupied {
            100
        } else if occupied < 0.196 {
            0
        } else {
            -1
        }
    }

    #[test]
    fn nav2_reads_the_pixels_as_they_are_meant() {
        assert_eq!([0, 254, 205].map(nav2), [100, 0, -1]);
    }

    #[test]
    fn the_yaml_says_where_the_map_lies() {
        let mut out = Vec::new();
        write_map_yaml(&map(), "map.pgm", &mut out).unwrap();
        let expected = "image: map.pgm\nmode: trinary\nresolution: 0.05\norigin: [-1.5, 2.0, 0.0]\nnegate: 0\n\
                        occupied_thresh: 0.65\nfree_thresh: 0.196\n";
        assert_eq!(String::from_utf8(out).unwrap(), expected);
        assert_eq!(yaml_text("my map: \"a\"\n"), "\"my map: \\\"a\\\"\\u000a\"");
    }

    #[test]
    fn impossible_maps_are_refused() {
        let short = GridImage { cells: vec![0; 5], ..map() };
        let message = short.validate().unwrap_err().to_string();
        assert_eq!(message, "a map of 3 x 2 cells needs 6 of them, found 5");
        assert!(GridImage { width: 0, cells: vec![], ..map() }.validate().is_err());
        for resolution_m in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(write_pgm(&GridImage { resolution_m, ..map() }, Vec::new()).is_err());
        }
    }
}
