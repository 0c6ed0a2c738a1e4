//! One self-contained page of a run, or of two side by side: HTML with its style and script within, no network.
//!
//! Maps of space can be turned as well (`turning.js`). What is told stands in the HTML and is drawn as SVG, so that it can be read without a script as well; the script (`page.js`) enlarges
//! maps, switches layers and lays submaps over each other.

mod clock;
mod closures;
mod drawn;
mod errors;
mod figure;
mod html;
mod inputs;
mod layers;
mod numbers;
mod plane;
mod plot;
mod relations;
mod results;
mod robots;
mod run;
mod sections;
mod settings;
mod sides;
mod single;
mod space;
mod status;
mod submaps;
mod thinning;
mod turning;
mod verdict;

use crate::failure::Failure;
use html::{escaped, filled, script_json};
pub(crate) use results::FLEET;
use serde_json::Value;
use std::path::{Path, PathBuf};

const TEMPLATE: &str = include_str!("page.html");
const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");
const TURNING_SCRIPT: &str = include_str!("turning.js");

/// A page, and what of the results could not be read.
pub(crate) struct Page {
    pub(crate) html: String,
    pub(crate) losses: Vec<String>,
}

/// What errors are told beside: a trajectory, or relations, which may be given as either.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Beside<'a> {
    pub(crate) reference: Option<&'a PathBuf>,
    pub(crate) relations: Option<&'a PathBuf>,
}

/// The page of a folder of results, with errors beside a reference where there is one.
pub(crate) fn report(folder: &Path, beside: Beside<'_>) -> Result<Page, Failure> {
    single::page(folder, beside)
}

/// The page of two folders of results side by side.
pub(crate) fn compare(folders: [&Path; 2], beside: Beside<'_>) -> Result<Page, Failure> {
    sides::page(folders, beside)
}

/// Title, what stands below it, and what the script is told.
fn fill(title: &str, body: &str, data: &Value) -> String {
    let parts = [
        ("title", escaped(title)),
        ("style", STYLE.to_owned()),
        ("script", format!("{TURNING_SCRIPT}\n{SCRIPT}")),
        ("body", body.to_owned()),
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("data", script_json(data)),
    ];
    let parts: Vec<(&str, &str)> = parts.iter().map(|(name, text)| (*name, text.as_str())).collect();
    filled(TEMPLATE, &parts)
}
