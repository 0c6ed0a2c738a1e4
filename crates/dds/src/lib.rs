//! ROS 2 over DDS without ROS: topics through Cyclone DDS, services through [`mapwright_rtps`].
//!
//! Two participants of one node, for Cyclone moves large messages into peers with small buffers faster than anything else does, but does not say to
//! which request a response is in the way that Fast DDS wants it. What decided is in `docs/decisions/0049-live.md`.
//!
//! The environment is read as ROS 2's nodes read it: `ROS_DOMAIN_ID`, `ROS_AUTOMATIC_DISCOVERY_RANGE`, `ROS_STATIC_PEERS`, `CYCLONEDDS_URI`.
//!
//! Without the feature `cyclone`, which needs cmake and libclang to build Cyclone DDS, there is nothing here.
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

#[cfg(feature = "cyclone")]
mod configuration;
#[cfg(feature = "cyclone")]
mod cyclone;
#[cfg(feature = "cyclone")]
mod node;
#[cfg(feature = "cyclone")]
mod services;

#[cfg(feature = "cyclone")]
pub use configuration::{Configuration, ConfigurationError, Range};
#[cfg(feature = "cyclone")]
pub use node::Dds;
