//! Many robots, one map.
//!
//! Each robot maps for itself ([`mapwright::Mapper`]) and says what it has mapped in a chain of signed records. [`Node`] is the protocol that
//! spreads these: over any radio, with losses, for a robot that was away as well. [`Team`] makes one map of them: the first robot of the
//! roster that is alive looks for the places of each robot among those of the others and hands out what it has found, as records of its own.
//! So all robots end with the same map, to the byte, for results are recorded and not computed again.
//!
//! The crate knows no clock, no file and no socket: time and bytes come in, bytes go out.

mod bytes;
mod chain;
mod inbox;
mod intent;
mod keys;
mod message;
mod node;
mod record;
mod sightings;
mod solution;
mod steps;
mod team;

pub use chain::Chain;
pub use intent::Intent;
pub use keys::{Member, Roster, RosterError, SIGNATURE_BYTES, Secret};
pub use message::{MESSAGE_AT_MOST, RECORDS_AT_MOST, Refusal};
pub use node::{Node, NodeSettings, Outgoing};
pub use record::{ChainId, Equivocation, Hash, Kind, PAYLOAD_AT_MOST, Record};
pub use sightings::SightedRobot;
pub use team::Team;
