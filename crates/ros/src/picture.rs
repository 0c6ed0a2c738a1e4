//! Grey values and colours out of images.

use crate::error::{RosError, excerpt};
use crate::messages::Image;

/// What a picture shows, row by row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Picture {
    /// Grey values.
    Grey(Vec<u8>),
    /// Red, green and blue.
    Colours(Vec<[u8; 3]>),
}

/// How pixels are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Packing {
    Grey,
    /// Bytes of a pixel, and where red, green and blue are among them.
    Colours(usize, [usize; 3]),
    /// One colour a pixel, by turns.
    Mosaic,
    /// Brightness in every other byte, from this one on.
    Brightness(usize),
}

impl Packing {
    fn of(encoding: &str) -> Option<Self> {
        Some(match encoding.trim() {
            "mono8" | "8UC1" | "Y8" | "y8" => Self::Grey,
            "rgb8" => Self::Colours(3, [0, 1, 2]),
            "bgr8" | "8UC3" => Self::Colours(3, [2, 1, 0]),
            "rgba8" => Self::Colours(4, [0, 1, 2]),
            "bgra8" | "8UC4" => Self::Colours(4, [2, 1, 0]),
            "bayer_rggb8" | "bayer_bggr8" | "bayer_gbrg8" | "bayer_grbg8" => Self::Mosaic,
            "yuv422" | "uyvy" => Self::Brightness(1),
            "yuv422_yuy2" | "yuyv" => Self::Brightness(0),
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::Grey | Self::Mosaic => 1,
            Self::Colours(bytes, _) => bytes,
            Self::Brightness(_) => 2,
        }
    }
}

impl Image<'_> {
    /// The encodings of pictures that are read, in words.
    pub const ENCODINGS_OF_PICTURES: &'static str = "mono8, rgb8, bgr8, rgba8, bgra8, bayer_*8, yuv422 or yuv422_yuy2";

    /// Whether it is a picture that can be read, by its encoding.
    #[must_use]
    pub fn is_picture(&self) -> bool {
        Packing::of(&self.encoding).is_some()
    }

    /// What it shows. Of a mosaic of colours each pixel has the mean of four, half a pixel further down and to the right.
    ///
    /// # Errors
    /// [`RosError::Image`] for another encoding, and where the data is not as long as height, width and step say.
    pub fn picture(&self) -> Result<Picture, RosError> {
        let packing = Packing::of(&self.encoding).ok_or_else(|| RosError::Image {
            what: "encoding",
            expected: format!("one of pictures: {}", Self::ENCODINGS_OF_PICTURES),
            found: excerpt(&self.encoding),
        })?;
        let (width, height) = (self.width as usize, self.height as usize);
        let row_bytes = width.saturating_mul(packing.bytes());
        let given = self.step as usize;
        let step = if height <= 1 || given < row_bytes { row_bytes } else { given };
        let needed = step.saturating_mul(height.saturating_sub(1)).saturating_add(row_bytes);
        if height == 0 || width == 0 || needed > self.data.len() {
            return Err(RosError::Image {
                what: "data",
                expected: format!("{width} x {height} pixels of {} bytes ({needed} bytes)", packing.bytes()),
                found: format!("{} bytes", self.data.len()),
            });
        }
        let rows = self.data.chunks(step).take(height).map(|row| row.get(..row_bytes).unwrap_or_default());
        Ok(match packing {
            Packing::Grey => Picture::Grey(rows.flatten().copied().collect()),
            Packing::Brightness(from) => {
                Picture::Grey(rows.flat_map(|row| row.iter().skip(from).step_by(2)).copied().collect())
            }
            Packing::Mosaic => Picture::Grey(of_mosaic(&rows.collect::<Vec<_>>())),
            Packing::Colours(bytes, order) => {
                let colour = |pixel: &[u8]| order.map(|at| pixel.get(at).copied().unwrap_or(0));
                Picture::Colours(rows.flat_map(|row| row.chunks_exact(bytes)).map(colour).collect())
            }
        })
    }
}

/// Each pixel with those to its right and below: one red, one blue and two green ones, wherever the mosaic begins.
fn of_mosaic(rows: &[&[u8]]) -> Vec<u8> {
    let value = |row: &[u8], x: usize| u16::from(row.get(x).or(row.get(x.saturating_sub(2))).copied().unwrap_or(0));
    let mut grey = Vec::new();
    for (y, row) in rows.iter().enumerate() {
        // beyond the last row or column the mosaic goes on as it did two before
        let below = rows.get(y + 1).or(y.checked_sub(1).and_then(|above| rows.get(above))).unwrap_or(row);
        let four = |x: usize| value(row, x) + value(row, x + 1) + value(below, x) + value(below, x + 1);
        grey.extend((0..row.len()).map(|x| (four(x) / 4) as u8));
    }
    grey
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image<'a>(encoding: &'static str, step: u32, data: &'a [u8]) -> Image<'a> {
        Image { width: 2, height: 2, encoding: encoding.into(), step, data, ..Default::default() }
    }

    #[test]
    fn pictures_of_any_packing() {
        let grey = |values: [u8; 4]| Ok(Picture::Grey(values.to_vec()));
        assert_eq!(image("mono8", 3, &[1, 2, 9, 3, 4]).picture(), grey([1, 2, 3, 4]));
        assert_eq!(image("yuv422", 4, &[0, 1, 0, 2, 0, 3, 0, 4]).picture(), grey([1, 2, 3, 4]));
        assert_eq!(image("yuyv", 4, &[1, 0, 2, 0, 3, 0, 4, 0]).picture(), grey([1, 2, 3, 4]));
        assert_eq!(
            image("bayer_rggb8", 2, &[40, 20, 20, 0]).picture(),
            grey([20, 30, 10, 20]).map(|_| { Picture::Grey(of_mosaic(&[&[40, 20], &[20, 0]])) })
        );
        assert_eq!(of_mosaic(&[&[40, 20], &[20, 0]])[0], 20);
        let colours = Ok(Picture::Colours(vec![[1, 2, 3], [4, 5, 6], [7, 8, 9], [10, 11, 12]]));
        assert_eq!(image("rgb8", 6, &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]).picture(), colours);
        assert_eq!(image("bgra8", 8, &[3, 2, 1, 0, 6, 5, 4, 0, 9, 8, 7, 0, 12, 11, 10, 0]).picture(), colours);
    }

    #[test]
    fn what_is_none_is_refused() {
        let error = image("16UC1", 4, &[0; 8]).picture().unwrap_err().to_string();
        assert!(error.contains("expected one of pictures: mono8") && error.contains("16UC1"), "{error}");
        let error = image("mono8", 2, &[0; 3]).picture().unwrap_err().to_string();
        assert!(error.contains("2 x 2 pixels of 1 bytes (4 bytes), found 3 bytes"), "{error}");
        let huge = Image { width: u32::MAX, height: u32::MAX, encoding: "bgra8".into(), ..Default::default() };
        assert!(huge.picture().is_err());
    }
}
