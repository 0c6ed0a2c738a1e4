//! ROS 2 over Zenoh without ROS: nodes that run with `RMW_IMPLEMENTATION=rmw_zenoh_cpp` hear and are heard.
//!
//! What goes over the wire is what `rmw_zenoh` (its `docs/design.md`) puts there: topics are Zenoh's publications, services its queries, what is
//! kept for who comes late is `zenoh-ext`'s, and who is there is said by liveliness tokens. Why it is done as it is stands in
//! `docs/decisions/0053-zenoh.md`.
//!
//! Nodes find each other through a router on their machine. Where there is none, this session is it.
//!
//! The environment is read as ROS 2's nodes read it: `ROS_DOMAIN_ID`, `ZENOH_SESSION_CONFIG_URI`, `ZENOH_ROUTER_CONFIG_URI`,
//! `ZENOH_CONFIG_OVERRIDE`.
//!
//! ```no_run
//! use mapwright_live::wire::{Delivery, Topic, Wire};
//! use mapwright_zenoh::{Configuration, Zenoh};
//!
//! let mut wire = Zenoh::join(&Configuration::from_environment()?, "/", "listener")?;
//! let scans = Topic::new("/scan", "sensor_msgs/msg/LaserScan", Delivery::BestEffort { depth: 10 });
//! wire.subscribe(&scans, Box::new(|bytes| println!("{} bytes", bytes.len())))?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod configuration;
mod keys;
mod latched;
mod listeners;
mod node;
mod opening;
mod services;

pub use configuration::{Configuration, ConfigurationError};
pub use node::Zenoh;
