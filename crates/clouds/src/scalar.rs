//! Numbers of any type in bytes.

/// Type of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Scalar {
    pub(crate) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    pub(crate) fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    /// The number at an offset; not a number behind the end.
    #[inline]
    pub(crate) fn read(self, bytes: &[u8], at: usize, is_big_endian: bool) -> f64 {
        match self {
            Self::I8 => array(bytes, at).map_or(f64::NAN, |b| f64::from(i8::from_le_bytes(b))),
            Self::U8 => array::<1>(bytes, at).map_or(f64::NAN, |b| f64::from(b[0])),
            Self::I16 => ordered(bytes, at, is_big_endian).map_or(f64::NAN, |b| f64::from(i16::from_le_bytes(b))),
            Self::U16 => ordered(bytes, at, is_big_endian).map_or(f64::NAN, |b| f64::from(u16::from_le_bytes(b))),
            Self::I32 => ordered(bytes, at, is_big_endian).map_or(f64::NAN, |b| f64::from(i32::from_le_bytes(b))),
            Self::U32 => ordered(bytes, at, is_big_endian).map_or(f64::NAN, |b| f64::from(u32::from_le_bytes(b))),
            Self::I64 => ordered(bytes, at, is_big_endian).map_or(f64::NAN, |b| i64::from_le_bytes(b) as f64),
            Self::U64 => ordered(bytes, at, is_big_endian).map_or(f64::NAN, |b| u64::from_le_bytes(b) as f64),
            Self::F32 => ordered(bytes, at, is_big_endian).map_or(f64::NAN, |b| f64::from(f32::from_le_bytes(b))),
            Self::F64 => ordered(bytes, at, is_big_endian).map_or(f64::NAN, f64::from_le_bytes),
        }
    }
}

/// `N` bytes from an offset on; none behind the end.
#[inline]
pub(crate) fn array<const N: usize>(bytes: &[u8], at: usize) -> Option<[u8; N]> {
    bytes.get(at..)?.first_chunk().copied()
}

/// The same, turned to little endian.
#[inline]
fn ordered<const N: usize>(bytes: &[u8], at: usize, is_big_endian: bool) -> Option<[u8; N]> {
    let mut found: [u8; N] = array(bytes, at)?;
    if is_big_endian {
        found.reverse();
    }
    Some(found)
}
