//! `mapwright fleet`.

use super::{FleetJoinArgs, FleetKeysArgs, FleetStatusArgs, SettingsArgs, SourceArgs, Voice};
use crate::liar::Lie;
use clap::{Args as ClapArgs, Subcommand};
use std::path::PathBuf;

#[derive(Debug, ClapArgs)]
pub(crate) struct FleetArgs {
    #[command(subcommand)]
    pub(crate) command: FleetCommand,
}

#[derive(Debug, Subcommand)]
pub(crate) enum FleetCommand {
    /// Logs as robots that drive at the same time and hear each other by a simulated radio: what a team would make of them.
    Simulate(FleetSimulateArgs),
    /// Keys, certificates and one configuration for each robot of a team.
    Keys(FleetKeysArgs),
    /// A robot of a team that maps a log, or what comes in, and shares one map with the others over the network.
    Join(FleetJoinArgs),
    /// Who of a team is there: what each robot holds, who solves, what is refused.
    Status(FleetStatusArgs),
}

#[derive(Debug, ClapArgs)]
pub(crate) struct FleetSimulateArgs {
    /// The log of each robot, as for `map`; all begin at the same time, wherever their robots stand.
    #[arg(required = true, num_args = 2.., value_name = "LOG")]
    pub(crate) logs: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) source: SourceArgs,
    /// Folder for the results; made if need be.
    #[arg(short, long, value_name = "FOLDER")]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
    /// Share of the messages that are lost, 0 to 0.95.
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = parse_loss)]
    pub(crate) loss: f64,
    /// A robot dies: the number of its log, from 1, and after how many seconds; may be repeated.
    #[arg(long, value_name = "ROBOT@S", value_parser = parse_death)]
    pub(crate) dies: Vec<(usize, f64)>,
    /// The first so many robots and the others do not hear each other between these times, seconds.
    #[arg(long, value_name = "ROBOTS@FROM:TO", value_parser = parse_split)]
    pub(crate) split: Option<(usize, [f64; 2])>,
    /// A robot lies: the number of its log, from 1, about what (offset, rotation, scaled, replay, forged, solution, outbid), and from how many
    /// seconds on; may be repeated.
    #[arg(long, value_name = "ROBOT:LIE@S", value_parser = parse_lie)]
    pub(crate) lies: Vec<(usize, Lie, f64)>,
    /// Everything random is drawn from it.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    #[command(flatten)]
    pub(crate) voice: Voice,
}

fn number<T: std::str::FromStr>(text: &str, expected: &str) -> Result<T, String> {
    text.parse().map_err(|_| format!("expected {expected}, found {text:?}"))
}

fn parse_loss(text: &str) -> Result<f64, String> {
    let loss: f64 = number(text, "a share from 0 to 0.95")?;
    if (0.0..=0.95).contains(&loss) { Ok(loss) } else { Err(format!("expected a share from 0 to 0.95, found {loss}")) }
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds: f64 = number(text, "seconds")?;
    let is_time = (0.0..1e9).contains(&seconds);
    if is_time { Ok(seconds) } else { Err(format!("expected seconds, not negative, found {seconds}")) }
}

fn parse_death(text: &str) -> Result<(usize, f64), String> {
    let (robot, at) = text.split_once('@').ok_or_else(|| format!("expected ROBOT@SECONDS, found {text:?}"))?;
    Ok((number(robot, "the number of a log, from 1")?, seconds(at)?))
}

fn parse_lie(text: &str) -> Result<(usize, Lie, f64), String> {
    let expected = || format!("expected ROBOT:LIE@SECONDS, found {text:?}");
    let (robot, rest) = text.split_once(':').ok_or_else(expected)?;
    let (name, at) = rest.split_once('@').ok_or_else(expected)?;
    let lie = Lie::ALL
        .into_iter()
        .find(|lie| lie.name() == name)
        .ok_or_else(|| format!("expected {}, found {name:?}", Lie::ALL.map(Lie::name).join(", ")))?;
    Ok((number(robot, "the number of a log, from 1")?, lie, seconds(at)?))
}

fn parse_split(text: &str) -> Result<(usize, [f64; 2]), String> {
    let expected = || format!("expected ROBOTS@FROM:TO, found {text:?}");
    let (robots, times) = text.split_once('@').ok_or_else(expected)?;
    let (from, to) = times.split_once(':').ok_or_else(expected)?;
    Ok((number(robots, "how many robots")?, [seconds(from)?, seconds(to)?]))
}
