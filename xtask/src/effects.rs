//! Crates that compute must not read a clock, open a file or socket, print, or draw randomness without a seed.

use crate::metadata::Metadata;
use proc_macro2::{Delimiter, Group, TokenStream, TokenTree};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Crates that may do everything: they talk to the world.
const OUTERMOST: [&str; 4] = ["net", "viewer", "py", "cli"];
/// The one file elsewhere that may open files: a recording can be a folder, and SQLite opens its database itself.
const OPENS_FILES: &str = "crates/bags/src/folder.rs";
/// What it may use for that.
const TO_OPEN_FILES: [&str; 2] = ["std::fs", "std::env"];
/// Names of clocks and of randomness without a seed.
const NAMES: [&str; 6] = ["Instant", "SystemTime", "thread_rng", "from_entropy", "from_os_rng", "OsRng"];
/// Modules of `std`.
const STD_MODULES: [&str; 4] = ["fs", "net", "process", "env"];
/// Macros that print.
const MACROS: [&str; 5] = ["println", "eprintln", "print", "eprint", "dbg"];

/// A complaint for every such word in a crate's `src`, outside of comments, texts and `#[cfg(test)]`.
pub(crate) fn check(metadata: &Metadata) -> Result<Vec<String>, String> {
    let mut complaints = Vec::new();
    for (_, package) in metadata.crates().filter(|(folder, _)| !OUTERMOST.contains(folder)) {
        for file in rust_files(&package.folder.join("src"))? {
            let shown = file.strip_prefix(&metadata.workspace_root).unwrap_or(&file).display().to_string();
            let found = effects_of(&crate::read(&file)?).map_err(|e| format!("{shown}: {e}"))?;
            complaints.extend(found.iter().filter(|(_, word)| !is_excepted(&shown, word)).map(|(line, word)| {
                format!("{shown}:{line}: `{word}` is an effect; only {} may have any", OUTERMOST.join(", "))
            }));
        }
    }
    Ok(complaints)
}

fn is_excepted(file: &str, word: &str) -> bool {
    Path::new(file) == Path::new(OPENS_FILES) && TO_OPEN_FILES.contains(&word)
}

fn rust_files(folder: &Path) -> Result<Vec<PathBuf>, String> {
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

/// Lines and words of the effects in a source text.
fn effects_of(source: &str) -> Result<Vec<(usize, String)>, String> {
    let tokens = TokenStream::from_str(source).map_err(|e| format!("expected Rust: {e}"))?;
    let mut found = Vec::new();
    search(tokens, &mut found);
    Ok(found)
}

fn search(tokens: TokenStream, found: &mut Vec<(usize, String)>) {
    let tokens: Vec<_> = tokens.into_iter().collect();
    let mut place = 0;
    while place < tokens.len() {
        if is_punct(&tokens[place], '#') {
            // an attribute holds no code, but one for tests hides the item behind it
            let (after, what) = attribute(&tokens, place);
            match what {
                Attribute::OfTestFile => return,
                Attribute::OfTestItem => place = after_item(&tokens, after),
                Attribute::Other => place = after,
            }
            continue;
        }
        match &tokens[place] {
            TokenTree::Group(group) => search(group.stream(), found),
            TokenTree::Ident(ident) => {
                let word = ident.to_string();
                let line = ident.span().start().line;
                let is_macro =
                    MACROS.contains(&word.as_str()) && tokens.get(place + 1).is_some_and(|t| is_punct(t, '!'));
                if NAMES.contains(&word.as_str()) || is_macro {
                    found.push((line, if is_macro { format!("{word}!") } else { word }));
                } else if word == "std" {
                    found.extend(std_modules(&tokens[place + 1..]).map(|module| (line, format!("std::{module}"))));
                }
            }
            _ => {}
        }
        place += 1;
    }
}

/// The forbidden modules that `::fs` or `::{fs, io}` names.
fn std_modules(after_std: &[TokenTree]) -> impl Iterator<Item = String> {
    let names = match after_std {
        [a, b, TokenTree::Ident(module), ..] if is_punct(a, ':') && is_punct(b, ':') => vec![module.to_string()],
        [a, b, TokenTree::Group(group), ..] if is_punct(a, ':') && is_punct(b, ':') => heads(group),
        _ => Vec::new(),
    };
    names.into_iter().filter(|name| STD_MODULES.contains(&name.as_str()))
}

/// The first name of each path in `{fs::File, io}`.
fn heads(group: &Group) -> Vec<String> {
    let tokens: Vec<_> = group.stream().into_iter().collect();
    let paths = tokens.split(|token| is_punct(token, ','));
    paths.filter_map(|path| path.first().map(ToString::to_string)).collect()
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

fn is_punct(token: &TokenTree, wanted: char) -> bool {
    matches!(token, TokenTree::Punct(punct) if punct.as_char() == wanted)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(source: &str) -> Vec<String> {
        effects_of(source).unwrap().into_iter().map(|(_, word)| word).collect()
    }

    #[test]
    fn effects_are_found_with_their_line() {
        let source = "use std::time::{Duration, Instant};\nfn f() {\n    if true { println!(\"hello\"); }\n}\n";
        assert_eq!(effects_of(source).unwrap(), [(1, "Instant".to_owned()), (3, "println!".to_owned())]);
        assert_eq!(words("fn f() { std::fs::read(p); std::net::TcpStream::connect(a); }"), ["std::fs", "std::net"]);
        assert_eq!(words("use std::{collections::BTreeMap, fs::File, io};"), ["std::fs"]);
        assert_eq!(words("macro_rules! m { () => { eprintln!() } }"), ["eprintln!"]);
        assert_eq!(words("fn f() -> std::time::SystemTime { todo!() }"), ["SystemTime"]);
    }

    #[test]
    fn comments_texts_and_tests_may_name_them() {
        let source = "//! Never `println!`.\n/// Not std::fs.\nfn f() -> &'static str { /* Instant */ \"std::net\" }\n
            #[cfg(test)]\n#[allow(dead_code)]\nmod tests { use std::fs; fn g() { println!(); } }\n
            #[cfg(test)]\nuse std::time::Instant;\n";
        assert_eq!(words(source), [""; 0]);
        assert_eq!(words("#![cfg(test)]\nuse std::fs;"), [""; 0]);
    }

    #[test]
    fn what_follows_tests_or_is_left_out_of_them_counts() {
        assert_eq!(words("#[cfg(test)] mod tests { use std::fs; } fn f() { println!(); }"), ["println!"]);
        assert_eq!(words("#[cfg(not(test))] use std::fs;"), ["std::fs"]);
        assert_eq!(words("#[derive(Debug)] struct A { t: Instant }"), ["Instant"]);
    }

    #[test]
    fn one_file_may_open_files_and_do_nothing_else() {
        assert!(is_excepted(OPENS_FILES, "std::fs") && is_excepted(OPENS_FILES, "std::env"));
        assert!(!is_excepted(OPENS_FILES, "println!") && !is_excepted("crates/bags/src/lib.rs", "std::fs"));
    }

    #[test]
    fn what_only_looks_alike_passes() {
        assert_eq!(words("fn f() { let print = 1; my::fs::read(); env!(\"X\"); use std::io::Read; }"), [""; 0]);
    }
}
