//! Clouds of points as PCD (Point Cloud Library, version 0.7), binary.

use crate::error::FormatError;
use crate::ply::one_each;
use std::io::Write;

/// Writes points, metres, with an intensity each where there are any, and a colour, packed into `rgb` as the library has it.
///
/// # Errors
/// What the stream says; as many colours and intensities as points, or none, are expected.
pub fn write_pcd(
    points_m: &[[f32; 3]],
    colours: &[[u8; 3]],
    intensities: &[f32],
    stream: &mut impl Write,
) -> Result<(), FormatError> {
    let count = points_m.len();
    let known = [(intensities.len(), "intensities", "intensity"), (colours.len(), "colours", "rgb")];
    let known: Vec<_> = known.into_iter().filter(|(found, ..)| *found > 0).collect();
    known.iter().try_for_each(|(found, what, _)| one_each(*found, what, count))?;
    let names: String = known.iter().map(|(.., name)| format!(" {name}")).collect();
    let column = |word: &str, more: &str| format!("{word}{}", format!(" {more}").repeat(known.len()));
    write!(stream, "# .PCD v0.7 - Point Cloud Data file format\n# metres, in the map's frame\nVERSION 0.7\n")?;
    write!(stream, "FIELDS {}\nSIZE {}\n", "x y z".to_owned() + &names, column("4 4 4", "4"))?;
    write!(stream, "TYPE {}\nCOUNT {}\n", column("F F F", "F"), column("1 1 1", "1"))?;
    write!(stream, "WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n")?;
    for (number, point) in points_m.iter().enumerate() {
        for value in point {
            stream.write_all(&value.to_le_bytes())?;
        }
        if let Some(intensity) = intensities.get(number) {
            stream.write_all(&intensity.to_le_bytes())?;
        }
        if let Some([red, green, blue]) = colours.get(number) {
            stream.write_all(&[*blue, *green, *red, 0])?;
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
        write_pcd(&[[1.0, 2.0, 3.0]], &[[4, 5, 6]], &[], &mut out).unwrap();
        let text = String::from_utf8_lossy(&out);
        assert!(text.contains("FIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\n") && text.contains("POINTS 1\n"));
        assert!(out.ends_with(&[0, 0, 64, 64, 6, 5, 4, 0]), "{out:?}");
        assert!(write_pcd(&[[0.0; 3]], &[[0; 3]; 2], &[], &mut Vec::new()).is_err());
        let mut out = Vec::new();
        write_pcd(&[[1.0, 2.0, 3.0]], &[[4, 5, 6]], &[2.0], &mut out).unwrap();
        let text = String::from_utf8_lossy(&out);
        assert!(
            text.contains("FIELDS x y z intensity rgb\nSIZE 4 4 4 4 4\nTYPE F F F F F\nCOUNT 1 1 1 1 1\n"),
            "{text}"
        );
        assert!(out.ends_with(&[0, 0, 64, 64, 0, 0, 0, 64, 6, 5, 4, 0]), "{out:?}");
    }
}
