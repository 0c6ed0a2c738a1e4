//! All that is linked or run in tests has a licence compatible with MIT OR Apache-2.0 and comes from crates.io.

use crate::metadata::{Metadata, Package};
use spdx::{Expression, ParseMode};

const ALLOWED: [&str; 12] = [
    "0BSD",
    "Apache-2.0",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    "CC0-1.0",
    "ISC",
    "MIT",
    "Unicode-3.0",
    "Unlicense",
    "Zlib",
    "bzip2-1.0.6",
];
/// Packages with another one, which asks something for changes to their own files alone.
const EXCEPTIONS: [(&str, &str); 2] = [("option-ext", "MPL-2.0"), ("webpki-roots", "CDLA-Permissive-2.0")];
const REGISTRY: &str = "registry+https://github.com/rust-lang/crates.io-index";

/// A complaint for every package with another licence or from another place.
pub(crate) fn check(metadata: &Metadata) -> Vec<String> {
    metadata.packages.iter().filter_map(|package| complaint(package).err()).collect()
}

fn complaint(package: &Package) -> Result<(), String> {
    let whose = format!("{} {}", package.name, package.version);
    if let Some(source) = package.source.as_deref().filter(|source| *source != REGISTRY) {
        return Err(format!("{whose}: expected a package of crates.io, found {source}"));
    }
    let licence = package.licence.as_deref().ok_or(format!("{whose}: expected a licence, found none"))?;
    let is_excepted = EXCEPTIONS.contains(&(package.name.as_str(), licence));
    if is_excepted || is_allowed(licence)? {
        Ok(())
    } else {
        Err(format!("{whose}: licence {licence} is not on the list"))
    }
}

/// Whether the allowed licences satisfy an SPDX expression; `MIT/Apache-2.0` of old manifests means OR.
fn is_allowed(licence: &str) -> Result<bool, String> {
    let expression =
        Expression::parse_mode(licence, ParseMode::LAX).map_err(|e| format!("licence `{licence}`: {e}"))?;
    let on_the_list = |wanted: &spdx::LicenseReq| wanted.license.id().is_some_and(|id| ALLOWED.contains(&id.name));
    Ok(expression.evaluate(on_the_list))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_allowed_choice_is_enough_and_all_of_a_conjunction_are_needed() {
        for licence in ["MIT", "MIT OR GPL-3.0", "MIT/Apache-2.0", "(MIT OR Apache-2.0) AND Unicode-3.0", "bzip2-1.0.6"]
        {
            assert_eq!(is_allowed(licence), Ok(true), "{licence}");
        }
        for licence in ["GPL-3.0", "MPL-2.0", "MIT AND LGPL-2.1", "LicenseRef-own"] {
            assert_eq!(is_allowed(licence), Ok(false), "{licence}");
        }
        assert_eq!(is_allowed("Apache-2.0 WITH LLVM-exception"), Ok(true));
        assert!(is_allowed("a licence in prose").is_err());
    }

    #[test]
    fn cargo_deny_has_the_same_list() {
        let deny = include_str!("../../deny.toml");
        let (_, from_list) = deny.split_once("allow = [").unwrap();
        let list = from_list.split_once(']').unwrap().0.split(',').map(|l| l.trim().trim_matches('"'));
        assert_eq!(list.filter(|l| !l.is_empty()).collect::<Vec<_>>(), ALLOWED);
    }

    #[test]
    fn a_package_without_licence_or_from_elsewhere_is_refused() {
        let package = |licence: Option<&str>, source: Option<&str>| Package {
            name: "some".into(),
            version: "1.0.0".into(),
            licence: licence.map(str::to_owned),
            source: source.map(str::to_owned),
            folder: "/some".into(),
            dependencies: Vec::new(),
        };
        assert!(complaint(&package(Some("MIT"), Some(REGISTRY))).is_ok());
        assert!(complaint(&package(None, Some(REGISTRY))).is_err());
        assert!(complaint(&package(Some("MIT"), Some("git+https://example.org/some"))).is_err());
    }
}
