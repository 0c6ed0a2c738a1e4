//! Grey images.

use crate::error::StereoError;

/// No camera has more pixels across or down; row and column then fit 16 bits each.
pub const SIDE_MAX: u32 = 16_384;

/// An image of grey values, row by row, of 8 or 16 bits: only differences of its own values count, so that their scale
/// does not matter.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct GreyImage {
    width: u32,
    height: u32,
    pixels: Vec<u16>,
}

impl GreyImage {
    /// Of values row by row.
    ///
    /// # Errors
    /// [`StereoError::Image`] where a side has no pixel or more than [`SIDE_MAX`], or there are not `width * height` values.
    pub fn new(width: u32, height: u32, pixels: Vec<u16>) -> Result<Self, StereoError> {
        check_size(width, height, pixels.len())?;
        Ok(Self { width, height, pixels })
    }

    /// Takes in an image of grey values of 8 bits, row by row, in the memory of the one before.
    ///
    /// # Errors
    /// As [`new`](Self::new); the image before stays then.
    pub fn set_grey8(&mut self, width: u32, height: u32, values: &[u8]) -> Result<(), StereoError> {
        self.set(width, height, values.iter().map(|value| u16::from(*value)), values.len())
    }

    /// Takes in an image of grey values of 16 bits.
    ///
    /// # Errors
    /// As [`set_grey8`](Self::set_grey8).
    pub fn set_grey16(&mut self, width: u32, height: u32, values: &[u16]) -> Result<(), StereoError> {
        self.set(width, height, values.iter().copied(), values.len())
    }

    /// Takes in an image of red, green and blue: its luma by ITU-R BT.601, in 16 bits, for rounding to 8 would make
    /// equal what is not.
    ///
    /// # Errors
    /// As [`set_grey8`](Self::set_grey8).
    pub fn set_rgb8(&mut self, width: u32, height: u32, colours: &[[u8; 3]]) -> Result<(), StereoError> {
        self.set(width, height, colours.iter().map(|colour| luma(*colour)), colours.len())
    }

    fn set(
        &mut self,
        width: u32,
        height: u32,
        values: impl Iterator<Item = u16>,
        count: usize,
    ) -> Result<(), StereoError> {
        check_size(width, height, count)?;
        self.pixels.clear();
        self.pixels.extend(values);
        (self.width, self.height) = (width, height);
        Ok(())
    }

    /// Pixels across.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels down.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Pixels across and down.
    #[must_use]
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// All values, row by row.
    #[must_use]
    pub fn pixels(&self) -> &[u16] {
        &self.pixels
    }

    /// The values of a row, which must exist.
    #[must_use]
    pub fn row(&self, y: usize) -> &[u16] {
        let width = self.width as usize;
        &self.pixels[y * width..][..width]
    }

    /// Room for an image of that size, whatever is in it.
    pub(crate) fn resized(&mut self, width: u32, height: u32) -> &mut [u16] {
        (self.width, self.height) = (width, height);
        self.pixels.resize(width as usize * height as usize, 0);
        &mut self.pixels
    }
}

/// 0.299 R + 0.587 G + 0.114 B, times 255 or a little less.
fn luma([red, green, blue]: [u8; 3]) -> u16 {
    ((19_595 * u32::from(red) + 38_470 * u32::from(green) + 7_471 * u32::from(blue)) >> 8) as u16
}

fn check_size(width: u32, height: u32, found: usize) -> Result<(), StereoError> {
    let sides = 1..=SIDE_MAX;
    if !sides.contains(&width) || !sides.contains(&height) {
        let expected = format!("1 to {SIDE_MAX} pixels across and down");
        return Err(StereoError::Image { what: "image", expected, found: format!("{width} x {height}") });
    }
    let expected = width as usize * height as usize;
    if expected == found {
        return Ok(());
    }
    let expected = format!("{expected} values of {width} x {height} pixels");
    Err(StereoError::Image { what: "image", expected, found: found.to_string() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_that_are_none_are_refused() {
        let error = GreyImage::new(0, 3, vec![]).unwrap_err().to_string();
        assert_eq!(error, "image: expected 1 to 16384 pixels across and down, found 0 x 3");
        let error = GreyImage::new(2, 2, vec![1; 3]).unwrap_err().to_string();
        assert_eq!(error, "image: expected 4 values of 2 x 2 pixels, found 3");
        let mut image = GreyImage::new(1, 1, vec![7]).unwrap();
        assert!(image.set_rgb8(3, 1, &[[0; 3]; 2]).is_err());
        assert_eq!(image.pixels(), [7]);
    }

    #[test]
    fn white_is_white() {
        let mut image = GreyImage::default();
        image.set_rgb8(2, 1, &[[255; 3], [0, 0, 1]]).unwrap();
        assert_eq!(image.pixels(), [65_280, 29]);
    }
}
