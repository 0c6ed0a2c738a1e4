//! Values as bytes, least significant first, and back.

use crate::error::EntryError;
use crate::pose::{MOST_NUMBERS, from_numbers, to_numbers};
use mapwright_geom::{Pose, TangentMatrix};

/// A value that one byte names.
pub(super) trait Coded: Sized {
    /// The byte.
    fn code(self) -> u8;
    /// What the byte names.
    fn from_code(code: u8) -> Option<Self>;
}

/// Writes down a byte for each variant; one that is forgotten does not compile.
macro_rules! coded {
    ($type:ty: $($variant:ident = $code:literal),+) => {
        impl Coded for $type {
            fn code(self) -> u8 {
                match self { $(Self::$variant => $code),+ }
            }

            fn from_code(code: u8) -> Option<Self> {
                match code { $($code => Some(Self::$variant),)+ _ => None }
            }
        }
    };
}
pub(super) use coded;

pub(super) fn put_u32(out: &mut Vec<u8>, value: u32) {
    out.extend_from_slice(&value.to_le_bytes());
}

pub(super) fn put_f64(out: &mut Vec<u8>, value: f64) {
    out.extend_from_slice(&value.to_le_bytes());
}

pub(super) fn put_pose<P: Pose>(out: &mut Vec<u8>, pose: P) {
    to_numbers(pose).into_iter().take(P::NUMBERS).for_each(|number| put_f64(out, number));
}

/// Row by row, all of it: computed matrices are symmetric but for their last digits, and are to come back to the bit.
pub(super) fn put_matrix<P: Pose>(out: &mut Vec<u8>, matrix: &P::Matrix) {
    for row in 0..P::DIMENSION {
        (0..P::DIMENSION).for_each(|column| put_f64(out, matrix[(row, column)]));
    }
}

/// Takes values off the front of bytes.
pub(super) struct Cursor<'a> {
    left: &'a [u8],
}

impl<'a> Cursor<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { left: bytes }
    }

    pub(super) fn left_bytes(&self) -> usize {
        self.left.len()
    }

    pub(super) fn take(&mut self, length: usize, expected: &'static str) -> Result<&'a [u8], EntryError> {
        let Some((taken, left)) = self.left.split_at_checked(length) else {
            return Err(EntryError { expected, found: format!("{} bytes of {length}", self.left.len()) });
        };
        self.left = left;
        Ok(taken)
    }

    /// All that is left.
    pub(super) fn rest(&mut self) -> &'a [u8] {
        std::mem::take(&mut self.left)
    }

    pub(super) fn array<const N: usize>(&mut self, expected: &'static str) -> Result<[u8; N], EntryError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N, expected)?);
        Ok(array)
    }

    pub(super) fn u32(&mut self, expected: &'static str) -> Result<u32, EntryError> {
        Ok(u32::from_le_bytes(self.array(expected)?))
    }

    pub(super) fn u64(&mut self, expected: &'static str) -> Result<u64, EntryError> {
        Ok(u64::from_le_bytes(self.array(expected)?))
    }

    pub(super) fn f64(&mut self, expected: &'static str) -> Result<f64, EntryError> {
        Ok(f64::from_le_bytes(self.array(expected)?))
    }

    pub(super) fn byte(&mut self, expected: &'static str) -> Result<u8, EntryError> {
        let [byte] = self.array(expected)?;
        Ok(byte)
    }

    pub(super) fn flag(&mut self, expected: &'static str) -> Result<bool, EntryError> {
        match self.byte(expected)? {
            0 => Ok(false),
            1 => Ok(true),
            other => Err(EntryError { expected, found: other.to_string() }),
        }
    }

    pub(super) fn coded<T: Coded>(&mut self, expected: &'static str) -> Result<T, EntryError> {
        let code = self.byte(expected)?;
        T::from_code(code).ok_or_else(|| EntryError { expected, found: code.to_string() })
    }

    /// A pose, to the bit; whether it is sound is asked when it is added.
    pub(super) fn pose<P: Pose>(&mut self) -> Result<P, EntryError> {
        let mut numbers = [0.0; MOST_NUMBERS];
        for number in numbers.iter_mut().take(P::NUMBERS) {
            *number = self.f64("a pose")?;
        }
        Ok(from_numbers(numbers))
    }

    pub(super) fn matrix<P: Pose>(&mut self) -> Result<P::Matrix, EntryError> {
        let mut matrix = P::Matrix::zero();
        for row in 0..P::DIMENSION {
            for column in 0..P::DIMENSION {
                matrix[(row, column)] = self.f64("a matrix")?;
            }
        }
        Ok(matrix)
    }

    /// A symmetric matrix of which the upper triangle stands here.
    pub(super) fn upper_triangle<P: Pose>(&mut self) -> Result<P::Matrix, EntryError> {
        let mut matrix = P::Matrix::zero();
        for row in 0..P::DIMENSION {
            for column in row..P::DIMENSION {
                let entry = self.f64("a matrix")?;
                (matrix[(row, column)], matrix[(column, row)]) = (entry, entry);
            }
        }
        Ok(matrix)
    }

    pub(super) fn end(&self) -> Result<(), EntryError> {
        let left = self.left.len();
        let expected = "the end of the entry";
        if left == 0 { Ok(()) } else { Err(EntryError { expected, found: format!("{left} bytes more") }) }
    }
}

/// Bytes that are text.
pub(super) fn text(bytes: &[u8], expected: &'static str) -> Result<String, EntryError> {
    let text = std::str::from_utf8(bytes);
    text.map(str::to_owned).map_err(|_| EntryError { expected, found: "bytes that are no UTF-8".to_owned() })
}
