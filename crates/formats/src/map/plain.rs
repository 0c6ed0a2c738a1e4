//! The map as a plain image with a world file, for programs that know places: QGIS, GDAL.

use super::canvas::{Colour, blend};
use super::palette::{FREE, UNSEEN, WALL};
use super::{FREE_UP_TO, GridImage, OCCUPIED_FROM, shades};
use crate::error::FormatError;
use mapwright_geom::sin_cos;
use std::io::Write;

/// How much of its colour a free cell has, and a wall.
const FREE_TINT: f32 = 0.22;
const WALL_TINT: f32 = 0.85;

/// Writes the map as a grey PNG of one pixel a cell, nothing drawn into it: the pixels of
/// [`write_pgm`](super::write_pgm), 0 occupied, 254 free, 205 unknown, the row of the largest y on top.
///
/// # Errors
///
/// As [`GridImage::validate`]; [`FormatError::Png`], [`FormatError::Io`].
pub fn write_plain_png(map: &GridImage, mut writer: impl Write) -> Result<(), FormatError> {
    map.validate()?;
    let shade = shades();
    let rows = map.cells.chunks_exact(map.width).rev();
    let pixels: Vec<u8> = rows.flatten().map(|&cell| shade[usize::from(cell)]).collect();
    write_pixels(map, png::ColorType::Grayscale, &pixels, &mut writer)?;
    Ok(writer.flush()?)
}

/// Writes the map as a PNG of one pixel a cell, each in the colour that its entry of `tints` names: walls in the colour itself, free cells in
/// a pale one; an entry that is no colour's leaves a cell grey. The row of the largest y is on top.
///
/// # Errors
///
/// As [`GridImage::validate`]; [`FormatError::CellCount`] where the tints are not as many as the cells; [`FormatError::Png`],
/// [`FormatError::Io`].
pub fn write_tinted_png(
    map: &GridImage,
    tints: &[u8],
    colours: &[Colour],
    mut writer: impl Write,
) -> Result<(), FormatError> {
    map.validate()?;
    let (width, height, expected) = (map.width, map.height, map.cells.len() as u128);
    if tints.len() != map.cells.len() {
        return Err(FormatError::CellCount { width, height, expected, found: tints.len() });
    }
    let pixel = |(&cell, &tint): (&u8, &u8)| match (cell, colours.get(usize::from(tint))) {
        (0..=FREE_UP_TO, Some(&colour)) => blend(FREE, colour, FREE_TINT),
        (0..=FREE_UP_TO, None) => FREE,
        (OCCUPIED_FROM..=100, Some(&colour)) => blend(WALL, colour, WALL_TINT),
        (OCCUPIED_FROM..=100, None) => WALL,
        _ => UNSEEN,
    };
    let rows = map.cells.chunks_exact(width).zip(tints.chunks_exact(width)).rev();
    let pixels: Vec<u8> = rows.flat_map(|(cells, tints)| cells.iter().zip(tints).flat_map(pixel)).collect();
    write_pixels(map, png::ColorType::Rgb, &pixels, &mut writer)?;
    Ok(writer.flush()?)
}

fn write_pixels(map: &GridImage, colour: png::ColorType, pixels: &[u8], writer: impl Write) -> Result<(), FormatError> {
    let too_large =
        |_| FormatError::MapGeometry { what: "side", value: map.width as f64, expected: "cells below 2^32" };
    let [width, height] = [u32::try_from(map.width).map_err(too_large)?, u32::try_from(map.height).map_err(too_large)?];
    let mut encoder = png::Encoder::new(writer, width, height);
    encoder.set_color(colour);
    encoder.set_depth(png::BitDepth::Eight);
    let mut png = encoder.write_header()?;
    png.write_image_data(pixels)?;
    Ok(png.finish()?)
}

/// Writes the world file (`.pgw`) of [`write_plain_png`]'s image, six lines: the step in x and y from a pixel to the one
/// on its right, that to the one below, and x and y of the *centre* of the upper left pixel; metres in the map's world.
///
/// # Errors
///
/// As [`GridImage::validate`]; [`FormatError::Io`].
pub fn write_world_file(map: &GridImage, mut writer: impl Write) -> Result<(), FormatError> {
    map.validate()?;
    let (s, c) = sin_cos(map.world_from_map.theta);
    let r = map.resolution_m;
    let [x, y] = map.world_from_map.transform([0.5 * r, (map.height as f64 - 0.5) * r]);
    for value in [r * c, r * s, r * s, -r * c, x, y] {
        writeln!(writer, "{:?}", value + 0.0)?; // no negative zero
    }
    Ok(writer.flush()?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::UNKNOWN;
    use mapwright_geom::Pose2;

    fn map(theta: f64) -> GridImage {
        let cells = vec![0, 50, 100, UNKNOWN, 19, 65];
        GridImage { width: 3, height: 2, resolution_m: 0.5, world_from_map: Pose2::new(-1.5, 2.0, theta), cells }
    }

    #[test]
    fn the_image_has_the_pixels_of_the_pgm() {
        let (mut png, mut pgm) = (Vec::new(), Vec::new());
        write_plain_png(&map(0.0), &mut png).unwrap();
        crate::write_pgm(&map(0.0), &mut pgm).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
        let mut pixels = vec![0; 6];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height), (3, 2));
        assert!(pgm.ends_with(&pixels));
    }

    #[test]
    fn the_world_file_gives_the_centre_of_the_upper_left_pixel() {
        let lines = |map: &GridImage| {
            let mut out = Vec::new();
            write_world_file(map, &mut out).unwrap();
            let text = String::from_utf8(out).unwrap();
            text.lines().map(|line| line.parse().unwrap()).collect::<Vec<f64>>()
        };
        assert_eq!(lines(&map(0.0)), [0.5, 0.0, 0.0, -0.5, -1.25, 2.75]);
        // turned, each pixel's centre is still where the cell's is
        let turned = map(0.7);
        let [a, d, b, e, c, f] = lines(&turned)[..] else { panic!("six lines") };
        for (column, row) in [(0, 0), (2, 0), (1, 1)] {
            let [x, y] = [f64::from(column), f64::from(row)];
            let cell = turned.world_from_map.transform([0.5 * (x + 0.5), 0.5 * (1.5 - y)]);
            assert!((a * x + b * y + c - cell[0]).abs() < 1e-12 && (d * x + e * y + f - cell[1]).abs() < 1e-12);
        }
    }
}
