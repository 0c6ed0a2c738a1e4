//! Pieces of files in reports and errors.

use std::fmt;

/// A short, printable piece of what was found in a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Excerpt(String);

impl Excerpt {
    /// Characters kept.
    const MAX_CHARS: usize = 48;
    /// So few characters are shown whatever they are; of more no more than this share may be such as no text has.
    const CHARS_SHOWN: usize = 8;
    const ODD_SHARE: f64 = 0.25;

    /// The beginning of `bytes`, with control characters and broken text made visible; `nothing` where it is empty.
    #[must_use]
    pub fn new(bytes: &[u8]) -> Self {
        if bytes.is_empty() {
            return Self("nothing".to_owned());
        }
        let shown = String::from_utf8_lossy(&bytes[..bytes.len().min(4 * Self::MAX_CHARS)]);
        let first = shown.chars().take(Self::MAX_CHARS);
        let is_odd = |c: &char| *c == char::REPLACEMENT_CHARACTER || c.is_control() && !c.is_ascii_whitespace();
        let (all, odd) = (first.clone().count(), first.filter(is_odd).count());
        if all >= Self::CHARS_SHOWN && odd as f64 > Self::ODD_SHARE * all as f64 {
            return Self(Self::in_hex(bytes));
        }
        let mut text = String::from("`");
        text.extend(shown.chars().take(Self::MAX_CHARS).flat_map(char::escape_debug));
        text.push_str(if bytes.len() > Self::MAX_CHARS { "...`" } else { "`" });
        Self(text)
    }

    /// The first eight bytes as numbers.
    fn in_hex(bytes: &[u8]) -> String {
        let first: Vec<_> = bytes.iter().take(8).map(|byte| format!("{byte:02x}")).collect();
        format!("{} bytes that are no text, the first {}", bytes.len(), first.join(" "))
    }

    /// A count or remark instead of the bytes themselves.
    pub(crate) fn remark(text: impl Into<String>) -> Self {
        Self(text.into())
    }
}

impl fmt::Display for Excerpt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn excerpts_are_short_and_printable() {
        assert_eq!(Excerpt::new(b"").to_string(), "nothing");
        assert_eq!(Excerpt::new(b"a\x00b").to_string(), "`a\\0b`");
        assert!(Excerpt::new(&[b'z'; 1_000_000]).to_string().len() < 60);
        let header = b"E\0\0\0\x04\0\0\0op=\x03\x12\0\0\0index";
        assert_eq!(Excerpt::new(header).to_string(), "21 bytes that are no text, the first 45 00 00 00 04 00 00 00");
    }
}
