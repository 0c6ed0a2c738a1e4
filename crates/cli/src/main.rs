//! The `mapwright` command: the library of this package, run with the words of the command line.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(mapwright_cli::run_command(std::env::args_os()))
}
