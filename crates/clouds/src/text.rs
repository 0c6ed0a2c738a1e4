//! Files of rows of numbers.

/// The longest excerpt in a report, characters.
const EXCERPT_CHARS: usize = 60;

/// A row, and where it begins.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row<'a> {
    pub(crate) offset_bytes: usize,
    pub(crate) text: &'a [u8],
}

impl<'a> Row<'a> {
    /// Its fields, separated by blanks or commas.
    pub(crate) fn fields(self) -> impl Iterator<Item = &'a str> {
        let is_blank = |byte: &u8| byte.is_ascii_whitespace() || *byte == b',';
        self.text
            .split(is_blank)
            .filter(|field| !field.is_empty())
            .map(|field| std::str::from_utf8(field).unwrap_or("?"))
    }

    /// Its fields as numbers, of which none may be anything else.
    pub(crate) fn numbers(self) -> Option<Vec<f64>> {
        self.fields().map(|field| field.parse().ok()).collect()
    }

    pub(crate) fn excerpt(self) -> String {
        excerpt(self.text)
    }
}

/// Rows that are neither empty nor comments (`#`, `%`).
pub(crate) fn rows(bytes: &[u8]) -> impl Iterator<Item = Row<'_>> {
    let mut offset = 0;
    bytes.split(|byte| *byte == b'\n').filter_map(move |line| {
        let row = Row { offset_bytes: offset, text: line.trim_ascii() };
        offset += line.len() + 1;
        let first = row.text.first()?;
        (!matches!(first, b'#' | b'%')).then_some(row)
    })
}

/// The beginning of some bytes, to be shown.
pub(crate) fn excerpt(bytes: &[u8]) -> String {
    let head = bytes.get(..4 * EXCERPT_CHARS).unwrap_or(bytes);
    let text = String::from_utf8_lossy(head);
    let mut shown: String = text.chars().take(EXCERPT_CHARS).map(|c| if c.is_control() { '.' } else { c }).collect();
    if shown.len() < bytes.len() && text.chars().count() > EXCERPT_CHARS {
        shown.push_str("...");
    }
    if shown.is_empty() { "nothing".to_owned() } else { format!("`{shown}`") }
}

/// Seconds of Unix of year, month, day, hour, minute and second.
pub(crate) fn seconds_of_date([year, month, day, hour, minute, second]: [i64; 6]) -> i64 {
    // days from the civil calendar, counted from March, so that leap days stand last
    let years = year - i64::from(month <= 2);
    let (era, of_era) = (years.div_euclid(400), years.rem_euclid(400));
    let of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    let days = era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + of_year - 719_468;
    days * 86_400 + hour * 3600 + minute * 60 + second
}
