//! `mapwright report` and `mapwright compare`

use crate::args::{BesideArgs, CompareArgs, ReportArgs};
use crate::failure::{Failure, Outcome};
use crate::maps::PAGE;
use crate::output::write_whole;
use crate::page::{Beside, Page, compare, report};
use crate::terminal::{grouped, say, say_json};
use serde_json::json;
use std::io::Write;
use std::path::Path;

/// In the present folder.
const COMPARED: &str = "compare.html";

pub(super) fn run(args: &ReportArgs) -> Result<Outcome, Failure> {
    let page = report(&args.results, beside(&args.beside))?;
    let in_folder = || {
        if args.results.is_dir() { args.results.join(PAGE) } else { args.results.with_file_name(PAGE) }
    };
    write(&page, &args.output.clone().unwrap_or_else(in_folder), args.json)
}

pub(super) fn run_compare(args: &CompareArgs) -> Result<Outcome, Failure> {
    let page = compare([&args.first, &args.second], beside(&args.beside))?;
    write(&page, args.output.as_deref().unwrap_or(Path::new(COMPARED)), args.json)
}

fn beside(args: &BesideArgs) -> Beside<'_> {
    Beside { reference: args.reference.as_ref(), relations: args.relations.as_ref() }
}

fn write(page: &Page, path: &Path, json: bool) -> Result<Outcome, Failure> {
    write_whole(path, |file| file.write_all(page.html.as_bytes()).map_err(|error| Failure::write(path, error)))?;
    if json {
        say_json(&json!({ "file": path, "bytes": page.html.len(), "lost": page.losses }))?;
        return Ok(Outcome::of_losses(&page.losses));
    }
    let losses: String = page.losses.iter().map(|loss| format!("lost     {loss}\n")).collect();
    say(&format!("{}: {} kB, one file, no network\n{losses}", path.display(), grouped(page.html.len() as u64 / 1000)))?;
    Ok(Outcome::of_losses(&page.losses))
}
