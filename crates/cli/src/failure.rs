//! How a command ends.

use mapwright::SettingsError;
use mapwright_eval::EvalError;
use mapwright_formats::FormatError;
use mapwright_graph::GraphError;
use mapwright_graph::g2o::G2oError;
use mapwright_logs::LogError;
use std::path::{Path, PathBuf};

/// Exit code of wrong usage.
pub(crate) const USAGE: u8 = 2;

/// A command that did what it was asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// All of it.
    Done,
    /// A result was made, but something was lost on the way.
    WithLoss,
}

impl Outcome {
    pub(crate) fn of_losses(losses: &[String]) -> Self {
        if losses.is_empty() { Self::Done } else { Self::WithLoss }
    }

    /// The number that the command ends with.
    pub(crate) fn code(self) -> u8 {
        match self {
            Self::Done => 0,
            Self::WithLoss => 3,
        }
    }
}

/// Why a command failed; each message names the file.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    #[error("cannot open {}: {reason}", path.display())]
    Open { path: PathBuf, reason: String },
    #[error("cannot read {}: {cause}", path.display())]
    Read { path: PathBuf, cause: String },
    #[error("cannot write {}: {cause}", path.display())]
    Write { path: PathBuf, cause: String },
    #[error("{0}")]
    Usage(String),
    #[error("{0}")]
    Log(String),
    #[error("{name}: expected laser scans, found {found}")]
    NoScan { name: String, found: String },
    #[error("{}: {cause}", path.display())]
    Config { path: PathBuf, cause: String },
    #[error(transparent)]
    Settings(#[from] SettingsError),
    #[error("{}: {cause}", path.display())]
    Score { path: PathBuf, cause: EvalError },
    #[error("{name}: {reason}")]
    NotCalibrated { name: String, reason: String },
    #[error("{}: {cause}", path.display())]
    Graph { path: PathBuf, cause: G2oError },
    #[error("{}: {cause}", path.display())]
    Solve { path: PathBuf, cause: GraphError },
    #[error("{}: {cause}", path.display())]
    Candidates { path: PathBuf, cause: String },
    #[error("{}: {cause}", path.display())]
    Session { path: PathBuf, cause: String },
    #[error("{name}: {reason}")]
    World { name: String, reason: String },
    #[error("{first} and {second} are not joined: {why}")]
    NotJoined { first: String, second: String, why: String },
    #[error("cannot write to the standard output: {0}")]
    Stdout(std::io::Error),
    #[error("cannot watch for signals: {0}")]
    Signals(std::io::Error),
}

impl Failure {
    pub(crate) fn write(path: impl AsRef<Path>, cause: impl Into<FormatError>) -> Self {
        Self::Write { path: path.as_ref().to_owned(), cause: in_words(cause.into()) }
    }

    pub(crate) fn write_in_words(path: &Path, cause: &impl std::fmt::Display) -> Self {
        Self::Write { path: path.to_owned(), cause: cause.to_string() }
    }

    pub(crate) fn read(path: &Path, cause: FormatError) -> Self {
        Self::Read { path: path.to_owned(), cause: in_words(cause) }
    }

    /// A log's failure in words, without naming the stream where the system is to blame.
    pub(crate) fn log(error: LogError) -> Self {
        match error {
            LogError::Carmen { name, cause } => Self::Log(format!("cannot read {name}: {}", in_words(cause))),
            other => Self::Log(other.to_string()),
        }
    }

    pub(crate) fn open(path: &Path, reason: impl ToString) -> Self {
        Self::Open { path: path.to_owned(), reason: reason.to_string() }
    }

    /// The number that the command ends with: wrong settings are wrong usage.
    pub(crate) fn code(&self) -> u8 {
        match self {
            Self::Config { .. } | Self::Settings(_) | Self::Usage(_) => USAGE,
            _ => 1,
        }
    }
}

/// The system's own words where it is to blame.
fn in_words(cause: FormatError) -> String {
    match cause {
        FormatError::Io(error) => error.to_string(),
        other => other.to_string(),
    }
}
