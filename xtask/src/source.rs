//! Source texts as tokens.

use proc_macro2::{Delimiter, Group, TokenStream, TokenTree};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// The Rust files below a folder, in order.
pub(crate) fn rust_files(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let error = |e| format!("{}: {e}", folder.display());
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(error)? {
        let path = entry.map_err(error)?.path();
        if path.is_dir() {
            files.extend(rust_files(&path)?);
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// The code of a source text: without comments, attributes and what is for tests only.
pub(crate) fn code(source: &str) -> Result<TokenStream, String> {
    TokenStream::from_str(source).map(without_tests).map_err(|e| format!("expected Rust: {e}"))
}

fn without_tests(tokens: TokenStream) -> TokenStream {
    let tokens: Vec<_> = tokens.into_iter().collect();
    let (mut kept, mut place) = (Vec::new(), 0);
    while let Some(token) = tokens.get(place) {
        if is_punct(token, '#') {
            // an attribute holds no code, but one for tests hides the item behind it
            let (after, what) = attribute(&tokens, place);
            match what {
                Attribute::OfTestFile => break,
                Attribute::OfTestItem => place = after_item(&tokens, after),
                Attribute::Other => place = after,
            }
            continue;
        }
        kept.push(match token {
            TokenTree::Group(group) => Group::new(group.delimiter(), without_tests(group.stream())).into(),
            other => other.clone(),
        });
        place += 1;
    }
    kept.into_iter().collect()
}

enum Attribute {
    OfTestFile,
    OfTestItem,
    Other,
}

/// What the attribute at `place` is, and the place behind it.
fn attribute(tokens: &[TokenTree], place: usize) -> (usize, Attribute) {
    let inner = tokens.get(place + 1).is_some_and(|t| is_punct(t, '!'));
    let at_group = place + 1 + usize::from(inner);
    match tokens.get(at_group) {
        Some(TokenTree::Group(group)) if group.delimiter() == Delimiter::Bracket => {
            let what = match (is_for_tests(group), inner) {
                (false, _) => Attribute::Other,
                (true, false) => Attribute::OfTestItem,
                (true, true) => Attribute::OfTestFile,
            };
            (at_group + 1, what)
        }
        _ => (place + 1, Attribute::Other),
    }
}

/// Whether `[cfg(test)]` or `[cfg(all(test, ..))]`.
fn is_for_tests(attribute: &Group) -> bool {
    let text: String = attribute.stream().to_string().split_whitespace().collect();
    text == "cfg(test)" || text.starts_with("cfg(all(test,")
}

/// The place behind the item that begins at `place`, its further attributes included.
fn after_item(tokens: &[TokenTree], mut place: usize) -> usize {
    while place < tokens.len() && is_punct(&tokens[place], '#') {
        place = attribute(tokens, place).0;
    }
    let ends = |token: &TokenTree| match token {
        TokenTree::Group(group) => group.delimiter() == Delimiter::Brace,
        other => is_punct(other, ';'),
    };
    tokens[place..].iter().position(ends).map_or(tokens.len(), |length| place + length + 1)
}

pub(crate) fn is_punct(token: &TokenTree, wanted: char) -> bool {
    matches!(token, TokenTree::Punct(punct) if punct.as_char() == wanted)
}

/// Whether `::` stands at `place`.
pub(crate) fn is_path_separator(tokens: &[TokenTree], place: usize) -> bool {
    matches!(tokens.get(place..), Some([a, b, ..]) if is_punct(a, ':') && is_punct(b, ':'))
}
