//! The commands.

mod calibrate;
mod completions;
mod config;
mod convert;
mod demo;
mod eval;
mod explain;
mod explore;
mod export;
mod fleet;
mod info;
mod live;
mod localise;
mod map;
mod merge;
mod merge_maps;
mod optimize;
mod perturb;
mod rendezvous;
mod report;
mod suite;
mod view;

use crate::args::Command;
use crate::failure::{Failure, Outcome};
pub(crate) use map::run_until as map_until;
pub(crate) use merge_maps::{read as read_map, yaml_of};

/// Does what was asked for.
pub(crate) fn run(command: Command) -> Result<Outcome, Failure> {
    match command {
        Command::Map(args) => map::run(&args),
        Command::Merge(args) => merge::run(&args),
        Command::MergeMaps(args) => merge_maps::run(&args),
        Command::Localise(args) => localise::run(&args),
        Command::Live(args) => live::run(&args),
        Command::View(args) => view::run(&args),
        Command::Fleet(args) => fleet::run(&args),
        Command::Info(args) => info::run(&args),
        Command::Eval(args) => eval::run(&args),
        Command::Calibrate(args) => calibrate::run(&args),
        Command::Config(args) => config::run(&args),
        Command::Demo(args) => demo::run(&args),
        Command::Explore(args) => explore::run(&args),
        Command::Optimize(args) => optimize::run(&args),
        Command::Perturb(args) => perturb::run(&args),
        Command::Explain(args) => explain::run(&args),
        Command::Report(args) => report::run(&args),
        Command::Compare(args) => report::run_compare(&args),
        Command::Export(args) => export::run(&args),
        Command::Convert(args) => convert::run(&args),
        Command::Suite(args) => suite::run(&args),
        Command::Rendezvous(args) => rendezvous::run(&args),
        Command::Completions(args) => completions::run(&args),
        Command::Man(args) => completions::run_man(&args),
    }
}
