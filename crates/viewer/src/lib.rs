//! The map while it grows, in a browser.
//!
//! ```no_run
//! use mapwright_record::{Session, Update};
//! use mapwright_viewer::{Pen, Settings, Viewer};
//! # fn next() -> Option<(Update, Session)> { None }
//! # fn main() -> Result<(), mapwright_viewer::ViewerError> {
//! let pen = Pen { resolution_m: 0.05, free_range_m: 6.0, passes_per_hit: 5 };
//! let mut viewer = Viewer::start(Settings::default(), pen)?;
//! let page = viewer.url(); // for whoever is to look
//! while let Some((update, session)) = next() {
//!     viewer.show(&update, &session); // never waits; next to nothing while nobody watches
//! }
//! # Ok(())
//! # }
//! ```
//!
//! Parts, from the mapper to the browser:
//!
//! 1. [`Viewer::show`] runs on the mapper's thread. It reads what is new of a session into [`News`], plain data, when the view asks for
//!    it: at most ten times a second, and never while nobody watches.
//! 2. The view has one thread. It draws keyframes where they are now, cell by cell as the exported map does, and puts what a page shows
//!    into a [`Scene`]: items of bytes, each with the version in which it changed last.
//! 3. A page says when it is ready for more and gets what has changed since, the oldest change first. Whoever is slow gets the newest state
//!    later; nothing waits for anybody, and nothing is queued. What the messages hold: [`wire`].
//!
//! A finished run is shown by the same page, with a time line: [`Replay`].
//!
//! Nobody but who sits at this machine sees anything: the view listens on 127.0.0.1, and on another address only with a token. What a page
//! of another site asks for is refused by its `Host` and its `Origin`.
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod access;
mod clouds;
mod error;
mod feed;
mod model;
mod news;
mod page;
mod picture;
mod replay;
mod scene;
mod server;
mod viewer;
pub mod wire;

pub use error::ViewerError;
pub use news::{Closure, News, Placed, Robot, Seen, View};
pub use page::page;
pub use picture::Pen;
pub use replay::{Replay, ReplayMaker};
pub use scene::Scene;
pub use viewer::{Settings, Viewer};
