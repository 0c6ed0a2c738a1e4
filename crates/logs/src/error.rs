//! Why a log cannot be read or mapped.

use mapwright_bags::BagError;
use mapwright_formats::FormatError;

/// A failure that ends reading; bad messages are none, they are counted in the [`LogReport`](crate::LogReport).
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// A recording that cannot be read at all.
    #[error("cannot read {name}: {cause}")]
    Recording {
        /// The log.
        name: String,
        /// What is wrong.
        cause: BagError,
    },
    /// A stream that failed.
    #[error("cannot read {name}: {cause}")]
    Carmen {
        /// The log.
        name: String,
        /// What is wrong.
        cause: FormatError,
    },
    /// Whoever watched it being looked through did not want to go on.
    #[error("{name}: stopped while it was looked through, before anything else")]
    Stopped {
        /// The log.
        name: String,
    },
    /// Logs in a row that are not one drive.
    #[error(
        "{name} cannot follow {before}: {why}. Logs in a row are one drive, in which the robot has not moved in between; \
         drives of their own are mapped onto each other by `mapwright merge`"
    )]
    NotOneDrive {
        /// The log that cannot follow.
        name: String,
        /// The log before.
        before: String,
        /// When it begins.
        why: String,
    },
    /// There is nothing in it to map with, or not without help: what is there, and what to type.
    #[error("{name}: {reason}")]
    Refused {
        /// The log.
        name: String,
        /// Why, what is there instead, and what to type.
        reason: String,
    },
}

impl LogError {
    /// What a plan refuses, with the log's name in the command to type.
    #[must_use]
    pub fn refused(name: &str, reason: &str) -> Self {
        Self::Refused { name: name.to_owned(), reason: reason.replace(" LOG ", &format!(" {name} ")) }
    }
}
