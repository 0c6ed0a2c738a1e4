//! `mapwright fleet`

pub(super) mod liar;
mod report;
mod simulate;
pub(super) mod team;

pub(crate) use liar::Lie;

use crate::args::{FleetArgs, FleetCommand};
use crate::failure::{Failure, Outcome};

pub(super) fn run(args: &FleetArgs) -> Result<Outcome, Failure> {
    match &args.command {
        FleetCommand::Simulate(args) => simulate::run(args),
    }
}
