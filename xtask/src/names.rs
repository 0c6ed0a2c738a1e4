//! Names in backticks that the documents use and the code does not have: constants and paths that are gone.

use std::collections::HashSet;
use std::path::Path;

/// Names of others.
const OF_OTHERS: [&str; 2] = ["KEEP_ALL", "RUSTC_WRAPPER"];
/// Where names may stand.
const ENDINGS: [&str; 9] = ["rs", "toml", "py", "js", "html", "sh", "service", "json", "css"];
const FOLDERS: [&str; 5] = ["crates", "xtask", "scripts", "packaging", ".ci"];

/// A complaint for each name in a document that stands nowhere in the code.
pub(crate) fn check(root: &Path) -> Result<Vec<String>, String> {
    let mut known = HashSet::new();
    for folder in FOLDERS {
        each_file(&root.join(folder), &mut |file| {
            let ending = file.extension().map(|ending| ending.to_string_lossy().into_owned());
            let is_code = ending.is_none_or(|ending| ENDINGS.contains(&ending.as_str()));
            if is_code && let Ok(text) = std::fs::read_to_string(file) {
                known.extend(words(&text).map(str::to_owned));
            }
            Ok(())
        })?;
    }
    let mut complaints = Vec::new();
    let mut look = |file: &Path| {
        let text = crate::read(file)?;
        let shown = file.strip_prefix(root).unwrap_or(file).display().to_string();
        let gone = gone_names(&text, |word| known.contains(word) || OF_OTHERS.contains(&word));
        complaints.extend(
            gone.into_iter().map(|(line, name)| format!("{shown}:{line}: `{name}` stands nowhere in the code")),
        );
        Ok(())
    };
    each_file(&root.join("docs"), &mut |file| {
        if file.extension().is_some_and(|e| e == "md") { look(file) } else { Ok(()) }
    })?;
    for file in ["ARCHITECTURE.md", "README.md"] {
        look(&root.join(file))?;
    }
    Ok(complaints)
}

fn each_file(folder: &Path, take: &mut dyn FnMut(&Path) -> Result<(), String>) -> Result<(), String> {
    let failed = |e: std::io::Error| format!("{}: {e}", folder.display());
    let entries: Result<Vec<_>, _> = std::fs::read_dir(folder).map_err(failed)?.collect();
    let mut paths: Vec<_> = entries.map_err(failed)?.into_iter().map(|entry| entry.path()).collect();
    paths.sort();
    for path in paths {
        if path.is_dir() { each_file(&path, take)? } else { take(&path)? }
    }
    Ok(())
}

fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !c.is_ascii_alphanumeric() && c != '_').filter(|word| !word.is_empty())
}

/// The lines of a document, outside of code blocks, and the constants and paths there of which a word is not known.
fn gone_names(text: &str, is_known: impl Fn(&str) -> bool) -> Vec<(usize, String)> {
    let (mut gone, mut is_block) = (Vec::new(), false);
    for (number, line) in text.lines().enumerate() {
        if line.trim_start().starts_with("```") {
            is_block = !is_block;
            continue;
        }
        for name in line.split('`').skip(1).step_by(2).filter(|_| !is_block) {
            if (is_constant(name) || is_path(name)) && !words(name).all(&is_known) {
                gone.push((number + 1, name.to_owned()));
            }
        }
    }
    gone
}

fn is_constant(name: &str) -> bool {
    let is_part = |c: char| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_';
    name.contains('_') && name.chars().all(is_part) && name.starts_with(|c: char| c.is_ascii_uppercase())
}

fn is_path(name: &str) -> bool {
    let name = name.strip_suffix("()").unwrap_or(name);
    name.contains("::") && name.split("::").all(|part| !part.is_empty() && words(part).eq([part]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_and_paths_that_are_gone_are_found() {
        let is_known = |word: &str| ["SURE_M", "Closing", "decide", "Mapper"].contains(&word);
        let text = "`SURE_M` and `GONE_M`, `Closing::decide`, `Closing::judge()`;\n`words`, `Mapper`, `a b::c`\n```\n`OLD_M`\n```\n`Live::meet`";
        let gone: Vec<(usize, String)> = gone_names(text, is_known);
        assert_eq!(gone, [(1, "GONE_M".to_owned()), (1, "Closing::judge()".to_owned()), (6, "Live::meet".to_owned())]);
    }
}
