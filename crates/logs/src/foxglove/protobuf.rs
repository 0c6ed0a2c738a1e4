//! The fields of a protobuf message (encoding guide, "Message structure"), as far as they are needed.

/// What a field has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part<'a> {
    /// A number of any length, its bits.
    Number(u64),
    /// A text, bytes, or a message.
    Bytes(&'a [u8]),
}

/// A message's fields, each with its number, until one cannot be read.
pub(super) struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    pub(super) fn of(message: &'a [u8]) -> Self {
        Self(message)
    }

    fn varint(&mut self) -> Option<u64> {
        let mut value = 0;
        for place in 0..10 {
            let (byte, rest) = self.0.split_first()?;
            self.0 = rest;
            value |= u64::from(byte & 0x7f) << (7 * place);
            if byte & 0x80 == 0 {
                return Some(value);
            }
        }
        None
    }

    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (bytes, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(bytes)
    }

    fn field(&mut self) -> Option<(u64, Part<'a>)> {
        let key = self.varint()?;
        let part = match key & 7 {
            0 => Part::Number(self.varint()?),
            1 => Part::Number(u64::from_le_bytes(self.take(8)?.try_into().ok()?)),
            2 => {
                let length = usize::try_from(self.varint()?).ok()?;
                Part::Bytes(self.take(length)?)
            }
            5 => Part::Number(u64::from(u32::from_le_bytes(self.take(4)?.try_into().ok()?))),
            _ => return None,
        };
        Some((key >> 3, part))
    }
}

impl<'a> Iterator for Fields<'a> {
    type Item = Result<(u64, Part<'a>), String>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.0.is_empty() {
            return None;
        }
        let left = self.0.len();
        let field = self.field();
        if field.is_none() {
            self.0 = &[];
        }
        Some(field.ok_or_else(|| format!("expected a field of protobuf, found none {left} bytes before the end")))
    }
}

/// The first numbers of a message of numbers; zero where it has none.
pub(super) fn numbers<const N: usize>(message: &[u8]) -> Result<[u64; N], String> {
    let mut numbers = [0; N];
    for entry in Fields::of(message) {
        if let (field, Part::Number(number)) = entry?
            && let Some(place) = usize::try_from(field).ok().and_then(|field| numbers.get_mut(field.wrapping_sub(1)))
        {
            *place = number;
        }
    }
    Ok(numbers)
}

/// The same of doubles.
pub(super) fn doubles<const N: usize>(message: &[u8]) -> Result<[f64; N], String> {
    numbers(message).map(|numbers| numbers.map(f64::from_bits))
}
