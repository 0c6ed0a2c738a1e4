//! `mapwright completions` and `mapwright man`: made of the same description of the command line that it is read by.

use crate::args::{Args, CompletionsArgs, ManArgs};
use crate::failure::{Failure, Outcome};
use crate::terminal::{say, say_raw};
use clap::CommandFactory;
use std::fs;

pub(super) fn run(args: &CompletionsArgs) -> Result<Outcome, Failure> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Args::command(), "mapwright", &mut script);
    say_raw(&String::from_utf8_lossy(&script))?;
    Ok(Outcome::Done)
}

/// A page of the command, and one of each below it.
pub(super) fn run_man(args: &ManArgs) -> Result<Outcome, Failure> {
    let failed = |error| Failure::write(&args.folder, error);
    fs::create_dir_all(&args.folder).map_err(failed)?;
    clap_mangen::generate_to(Args::command().disable_help_subcommand(true), &args.folder).map_err(failed)?;
    let folder = args.folder.display();
    say(&format!("{folder}: `man -l {folder}/mapwright.1` shows the first page\n"))?;
    Ok(Outcome::Done)
}
