//! Writing bytes: ROS 1's serialization and plain little-endian CDR.

use crate::error::RosError;
use crate::wire::{Encoding, Scalar};

/// A message being written.
#[derive(Debug, Clone)]
pub struct Encoder {
    out: Vec<u8>,
    encoding: Encoding,
    too_long: Option<usize>,
}

impl Encoder {
    /// An empty message, for CDR with its encapsulation header.
    #[must_use]
    pub fn new(encoding: Encoding) -> Self {
        let out = if encoding == Encoding::Cdr { vec![0, 1, 0, 0] } else { Vec::new() };
        Self { out, encoding, too_long: None }
    }

    /// How the message is serialized.
    #[must_use]
    pub fn encoding(&self) -> Encoding {
        self.encoding
    }

    /// Appends a number.
    pub fn scalar<T: Scalar>(&mut self, value: T) {
        self.align(T::PRIMITIVE.size());
        value.encode(&mut self.out);
    }

    /// Appends numbers without their count.
    pub fn numbers<T: Scalar>(&mut self, values: impl ExactSizeIterator<Item = T>) {
        if values.len() > 0 {
            self.align(T::PRIMITIVE.size());
            self.out.reserve(values.len() * T::PRIMITIVE.size());
            values.for_each(|value| value.encode(&mut self.out));
        }
    }

    /// Appends bytes without their count.
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.out.extend_from_slice(bytes);
    }

    /// Appends the length of a list.
    pub fn count(&mut self, count: usize) {
        let short = u32::try_from(count).unwrap_or_else(|_| {
            self.too_long = Some(count);
            u32::MAX
        });
        self.scalar(short);
    }

    /// Appends a text.
    pub fn text(&mut self, text: &str) {
        let ending = usize::from(self.encoding == Encoding::Cdr);
        self.count(text.len() + ending);
        self.out.extend_from_slice(text.as_bytes());
        self.out.extend_from_slice(&[0][..ending]);
    }

    /// The message.
    ///
    /// # Errors
    /// [`RosError::TooLong`] where a length did not fit.
    pub fn finish(self) -> Result<Vec<u8>, RosError> {
        match self.too_long {
            Some(found) => Err(RosError::TooLong { found }),
            None => Ok(self.out),
        }
    }

    fn align(&mut self, size: usize) {
        if self.encoding == Encoding::Cdr {
            let body_bytes = self.out.len() - 4;
            self.out.resize(4 + body_bytes.next_multiple_of(size), 0);
        }
    }
}
