//! `mapwright fleet`

#[cfg(feature = "net")]
mod join;
#[cfg(feature = "net")]
mod keys;
#[cfg(feature = "net")]
mod member;
pub(super) mod report;
#[cfg(feature = "net")]
mod results;
#[cfg(feature = "net")]
mod robot;
mod simulate;
#[cfg(feature = "net")]
mod state;
#[cfg(feature = "net")]
mod status;
#[cfg(feature = "net")]
mod told;
#[cfg(feature = "net")]
mod turns;

use crate::args::{FleetArgs, FleetCommand};
use crate::failure::{Failure, Outcome};

pub(super) fn run(args: &FleetArgs) -> Result<Outcome, Failure> {
    match &args.command {
        FleetCommand::Simulate(args) => simulate::run(args),
        #[cfg(feature = "net")]
        FleetCommand::Keys(args) => keys::run(args),
        #[cfg(feature = "net")]
        FleetCommand::Join(args) => {
            turns::take_turns();
            join::run(args)
        }
        #[cfg(feature = "net")]
        FleetCommand::Status(args) => {
            turns::take_turns();
            status::run(args)
        }
        #[cfg(not(feature = "net"))]
        FleetCommand::Keys(_) | FleetCommand::Join(_) | FleetCommand::Status(_) => Err(Failure::Usage(
            "this mapwright was built without the network; the packages have it, and `cargo install --path crates/cli --features net`"
                .to_owned(),
        )),
    }
}
