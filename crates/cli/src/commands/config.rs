//! `mapwright config`

use crate::args::SettingsArgs;
use crate::failure::{Failure, Outcome};
use crate::settings;
use crate::terminal::say_raw;

pub(super) fn run(args: &SettingsArgs) -> Result<Outcome, Failure> {
    say_raw(&settings::to_toml(&settings::load(args)?))?;
    Ok(Outcome::Done)
}
