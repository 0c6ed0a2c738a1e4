//! Which crate may depend on which: the table in ARCHITECTURE.md against what `cargo metadata` says.

use crate::metadata::Metadata;
use std::collections::BTreeMap;

const BEGIN: &str = "<!-- arrows: begin -->";
const END: &str = "<!-- arrows: end -->";
/// The row for what tests, examples and benchmarks of any crate may use besides.
const TESTS: &str = "tests";
const ANYTHING: &str = "anything";

/// The allowed arrows.
#[derive(Debug, PartialEq)]
pub(crate) struct Table(BTreeMap<String, Allowed>);

#[derive(Debug, PartialEq)]
enum Allowed {
    Anything,
    Only(Vec<String>),
}

impl Allowed {
    fn contains(&self, folder: &str) -> bool {
        match self {
            Self::Anything => true,
            Self::Only(folders) => folders.iter().any(|f| f == folder),
        }
    }
}

impl Table {
    /// Reads rows `` | `crate` | contents | crates it may depend on | `` between the markers. Crates that do not exist
    /// yet may stand there; arrows point to rows above only, so that the table has no cycle.
    pub(crate) fn parse(document: &str) -> Result<Self, String> {
        let (_, from_begin) = document.split_once(BEGIN).ok_or_else(|| format!("expected {BEGIN}, found none"))?;
        let (table, _) = from_begin.split_once(END).ok_or_else(|| format!("expected {END}, found none"))?;
        let mut rows = BTreeMap::new();
        for line in table.lines().filter(|line| line.starts_with("| `")) {
            let (folder, allowed) = parse_row(line)?;
            if let Allowed::Only(folders) = &allowed
                && folder != TESTS
                && let Some(unknown) = folders.iter().find(|f| !rows.contains_key(*f))
            {
                return Err(format!("row `{folder}`: expected crates from rows above, found `{unknown}`"));
            }
            if rows.insert(folder.clone(), allowed).is_some() {
                return Err(format!("expected one row for `{folder}`, found two"));
            }
        }
        if rows.is_empty() { Err("expected rows between the markers, found none".into()) } else { Ok(Self(rows)) }
    }

    fn allows(&self, from: &str, to: &str, for_tests: bool) -> bool {
        let by_row = |row: &str| self.0.get(row).is_some_and(|allowed| allowed.contains(to));
        by_row(from) || (for_tests && by_row(TESTS))
    }
}

fn parse_row(line: &str) -> Result<(String, Allowed), String> {
    let cells: Vec<_> = line.trim().trim_matches('|').split('|').map(str::trim).collect();
    let [folder, _, allowed] = cells[..] else {
        return Err(format!("expected three columns, found {} in `{line}`", cells.len()));
    };
    let words = allowed.split_whitespace().filter(|word| *word != "-");
    let allowed =
        if allowed == ANYTHING { Allowed::Anything } else { Allowed::Only(words.map(str::to_owned).collect()) };
    Ok((folder.trim_matches('`').to_owned(), allowed))
}

/// A complaint for every arrow between crates that the table does not have, and for every crate without a row.
pub(crate) fn check(table: &Table, metadata: &Metadata) -> Vec<String> {
    let mut complaints = Vec::new();
    let folders: BTreeMap<_, _> = metadata.crates().map(|(folder, package)| (package.name.as_str(), folder)).collect();
    for (folder, package) in metadata.crates() {
        if !table.0.contains_key(folder) {
            complaints.push(format!("crates/{folder}: expected a row in ARCHITECTURE.md, found none"));
        }
        for dependency in &package.dependencies {
            let Some(target) = folders.get(dependency.package.as_str()) else { continue };
            if *target != folder && !table.allows(folder, target, dependency.for_tests) {
                let tests = if dependency.for_tests { " in its tests" } else { "" };
                complaints.push(format!(
                    "crates/{folder}: depends on `{target}`{tests}, which ARCHITECTURE.md does not allow"
                ));
            }
        }
    }
    complaints
}

#[cfg(test)]
mod tests {
    use super::*;

    const DOCUMENT: &str = "
text
<!-- arrows: begin -->
| crate | contents | may depend on |
|---|---|---|
| `geom` | poses | - |
| `graph` | solver | geom |
| `sim` | worlds | geom |
| `not-yet` | later | geom graph |
| `cli` | command | anything |
| `tests` | of any crate | sim |
<!-- arrows: end -->";

    /// A workspace with one package for each `(folder, dependencies)`; a dependency `+x` is for tests.
    fn workspace(crates: &[(&str, &[&str])]) -> Metadata {
        let dependency = |name: &&str| {
            let kind = if name.starts_with('+') { r#""dev""# } else { "null" };
            format!(r#"{{"name": "mapwright-{}", "kind": {kind}}}"#, name.trim_start_matches('+'))
        };
        let package = |(folder, dependencies): &(&str, &[&str])| {
            format!(
                r#"{{"name": "mapwright-{folder}", "version": "0.1.0", "license": "MIT", "source": null,
                     "manifest_path": "/house/crates/{folder}/Cargo.toml", "dependencies": [{}]}}"#,
                dependencies.iter().map(dependency).collect::<Vec<_>>().join(",")
            )
        };
        let packages = crates.iter().map(package).collect::<Vec<_>>().join(",");
        Metadata::parse(format!(r#"{{"workspace_root": "/house", "packages": [{packages}]}}"#).as_bytes()).unwrap()
    }

    fn complaints(crates: &[(&str, &[&str])]) -> Vec<String> {
        check(&Table::parse(DOCUMENT).unwrap(), &workspace(crates))
    }

    #[test]
    fn allowed_arrows_pass_and_crates_outside_are_none_of_our_business() {
        let none: [String; 0] = [];
        assert_eq!(complaints(&[("geom", &[]), ("graph", &["geom", "serde"]), ("cli", &["geom", "graph"])]), none);
    }

    #[test]
    fn a_forbidden_arrow_is_refused() {
        assert_eq!(
            complaints(&[("geom", &["graph"]), ("graph", &["geom"])]),
            ["crates/geom: depends on `graph`, which ARCHITECTURE.md does not allow"]
        );
    }

    #[test]
    fn tests_may_use_what_their_row_says_and_the_library_may_not() {
        assert!(complaints(&[("graph", &["geom", "+sim"]), ("sim", &[]), ("geom", &[])]).is_empty());
        assert_eq!(complaints(&[("graph", &["sim"]), ("sim", &[])]).len(), 1);
        assert_eq!(complaints(&[("geom", &["+graph"]), ("graph", &[])]).len(), 1);
    }

    #[test]
    fn a_crate_without_a_row_is_refused() {
        assert_eq!(
            complaints(&[("stranger", &[])]),
            ["crates/stranger: expected a row in ARCHITECTURE.md, found none"]
        );
    }

    #[test]
    fn tables_that_point_up_repeat_or_are_not_there_are_refused() {
        let upward = DOCUMENT.replace("| poses | - |", "| poses | graph |");
        assert!(Table::parse(&upward).unwrap_err().contains("rows above"));
        assert!(Table::parse(&DOCUMENT.replace("`graph`", "`geom`")).unwrap_err().contains("found"));
        assert!(Table::parse("no table").unwrap_err().contains("begin"));
    }
}
