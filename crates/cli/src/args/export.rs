//! What results and logs can become.

use super::SourceArgs;
use clap::{Args as ClapArgs, ValueEnum};
use std::path::{Path, PathBuf};

#[derive(Debug, ClapArgs)]
pub(crate) struct ExportArgs {
    /// Folder of results of `mapwright map`, or its session.mapwright.
    pub(crate) results: PathBuf,
    /// What to write.
    #[arg(long, value_enum)]
    pub(crate) to: ExportTo,
    /// The file; otherwise export.tum, export.mcap and so on in the folder of results.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ExportTo {
    /// Trajectory: stamp x y z qx qy qz qw.
    Tum,
    /// Trajectory: 12 numbers a line, the upper rows of the pose's matrix; no stamps.
    Kitti,
    /// Trajectory with odometry's beside it, a line of names first.
    Csv,
    /// Map, path, transforms, scans and closures for Foxglove and ROS 2.
    Mcap,
    /// Map for Nav2, with its .yaml.
    Pgm,
    /// Map as a plain PNG with a world file (.pgw), for QGIS and others.
    Worldfile,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct ConvertArgs {
    /// Log: ROS 1 bag, MCAP file, ROS 2 bag (folder or file), CARMEN log (plain, .gz or .bz2; `-` is the standard input).
    pub(crate) log: PathBuf,
    /// The new log; its ending says in which format.
    #[arg(value_name = "OUT", value_parser = parse_log_name)]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) source: SourceArgs,
}

/// Formats that logs are written in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LogFormat {
    Carmen,
    Bag1,
    Mcap,
}

impl LogFormat {
    fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "clf" | "log" | "carmen" => Some(Self::Carmen),
            "bag" => Some(Self::Bag1),
            "mcap" => Some(Self::Mcap),
            _ => None,
        }
    }
}

impl ConvertArgs {
    /// The parser has seen to it that there is one.
    pub(crate) fn format(&self) -> LogFormat {
        LogFormat::of(&self.output).unwrap_or(LogFormat::Carmen)
    }
}

fn parse_log_name(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let known = LogFormat::of(&path).is_some();
    if known { Ok(path) } else { Err("expected a name that ends in .clf, .log, .bag or .mcap".to_owned()) }
}
