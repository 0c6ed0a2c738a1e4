//! No circles among the modules of a crate: what stands side by side may not use each other both ways.
//!
//! A module counts with all below it, as a folder and the file that bears its name are one thing: that a parent uses its
//! children, and they its types, is no circle. Where two siblings, or what is below them, use each other, neither can be
//! read, tested or moved without the other.

use crate::metadata::Metadata;
use crate::source::{code, is_path_separator, is_punct, rust_files};
use proc_macro2::{Delimiter, TokenStream, TokenTree};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Names that are followed from one `use` to the next at most.
const HOPS: usize = 8;

/// Names from the crate's root on.
type Names = Vec<String>;

/// Modules of one folder that use each other, and one use of each by each.
#[derive(Debug, PartialEq)]
struct Circle {
    folder: String,
    modules: Vec<String>,
    uses: Vec<String>,
}

/// A complaint for every circle that is not on the list, and for every one on the list that is none any more.
pub(crate) fn check(metadata: &Metadata) -> Result<Vec<String>, String> {
    let mut found = Vec::new();
    for (folder, package) in metadata.crates() {
        let sources = read_sources(&package.folder.join("src"))?;
        found.extend(circles(&format!("crates/{folder}/src"), &Modules::of(&sources)?));
    }
    Ok(found.iter().map(complaint).collect())
}

fn complaint(circle: &Circle) -> String {
    format!("{}: {} in a circle: {}", circle.folder, circle.modules.join(", "), circle.uses.join(", "))
}

/// Each file's place as a module, and its text.
fn read_sources(src: &Path) -> Result<Vec<(Names, String)>, String> {
    let files = rust_files(src)?;
    files.iter().map(|file| Ok((module_of(file.strip_prefix(src).unwrap_or(file)), crate::read(file)?))).collect()
}

/// `a/b.rs` and `a/b/mod.rs` are `a::b`; `lib.rs` and `main.rs` are the root.
fn module_of(file: &Path) -> Names {
    let mut names: Names = file.with_extension("").iter().map(|name| name.to_string_lossy().into_owned()).collect();
    let is_parent = |name: &String| matches!(name.as_str(), "mod" | "lib" | "main");
    names.pop_if(|name| is_parent(name));
    names
}

/// The modules of a crate: which paths each has in it, and what its `use` items bring into it.
struct Modules {
    paths: BTreeMap<Names, Vec<Names>>,
    brought: BTreeMap<Names, BTreeMap<String, Names>>,
}

impl Modules {
    fn of(sources: &[(Names, String)]) -> Result<Self, String> {
        let mut modules = Self { paths: BTreeMap::new(), brought: BTreeMap::new() };
        for (module, _) in sources {
            modules.paths.insert(module.clone(), Vec::new());
        }
        for (module, source) in sources {
            let found = Paths::of(code(source).map_err(|e| format!("{}: {e}", module.join("::")))?);
            let rooted = |paths: Vec<Names>| paths.iter().filter_map(|path| modules.rooted(module, path)).collect();
            let (used, all): (Vec<Names>, Vec<Names>) = (rooted(found.used), rooted(found.all));
            let by_name = used.into_iter().filter_map(|path| Some((path.last()?.clone(), path))).collect();
            modules.brought.insert(module.clone(), by_name);
            modules.paths.insert(module.clone(), all);
        }
        Ok(modules)
    }

    /// A path within a module as one from the root on; none where it leads out of the crate.
    fn rooted(&self, module: &[String], path: &[String]) -> Option<Names> {
        let up = path.iter().take_while(|name| *name == "super").count();
        let below = |from: &[String], rest: &[String]| Some([from, rest].concat());
        match path.first()?.as_str() {
            "crate" => below(&[], &path[1..]),
            "self" => below(module, &path[1..]),
            "super" => below(module.get(..module.len().checked_sub(up)?)?, &path[up..]),
            _ => below(module, path).filter(|path| self.paths.contains_key(&path[..=module.len()])),
        }
    }

    /// The module that a path leads to, through what others bring in, and the path.
    fn target(&self, mut path: Names) -> (usize, Names) {
        for _ in 0..HOPS {
            let depth = self.depth(&path);
            let next = path.get(depth).and_then(|name| self.brought.get(&path[..depth])?.get(name));
            match next {
                Some(from) if *from != path[..=depth] => path = [from, &path[depth + 1..]].concat(),
                _ => break,
            }
        }
        (self.depth(&path), path)
    }

    /// How many names of a path are modules.
    fn depth(&self, path: &[String]) -> usize {
        (0..=path.len()).rev().find(|&depth| self.paths.contains_key(&path[..depth])).unwrap_or(0)
    }
}

/// Paths in a module's code.
#[derive(Default)]
struct Paths {
    /// Those of `use` items.
    used: Vec<Names>,
    all: Vec<Names>,
}

impl Paths {
    fn of(code: TokenStream) -> Self {
        let mut paths = Self::default();
        paths.search(code);
        paths
    }

    fn search(&mut self, tokens: TokenStream) {
        let tokens: Vec<_> = tokens.into_iter().collect();
        let mut place = 0;
        while let Some(token) = tokens.get(place) {
            place += 1;
            match token {
                TokenTree::Group(group) => self.search(group.stream()),
                TokenTree::Ident(word) if word == "use" => {
                    place = read_path(&tokens, place, Vec::new(), &mut self.used);
                }
                TokenTree::Ident(_) => place = read_path(&tokens, place - 1, Vec::new(), &mut self.all),
                _ => {}
            }
        }
        self.all.extend(self.used.iter().cloned());
    }
}

/// Reads the path at `place`, in braces all its branches; the place behind it.
fn read_path(tokens: &[TokenTree], mut place: usize, mut path: Names, found: &mut Vec<Names>) -> usize {
    while let Some(TokenTree::Ident(name)) = tokens.get(place) {
        path.extend(Some(name.to_string()).filter(|name| name != "self" || path.is_empty()));
        place += 1;
        if !is_path_separator(tokens, place) {
            break;
        }
        place += 2;
        if let Some(TokenTree::Group(group)) = tokens.get(place).filter(|token| is_brace(token)) {
            let branches: Vec<_> = group.stream().into_iter().collect();
            for branch in branches.split(|token| is_punct(token, ',')) {
                read_path(branch, 0, path.clone(), found);
            }
            return place + 1;
        }
    }
    found.push(path);
    place
}

fn is_brace(token: &TokenTree) -> bool {
    matches!(token, TokenTree::Group(group) if group.delimiter() == Delimiter::Brace)
}

/// Which module of a folder uses which other, and by which path first.
type Arrows = BTreeMap<String, BTreeMap<String, String>>;

fn circles(src: &str, modules: &Modules) -> Vec<Circle> {
    let mut folders: BTreeMap<Names, Arrows> = BTreeMap::new();
    for (from, paths) in &modules.paths {
        for path in paths {
            let (depth, path) = modules.target(path.clone());
            let common = from.iter().zip(&path[..depth]).take_while(|(a, b)| a == b).count();
            if common < from.len() && common < depth {
                let arrows =
                    folders.entry(from[..common].to_vec()).or_default().entry(from[common].clone()).or_default();
                let words = format!("{} uses {}", from[common..].join("::"), path[common..].join("::"));
                arrows.entry(path[common].clone()).or_insert(words);
            }
        }
    }
    let in_folder = |(folder, arrows): (&Names, &Arrows)| {
        let folder = [&[src.to_owned()], &folder[..]].concat().join("/");
        rings(arrows).into_iter().map(move |ring| circle(&folder, arrows, ring)).collect::<Vec<_>>()
    };
    folders.iter().flat_map(in_folder).collect()
}

fn circle(folder: &str, arrows: &Arrows, ring: BTreeSet<&str>) -> Circle {
    let within = arrows.iter().filter(|(from, _)| ring.contains(from.as_str()));
    let uses = within.flat_map(|(_, to)| to.iter()).filter(|(to, _)| ring.contains(to.as_str()));
    Circle {
        folder: folder.to_owned(),
        uses: uses.map(|(_, words)| words.clone()).collect(),
        modules: ring.into_iter().map(str::to_owned).collect(),
    }
}

/// Sets of modules each of which leads to every other.
fn rings(arrows: &Arrows) -> Vec<BTreeSet<&str>> {
    let reach: BTreeMap<_, _> = arrows.keys().map(|from| (from.as_str(), reach(arrows, from))).collect();
    let back = |from: &str, to: &str| reach.get(to).is_some_and(|reach| reach.contains(from));
    let mut rings: Vec<BTreeSet<&str>> =
        reach.iter().map(|(from, reach)| reach.iter().copied().filter(|to| back(from, to)).collect()).collect();
    rings.retain(|ring| !ring.is_empty());
    rings.sort();
    rings.dedup();
    rings
}

/// All that a module uses, directly or by others.
fn reach<'a>(arrows: &'a Arrows, from: &str) -> BTreeSet<&'a str> {
    let (mut reached, mut open) = (BTreeSet::new(), vec![from]);
    while let Some(next) = open.pop() {
        for to in arrows.get(next).into_iter().flat_map(BTreeMap::keys) {
            if reached.insert(to.as_str()) {
                open.push(to);
            }
        }
    }
    reached
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The circles of a crate of these files.
    fn found(files: &[(&str, &str)]) -> Vec<Circle> {
        let sources: Vec<_> =
            files.iter().map(|(file, text)| (module_of(Path::new(file)), (*text).to_owned())).collect();
        circles("src", &Modules::of(&sources).unwrap())
    }

    fn modules(files: &[(&str, &str)]) -> Vec<String> {
        found(files).iter().map(|circle| format!("{}: {}", circle.folder, circle.modules.join(" "))).collect()
    }

    #[test]
    fn siblings_that_use_each_other_are_a_circle() {
        let files = [("lib.rs", "mod a; mod b;"), ("a.rs", "use crate::b::B;"), ("b.rs", "fn f() { super::a::g(); }")];
        assert_eq!(
            found(&files),
            [Circle {
                folder: "src".to_owned(),
                modules: vec!["a".to_owned(), "b".to_owned()],
                uses: vec!["a uses b::B".to_owned(), "b uses a::g".to_owned()],
            }]
        );
    }

    #[test]
    fn circles_may_go_around_through_what_is_below_and_through_names_brought_in() {
        let below = [
            ("lib.rs", ""),
            ("a.rs", "mod c;"),
            ("a/c.rs", "use crate::{b::{self, B}};"),
            ("b.rs", "use crate::a::A;"),
        ];
        assert_eq!(modules(&below), ["src: a b"]);
        let around = [("a.rs", "use crate::b::B;"), ("b.rs", "use crate::c::C;"), ("c/mod.rs", "use crate::a;")];
        assert_eq!(modules(&around), ["src: a b c"]);
        let brought = [("lib.rs", "pub use b::B; pub use a::A;"), ("a.rs", "use crate::B;"), ("b.rs", "use crate::A;")];
        assert_eq!(modules(&brought), ["src: a b"]);
        let deep =
            [("p/mod.rs", "mod a; mod b; use a::A;"), ("p/a.rs", "use super::b::B;"), ("p/b.rs", "use super::A;")];
        assert_eq!(modules(&deep), ["src/p: a b"]);
    }

    #[test]
    fn parents_and_children_are_one_thing_and_tests_are_not_looked_at() {
        let parent =
            [("lib.rs", "mod a; use a::A;"), ("a.rs", "mod b; use b::B;"), ("a/b.rs", "use super::A; use crate::C;")];
        assert!(found(&parent).is_empty());
        let tests = [("a.rs", "use crate::b::B;"), ("b.rs", "#[cfg(test)] mod tests { use crate::a::A; }")];
        assert!(found(&tests).is_empty());
        let foreign = [("a.rs", "use crate::b::B; use std::b::C;"), ("b.rs", "use a::A; fn f() { a.b::<C>(); }")];
        assert!(found(&foreign).is_empty());
    }

    #[test]
    fn a_complaint_says_who_uses_whom() {
        let circle = Circle {
            folder: "src".to_owned(),
            modules: vec!["a".to_owned(), "b".to_owned()],
            uses: vec!["a uses b::B".to_owned(), "b uses a::A".to_owned()],
        };
        assert_eq!(complaint(&circle), "src: a, b in a circle: a uses b::B, b uses a::A");
    }
}
