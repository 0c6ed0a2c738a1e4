//! Reading bytes: ROS 1's serialization and plain CDR.

use crate::error::RosError;
use crate::schema::Primitive;
use std::borrow::Cow;

/// How messages of a channel are serialized.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// ROS 1: little endian, no padding.
    Ros1,
    /// ROS 2: CDR of either endianness with its encapsulation header. Only plain CDR (XCDR version 1) is read.
    Cdr,
}

impl Encoding {
    /// The encoding that a container calls by this name: `ros1` or `cdr`.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "ros1" => Some(Self::Ros1),
            "cdr" => Some(Self::Cdr),
            _ => None,
        }
    }
}

/// A number that messages are made of.
pub trait Scalar: Copy + Default + PartialEq + std::fmt::Debug + 'static {
    /// Its type in a definition.
    const PRIMITIVE: Primitive;
    /// The number in the first bytes; zero where there are too few.
    fn decode(bytes: &[u8], big_endian: bool) -> Self;
    /// Appends the number, little endian.
    fn encode(self, out: &mut Vec<u8>);
}

macro_rules! scalars {
    ($($number:ty => $primitive:ident),*) => {$(
        impl Scalar for $number {
            const PRIMITIVE: Primitive = Primitive::$primitive;
            #[inline]
            fn decode(bytes: &[u8], big_endian: bool) -> Self {
                let raw = bytes.first_chunk().copied().unwrap_or_default();
                if big_endian { <$number>::from_be_bytes(raw) } else { <$number>::from_le_bytes(raw) }
            }
            #[inline]
            fn encode(self, out: &mut Vec<u8>) {
                out.extend_from_slice(&self.to_le_bytes());
            }
        }
    )*};
}

scalars!(i8 => I8, u8 => U8, i16 => I16, u16 => U16, i32 => I32, u32 => U32, i64 => I64, u64 => U64, f32 => F32, f64 => F64);

impl Scalar for bool {
    const PRIMITIVE: Primitive = Primitive::Bool;
    fn decode(bytes: &[u8], _: bool) -> Self {
        bytes.first().is_some_and(|byte| *byte != 0)
    }
    fn encode(self, out: &mut Vec<u8>) {
        out.push(u8::from(self));
    }
}

/// A place in a message. Nothing is allocated by a length that is longer than what is left.
#[derive(Debug, Clone)]
pub struct Cursor<'a> {
    body: &'a [u8],
    at: usize,
    header_bytes: usize,
    encoding: Encoding,
    big_endian: bool,
    lossy_texts: u64,
}

impl<'a> Cursor<'a> {
    /// The message's beginning.
    ///
    /// # Errors
    /// [`RosError::Cut`] and [`RosError::Encapsulation`] for CDR without a header or of another kind.
    pub fn new(encoding: Encoding, message: &'a [u8]) -> Result<Self, RosError> {
        let (body, header_bytes, big_endian) = match encoding {
            Encoding::Ros1 => (message, 0, false),
            Encoding::Cdr => {
                let (header, body) = message.split_first_chunk::<4>().ok_or_else(|| RosError::Cut {
                    field: "encapsulation header".to_owned(),
                    offset_bytes: 0,
                    expected_bytes: 4,
                    left_bytes: message.len(),
                })?;
                (body, 4, is_big_endian(u16::from_be_bytes([header[0], header[1]]))?)
            }
        };
        Ok(Self { body, at: 0, header_bytes, encoding, big_endian, lossy_texts: 0 })
    }

    /// How the message is serialized.
    #[must_use]
    pub fn encoding(&self) -> Encoding {
        self.encoding
    }

    /// Whether numbers have their most significant byte first.
    #[must_use]
    pub fn big_endian(&self) -> bool {
        self.big_endian
    }

    /// Texts so far that were no UTF-8.
    #[must_use]
    pub fn lossy_texts(&self) -> u64 {
        self.lossy_texts
    }

    /// Where the cursor stands in the message, header included.
    #[must_use]
    pub fn offset_bytes(&self) -> usize {
        self.at + self.header_bytes
    }

    /// Bytes that are left.
    #[must_use]
    pub fn left_bytes(&self) -> usize {
        self.body.len().saturating_sub(self.at)
    }

    /// The next number.
    ///
    /// # Errors
    /// [`RosError::Cut`].
    #[inline]
    pub fn scalar<T: Scalar>(&mut self) -> Result<T, RosError> {
        let size = T::PRIMITIVE.size();
        self.align(size);
        Ok(T::decode(self.take(size)?, self.big_endian))
    }

    /// The next `count` numbers of `size` bytes each.
    ///
    /// # Errors
    /// [`RosError::Cut`].
    pub fn numbers(&mut self, size: usize, count: usize) -> Result<&'a [u8], RosError> {
        if count == 0 {
            return Ok(&[]);
        }
        self.align(size);
        self.take(size.saturating_mul(count))
    }

    /// The length of a list whose elements take `min_bytes` or more.
    ///
    /// # Errors
    /// [`RosError::Cut`] where that many elements do not fit into what is left.
    pub fn count(&mut self, min_bytes: usize) -> Result<usize, RosError> {
        let count = self.scalar::<u32>()? as usize;
        let needed = count.saturating_mul(min_bytes.max(1));
        if needed > self.left_bytes() { Err(self.cut(needed)) } else { Ok(count) }
    }

    /// The next text; what is no UTF-8 is replaced and counted.
    ///
    /// # Errors
    /// [`RosError::Cut`].
    pub fn text(&mut self) -> Result<Cow<'a, str>, RosError> {
        let length = self.scalar::<u32>()? as usize;
        let bytes = self.take(length)?;
        let bytes = match (self.encoding, bytes) {
            (Encoding::Cdr, [text @ .., 0]) => text,
            _ => bytes,
        };
        let text = String::from_utf8_lossy(bytes);
        self.lossy_texts += u64::from(matches!(text, Cow::Owned(_)));
        Ok(text)
    }

    /// That the message ends here. Writers of CDR may pad to a multiple of four.
    ///
    /// # Errors
    /// [`RosError::Trailing`].
    pub fn finish(&self) -> Result<(), RosError> {
        let padding = if self.encoding == Encoding::Cdr { 3 } else { 0 };
        if self.left_bytes() > padding {
            return Err(RosError::Trailing { offset_bytes: self.offset_bytes(), left_bytes: self.left_bytes() });
        }
        Ok(())
    }

    #[inline]
    fn align(&mut self, size: usize) {
        if self.encoding == Encoding::Cdr {
            self.at = self.at.next_multiple_of(size);
        }
    }

    #[inline]
    fn take(&mut self, count: usize) -> Result<&'a [u8], RosError> {
        let end = self.at.saturating_add(count);
        let bytes = self.body.get(self.at..end).ok_or_else(|| self.cut(count))?;
        self.at = end;
        Ok(bytes)
    }

    #[cold]
    fn cut(&self, expected_bytes: usize) -> RosError {
        RosError::Cut {
            field: String::new(),
            offset_bytes: self.offset_bytes(),
            expected_bytes,
            left_bytes: self.left_bytes(),
        }
    }
}

/// Representation identifiers of DDS-XTypes 1.3, table 60.
fn is_big_endian(code: u16) -> Result<bool, RosError> {
    let found = match code {
        0 => return Ok(true),
        1 => return Ok(false),
        2 | 3 => "parameter-list CDR",
        6 | 7 => "plain CDR version 2",
        8 | 9 => "delimited CDR version 2",
        10 | 11 => "parameter-list CDR version 2",
        _ => "an unknown encapsulation",
    };
    Err(RosError::Encapsulation { found, code })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_aligned_relative_to_the_body() {
        let message = [0, 1, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0];
        let mut cursor = Cursor::new(Encoding::Cdr, &message).unwrap();
        assert_eq!(cursor.scalar::<u8>().unwrap(), 7);
        assert_eq!(cursor.scalar::<u64>().unwrap(), 1);
        assert!(cursor.finish().is_ok());
    }

    #[test]
    fn a_length_beyond_the_end_is_refused_where_it_stands() {
        let mut cursor = Cursor::new(Encoding::Ros1, &[255, 255, 255, 255, 1]).unwrap();
        let error = cursor.text().unwrap_err().inside("name").inside("header");
        assert_eq!(error.to_string(), "byte 4, field `header.name`: expected 4294967295 bytes, found 1");
    }

    #[test]
    fn other_encapsulations_are_refused_by_name() {
        let error = Cursor::new(Encoding::Cdr, &[0, 7, 0, 0]).unwrap_err();
        assert_eq!(
            error.to_string(),
            "byte 0: expected plain CDR (0x0000 or 0x0001), found plain CDR version 2 (0x0007)"
        );
    }

    #[test]
    fn a_text_that_is_no_utf8_is_replaced_and_counted() {
        let mut cursor = Cursor::new(Encoding::Ros1, &[2, 0, 0, 0, b'a', 255]).unwrap();
        assert_eq!(cursor.text().unwrap(), "a\u{fffd}");
        assert_eq!(cursor.lossy_texts(), 1);
    }
}
