//! The page of one run.

use super::errors::{self, Reference};
use super::html::escaped;
use super::run::{Run, TURNING_BYTES};
use super::sections::{data, drive_next, layer_switches, maps, section};
use super::{Beside, Page, closures, fill, inputs, numbers, relations, robots, settings, status, verdict};
use crate::failure::Failure;
use serde_json::json;
use std::path::Path;

const DETAIL: &str = include_str!("detail.html");

pub(super) fn page(folder: &Path, beside: Beside<'_>) -> Result<Page, Failure> {
    let run = Run::read(folder, None, TURNING_BYTES)?;
    let (reference, relations) = relations::told_apart(beside.reference, beside.relations)?;
    let related = relations.as_ref().map(|relations| relations.errors(&run)).transpose()?;
    let reference = Reference::of(reference, &run)?;
    let errors = reference.as_ref().map(|reference| reference.errors(&run)).transpose()?;
    let mut body = format!(
        "<header><h1>{}</h1>\n<p class=\"note\">{}</p></header>\n",
        escaped(&short_name(&run.name)),
        what_it_is(&run)
    );
    body += &verdict::block(&run.results.report);
    let map = format!("{}<div class=\"beside\"><div>{}</div>{DETAIL}</div>", layer_switches(&[&run]), maps(&run, "a"));
    body += &section("map", "The map", &map);
    if let Some((title, content)) = robots::block(&run) {
        body += &section("robots", title, &content);
    }
    body += &section("next", "Where to drive next", &drive_next(&run));
    body += &section("numbers", "In numbers", &numbers::list(&numbers::of(&run, errors.as_ref(), related.as_ref())));
    body += &section("closures", "Closures", &closures::table(&run, "a"));
    if let (Some(reference), Some(errors)) = (&reference, &errors) {
        body += &section("errors", "Errors", &errors::plots(&reference.name, &[("errors", &run, errors)]));
    }
    if let (Some(relations), Some(report)) = (&relations, &related) {
        let content = relations::heading(relations) + &relations::table(report);
        body += &section("relations", "Errors beside surveyed relations", &content);
    }
    body += &section("over-the-run", "Over the run", &status::over_the_run(&run));
    body += &section("input", "What was read, lost and odd", &inputs::block(&run));
    body += &section("settings", "Settings", &settings::block(&run));
    let html = fill(&format!("{} – mapwright", run.name), &body, &json!({ "a": data(&run) }));
    Ok(Page { html, losses: run.results.losses })
}

/// Below the title.
pub(super) fn what_it_is(run: &Run) -> String {
    let kind = if run.drawn.is_space { "a map of space" } else { "a map of the plane" };
    escaped(&format!("{}: {kind}; results in {}", run.name, run.results.folder.display()))
}

/// Without the folders of paths.
pub(super) fn short_name(name: &str) -> String {
    let short = |name: &str| name.rsplit('/').find(|part| !part.is_empty()).unwrap_or(name).to_owned();
    name.split(", ").map(short).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lose_their_folders() {
        let names = ["/data/one.clf", "kitti/00/", "/data/one.clf, /data/two.bag, robot1", "demo, seed 5"];
        assert_eq!(names.map(short_name), ["one.clf", "00", "one.clf, two.bag, robot1", "demo, seed 5"]);
    }
}
