//! Images as PGM and PPM: the binary kinds P5 and P6 of netpbm, of 8 and 16 bits.

use crate::error::CloudError;

/// An image whose header was read, with all of its pixels.
pub(crate) struct Pnm<'a> {
    pub(crate) size: [u32; 2],
    /// Of a pixel: 1, grey, or 3, red, green and blue.
    pub(crate) samples: usize,
    /// The value of white.
    greatest: u32,
    /// One byte a sample, or two, the higher one first.
    bytes: &'a [u8],
}

/// Whether a file begins as netpbm's do.
pub(crate) fn is_pnm(bytes: &[u8]) -> bool {
    matches!(bytes, [b'P', b'1'..=b'7', ..])
}

impl<'a> Pnm<'a> {
    /// An image of which no side is larger than `side_most`; `file` is its name in errors.
    ///
    /// # Errors
    /// [`CloudError::Content`] where it is of another kind, or its header is none or asks for more bytes than there are.
    pub(crate) fn open(file: &str, bytes: &'a [u8], side_most: u32) -> Result<Self, CloudError> {
        let samples = match bytes {
            [b'P', b'5', ..] => 1,
            [b'P', b'6', ..] => 3,
            _ => {
                let kind = bytes.get(..2).unwrap_or(bytes).escape_ascii();
                return Err(CloudError::content(file, 0, "a binary PGM or PPM image (P5 or P6)", kind.to_string()));
            }
        };
        let mut at = 2;
        let [width, height, greatest] = [
            number(file, bytes, &mut at, "the width")?,
            number(file, bytes, &mut at, "the height")?,
            number(file, bytes, &mut at, "the greatest value")?,
        ];
        if ![width, height].iter().all(|side| (1..=side_most).contains(side)) {
            let expected = format!("an image of 1 to {side_most} pixels a side");
            return Err(CloudError::content(file, 2, expected, format!("{width} x {height}")));
        }
        if !(1..=0xffff).contains(&greatest) {
            return Err(CloudError::content(file, 2, "a greatest value of 1 to 65535", greatest.to_string()));
        }
        let wide = if greatest > 0xff { 2 } else { 1 };
        // of sides that were looked at: at most 2^31 bytes
        let wanted = width as usize * height as usize * samples * wide;
        let found = &bytes[at..];
        let bytes = found.get(..wanted).ok_or_else(|| {
            let expected = format!("{wanted} bytes of pixels for {width} x {height}");
            CloudError::content(file, at, expected, found.len().to_string())
        })?;
        Ok(Self { size: [width, height], samples, greatest, bytes })
    }

    /// All samples, as they are.
    pub(crate) fn values(&self) -> Vec<u16> {
        if self.greatest > 0xff {
            return self.bytes.as_chunks::<2>().0.iter().map(|pair| u16::from_be_bytes(*pair)).collect();
        }
        self.bytes.iter().copied().map(u16::from).collect()
    }

    /// A sample in 8 bits.
    pub(crate) fn byte(&self, value: u16) -> u8 {
        let value = u32::from(value).min(self.greatest);
        ((value * 0xff + self.greatest / 2) / self.greatest) as u8
    }
}

/// The next number of a header, and the one blank after it. A comment, up to the end of its line, counts as that line's end.
fn number(file: &str, bytes: &[u8], at: &mut usize, what: &str) -> Result<u32, CloudError> {
    let mut value = None;
    loop {
        let found = bytes.get(*at).copied();
        match found {
            Some(digit @ b'0'..=b'9') => {
                value = Some(value.unwrap_or(0_u32).saturating_mul(10).saturating_add(u32::from(digit - b'0')));
            }
            Some(b'#') => {
                let comment = bytes[*at..].iter().take_while(|byte| !matches!(byte, b'\n' | b'\r'));
                *at += comment.count();
                continue;
            }
            Some(blank) if blank.is_ascii_whitespace() => {}
            _ => {
                let found =
                    found.map_or_else(|| "the end of the file".to_owned(), |byte| byte.escape_ascii().to_string());
                return Err(CloudError::content(file, *at, format!("{what} of the image as a number"), found));
            }
        }
        *at += 1;
        match (value, found) {
            (Some(value), Some(blank)) if blank.is_ascii_whitespace() => return Ok(value),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(bytes: &[u8]) -> String {
        Pnm::open("a.pgm", bytes, 100).map(|_| ()).unwrap_err().to_string()
    }

    #[test]
    fn headers_with_blanks_and_comments() {
        for header in
            ["P5 2 1 255\n", "P5\n# a camera\n2 1 # wide\n255\n", "P5\r\n2\t1\n\n255 ", "P5#a\n#b\n2 1 255#c\n"]
        {
            let bytes = [header.as_bytes(), &[7, b'\n']].concat();
            let image = Pnm::open("a.pgm", &bytes, 100).unwrap();
            assert_eq!((image.size, image.values()), ([2, 1], vec![7, 10]), "{header:?}");
        }
    }

    #[test]
    fn samples_of_any_depth() {
        let twelve_bits = Pnm::open("a.pgm", b"P5 2 1 4095 \x0f\xff\x01\x00 more", 100).unwrap();
        assert_eq!(twelve_bits.values(), [4095, 256]);
        assert_eq!([4095, 256, 0, 9000].map(|value| twelve_bits.byte(value)), [255, 16, 0, 255]);
        let colours = Pnm::open("a.ppm", b"P6 1 1 255 \x01\x02\x03", 100).unwrap();
        assert_eq!((colours.samples, colours.values()), (3, vec![1, 2, 3]));
    }

    #[test]
    fn what_is_none_is_refused_with_its_place() {
        for (bytes, says) in [
            (&b"P2 2 1 255 7 7"[..], "a.pgm, byte 0: expected a binary PGM or PPM image (P5 or P6), found P2"),
            (b"P5 2 -1 255 7", "a.pgm, byte 5: expected the height of the image as a number, found -"),
            (b"P5 2 1", "a.pgm, byte 6: expected the height of the image as a number, found the end of the file"),
            (b"P5 # 2 1", "a.pgm, byte 8: expected the width of the image as a number, found the end of the file"),
            (b"P5 0 101 255 ", "a.pgm, byte 2: expected an image of 1 to 100 pixels a side, found 0 x 101"),
            (
                b"P5 1 99999999999 255 ",
                "a.pgm, byte 2: expected an image of 1 to 100 pixels a side, found 1 x 4294967295",
            ),
            (b"P5 1 1 0 7", "a.pgm, byte 2: expected a greatest value of 1 to 65535, found 0"),
            (b"P5 1 1 65536 7", "a.pgm, byte 2: expected a greatest value of 1 to 65535, found 65536"),
            (b"P5 3 1 256 12345", "a.pgm, byte 11: expected 6 bytes of pixels for 3 x 1, found 5"),
            (b"P6 100 100 255\n", "a.pgm, byte 15: expected 30000 bytes of pixels for 100 x 100, found 0"),
        ] {
            assert_eq!(refusal(bytes), says);
        }
    }
}
