//! What `cargo metadata` says, as far as the checks need it.

use serde_json::Value;
use std::path::{Path, PathBuf};

pub(crate) struct Metadata {
    pub(crate) workspace_root: PathBuf,
    /// Members and dependencies alike.
    pub(crate) packages: Vec<Package>,
}

pub(crate) struct Package {
    pub(crate) name: String,
    pub(crate) version: String,
    /// An SPDX expression.
    pub(crate) licence: Option<String>,
    /// None for a member or another package on this disk.
    pub(crate) source: Option<String>,
    pub(crate) folder: PathBuf,
    pub(crate) dependencies: Vec<Dependency>,
}

pub(crate) struct Dependency {
    pub(crate) package: String,
    /// Only tests, examples and benchmarks see it.
    pub(crate) for_tests: bool,
}

impl Metadata {
    pub(crate) fn parse(json: &[u8]) -> Result<Self, String> {
        let json: Value = serde_json::from_slice(json).map_err(|e| format!("cargo metadata: {e}"))?;
        let packages = json["packages"].as_array().ok_or("cargo metadata: expected a list of packages, found none")?;
        Ok(Self {
            workspace_root: PathBuf::from(text(&json, "workspace_root")?),
            packages: packages.iter().map(Package::parse).collect::<Result<_, _>>()?,
        })
    }

    /// The workspace's crates with the folder each has below `crates`.
    pub(crate) fn crates(&self) -> impl Iterator<Item = (&str, &Package)> {
        let folder = self.workspace_root.join("crates");
        self.packages.iter().filter_map(move |package| Some((name_below(&folder, package)?, package)))
    }
}

fn name_below<'a>(folder: &Path, package: &'a Package) -> Option<&'a str> {
    (package.source.is_none() && package.folder.parent() == Some(folder))
        .then(|| package.folder.file_name()?.to_str())?
}

impl Package {
    fn parse(json: &Value) -> Result<Self, String> {
        let manifest = PathBuf::from(text(json, "manifest_path")?);
        let dependencies = json["dependencies"].as_array().into_iter().flatten();
        Ok(Self {
            name: text(json, "name")?,
            version: text(json, "version")?,
            licence: text(json, "license").ok(),
            source: text(json, "source").ok(),
            folder: manifest.parent().map(Path::to_path_buf).unwrap_or_default(),
            dependencies: dependencies.map(Dependency::parse).collect::<Result<_, _>>()?,
        })
    }
}

impl Dependency {
    fn parse(json: &Value) -> Result<Self, String> {
        Ok(Self { package: text(json, "name")?, for_tests: json["kind"].as_str() == Some("dev") })
    }
}

fn text(json: &Value, key: &str) -> Result<String, String> {
    json[key].as_str().map(str::to_owned).ok_or_else(|| format!("cargo metadata: expected text in `{key}`, found none"))
}
