//! Logs in, maps and trajectories out.
//!
//! Readers and writers take [`Read`](std::io::Read) and [`Write`](std::io::Write), never paths; they read no clock and
//! print nothing. Bad sensor data is no error: it is dropped, counted and described in a [`ReadReport`].
//!
//! - [`open_log`]: plain, gzip and bzip2 streams, told by their first bytes.
//! - [`CarmenReader`], [`CarmenWriter`]: CARMEN logs.
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod carmen;
mod error;
mod lines;
mod number;
mod open;
mod report;
mod stamp_watch;

pub use carmen::{CarmenReader, CarmenWriter, DEFAULT_RANGE_MAX_M, LogEvent};
pub use error::FormatError;
pub use lines::Excerpt;
pub use open::{Compression, LogStream, open_log};
pub use report::{DropReason, DroppedLine, Drops, Noted, ReadReport, TopicReport};
pub use stamp_watch::{StampStep, StampWatch};
