//! Values as bytes and back to the bit: what stages that stop write of themselves, and what they go on with.
//!
//! Bytes may be any: what no value of its type can be is none, no length is believed before its values are there, and counters
//! leave room to count on. What else has to hold between values is asked by who knows it.

use crate::{Pose2, Pose3, Stamp};
use nalgebra::{Matrix3, Matrix6, Quaternion, UnitQuaternion, Vector3};
use std::collections::VecDeque;

/// A counter is below this; so nothing overflows that goes on counting.
const COUNT_BITS: u32 = 56;
/// Numbers of 32 bits are below this.
const NUMBER_BITS: u32 = 31;
/// A rotation's quaternion has unit length within this.
const UNIT_WITHIN: f64 = 1e-9;
/// A matrix has no entry beyond this.
const LARGEST_ENTRY: f64 = 1e15;

/// A value that can be written down and read back.
pub trait Stored: Sized {
    /// Appends its bytes.
    fn put(&self, out: &mut Vec<u8>);

    /// Takes a value off the front of bytes; none where they are not those of one.
    fn take(from: &mut &[u8]) -> Option<Self>;
}

/// Writes a structure down field by field, in this order; one that is forgotten does not compile. Those after a semicolon are
/// not kept and come back empty.
///
/// ```
/// use mapwright_geom::{Stored, stored};
/// #[derive(Debug, PartialEq)]
/// struct Mean { sum: f64, count: u32, buffer: Vec<f64> }
/// stored!(Mean { sum, count; buffer });
///
/// let (mut bytes, mean) = (Vec::new(), Mean { sum: 0.5, count: 2, buffer: Vec::new() });
/// mean.put(&mut bytes);
/// assert_eq!(bytes.len(), 9);
/// assert_eq!(Mean::take(&mut &bytes[..]), Some(mean));
/// assert_eq!(Mean::take(&mut &bytes[..8]), None);
/// ```
#[macro_export]
macro_rules! stored {
    ($type:ident $(<$point:ident>)? { $($field:ident),+ $(; $($empty:ident),+)? }) => {
        impl $(<$point: $crate::Stored>)? $crate::Stored for $type $(<$point>)? {
            fn put(&self, out: &mut Vec<u8>) {
                $($crate::Stored::put(&self.$field, out);)+
            }

            fn take(from: &mut &[u8]) -> Option<Self> {
                Some(Self {
                    $($field: $crate::Stored::take(from)?,)+
                    $($($empty: Default::default(),)+)?
                })
            }
        }
    };
}

fn array<const N: usize>(from: &mut &[u8]) -> Option<[u8; N]> {
    let (array, left) = from.split_first_chunk()?;
    *from = left;
    Some(*array)
}

/// Seven bits a byte, the lowest first.
fn put_number(mut number: u64, out: &mut Vec<u8>) {
    while number >= 0x80 {
        out.push(number as u8 | 0x80);
        number >>= 7;
    }
    out.push(number as u8);
}

fn take_number(from: &mut &[u8], bits: u32) -> Option<u64> {
    let mut number = 0;
    for shift in (0..bits).step_by(7) {
        let [byte] = array(from)?;
        number |= u64::from(byte & 0x7f) << shift;
        if byte < 0x80 {
            return (number >> bits == 0).then_some(number);
        }
    }
    None
}

macro_rules! stored_numbers {
    ($($type:ty: $bits:expr),+) => {$(
        impl Stored for $type {
            fn put(&self, out: &mut Vec<u8>) {
                put_number(*self as u64, out);
            }

            fn take(from: &mut &[u8]) -> Option<Self> {
                Some(take_number(from, $bits)? as Self)
            }
        }
    )+};
}
stored_numbers!(u8: 8, u16: 16, u32: NUMBER_BITS, u64: COUNT_BITS, usize: COUNT_BITS);

/// Small numbers of either sign are short.
macro_rules! stored_signed {
    ($($type:ty: $unsigned:ty),+) => {$(
        impl Stored for $type {
            fn put(&self, out: &mut Vec<u8>) {
                put_number(((self << 1) ^ (self >> (<$type>::BITS - 1))) as $unsigned as u64, out);
            }

            fn take(from: &mut &[u8]) -> Option<Self> {
                let folded = take_number(from, <$type>::BITS)? as $unsigned;
                Some((folded >> 1) as Self ^ -((folded & 1) as Self))
            }
        }
    )+};
}
stored_signed!(i16: u16, i32: u32);

impl Stored for bool {
    fn put(&self, out: &mut Vec<u8>) {
        out.push(u8::from(*self));
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        match array(from)? {
            [0] => Some(false),
            [1] => Some(true),
            _ => None,
        }
    }
}

/// Any number but none at all.
impl Stored for f64 {
    fn put(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.to_le_bytes());
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        Some(Self::from_le_bytes(array(from)?)).filter(|number| !number.is_nan())
    }
}

/// Anything, for what was measured may be unknown.
impl Stored for f32 {
    fn put(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.to_le_bytes());
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        Some(Self::from_le_bytes(array(from)?))
    }
}

impl Stored for Stamp {
    fn put(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.0.to_le_bytes());
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        Some(Self(i64::from_le_bytes(array(from)?)))
    }
}

impl Stored for String {
    fn put(&self, out: &mut Vec<u8>) {
        self.len().put(out);
        out.extend_from_slice(self.as_bytes());
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        let length = usize::take(from)?;
        let (text, left) = from.split_at_checked(length)?;
        *from = left;
        Some(std::str::from_utf8(text).ok()?.to_owned())
    }
}

impl<T: Stored> Stored for Option<T> {
    fn put(&self, out: &mut Vec<u8>) {
        self.is_some().put(out);
        self.iter().for_each(|value| value.put(out));
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        Some(if bool::take(from)? { Some(T::take(from)?) } else { None })
    }
}

impl<T: Stored> Stored for Vec<T> {
    fn put(&self, out: &mut Vec<u8>) {
        self.len().put(out);
        self.iter().for_each(|value| value.put(out));
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        let length = usize::take(from)?;
        (0..length).map(|_| T::take(from)).collect()
    }
}

impl<T: Stored> Stored for VecDeque<T> {
    fn put(&self, out: &mut Vec<u8>) {
        self.len().put(out);
        self.iter().for_each(|value| value.put(out));
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        Vec::take(from).map(Self::from)
    }
}

impl<T: Stored, const N: usize> Stored for [T; N] {
    fn put(&self, out: &mut Vec<u8>) {
        self.iter().for_each(|value| value.put(out));
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        let values: Vec<T> = (0..N).map(|_| T::take(from)).collect::<Option<_>>()?;
        values.try_into().ok()
    }
}

macro_rules! stored_tuples {
    ($(($($name:ident),+)),+) => {$(
        #[allow(non_snake_case, reason = "a value is called as its type")]
        impl<$($name: Stored),+> Stored for ($($name,)+) {
            fn put(&self, out: &mut Vec<u8>) {
                let ($($name,)+) = self;
                $($name.put(out);)+
            }

            fn take(from: &mut &[u8]) -> Option<Self> {
                Some(($($name::take(from)?,)+))
            }
        }
    )+};
}
stored_tuples!((A, B), (A, B, C), (A, B, C, D));

/// Finite.
impl Stored for Pose2 {
    fn put(&self, out: &mut Vec<u8>) {
        [self.x, self.y, self.theta].put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        let [x, y, theta] = Stored::take(from)?;
        // not `new`, which wraps and may change the last digit
        Some(Self { x, y, theta }).filter(|pose| pose.is_finite())
    }
}

/// Of unit length; what is read is not normalised again, which may change the last digit.
impl Stored for UnitQuaternion<f64> {
    fn put(&self, out: &mut Vec<u8>) {
        [self.i, self.j, self.k, self.w].put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        let [i, j, k, w]: [f64; 4] = Stored::take(from)?;
        let rotation = Quaternion::new(w, i, j, k);
        let is_unit = (rotation.norm_squared() - 1.0).abs() < UNIT_WITHIN;
        is_unit.then(|| Self::new_unchecked(rotation))
    }
}

/// Finite, of unit rotation.
impl Stored for Pose3 {
    fn put(&self, out: &mut Vec<u8>) {
        <[f64; 3]>::from(self.translation).put(out);
        self.rotation.put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        let (translation, rotation): ([f64; 3], _) = Stored::take(from)?;
        Some(Self { translation: translation.into(), rotation }).filter(|pose| pose.is_finite())
    }
}

/// Finite and of some reason.
macro_rules! stored_matrix {
    ($matrix:ident, $entries:literal) => {
        impl Stored for $matrix<f64> {
            fn put(&self, out: &mut Vec<u8>) {
                self.iter().for_each(|entry| entry.put(out));
            }

            fn take(from: &mut &[u8]) -> Option<Self> {
                let entries: [f64; $entries] = Stored::take(from)?;
                entries.iter().all(|entry| entry.abs() <= LARGEST_ENTRY).then(|| Self::from_column_slice(&entries))
            }
        }
    };
}
stored_matrix!(Vector3, 3);
stored_matrix!(Matrix3, 9);
stored_matrix!(Matrix6, 36);

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test may fail loudly")]
mod tests {
    use super::*;
    use proptest::prelude::*;

    type Everything = (
        (Vec<Option<[f64; 2]>>, VecDeque<(u32, i16, f32)>, bool, String),
        (i32, u64, [u16; 3], Stamp),
        (Pose2, Matrix3<f64>, u8),
    );

    fn everything(numbers: &[(f64, u32)], small: i32, text: String) -> Everything {
        let x = numbers.first().map_or(0.5, |(x, _)| *x);
        let some = numbers.iter().map(|&(x, k)| k.is_multiple_of(2).then_some([x, -x])).collect();
        let all = numbers.iter().map(|&(x, k)| (k >> 1, k as i16, x as f32)).collect();
        let count = u64::from(small.unsigned_abs()) << 24;
        let codes = [small as u16, 0, u16::MAX];
        let matrix = Matrix3::from_fn(|row, column| x / (1.0 + row as f64 + 3.0 * column as f64));
        let pose = Pose2 { x, y: -0.0, theta: 0.1 * x };
        let head = (some, all, small < 0, text);
        (head, (small, count, codes, Stamp(i64::from(small) << 31)), (pose, matrix, small as u8))
    }

    proptest! {
        #[test]
        fn what_was_written_comes_back_and_any_bytes_are_survived(
            numbers in prop::collection::vec((-1e9..1e9_f64, any::<u32>()), 0..20), small in any::<i32>(), text in ".*",
            damage in prop::collection::vec((any::<prop::sample::Index>(), 1..=255_u8), 1..4),
        ) {
            let value = everything(&numbers, small, text);
            let mut bytes = Vec::new();
            value.put(&mut bytes);
            let mut from = &bytes[..];
            prop_assert_eq!(Everything::take(&mut from).unwrap(), value);
            prop_assert!(from.is_empty());
            prop_assert_eq!(Everything::take(&mut &bytes[..bytes.len() - 1]), None);
            for (at, flip) in damage {
                let at = at.index(bytes.len());
                bytes[at] ^= flip;
            }
            let _ = Everything::take(&mut &bytes[..]);
        }
    }

    #[test]
    fn lengths_are_not_believed_and_counters_have_room() {
        let huge = [0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x7f];
        assert_eq!(usize::take(&mut &huge[..]), Some((1 << 56) - 1));
        assert_eq!(Vec::<u8>::take(&mut &huge[..]), None);
        assert_eq!(String::take(&mut &huge[..]), None);
        let mut bytes = Vec::new();
        u32::MAX.put(&mut bytes);
        assert_eq!(u32::take(&mut &bytes[..]), None);
        assert_eq!(f64::take(&mut &f64::NAN.to_le_bytes()[..]), None);
    }
}
