//! The `mapwright` command: everything below is effects (files, clock, terminal); the mapping is the library's.

mod advice;
mod args;
mod batch;
mod calibrated;
mod calibration;
mod closures;
mod commands;
mod doubt;
mod drawing;
mod events;
mod exploring;
mod failure;
mod foreign;
mod going_on;
mod hanging;
mod image;
mod interrupt;
mod liar;
mod mapping;
mod maps;
mod output;
mod pace;
mod page;
mod picture;
mod pieces;
mod pose_graph;
mod progress;
mod reading;
mod recorded;
mod report;
mod robots;
mod session;
mod settings;
mod simulated;
mod sonar;
mod space;
mod stamps;
mod status_runs;
mod tally;
mod terminal;
mod timing;
mod turns;
mod verdict;
mod wheels;

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    let args = args::Args::parse();
    terminal::colour(args.colour());
    match commands::run(args.command) {
        Ok(outcome) => outcome.exit_code(),
        Err(failure) => {
            if args::asks_for_json() {
                let value = serde_json::json!({ "error": failure.to_string(), "exit_code": failure.code() });
                let _ = terminal::say_json(&value); // nothing helps where even that fails
            }
            terminal::complain(&failure);
            failure.exit_code()
        }
    }
}
