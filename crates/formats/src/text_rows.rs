//! Rows of numbers in text files that must be right: any bad row is an error.

use crate::error::FormatError;
use crate::excerpt::Excerpt;
use crate::lines::LineReader;
use crate::number::{parse_f64, parse_stamp};
use mapwright_geom::Stamp;
use std::io::Read;

/// Columns that a row can have.
const MAX_COLUMNS: usize = 12;

/// Reads rows of blank-separated columns; blank lines and those beginning with `#` are passed over.
#[derive(Debug)]
pub(crate) struct RowReader<R> {
    lines: LineReader<R>,
}

impl<R: Read> RowReader<R> {
    pub(crate) fn new(reader: R) -> Self {
        Self { lines: LineReader::new(reader) }
    }

    /// The next row, which must have one of the numbers of columns in `widths`; `expected` names the columns.
    pub(crate) fn next_row(
        &mut self,
        widths: &[usize],
        expected: &'static str,
    ) -> Result<Option<Row<'_>>, FormatError> {
        loop {
            let Some(line) = self.lines.next_line()? else {
                return self.lines.take_tear().map_or(Ok(None), Err);
            };
            let (number, content) = (line.number, line.bytes.trim_ascii());
            if content.is_empty() || content[0] == b'#' {
                continue;
            }
            // The line is looked up again: it cannot be lent across the turns of the loop.
            let content = self.lines.last_line().trim_ascii();
            return Row::split(number, content, widths, expected).map(Some);
        }
    }
}

/// The columns of one line.
#[derive(Debug)]
pub(crate) struct Row<'a> {
    line: u64,
    words: [&'a [u8]; MAX_COLUMNS],
    /// How many there are.
    pub(crate) width: usize,
}

impl<'a> Row<'a> {
    fn split(line: u64, content: &'a [u8], widths: &[usize], expected: &'static str) -> Result<Self, FormatError> {
        let mut words = [&b""[..]; MAX_COLUMNS];
        let mut width = 0;
        for word in content.split(|b| b.is_ascii_whitespace()).filter(|w| !w.is_empty()) {
            if width < MAX_COLUMNS {
                words[width] = word;
            }
            width += 1;
        }
        if widths.contains(&width) {
            return Ok(Self { line, words, width });
        }
        let found = Excerpt::remark(format!("{width} columns: {}", Excerpt::new(content)));
        Err(FormatError::Line { line, expected: expected.to_owned(), found })
    }

    /// The stamp in a column.
    pub(crate) fn stamp(&self, column: usize) -> Result<Stamp, FormatError> {
        parse_stamp(self.words[column]).ok_or_else(|| self.bad(column, "a stamp in seconds"))
    }

    /// Finite numbers from a column on.
    pub(crate) fn numbers<const N: usize>(&self, column: usize) -> Result<[f64; N], FormatError> {
        let mut numbers = [0.0; N];
        for (offset, number) in numbers.iter_mut().enumerate() {
            *number = self.number(column + offset)?;
        }
        Ok(numbers)
    }

    fn number(&self, column: usize) -> Result<f64, FormatError> {
        let number = parse_f64(self.words[column]).filter(|v| v.is_finite());
        number.ok_or_else(|| self.bad(column, "a finite number"))
    }

    /// The error for a column that is not what it should be.
    pub(crate) fn bad(&self, column: usize, expected: &str) -> FormatError {
        let expected = format!("{expected} in column {}", column + 1);
        FormatError::Line { line: self.line, expected, found: Excerpt::new(self.words[column]) }
    }
}
