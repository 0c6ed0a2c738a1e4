//! Logs of any kind as one stream of scans and odometry: CARMEN logs, ROS 1 bags, MCAP files and ROS 2 bags.
//!
//! What to use of a recording is found, not configured. A first pass ([`Survey`]) reads what is there: topics with their
//! types and counts, and which frame hangs where. From that a [`Plan`] is made, in which every decision has its reason in
//! words, or a refusal that says what is there and what to type instead. A [`Drive`] then reads one or several logs
//! according to their plans and yields their events.
//!
//! # Order
//!
//! Topics of a recording are merged by the stamps of their headers, a scan by the end of its sweep, over a window of at most
//! [`WINDOW_S`] seconds of arrival, [`WINDOW_MESSAGES`] messages and [`WINDOW_BYTES`] bytes of scans; messages that come later than the window allows
//! are counted. A clock that is set while the log runs counts as if it had not been: stamps stay as they are, and order
//! and odometry go by what they would have been. So do two topics whose clocks differ by more than a minute. A stamp that steps back by more than
//! a second and less than five is a message that was recorded late, unless the ones after it stay behind for five seconds; until that is known it waits, within the window's messages and bytes. A header without a stamp has the time of its recording instead, and is counted.
//!
//! Then one rule for all readers: events keep the order in which they arrived, or have that of their stamps, whichever makes the robot's way shorter, over
//! those of the last five seconds. Scans that were recorded late make it go to and fro as they arrived; stamps that were made late, as those of the
//! Intel lab's log are, make it go to and fro by them. Where there is no odometry the scans themselves tell: successive ones look alike.
//! Both ways are in the [report](OrderReport), as are stamps that step backwards.
//!
//! # Several lasers
//!
//! Planar lasers of one robot whose places on it are known are mapped together, where each sees directions that those before it do not; or those
//! that are asked for by their topics. Each scan has its own stamp and its laser's mounting.
//!
//! # Odometry of a scan
//!
//! It is the reading of the scan's stamp, which is that of its first beam, or else interpolated there between the readings
//! before and after it, where these are at most [`WINDOW_S`] seconds apart; else it is the one before, unless that is older than that; else
//! there is none.
//!
//! Odometry that clearly lags behind the scans, or runs ahead of them, is put at the time at which it was true before that ([`LagEstimator`]): of a recording
//! the first minutes are read once more for it, events of a CARMEN log are held back until it is known. A lag that is given
//! ([`OdometryCalibration`]) counts instead, and [`Choice::odometry_as_stamped`] leaves stamps alone.
//!
//! # Motion within a scan
//!
//! Beams of a laser keep their times (`time_increment`, the stamp being that of the first), and the mapper undoes the motion
//! between them. Points of a cloud that have times are moved to where the sensor was at the stamp, by odometry's twist there.
//!
//! # Memory
//!
//! Neither pass holds more than a chunk or message, the window, and reports that are bounded.
//!
//! ```no_run
//! use mapwright_logs::{Choice, Drive, Input};
//! let input = Input::Recording("drive.mcap".into());
//! let mut drive = Drive::open(vec![("drive.mcap".to_owned(), input)], &Choice::default())?;
//! while let Some(event) = drive.next_event()? {
//!     println!("{event:?}");
//! }
//! # Ok::<(), mapwright_logs::LogError>(())
//! ```
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod camera;
mod carmen;
mod chain;
mod channel;
mod choice;
mod clock;
mod directions;
mod drive;
mod error;
mod foxglove;
mod frames;
mod lag;
mod lagging;
mod links;
mod merge;
mod odometry;
mod order;
mod packets;
mod plan;
mod problem;
mod ranges;
mod report;
mod robots;
mod scans;
mod sonars;
mod space;
mod still;
mod stream;
mod survey;
mod turning;
mod unread;
mod words;

pub use camera::CameraSurvey;
pub use channel::TopicKind;
pub use choice::{Choice, MountChoice, SliceBounds, SpaceCalibration};
pub use clock::ClockStep;
pub use drive::{Drive, Input};
pub use error::LogError;
pub use lag::{Lag, LagEstimator};
pub use links::{Link, Links};
pub use mapwright_formats::OrderReport;
pub use mapwright_sensor::OdometryCalibration;
pub use merge::{WINDOW_BYTES, WINDOW_MESSAGES, WINDOW_S};
pub use odometry::OdometrySource;
pub use plan::{FurtherLaser, Plan};
pub use report::{LogReport, RecordingReport, Refused, StreamReport};
pub use robots::Robot;
pub use sonars::SonarSource;
pub use space::{ImuCalibrator, ImuFit, ImuSource, SpaceEvent, SpacePlan, SpaceStream};
pub use survey::{Survey, TopicSurvey};
pub use turning::TurningSource;
