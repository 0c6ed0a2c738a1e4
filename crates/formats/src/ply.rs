//! Clouds of points as PLY (Turk 1994), binary, little endian.

use crate::error::FormatError;
use std::io::Write;

/// Writes points, metres, with a colour each where there are any.
///
/// # Errors
/// What the stream says; as many colours as points, or none, are expected.
pub fn write_ply(points_m: &[[f32; 3]], colours: &[[u8; 3]], stream: &mut impl Write) -> Result<(), FormatError> {
    let coloured = !colours.is_empty();
    if coloured && colours.len() != points_m.len() {
        let found = format!("{} colours for {} points", colours.len(), points_m.len());
        return Err(std::io::Error::other(found).into());
    }
    write!(stream, "ply\nformat binary_little_endian 1.0\ncomment metres, in the map's frame\n")?;
    write!(stream, "element vertex {}\nproperty float x\nproperty float y\nproperty float z\n", points_m.len())?;
    if coloured {
        stream.write_all(b"property uchar red\nproperty uchar green\nproperty uchar blue\n")?;
    }
    stream.write_all(b"end_header\n")?;
    for (number, point) in points_m.iter().enumerate() {
        for value in point {
            stream.write_all(&value.to_le_bytes())?;
        }
        if let Some(colour) = colours.get(number) {
            stream.write_all(colour)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_and_colours_stand_side_by_side() {
        let mut out = Vec::new();
        write_ply(&[[1.0, 2.0, 3.0]], &[[4, 5, 6]], &mut out).unwrap();
        let text = String::from_utf8_lossy(&out);
        assert!(text.contains("element vertex 1\n") && text.contains("property uchar red\n"));
        assert!(out.ends_with(&[0, 0, 64, 64, 4, 5, 6]), "{out:?}");
        assert!(write_ply(&[[0.0; 3]], &[[0; 3]; 2], &mut Vec::new()).is_err());
    }
}
