//! The `mapwright` command as a library: everything below is effects (files, clock, terminal); the mapping is the library's.
//!
//! [`run_command`] is the command itself. Another program maps with [`map`], whose results are the command's, byte for byte, and
//! reads and writes folders of results with [`read_session`], [`read_grid`], [`save_plane`] and [`save_space`].

mod advice;
mod args;
mod batch;
mod calibrated;
mod calibration;
mod closures;
mod commands;
mod doubt;
mod drawing;
mod embedding;
mod events;
mod exploring;
mod failure;
mod floor;
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
pub use embedding::{CommandError, grid_of, map, points_of, read_grid, read_session, save_plane, save_space};
pub use session::AnySession;
use std::ffi::OsString;

/// Runs a command line, its first word the command's name, and says on standard output and error what there is to say. Returns the
/// number that the process should end with.
///
/// Long commands install handlers of SIGINT, SIGTERM and SIGHUP: in a program that is more than this command use [`map`].
pub fn run_command(args: impl IntoIterator<Item = OsString>) -> u8 {
    let words: Vec<OsString> = args.into_iter().collect();
    let args = match args::Args::try_parse_from(&words) {
        Ok(args) => args,
        Err(error) => {
            let _ = error.print(); // nothing helps where even that fails
            return u8::try_from(error.exit_code()).unwrap_or(failure::USAGE);
        }
    };
    terminal::colour(args.colour());
    match commands::run(args.command) {
        Ok(outcome) => outcome.code(),
        Err(failure) => {
            if args::asks_for_json(&words) {
                let value = serde_json::json!({ "error": failure.to_string(), "exit_code": failure.code() });
                let _ = terminal::say_json(&value); // nothing helps where even that fails
            }
            terminal::complain(&failure);
            failure.code()
        }
    }
}
