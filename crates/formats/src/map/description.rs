//! What a map's YAML says of its image, in the convention of ROS's `map_server`, of ROS 1 and of ROS 2.

use super::geometry;
use crate::error::FormatError;
use mapwright_geom::Pose2;
use serde::Deserialize;
use std::io::Read;

/// No map's YAML is longer, bytes.
const MAX_BYTES: u64 = 1 << 16;
/// What `map_server` takes where a file does not say.
const OCCUPIED_THRESH: f64 = 0.65;
const FREE_THRESH: f64 = 0.196;

/// How pixels tell what a cell is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MapMode {
    /// Occupied, free or unknown, by the thresholds.
    #[default]
    Trinary,
    /// The same, with degrees between the thresholds; what is transparent is unknown.
    Scale,
    /// The pixel itself is the probability in percent; above 100 it is unknown.
    Raw,
}

/// A map's YAML.
#[derive(Debug, Clone, PartialEq)]
pub struct MapDescription {
    /// Name of the image, as seen from where the YAML lies.
    pub image: String,
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// Pose of the map's lower left corner.
    pub world_from_map: Pose2,
    /// Whether white is occupied.
    pub negate: bool,
    /// Above this share of black a cell is occupied.
    pub occupied_thresh: f64,
    /// Below this share of black a cell is free.
    pub free_thresh: f64,
    /// How pixels are read.
    pub mode: MapMode,
}

#[derive(Debug, Deserialize)]
struct File {
    image: Option<String>,
    resolution: Option<f64>,
    origin: Option<Vec<f64>>,
    negate: Option<Flag>,
    occupied_thresh: Option<f64>,
    free_thresh: Option<f64>,
    mode: Option<String>,
}

/// `negate` is 0 or 1 in most files, and a word in some.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Flag {
    Word(bool),
    Number(i64),
}

/// Reads a map's YAML. What else stands in it is left alone.
///
/// # Errors
///
/// [`FormatError::MapFile`] where it is no map's YAML or lacks image, resolution or origin, [`FormatError::MapGeometry`] where one of its
/// numbers is no use, [`FormatError::Io`].
pub fn read_map_yaml(reader: impl Read) -> Result<MapDescription, FormatError> {
    let mut bytes = Vec::new();
    reader.take(MAX_BYTES + 1).read_to_end(&mut bytes)?;
    let expected = |found: String| FormatError::MapFile {
        place: "map".to_owned(),
        expected: "a map's YAML (image, resolution, origin)".to_owned(),
        found,
    };
    if bytes.len() as u64 > MAX_BYTES {
        return Err(expected(format!("a file of more than {MAX_BYTES} bytes")));
    }
    let text = String::from_utf8(bytes).map_err(|_| expected("bytes that are no text".to_owned()))?;
    let file: File = serde_saphyr::from_str(&text).map_err(|error| {
        let text = error.to_string();
        expected(format!("what is none: {}", text.lines().next().unwrap_or("no YAML")))
    })?;
    description(file)
}

fn missing(what: &str, expected: &str, found: impl ToString) -> FormatError {
    FormatError::MapFile { place: what.to_owned(), expected: expected.to_owned(), found: found.to_string() }
}

fn description(file: File) -> Result<MapDescription, FormatError> {
    let image = file.image.filter(|name| !name.is_empty());
    let image = image.ok_or_else(|| missing("image", "the name of a PGM or PNG file", "none"))?;
    let resolution_m = file.resolution.ok_or_else(|| missing("resolution", "metres a cell", "none"))?;
    geometry("resolution", resolution_m, 1e-6..=1e6, "metres from 10^-6 to 10^6")?;
    let origin = file.origin.ok_or_else(|| missing("origin", "x, y and yaw of the lower left corner", "none"))?;
    let [x, y, yaw] = <[f64; 3]>::try_from(origin)
        .map_err(|found| missing("origin", "three numbers", format_args!("{}", found.len())))?;
    for (what, metres) in [("origin x", x), ("origin y", y)] {
        geometry(what, metres, -1e9..=1e9, "metres within 10^9")?;
    }
    geometry("origin yaw", yaw, -7.0..=7.0, "radians within a turn")?;
    let occupied_thresh = file.occupied_thresh.unwrap_or(OCCUPIED_THRESH);
    let free_thresh = file.free_thresh.unwrap_or(FREE_THRESH);
    geometry("occupied_thresh", occupied_thresh, 0.0..=1.0, "a share from 0 to 1")?;
    geometry("free_thresh", free_thresh, 0.0..=occupied_thresh, "a share from 0 to occupied_thresh")?;
    let mode = match file.mode.as_deref() {
        None | Some("trinary") => MapMode::Trinary,
        Some("scale") => MapMode::Scale,
        Some("raw") => MapMode::Raw,
        Some(found) => return Err(missing("mode", "trinary, scale or raw", format_args!("`{found}`"))),
    };
    let negate = match file.negate {
        None | Some(Flag::Word(false) | Flag::Number(0)) => false,
        Some(Flag::Word(true) | Flag::Number(1)) => true,
        Some(Flag::Number(found)) => return Err(missing("negate", "0 or 1", found)),
    };
    let world_from_map = Pose2::new(x, y, yaw);
    Ok(MapDescription { image, resolution_m, world_from_map, negate, occupied_thresh, free_thresh, mode })
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHOLE: &str = "image: my map.pgm\nmode: trinary\nresolution: 0.05\norigin: [-10, -2.5, 0.5]\nnegate: 0\n\
                         occupied_thresh: 0.65\nfree_thresh: 0.25\n";

    #[test]
    fn what_map_savers_write_is_read() {
        let found = read_map_yaml(WHOLE.as_bytes()).unwrap();
        let expected = MapDescription {
            image: "my map.pgm".to_owned(),
            resolution_m: 0.05,
            world_from_map: Pose2::new(-10.0, -2.5, 0.5),
            negate: false,
            occupied_thresh: 0.65,
            free_thresh: 0.25,
            mode: MapMode::Trinary,
        };
        assert_eq!(found, expected);
        let ros1 = "image: m.png\nresolution: 0.050000\norigin: [-1.0e+1, 2, 0.000000]\nnegate: 1\n\
                    occupied_thresh: 0.65\nfree_thresh: 0.196\n\n";
        let found = read_map_yaml(ros1.as_bytes()).unwrap();
        assert!(found.negate && found.world_from_map == Pose2::new(-10.0, 2.0, 0.0));
        let block = "image: m.pgm\nresolution: 1\norigin:\n- 1\n- 2\n- 0\nnegate: true # white is a wall\nmode: raw\n";
        let found = read_map_yaml(block.as_bytes()).unwrap();
        assert_eq!((found.mode, found.negate, found.occupied_thresh), (MapMode::Raw, true, 0.65));
    }

    #[test]
    fn what_is_wrong_is_named() {
        let with = |from: &str, to: &str| read_map_yaml(WHOLE.replace(from, to).as_bytes()).unwrap_err().to_string();
        assert_eq!(with("0.05\n", "0\n"), "map resolution is 0, expected metres from 10^-6 to 10^6");
        assert_eq!(with("-10", ".nan"), "map origin x is NaN, expected metres within 10^9");
        assert_eq!(with("[-10, -2.5, 0.5]", "[-10, -2.5]"), "origin: expected three numbers, found 2");
        assert_eq!(with("trinary", "colour"), "mode: expected trinary, scale or raw, found `colour`");
        assert_eq!(with("image: my map.pgm\n", ""), "image: expected the name of a PGM or PNG file, found none");
        assert_eq!(with("0.65", "0.1"), "map free_thresh is 0.25, expected a share from 0 to occupied_thresh");
        assert_eq!(with("negate: 0", "negate: 2"), "negate: expected 0 or 1, found 2");
        for text in ["", "FLASER 3 1 2 3", "[1, 2]", "{\"image\": 5", "\u{0}\u{1}"] {
            let said = read_map_yaml(text.as_bytes()).unwrap_err().to_string();
            assert!(said.contains("expected"), "{text:?}: {said}");
        }
        assert!(read_map_yaml([b'a'; 70_000].as_slice()).is_err());
        assert!(read_map_yaml([0xff, 0xfe].as_slice()).is_err());
    }
}
