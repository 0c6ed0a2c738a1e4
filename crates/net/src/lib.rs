//! The wire of a team of robots: bytes in and out over Zenoh, with TLS on both sides; and the keys and certificates that go with it.
//!
//! It knows Zenoh and nothing of maps. [`Wire`] is a connection to the team: it hands out what others have said with
//! the name in their certificate, and says which of them are reached. Each robot can speak in its own name alone, by rules that every other
//! robot applies to it. [`Authority`] makes certificates, [`Credentials`] are what one robot has of them.

mod credentials;
mod error;
mod issue;
mod queue;
mod rules;
mod watch;
mod wire;

pub use credentials::{Credentials, is_team_name};
pub use error::NetError;
pub use issue::{Authority, Issued, random_bytes};
pub use rules::WireSettings;
pub use watch::Complaint;
pub use wire::{Arrival, Link, Wire};
