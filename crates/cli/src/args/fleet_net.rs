//! `mapwright fleet keys`, `join` and `status`.
#![cfg_attr(not(feature = "net"), allow(dead_code, reason = "what is asked for is refused then"))]

use super::values::{parse_assignment, parse_seconds};
use super::{SourceArgs, Voice};
use clap::Args as ClapArgs;
use std::path::PathBuf;

#[derive(Debug, ClapArgs)]
pub(crate) struct FleetKeysArgs {
    /// The robots, each with where the others find it: its name is its address as well where none is given, and the port 7447.
    #[arg(required = true, value_name = "NAME[@HOST[:PORT]]")]
    pub(crate) robots: Vec<String>,
    /// Folder for the keys; made if need be. Where it has those of a team, the robots join that one.
    #[arg(short, long, value_name = "FOLDER")]
    pub(crate) output: PathBuf,
    /// What the team is called; teams on one network do not hear each other.
    #[arg(long, value_name = "NAME", default_value = "team")]
    pub(crate) team: String,
    /// For so many days certificates are valid.
    #[arg(long, value_name = "DAYS", default_value_t = 365, value_parser = clap::value_parser!(u32).range(0..=36_500))]
    pub(crate) days: u32,
    /// New keys for robots that have some: the old ones are not believed any more by those who have the new team.toml.
    #[arg(long)]
    pub(crate) force: bool,
    /// Common name of a router that may pass on what robots say; gets a certificate too. May be repeated.
    #[arg(long, value_name = "NAME")]
    pub(crate) router: Vec<String>,
    #[command(flatten)]
    pub(crate) voice: Voice,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct FleetJoinArgs {
    /// The robot's log, as for `map`; `-` is the standard input.
    #[arg(value_name = "LOG")]
    pub(crate) log: PathBuf,
    /// Who the robot is: robot.toml as `fleet keys` has made it.
    #[arg(long, value_name = "FILE")]
    pub(crate) config: PathBuf,
    #[command(flatten)]
    pub(crate) source: SourceArgs,
    /// Folder for the results; made if need be. Otherwise `mapwright-` and the robot's name, where you are.
    #[arg(short, long, value_name = "FOLDER")]
    pub(crate) output: Option<PathBuf>,
    /// How fast the log is played: 1 as it was driven, 10 ten times as fast, `max` as fast as it goes.
    #[arg(long, value_name = "N|max", default_value = "1", value_parser = parse_rate)]
    pub(crate) rate: f64,
    /// After the log the robot goes on hearing and answering until nothing new has come for so long, seconds.
    #[arg(long, value_name = "S", default_value = "15", value_parser = parse_seconds)]
    pub(crate) stay: f64,
    /// And at most so long after the log, seconds.
    #[arg(long, value_name = "S", default_value = "600", value_parser = parse_seconds)]
    pub(crate) wait: f64,
    /// One setting, such as map.resolution_m=0.1, instead of what robot.toml says; may be repeated.
    #[arg(long, value_name = "KEY=VALUE", value_parser = parse_assignment)]
    pub(crate) set: Vec<(String, String)>,
    #[command(flatten)]
    pub(crate) voice: Voice,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct FleetStatusArgs {
    /// Who asks: robot.toml as `fleet keys` has made it. The robot itself may be running.
    #[arg(long, value_name = "FILE")]
    pub(crate) config: PathBuf,
    /// Listen for so long, seconds.
    #[arg(long, value_name = "S", default_value = "4", value_parser = parse_seconds)]
    pub(crate) seconds: f64,
    /// One JSON object on the standard output instead of words.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Times real time; infinite for as fast as it goes.
fn parse_rate(text: &str) -> Result<f64, String> {
    if text == "max" {
        return Ok(f64::INFINITY);
    }
    let rate: Option<f64> = text.parse().ok().filter(|rate| (0.001..=1e6).contains(rate));
    rate.ok_or_else(|| format!("expected how many times as fast, 0.001 to a million, or max, found {text:?}"))
}
