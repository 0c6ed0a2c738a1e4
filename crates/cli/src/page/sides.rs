//! The page of two runs side by side.

use super::errors::{self, Errors, Reference};
use super::html::escaped;
use super::run::{Run, TURNING_BYTES};
use super::sections::{data, drive_next, layer_switches, maps, section};
use super::single::{short_name, what_it_is};
use super::{Beside, Page, closures, fill, inputs, numbers, relations, settings, status, verdict};
use crate::failure::Failure;
use serde_json::json;
use std::path::{Path, PathBuf};

const DETAIL: &str = include_str!("detail.html");
/// The switch that the script asks when one of the maps was enlarged or moved.
const COUPLED: &str = "<p class=\"coupled\"><label><input type=\"checkbox\" id=\"coupled\" checked=\"\"/> Enlarge and move both maps \
                       together</label></p>\n";
/// The runs' ids on the page, and what they are called.
const IDS: [&str; 2] = ["a", "b"];
const NAMES: [&str; 2] = ["A", "B"];

pub(super) fn page(folders: [&Path; 2], asked: Beside<'_>) -> Result<Page, Failure> {
    let (reference, relations) = relations::told_apart(asked.reference, asked.relations)?;
    let first = Run::read(folders[0], None, TURNING_BYTES / 2)?;
    // Both maps lie the same way.
    let second =
        Run::read(folders[1], first.drawn.figures.first().and_then(|figure| figure.level_rad), TURNING_BYTES / 2)?;
    let runs = [first, second];
    let both = [&runs[0], &runs[1]];
    let [a, b] = both.map(|run| beside(reference, run));
    let errors = [a?, b?];
    let related = match &relations {
        Some(relations) => [Some(relations.errors(both[0])?), Some(relations.errors(both[1])?)],
        None => [None, None],
    };
    let title = format!("{} and {}", both[0].results.folder.display(), both[1].results.folder.display());
    let mut body = format!("<header><h1>Two runs side by side</h1>\n{}</header>\n", each(|k| head(both[k], k)));
    body += &each(|k| verdict::block(&both[k].results.report));
    let map = format!("{}{COUPLED}{}{DETAIL}", layer_switches(&both), each(|k| maps(both[k], IDS[k])));
    body += &section("map", "The maps", &map);
    body += &section("next", "Where to drive next", &each(|k| drive_next(both[k])));
    let of = |k: usize| numbers::of(both[k], errors[k].as_ref().map(|(_, errors)| errors), related[k].as_ref());
    body += &section("numbers", "In numbers", &numbers::table(NAMES, [&of(0), &of(1)]));
    body += &section("apart", "How far the two ways are apart", &apart(both));
    body += &section("closures", "Closures", &each(|k| closures::table(both[k], IDS[k])));
    if let [Some((reference, a)), Some((_, b))] = &errors {
        let runs = [(NAMES[0], both[0], a), (NAMES[1], both[1], b)];
        body += &section("errors", "Errors", &errors::plots(reference, &runs));
    }
    if let Some(relations) = &relations {
        let table = |k: usize| related[k].as_ref().map_or_else(String::new, relations::table);
        let content = relations::heading(relations) + &each(table);
        body += &section("relations", "Errors beside surveyed relations", &content);
    }
    body += &section("over-the-run", "Over the run", &each(|k| status::over_the_run(both[k])));
    body += &section("settings", "Settings", &settings::differences(NAMES, both));
    body += &section("input", "What was read, lost and odd", &each(|k| inputs::block(both[k])));
    let html = fill(&format!("{title} – mapwright"), &body, &json!({ "a": data(both[0]), "b": data(both[1]) }));
    Ok(Page { html, losses: runs.into_iter().flat_map(|run| run.results.losses).collect() })
}

/// The errors of a run, and the name of what they are beside.
fn beside(reference: Option<&PathBuf>, run: &Run) -> Result<Option<(String, Errors)>, Failure> {
    let reference = Reference::of(reference, run)?;
    let errors = |reference: Reference| Ok((reference.name.clone(), reference.errors(run)?));
    reference.map(errors).transpose()
}

/// Both runs beside each other.
fn each(content: impl Fn(usize) -> String) -> String {
    let sides = [0, 1].map(|k| format!("<div class=\"side\" data-name=\"{}\">{}</div>", NAMES[k], content(k)));
    format!("<div class=\"sides\">{}</div>\n", sides.concat())
}

fn head(run: &Run, k: usize) -> String {
    format!("<p><b>{}: {}</b></p><p class=\"note\">{}</p>", NAMES[k], escaped(&short_name(&run.name)), what_it_is(run))
}

/// The second way beside the first one.
fn apart([first, second]: [&Run; 2]) -> String {
    match Reference::of_run(first).errors(second) {
        Ok(errors) => errors::plots("the way of run A that of run B", &[("B", second, &errors)]),
        Err(why) => format!("<p>They cannot be compared: {}.</p>\n", escaped(&why.to_string())),
    }
}
