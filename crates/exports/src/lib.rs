//! Logs and results for other tools of robots, as ROS 1 bags and MCAP.
//!
//! - [`EventWriter`]: a log's scans and odometry as CARMEN, ROS 1 bag or MCAP.
//! - [`write_session_mcap`]: a run's map, path, transforms, scans and closures as an MCAP file of ROS 2.
//! - [`write_space_session_mcap`]: the same of space, the map as points.
//!
//! ```
//! use mapwright_exports::EventWriter;
//! use mapwright_formats::{CarmenReader, LogEvent};
//! use std::io::Cursor;
//!
//! let log = "FLASER 3 1.00 2.00 81.83 1 0 0 1 0 0 12.75 host 0.2\n";
//! let mut writer = EventWriter::mcap(Cursor::new(Vec::new()))?;
//! let mut reader = CarmenReader::new(log.as_bytes());
//! while let Some(event) = reader.next_event()? {
//!     writer.write(event)?;
//! }
//! let (mcap, counts) = writer.finish()?;
//! assert_eq!((counts.scans, &mcap.get_ref()[1..5]), (1, b"MCAP".as_slice()));
//! # Ok::<(), mapwright_exports::ExportError>(())
//! ```
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod carmen;
mod error;
mod events;
mod frames;
mod markers;
mod messages;
mod recording;
mod ros_events;
mod session;
mod space_session;

pub use error::ExportError;
pub use events::{EventCounts, EventWriter};
pub use session::{SessionCounts, write_session_mcap};
pub use space_session::{SpacePoints, SpaceSessionCounts, write_space_session_mcap};
