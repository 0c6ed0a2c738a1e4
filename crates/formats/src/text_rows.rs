//! Rows of numbers in text files that must be right: any bad row is an error.

use crate::error::FormatError;
use crate::excerpt::Excerpt;
use crate::lines::LineReader;
use crate::number::{parse_f64, parse_stamp};
use mapwright_geom::Stamp;
use std::io::Read;

/// Columns that a row can have.
const MAX_COLUMNS: usize = 12;

/// Reads rows of columns that blanks, commas or semicolons separate; blank lines and those beginning with `#` are passed over, as is a first
/// line that names the columns.
#[derive(Debug)]
pub(crate) struct RowReader<R> {
    lines: LineReader<R>,
    is_begun: bool,
}

impl<R: Read> RowReader<R> {
    pub(crate) fn new(reader: R) -> Self {
        Self { lines: LineReader::new(reader), is_begun: false }
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
            if !std::mem::replace(&mut self.is_begun, true) && names_columns(content, widths) {
                continue;
            }
            // The line is looked up again: it cannot be lent across the turns of the loop.
            let content = self.lines.last_line().trim_ascii();
            return Row::split(number, content, widths, expected).map(Some);
        }
    }
}

/// The columns' words of a line.
fn words(content: &[u8]) -> impl Iterator<Item = &[u8]> {
    let is_between = |byte: &u8| byte.is_ascii_whitespace() || b",;".contains(byte);
    content.split(is_between).filter(|word| !word.is_empty())
}

/// Whether a line has as many columns as a row, and none is a number.
fn names_columns(content: &[u8], widths: &[usize]) -> bool {
    widths.contains(&words(content).count()) && words(content).all(|word| parse_f64(word).is_none())
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
        for word in self::words(content) {
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

    /// Numbers from a column on, which need not be finite.
    pub(crate) fn any_numbers<const N: usize>(&self, column: usize) -> Result<[f64; N], FormatError> {
        let mut numbers = [0.0; N];
        for (offset, number) in numbers.iter_mut().enumerate() {
            let at = column + offset;
            *number = parse_f64(self.words[at]).ok_or_else(|| self.bad(at, "a number"))?;
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

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(text: &str) -> Result<Vec<[f64; 3]>, String> {
        let mut reader = RowReader::new(text.as_bytes());
        let mut rows = Vec::new();
        while let Some(row) = reader.next_row(&[3], "a b c").map_err(|error| error.to_string())? {
            rows.push(row.numbers(0).map_err(|error| error.to_string())?);
        }
        Ok(rows)
    }

    #[test]
    fn commas_and_a_line_of_names_are_read() {
        for text in
            ["1 2 3\n4 5 6\n", "a,b,c\n1,2,3\n4, 5, 6\n", "# x\n\na b c\n1;2;3\n4 5 6", "\"a\"\tb\tc\n1 2 3\n4,5,6"]
        {
            assert_eq!(rows(text), Ok(vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), "{text}");
        }
        for text in ["a b c\na b c\n1 2 3", "1 2 3\na b c", "a b\n1 2 3", "a 2 c\n1 2 3", "1,2\n"] {
            assert!(rows(text).is_err(), "{text}");
        }
    }
}
