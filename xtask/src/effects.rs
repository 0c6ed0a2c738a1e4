//! Crates that compute must not read a clock, open a file or socket, print, or draw randomness without a seed.

use crate::metadata::Metadata;
use crate::source::{code, is_path_separator, is_punct, rust_files};
use proc_macro2::{Group, TokenStream, TokenTree};
use std::path::Path;

/// Crates that may do everything: they talk to the world.
const OUTERMOST: [&str; 7] = ["net", "rtps", "dds", "zenoh", "viewer", "python", "cli"];
/// Files elsewhere that may open files: a recording can be a folder, and SQLite opens its database itself, whose head is
/// read beside it.
const OPEN_FILES: [&str; 2] = ["crates/bags/src/folder.rs", "crates/bags/src/sqlite/head.rs"];
/// What they may use for that.
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
    OPEN_FILES.iter().any(|open| Path::new(file) == Path::new(open)) && TO_OPEN_FILES.contains(&word)
}

/// Lines and words of the effects in a source text.
fn effects_of(source: &str) -> Result<Vec<(usize, String)>, String> {
    let mut found = Vec::new();
    search(code(source)?, &mut found);
    Ok(found)
}

fn search(tokens: TokenStream, found: &mut Vec<(usize, String)>) {
    let tokens: Vec<_> = tokens.into_iter().collect();
    for (place, token) in tokens.iter().enumerate() {
        match token {
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
    }
}

/// The forbidden modules that `::fs` or `::{fs, io}` names.
fn std_modules(after_std: &[TokenTree]) -> impl Iterator<Item = String> {
    let names = match after_std.get(2) {
        Some(TokenTree::Ident(module)) if is_path_separator(after_std, 0) => vec![module.to_string()],
        Some(TokenTree::Group(group)) if is_path_separator(after_std, 0) => heads(group),
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
    fn some_files_may_open_files_and_do_nothing_else() {
        let file = OPEN_FILES[0];
        assert!(is_excepted(file, "std::fs") && is_excepted(file, "std::env"));
        assert!(!is_excepted(file, "println!") && !is_excepted("crates/bags/src/lib.rs", "std::fs"));
    }

    #[test]
    fn what_only_looks_alike_passes() {
        assert_eq!(words("fn f() { let print = 1; my::fs::read(); env!(\"X\"); use std::io::Read; }"), [""; 0]);
    }
}
