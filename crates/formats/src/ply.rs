//! Clouds of points as PLY (Turk 1994), binary, little endian.

use crate::error::FormatError;
use std::io::Write;

/// Writes points, metres, with a colour and an intensity each where there are any.
///
/// # Errors
/// What the stream says; as many colours and intensities as points, or none, are expected.
pub fn write_ply(
    points_m: &[[f32; 3]],
    colours: &[[u8; 3]],
    intensities: &[f32],
    stream: &mut impl Write,
) -> Result<(), FormatError> {
    if intensities.is_empty() {
        return write_vertices(points_m.iter().copied(), &["x", "y", "z"], colours, stream);
    }
    one_each(intensities.len(), "intensities", points_m.len())?;
    let rows = points_m.iter().zip(intensities).map(|(&[x, y, z], &intensity)| [x, y, z, intensity]);
    write_vertices(rows, &["x", "y", "z", "intensity"], colours, stream)
}

/// As many of something as points.
pub(crate) fn one_each(found: usize, what: &str, points: usize) -> Result<(), FormatError> {
    let words = || std::io::Error::other(format!("{found} {what} for {points} points"));
    if found == points { Ok(()) } else { Err(words().into()) }
}

/// A small disc of a surface, as viewers of point clouds draw them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disc {
    /// Its middle, metres.
    pub point_m: [f32; 3],
    /// Of length one, away from the surface.
    pub normal: [f32; 3],
    /// Its size, metres.
    pub radius_m: f32,
}

/// Writes discs, `x y z nx ny nz radius`, with a colour each where there are any.
///
/// # Errors
/// What the stream says; as many colours as discs, or none, are expected.
pub fn write_ply_discs(discs: &[Disc], colours: &[[u8; 3]], stream: &mut impl Write) -> Result<(), FormatError> {
    let rows = discs
        .iter()
        .map(|&Disc { point_m: [x, y, z], normal: [nx, ny, nz], radius_m }| [x, y, z, nx, ny, nz, radius_m]);
    write_vertices(rows, &["x", "y", "z", "nx", "ny", "nz", "radius"], colours, stream)
}

fn write_vertices<const N: usize>(
    rows: impl ExactSizeIterator<Item = [f32; N]>,
    names: &[&str; N],
    colours: &[[u8; 3]],
    stream: &mut impl Write,
) -> Result<(), FormatError> {
    let coloured = !colours.is_empty();
    if coloured {
        one_each(colours.len(), "colours", rows.len())?;
    }
    write!(stream, "ply\nformat binary_little_endian 1.0\ncomment metres, in the map's frame\n")?;
    writeln!(stream, "element vertex {}", rows.len())?;
    names.iter().try_for_each(|name| writeln!(stream, "property float {name}"))?;
    if coloured {
        stream.write_all(b"property uchar red\nproperty uchar green\nproperty uchar blue\n")?;
    }
    stream.write_all(b"end_header\n")?;
    for (number, row) in rows.enumerate() {
        for value in row {
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
        write_ply(&[[1.0, 2.0, 3.0]], &[[4, 5, 6]], &[], &mut out).unwrap();
        let text = String::from_utf8_lossy(&out);
        assert!(text.contains("element vertex 1\n") && text.contains("property uchar red\n"));
        assert!(out.ends_with(&[0, 0, 64, 64, 4, 5, 6]), "{out:?}");
        assert!(write_ply(&[[0.0; 3]], &[[0; 3]; 2], &[], &mut Vec::new()).is_err());
        assert!(write_ply(&[[0.0; 3]], &[], &[1.0; 2], &mut Vec::new()).is_err());
        let mut out = Vec::new();
        write_ply(&[[1.0, 2.0, 3.0]], &[], &[2.0], &mut out).unwrap();
        assert!(String::from_utf8_lossy(&out).contains("property float z\nproperty float intensity\nend_header"));
        assert!(out.ends_with(&[0, 0, 64, 64, 0, 0, 0, 64]), "{out:?}");
    }
    #[test]
    fn discs_have_normals_and_a_radius() {
        let disc = Disc { point_m: [1.0, 2.0, 3.0], normal: [0.0, 0.0, 1.0], radius_m: 0.5 };
        let mut out = Vec::new();
        write_ply_discs(&[disc], &[[4, 5, 6]], &mut out).unwrap();
        let text = String::from_utf8_lossy(&out);
        assert!(text.contains("property float nz\nproperty float radius\nproperty uchar red\n"), "{text}");
        let values: Vec<u8> = [1.0, 2.0, 3.0, 0.0, 0.0, 1.0, 0.5_f32].iter().flat_map(|v| v.to_le_bytes()).collect();
        assert!(out.ends_with(&[&values[..], &[4, 5, 6]].concat()), "{out:?}");
        assert!(write_ply_discs(&[disc], &[[0; 3]; 2], &mut Vec::new()).is_err());
    }
}
