//! The image of a finished map: PGM or PNG, as cells.

use super::description::{MapDescription, MapMode};
use super::{GridImage, UNKNOWN};
use crate::error::FormatError;
use std::io::{BufRead, Read, Seek, SeekFrom};

/// Cells a map may have: 500 m x 500 m at 5 cm.
pub const MAX_MAP_CELLS: u64 = 100_000_000;
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";
/// Memory that a picture's rows may take, bytes.
const PNG_BYTES: usize = 1 << 28;

/// Reads the image that a map's YAML names: PGM, plain or binary, of up to 16 bits, or PNG. Cells are 100 where occupied, 0 where free,
/// [`UNKNOWN`] where nothing is known, and between 0 and 100 where the mode has degrees.
///
/// # Errors
///
/// [`FormatError::MapFile`] where it is no such image, is cut off, or has more than [`MAX_MAP_CELLS`] cells; [`FormatError::Io`].
pub fn read_map_image(about: &MapDescription, mut reader: impl BufRead + Seek) -> Result<GridImage, FormatError> {
    let mut head = Vec::new();
    (&mut reader).take(PNG.len() as u64).read_to_end(&mut head)?;
    reader.seek(SeekFrom::Start(0))?;
    let cell_of = CellOf::new(about);
    let (width, height, mut cells) = match head.as_slice() {
        PNG => read_png(reader, &cell_of)?,
        [b'P', b'5' | b'2', ..] => read_pgm(reader, &cell_of)?,
        [] => return Err(unexpected("a PGM or PNG image", "an empty file")),
        other => {
            let found = format!("a file that begins with {}", other.escape_ascii());
            return Err(unexpected("a PGM or PNG image", &found));
        }
    };
    // The largest y is on top.
    for row in 0..height / 2 {
        let (upper, lower) = cells.split_at_mut((height - 1 - row) * width);
        upper[row * width..][..width].swap_with_slice(&mut lower[..width]);
    }
    let map =
        GridImage { width, height, resolution_m: about.resolution_m, world_from_map: about.world_from_map, cells };
    map.validate()?;
    Ok(map)
}

fn unexpected(expected: &str, found: &str) -> FormatError {
    FormatError::MapFile { place: "image".to_owned(), expected: expected.to_owned(), found: found.to_owned() }
}

/// What a pixel says, as `map_server` has it.
struct CellOf<'a> {
    about: &'a MapDescription,
}

impl<'a> CellOf<'a> {
    fn new(about: &'a MapDescription) -> Self {
        Self { about }
    }

    /// Of a pixel's lightness from 0 to 1.
    fn cell(&self, lightness: f64, is_transparent: bool) -> u8 {
        let MapDescription { negate, occupied_thresh, free_thresh, mode, .. } = *self.about;
        let dark = if negate { lightness } else { 1.0 - lightness };
        let raw = 255.0 * (1.0 - dark);
        let share = match mode {
            MapMode::Raw if raw > 100.5 => return UNKNOWN,
            MapMode::Raw => raw / 100.0,
            MapMode::Scale if is_transparent => return UNKNOWN,
            MapMode::Scale | MapMode::Trinary => dark,
        };
        match mode {
            _ if share > occupied_thresh => 100,
            _ if share < free_thresh => 0,
            MapMode::Trinary => UNKNOWN,
            // Neither threshold is reached, so that they are apart.
            MapMode::Scale | MapMode::Raw => {
                (1.0 + 98.0 * (share - free_thresh) / (occupied_thresh - free_thresh).max(1e-9)).clamp(1.0, 99.0) as u8
            }
        }
    }

    fn table(&self, greatest: u32) -> Vec<u8> {
        (0..=greatest).map(|value| self.cell(f64::from(value) / f64::from(greatest), false)).collect()
    }
}

fn sides(width: u64, height: u64) -> Result<(usize, usize), FormatError> {
    let cells = width.saturating_mul(height);
    if cells == 0 || cells > MAX_MAP_CELLS {
        let found = format!("{width} x {height}");
        return Err(unexpected(&format!("from 1 to {MAX_MAP_CELLS} cells"), &found));
    }
    Ok((width as usize, height as usize))
}

fn read_pgm(mut reader: impl BufRead, cell_of: &CellOf<'_>) -> Result<(usize, usize, Vec<u8>), FormatError> {
    let mut magic = [0; 2];
    reader.read_exact(&mut magic)?;
    let [width, height, greatest] = [number(&mut reader)?, number(&mut reader)?, number(&mut reader)?];
    let (width, height) = sides(width, height)?;
    if !(1..=65_535).contains(&greatest) {
        return Err(unexpected("a greatest grey value from 1 to 65535", &greatest.to_string()));
    }
    let table = cell_of.table(greatest as u32);
    let cell = |value: usize| table[value.min(table.len() - 1)];
    let wanted = width * height;
    let cells: Vec<u8> = if magic == *b"P2" {
        let mut cells = Vec::new();
        for _ in 0..wanted {
            cells.push(cell(number(&mut reader)? as usize));
        }
        cells
    } else {
        let wide = if greatest > 255 { 2 } else { 1 };
        let mut bytes = Vec::new();
        reader.take((wanted * wide) as u64).read_to_end(&mut bytes)?;
        if bytes.len() < wanted * wide {
            let expected = format!("{} bytes of pixels for {width} x {height} cells", wanted * wide);
            return Err(unexpected(&expected, &bytes.len().to_string()));
        }
        match wide {
            1 => bytes.iter().map(|&value| cell(usize::from(value))).collect(),
            _ => bytes.chunks_exact(2).map(|pair| cell(usize::from(pair[0]) << 8 | usize::from(pair[1]))).collect(),
        }
    };
    Ok((width, height, cells))
}

/// The next number of a PGM, past blanks and comments, and the one blank after it.
fn number(reader: &mut impl BufRead) -> Result<u64, FormatError> {
    let (mut digits, mut value, mut in_comment) = (0, 0_u64, false);
    loop {
        let Some(&byte) = reader.fill_buf()?.first() else {
            return if digits > 0 { Ok(value) } else { Err(unexpected("a number", "the end of the file")) };
        };
        reader.consume(1);
        match byte {
            b'\n' | b'\r' if in_comment => in_comment = false,
            _ if in_comment => {}
            b'0'..=b'9' if digits < 12 => (digits, value) = (digits + 1, value * 10 + u64::from(byte - b'0')),
            _ if byte.is_ascii_whitespace() && digits > 0 => return Ok(value),
            _ if byte.is_ascii_whitespace() => {}
            b'#' if digits == 0 => in_comment = true,
            other => return Err(unexpected("a number", &format!("`{}`", other.escape_ascii()))),
        }
    }
}

fn read_png(reader: impl BufRead + Seek, cell_of: &CellOf<'_>) -> Result<(usize, usize, Vec<u8>), FormatError> {
    let broken = |error: png::DecodingError| unexpected("a PNG image", &error.to_string());
    let mut decoder = png::Decoder::new_with_limits(reader, png::Limits { bytes: PNG_BYTES });
    decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::STRIP_16);
    let (width, height) = decoder.read_header_info().map_err(broken)?.size();
    let (width, height) = sides(u64::from(width), u64::from(height))?;
    let mut reader = decoder.read_info().map_err(broken)?;
    if reader.info().interlaced {
        return Err(unexpected("a PNG image without interlacing", "one with it"));
    }
    let samples = reader.output_color_type().0.samples();
    // Grey or colours, and then the alpha channel.
    let colours = if samples % 2 == 0 { samples - 1 } else { samples };
    let mut cells = Vec::new();
    while let Some(row) = reader.next_row().map_err(broken)? {
        for pixel in row.data().chunks_exact(samples) {
            let sum: u32 = pixel[..colours].iter().map(|&value| u32::from(value)).sum();
            let lightness = f64::from(sum) / (255.0 * colours as f64);
            cells.push(cell_of.cell(lightness, pixel[colours..].iter().any(|&alpha| alpha < 255)));
        }
    }
    Ok((width, height, cells))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{read_map_yaml, write_map_yaml, write_pgm, write_plain_png};
    use mapwright_geom::Pose2;
    use std::io::Cursor;

    fn about(more: &str) -> MapDescription {
        read_map_yaml(format!("image: m.pgm\nresolution: 0.1\norigin: [1, 2, 0.5]\n{more}").as_bytes()).unwrap()
    }

    fn cells(more: &str, image: &[u8]) -> Vec<u8> {
        read_map_image(&about(more), Cursor::new(image)).unwrap().cells
    }

    fn refusal(image: &[u8]) -> String {
        read_map_image(&about(""), Cursor::new(image)).unwrap_err().to_string()
    }

    #[test]
    fn what_is_written_is_read_again() {
        let map = GridImage {
            width: 3,
            height: 2,
            resolution_m: 0.05,
            world_from_map: Pose2::new(-1.5, 2.0, 0.25),
            cells: vec![0, 100, UNKNOWN, 100, UNKNOWN, 0],
        };
        let (mut yaml, mut pgm, mut png) = (Vec::new(), Vec::new(), Vec::new());
        write_map_yaml(&map, "m.pgm", &mut yaml).unwrap();
        write_pgm(&map, &mut pgm).unwrap();
        write_plain_png(&map, &mut png).unwrap();
        let about = read_map_yaml(yaml.as_slice()).unwrap();
        for image in [pgm, png] {
            assert_eq!(read_map_image(&about, Cursor::new(image)).unwrap(), map);
        }
    }

    #[test]
    fn pixels_mean_what_the_mode_says() {
        let image = b"P5\n# a comment\n6 1 255\n\x00\x64\xcd\xfe\xff\x50";
        assert_eq!(cells("", image), [100, UNKNOWN, UNKNOWN, 0, 0, 100]);
        assert_eq!(cells("negate: 1\n", image), [0, UNKNOWN, 100, 100, 100, UNKNOWN]);
        assert_eq!(cells("mode: scale\noccupied_thresh: 0.9\nfree_thresh: 0.1\n", image)[..3], [100, 63, 12]);
        assert_eq!(cells("mode: raw\n", image), [0, 100, UNKNOWN, UNKNOWN, UNKNOWN, 100]);
        assert_eq!(cells("", b"P2 3 1 1000 0 # a wall\n 1000 500 "), [100, 0, UNKNOWN]);
        assert_eq!(cells("", b"P5 2 1 65535 \0\0\xff\xff"), [100, 0]);
    }

    #[test]
    fn what_is_no_image_is_refused() {
        let huge = refusal(b"P5 20000 20000 255 ");
        assert_eq!(huge, "image: expected from 1 to 100000000 cells, found 20000 x 20000");
        let cut = refusal(b"P5 20 20 255 abc");
        assert_eq!(cut, "image: expected 400 bytes of pixels for 20 x 20 cells, found 3");
        assert_eq!(refusal(b"P5 4000000000 4000000000 255 "), huge.replace("20000", "4000000000"));
        assert_eq!(refusal(b"P2 2 1 255 1"), "image: expected a number, found the end of the file");
        assert_eq!(refusal(b"P5 2 -1 255 1"), "image: expected a number, found `-`");
        assert_eq!(refusal(b""), "image: expected a PGM or PNG image, found an empty file");
        assert_eq!(refusal(b"BM123"), "image: expected a PGM or PNG image, found a file that begins with BM123");
        assert!(refusal(b"P5 0 5 255 ").contains("found 0 x 5"));
        assert!(refusal(b"P5 1 1 0 a").contains("greatest grey value"));
        assert!(refusal(b"\x89PNG\r\n\x1a\nnothing").contains("expected a PNG image"));
        let mut png = Vec::new();
        let map =
            GridImage { width: 9, height: 9, resolution_m: 1.0, world_from_map: Pose2::IDENTITY, cells: vec![0; 81] };
        write_plain_png(&map, &mut png).unwrap();
        assert!(refusal(&png[..png.len() - 20]).contains("expected a PNG image"));
    }
}
