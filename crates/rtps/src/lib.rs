//! Services of ROS 2 over DDS: a participant that answers requests, of the wire protocol of DDS (RTPS, OMG DDSI-RTPS 2.5) what services want.
//!
//! It is there because no library that moves topics well says to which request a response belongs in the way that Fast DDS wants it, and
//! because who asks for the first time should be answered at once. Found and told are participants, readers and writers; reliable readers of
//! requests and reliable writers of responses, in fragments where they are long. There is no security, no IPv6, no key and no content filter.
//!
//! Whatever arrives is checked before it is believed; what is kept of others is bounded.
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod bytes;
mod ids;
mod interfaces;
mod message;
mod packets;
mod parameters;
mod participant;
mod services;
mod source;
#[cfg(test)]
mod tests;
mod writer;

pub use participant::ServiceNames;
pub use services::{Answer, Configuration, RtpsError, Services};
