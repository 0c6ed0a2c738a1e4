//! Bytes of a file or of a decompressed chunk, by their place.

use std::io::{self, Read, Seek, SeekFrom};

/// Read beyond what is asked for, so that small records cost no call each.
const READ_AHEAD_BYTES: u64 = 1 << 16;

/// Bytes by their place.
pub(crate) trait Bytes {
    /// Where they end.
    fn end(&self) -> u64;

    /// `n` bytes from `offset` on; fewer only where the bytes end.
    fn get(&mut self, offset: u64, n: usize) -> io::Result<&[u8]>;
}

/// A part of a file in memory, moved on as bytes are asked for. Never larger than what was asked for in one go, and
/// that never larger than the file.
#[derive(Debug)]
pub(crate) struct Window<R> {
    reader: R,
    reader_at: u64,
    end: u64,
    start: u64,
    filled: usize,
    /// Kept at its largest length ever, so that nothing is zeroed twice.
    buffer: Vec<u8>,
}

impl<R: Read + Seek> Window<R> {
    pub(crate) fn new(mut reader: R) -> io::Result<Self> {
        let end = reader.seek(SeekFrom::End(0))?;
        reader.rewind()?;
        Ok(Self { reader, reader_at: 0, end, start: 0, filled: 0, buffer: Vec::new() })
    }

    /// Bytes of memory held.
    pub(crate) fn held_bytes(&self) -> usize {
        self.buffer.capacity()
    }

    fn refill(&mut self, offset: u64, n: usize) -> io::Result<()> {
        self.keep_from(offset);
        let wanted = (n as u64 + READ_AHEAD_BYTES).min(self.end - offset) as usize;
        if self.buffer.len() < wanted {
            self.buffer.reserve_exact(wanted - self.buffer.len());
            self.buffer.resize(wanted, 0);
        }
        let at = self.start + self.filled as u64;
        if self.reader_at != at {
            self.reader_at = self.reader.seek(SeekFrom::Start(at))?;
        }
        while self.filled < n {
            match self.reader.read(&mut self.buffer[self.filled..wanted]) {
                Ok(0) => {
                    self.end = self.start + self.filled as u64; // the file became shorter
                    break;
                }
                Ok(got) => {
                    self.filled += got;
                    self.reader_at += got as u64;
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Moves what is there from `offset` on to the front.
    fn keep_from(&mut self, offset: u64) {
        let place = offset.checked_sub(self.start).map_or(self.filled, |place| place.min(self.filled as u64) as usize);
        self.buffer.copy_within(place..self.filled, 0);
        self.filled -= place;
        self.start = offset;
    }
}

impl<R: Read + Seek> Bytes for Window<R> {
    fn end(&self) -> u64 {
        self.end
    }

    fn get(&mut self, offset: u64, n: usize) -> io::Result<&[u8]> {
        let offset = offset.min(self.end);
        let n = (n as u64).min(self.end - offset) as usize;
        let is_there = offset >= self.start && offset - self.start + n as u64 <= self.filled as u64;
        if !is_there {
            self.refill(offset, n)?;
        }
        let from = (offset - self.start) as usize;
        Ok(&self.buffer[from..(from + n).min(self.filled)])
    }
}

/// A decompressed chunk.
#[derive(Debug, Default)]
pub(crate) struct Memory {
    /// Kept at its largest length ever, so that nothing is zeroed twice.
    pub(crate) buffer: Vec<u8>,
    pub(crate) filled: usize,
}

impl Memory {
    /// Makes room for so many bytes, and no more than that.
    pub(crate) fn reach(&mut self, length: usize) {
        if self.buffer.len() < length {
            self.buffer.reserve_exact(length - self.buffer.len());
            self.buffer.resize(length, 0);
        }
    }
}

impl Bytes for Memory {
    fn end(&self) -> u64 {
        self.filled as u64
    }

    fn get(&mut self, offset: u64, n: usize) -> io::Result<&[u8]> {
        let from = offset.min(self.filled as u64) as usize;
        Ok(&self.buffer[from..from.saturating_add(n).min(self.filled)])
    }
}

pub(crate) fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    bytes.get(at..at.checked_add(2)?)?.try_into().ok().map(u16::from_le_bytes)
}

pub(crate) fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..at.checked_add(4)?)?.try_into().ok().map(u32::from_le_bytes)
}

pub(crate) fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    bytes.get(at..at.checked_add(8)?)?.try_into().ok().map(u64::from_le_bytes)
}

/// Bytes for a report: the first few as text.
pub(crate) fn excerpt(bytes: &[u8]) -> String {
    let shown = bytes.get(..24).unwrap_or(bytes);
    format!("\"{}\"{}", shown.escape_ascii(), if bytes.len() > shown.len() { "..." } else { "" })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    #[test]
    fn any_place_can_be_read_in_any_order_and_ends_where_the_file_does() {
        let content: Vec<u8> = (0..300_000_u32).map(|i| (i * 7 % 251) as u8).collect();
        let mut window = Window::new(Cursor::new(&content)).unwrap();
        for (offset, n) in [(0, 10), (5, 100_000), (99_000, 3), (250_000, 90_000), (10, 20), (299_999, 5), (400_000, 1)]
        {
            let from = (offset as usize).min(content.len());
            let expected = &content[from..(from + n).min(content.len())];
            assert_eq!(window.get(offset, n).unwrap(), expected);
        }
        assert!(window.buffer.len() <= content.len());
        assert!(window.get(u64::MAX, usize::MAX).unwrap().is_empty());
    }
}
