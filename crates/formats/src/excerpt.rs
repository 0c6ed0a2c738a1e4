//! Pieces of files in reports and errors.

use std::fmt;

/// A short, printable piece of what was found in a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Excerpt(String);

impl Excerpt {
    /// Characters kept.
    const MAX_CHARS: usize = 48;

    /// The beginning of `bytes`, with control characters and broken text made visible; `nothing` where it is empty.
    #[must_use]
    pub fn new(bytes: &[u8]) -> Self {
        if bytes.is_empty() {
            return Self("nothing".to_owned());
        }
        let shown = String::from_utf8_lossy(&bytes[..bytes.len().min(4 * Self::MAX_CHARS)]);
        let mut text = String::from("`");
        text.extend(shown.chars().take(Self::MAX_CHARS).flat_map(char::escape_debug));
        text.push_str(if bytes.len() > Self::MAX_CHARS { "...`" } else { "`" });
        Self(text)
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
    }
}
