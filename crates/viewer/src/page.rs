//! The page: one file, which loads nothing else.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::GzEncoder;
use sha2::{Digest, Sha256};
use std::io::Write;

const HTML: &str = include_str!("page/page.html");
const STYLE: &str = include_str!("page/page.css");
const SCRIPT: &str = include_str!("page/page.js");

/// The page of the view, as it is served: HTML with its style and its script.
#[must_use]
pub fn page() -> String {
    let html: String = HTML.lines().map(str::trim).collect();
    html.replace("{{style}}", &style()).replace("{{script}}", &script())
}

fn style() -> String {
    tight(STYLE, "#.+-*%)(\"'`!~&[")
}

fn script() -> String {
    tight(SCRIPT, "_$")
}

/// Without comments, and without white space that says nothing: it is needed between letters, digits and the signs of `kept`. Comments
/// have lines of their own, each statement ends in a sign, and there are no patterns between slashes.
fn tight(text: &str, kept: &str) -> String {
    let mut out = String::new();
    for line in text.lines().map(str::trim).filter(|line| !line.starts_with("//")) {
        let mut quote = None;
        let mut characters = line.chars().peekable();
        while let Some(c) = characters.next() {
            match quote {
                Some(mark) => {
                    out.push(c);
                    if c == '\\' {
                        out.extend(characters.next());
                    } else if c == mark {
                        quote = None;
                    }
                }
                None if c == ' ' => {
                    let is_needed = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || kept.contains(c));
                    if is_needed(out.chars().last()) && is_needed(characters.peek().copied()) {
                        out.push(c);
                    }
                }
                None => {
                    out.push(c);
                    quote = "\"'`".contains(c).then_some(c);
                }
            }
        }
        if line.ends_with(|c: char| c.is_alphanumeric()) {
            out.push(' ');
        }
    }
    out
}

/// What is sent for it.
pub(crate) struct Served {
    pub(crate) plain: String,
    pub(crate) gzip: Option<Vec<u8>>,
    /// What a browser is to let it do: run this script in this style, and speak with where it came from.
    pub(crate) policy: String,
}

impl Served {
    pub(crate) fn new() -> Self {
        let plain = page();
        let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
        let gzip = encoder.write_all(plain.as_bytes()).and_then(|()| encoder.finish()).ok();
        let policy = format!(
            "default-src 'none'; script-src '{}'; style-src '{}'; connect-src 'self'; img-src data:; base-uri 'none'; form-action 'none'; \
             frame-ancestors 'none'",
            hash(&script()),
            hash(&style()),
        );
        Self { plain, gzip, policy }
    }
}

fn hash(text: &str) -> String {
    format!("sha256-{}", STANDARD.encode(Sha256::digest(text)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_is_small_and_loads_nothing() {
        let served = Served::new();
        let (plain, gzip) = (served.plain.len(), served.gzip.unwrap().len());
        println!("page: {plain} bytes, {gzip} compressed");
        assert!(plain < 26_000 && gzip < 12_000, "{plain} and {gzip} bytes; 20 kB is the most that may be sent");
        for word in ["http:", "https:", "src=", "{{", "innerHTML", "eval("] {
            let found = served.plain.replace("http://www.w3.org", "");
            assert!(!found.contains(word), "{word}");
        }
    }
}
