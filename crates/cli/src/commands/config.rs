//! `mapwright config`

use crate::args::SettingsArgs;
use crate::failure::{Failure, Outcome};
use crate::settings;
use crate::terminal::say;

pub(super) fn run(args: &SettingsArgs) -> Result<Outcome, Failure> {
    say(&settings::to_toml(&settings::load(args)?))?;
    Ok(Outcome::Done)
}
