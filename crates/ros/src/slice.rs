//! Arrays of numbers that stay where they are.

use crate::wire::Scalar;

/// Numbers of a message, not copied; or numbers to be written.
#[derive(Debug, Clone, Copy)]
pub enum Slice<'a, T> {
    /// As they are in a message; a whole number of elements.
    Wire {
        /// The elements' bytes.
        bytes: &'a [u8],
        /// Whether the most significant byte comes first.
        big_endian: bool,
    },
    /// As they are in memory.
    Native(&'a [T]),
}

impl<'a, T: Scalar> Slice<'a, T> {
    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Wire { bytes, .. } => bytes.len() / T::PRIMITIVE.size(),
            Self::Native(values) => values.len(),
        }
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// One of them; none beyond the end.
    #[must_use]
    pub fn get(&self, index: usize) -> Option<T> {
        match *self {
            Self::Wire { bytes, big_endian } => {
                let size = T::PRIMITIVE.size();
                let start = index.checked_mul(size)?;
                bytes.get(start..start.checked_add(size)?).map(|bytes| T::decode(bytes, big_endian))
            }
            Self::Native(values) => values.get(index).copied(),
        }
    }

    /// All of them in order.
    pub fn iter(&self) -> SliceIter<'a, T> {
        SliceIter { slice: *self, next: 0 }
    }

    /// A copy of all of them.
    #[must_use]
    pub fn to_vec(&self) -> Vec<T> {
        let size = T::PRIMITIVE.size();
        match *self {
            // one loop for each endianness, so that neither has a branch inside
            Self::Wire { bytes, big_endian: false } => bytes.chunks_exact(size).map(|b| T::decode(b, false)).collect(),
            Self::Wire { bytes, big_endian: true } => bytes.chunks_exact(size).map(|b| T::decode(b, true)).collect(),
            Self::Native(values) => values.to_vec(),
        }
    }
}

impl<T> Default for Slice<'_, T> {
    fn default() -> Self {
        Self::Native(&[])
    }
}

impl<'a, T> From<&'a [T]> for Slice<'a, T> {
    fn from(values: &'a [T]) -> Self {
        Self::Native(values)
    }
}

impl<T: Scalar> PartialEq for Slice<'_, T> {
    fn eq(&self, other: &Self) -> bool {
        self.len() == other.len() && self.iter().eq(other.iter())
    }
}

impl<'a, T: Scalar> IntoIterator for Slice<'a, T> {
    type Item = T;
    type IntoIter = SliceIter<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

/// The elements of a [`Slice`].
#[derive(Debug, Clone)]
pub struct SliceIter<'a, T> {
    slice: Slice<'a, T>,
    next: usize,
}

impl<T: Scalar> Iterator for SliceIter<'_, T> {
    type Item = T;

    #[inline]
    fn next(&mut self) -> Option<T> {
        let value = self.slice.get(self.next)?;
        self.next += 1;
        Some(value)
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = self.slice.len() - self.next;
        (left, Some(left))
    }
}

impl<T: Scalar> ExactSizeIterator for SliceIter<'_, T> {}
