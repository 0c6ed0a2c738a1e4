//! Numbers as the protocol lays them out, of either byte order.

/// What is left to be read of some bytes. Whatever is asked beyond their end is none.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reader<'a> {
    rest: &'a [u8],
    /// Least significant byte first.
    pub(crate) is_little: bool,
}

impl<'a> Reader<'a> {
    pub(crate) fn new(bytes: &'a [u8], is_little: bool) -> Self {
        Self { rest: bytes, is_little }
    }

    pub(crate) fn rest(&self) -> &'a [u8] {
        self.rest
    }

    pub(crate) fn take(&mut self, length: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.rest.split_at_checked(length)?;
        self.rest = rest;
        Some(taken)
    }

    pub(crate) fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    pub(crate) fn u16(&mut self) -> Option<u16> {
        let bytes = self.array()?;
        Some(if self.is_little { u16::from_le_bytes(bytes) } else { u16::from_be_bytes(bytes) })
    }

    pub(crate) fn u32(&mut self) -> Option<u32> {
        let bytes = self.array()?;
        Some(if self.is_little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
    }

    /// A sequence number: the upper half, with its sign, comes first whatever the byte order (9.3.2.10).
    pub(crate) fn sequence_number(&mut self) -> Option<i64> {
        let high = self.u32()?.cast_signed();
        Some(i64::from(high) << 32 | i64::from(self.u32()?))
    }

    /// A text with its length in front and a zero at its end.
    pub(crate) fn text(&mut self) -> Option<&'a str> {
        let length = usize::try_from(self.u32()?).ok()?;
        std::str::from_utf8(self.take(length)?.strip_suffix(&[0])?).ok()
    }
}

/// Puts down numbers, least significant byte first.
pub(crate) trait Put {
    fn put_u16(&mut self, number: u16);
    fn put_u32(&mut self, number: u32);
    fn put_sequence_number(&mut self, number: i64);
}

impl Put for Vec<u8> {
    fn put_u16(&mut self, number: u16) {
        self.extend(number.to_le_bytes());
    }

    fn put_u32(&mut self, number: u32) {
        self.extend(number.to_le_bytes());
    }

    fn put_sequence_number(&mut self, number: i64) {
        let bytes = number.to_le_bytes();
        self.extend(&bytes[4..]);
        self.extend(&bytes[..4]);
    }
}
