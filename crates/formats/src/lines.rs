//! Lines out of a stream, with bounded memory.

use crate::error::FormatError;
use std::io::{self, Read};

/// First size of the buffer; large reads keep system calls rare.
const BUFFER_BYTES: usize = 256 * 1024;

/// What editors write at the beginning of UTF-8 text.
const BYTE_ORDER_MARK: &[u8] = &[0xEF, 0xBB, 0xBF];

/// Longest line that is read; longer ones are skipped and reported.
pub(crate) const MAX_LINE_BYTES: usize = 16 * 1024 * 1024;

/// One line without its ending.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Line<'a> {
    /// From 1.
    pub(crate) number: u64,
    /// Content without line feed and carriage return; only the beginning where `skipped_bytes` is set.
    pub(crate) bytes: &'a [u8],
    /// Whether a line feed ended it; false only for the last line of a file.
    pub(crate) terminated: bool,
    /// Length of a line that was too long to be read.
    pub(crate) skipped_bytes: Option<u64>,
}

/// Splits a stream into lines; no allocation per line.
#[derive(Debug)]
pub(crate) struct LineReader<R> {
    reader: R,
    buffer: Vec<u8>,
    start: usize,
    end: usize,
    max_line_bytes: usize,
    lines: u64,
    bytes: u64,
    /// Where the line last handed out lies in the buffer.
    last: std::ops::Range<usize>,
    at_end: bool,
    tear: Option<FormatError>,
}

impl<R: Read> LineReader<R> {
    pub(crate) fn new(reader: R) -> Self {
        Self::with_max_line(reader, MAX_LINE_BYTES)
    }

    fn with_max_line(reader: R, max_line_bytes: usize) -> Self {
        let buffer = vec![0; BUFFER_BYTES.min(max_line_bytes)];
        let (start, end, lines, bytes) = (0, 0, 0, 0);
        Self { reader, buffer, start, end, max_line_bytes, lines, bytes, last: 0..0, at_end: false, tear: None }
    }

    /// Lines delivered or skipped so far.
    pub(crate) fn lines(&self) -> u64 {
        self.lines
    }

    /// Bytes read from the stream so far.
    pub(crate) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The line handed out last, once more, with a carriage return if it had one.
    pub(crate) fn last_line(&self) -> &[u8] {
        &self.buffer[self.last.clone()]
    }

    /// The tear that ended a compressed stream early, once.
    pub(crate) fn take_tear(&mut self) -> Option<FormatError> {
        self.tear.take()
    }

    /// The next line, or none at the end.
    pub(crate) fn next_line(&mut self) -> Result<Option<Line<'_>>, FormatError> {
        let mut searched = 0;
        loop {
            if let Some(at) = memchr::memchr(b'\n', &self.buffer[self.start + searched..self.end]) {
                return Ok(Some(self.take_line(searched + at, 1)));
            }
            searched = self.end - self.start;
            if self.at_end {
                return Ok((searched > 0).then(|| self.take_line(searched, 0)));
            }
            if searched >= self.max_line_bytes {
                return self.skip_line().map(Some);
            }
            self.fill()?;
        }
    }

    /// Hands out `length` bytes and steps over them and the `ending` bytes behind.
    fn take_line(&mut self, length: usize, ending: usize) -> Line<'_> {
        let mark = if self.lines == 0 { self.mark_bytes(length) } else { 0 };
        let (from, length) = (self.start + mark, length - mark);
        self.start = from;
        self.start += length + ending;
        self.lines += 1;
        self.last = from..from + length;
        let bytes = &self.buffer[self.last.clone()];
        let bytes = bytes.strip_suffix(b"\r").unwrap_or(bytes);
        Line { number: self.lines, bytes, terminated: ending > 0, skipped_bytes: None }
    }

    /// Length of the byte order mark before the first line.
    fn mark_bytes(&self, length: usize) -> usize {
        let line = &self.buffer[self.start..self.start + length];
        if line.starts_with(BYTE_ORDER_MARK) { BYTE_ORDER_MARK.len() } else { 0 }
    }

    /// Reads more behind what is buffered, making room first.
    fn fill(&mut self) -> Result<(), FormatError> {
        if self.end == self.buffer.len() {
            self.make_room();
        }
        let got = self.read_at(self.end)?;
        self.end += got;
        Ok(())
    }

    fn make_room(&mut self) {
        if self.start > 0 {
            self.buffer.copy_within(self.start..self.end, 0);
            self.end -= self.start;
            self.start = 0;
        } else {
            let larger = (2 * self.buffer.len()).min(self.max_line_bytes + 1);
            self.buffer.resize(larger, 0);
        }
    }

    /// Reads into the buffer from `at` on; zero bytes mean the end, also when a compressed stream is torn.
    fn read_at(&mut self, at: usize) -> Result<usize, FormatError> {
        loop {
            match self.reader.read(&mut self.buffer[at..]) {
                Ok(got) => {
                    self.at_end = got == 0;
                    self.bytes += got as u64;
                    return Ok(got);
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return self.end_at_tear(error),
            }
        }
    }

    fn end_at_tear(&mut self, error: io::Error) -> Result<usize, FormatError> {
        let tear = error.downcast::<FormatError>()?;
        self.tear = Some(tear);
        self.at_end = true;
        Ok(0)
    }

    /// Steps over a line that does not fit, keeping its beginning for the report.
    fn skip_line(&mut self) -> Result<Line<'_>, FormatError> {
        let kept = 64.min(self.end - self.start);
        self.buffer.copy_within(self.start..self.start + kept, 0);
        let mut length = (self.end - self.start) as u64;
        loop {
            let got = self.read_at(kept)?;
            (self.start, self.end) = (kept, kept + got);
            let line_feed = memchr::memchr(b'\n', &self.buffer[self.start..self.end]);
            length += line_feed.unwrap_or(got) as u64;
            if got == 0 || line_feed.is_some() {
                self.start += line_feed.map_or(got, |at| at + 1);
                self.lines += 1;
                self.last = 0..kept;
                let (number, bytes) = (self.lines, &self.buffer[..kept]);
                return Ok(Line { number, bytes, terminated: line_feed.is_some(), skipped_bytes: Some(length) });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Delivers a few bytes at a time.
    struct Dribble<'a>(&'a [u8], usize);

    impl Read for Dribble<'_> {
        fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
            let n = self.1.min(out.len()).min(self.0.len());
            out[..n].copy_from_slice(&self.0[..n]);
            self.0 = &self.0[n..];
            Ok(n)
        }
    }

    fn all(text: &[u8], step: usize, max: usize) -> Vec<(u64, Vec<u8>, bool, Option<u64>)> {
        let mut reader = LineReader::with_max_line(Dribble(text, step), max);
        let mut lines = Vec::new();
        while let Some(line) = reader.next_line().unwrap() {
            lines.push((line.number, line.bytes.to_vec(), line.terminated, line.skipped_bytes));
        }
        lines
    }

    #[test]
    fn lines_are_the_same_however_the_bytes_arrive() {
        let text = b"one\r\n\ntwo three\nfour";
        for step in 1..25 {
            let lines = all(text, step, 16);
            let texts: Vec<_> = lines.iter().map(|l| l.1.as_slice()).collect();
            assert_eq!(texts, [b"one".as_slice(), b"", b"two three", b"four"]);
            assert!(lines[2].2 && !lines[3].2);
        }
    }

    #[test]
    fn a_byte_order_mark_is_no_part_of_the_first_line() {
        for step in 1..9 {
            let lines = all(b"\xEF\xBB\xBFone\n\xEF\xBB\xBFtwo", step, 16);
            assert_eq!(
                lines.iter().map(|l| l.1.as_slice()).collect::<Vec<_>>(),
                [b"one".as_slice(), b"\xEF\xBB\xBFtwo"]
            );
        }
    }

    #[test]
    fn a_line_too_long_is_skipped_and_the_next_ones_are_read() {
        let mut text = b"a\n".to_vec();
        text.extend([b'x'; 1000]);
        text.extend(b"\nb\n");
        text.extend([b'y'; 1000]);
        for step in [1, 7, 100, 5000] {
            let lines = all(&text, step, 100);
            assert_eq!(lines.len(), 4, "{step}");
            assert_eq!((lines[1].0, lines[1].3), (2, Some(1000)));
            assert_eq!(lines[2].1, b"b");
            assert_eq!((lines[3].3, lines[3].2), (Some(1000), false));
        }
    }
}
