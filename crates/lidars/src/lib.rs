//! Lidars on a cable, without ROS: bytes in; requests to send, revolutions and clouds out.
//!
//! | lidar | cable | what comes out |
//! |---|---|---|
//! | LD06, LD19 ([`Ld06`]) | serial, 230,400 baud | [`Revolution`] |
//! | RPLIDAR ([`Rplidar`]): standard, express, dense and ultra scans | serial, 115,200 baud and others | [`Revolution`] |
//! | Velodyne, Ouster, Hesai ([`Udp`]) | datagrams | [`Cloud`](mapwright_sensor::Cloud), inertial readings |
//!
//! Nothing here opens a port, reads a clock or waits. Whoever does hands in what arrived and when ([`Lidar::receive`], in any pieces), sends what
//! [`Lidar::next_request`] asks for, and takes what is ready. A cable that was pulled out and put back is told by [`Lidar::restart`]. All bytes are
//! accounted for ([`Counts`]), and what is wrong is said in words ([`Lidar::problem`]).
//!
//! A [`Revolution`] has every beam with its own bearing and time. A [`Fan`] makes a [`LaserScan`](mapwright_sensor::LaserScan) of it, which has beams
//! at even steps ([0051](https://github.com/mapwright/mapwright/blob/main/docs/decisions/0051-lidars.md)).
//!
//! ```
//! use mapwright_geom::Stamp;
//! use mapwright_lidars::{Lidar, LidarPlace};
//!
//! let place: LidarPlace = "ld06:/dev/ttyUSB0".parse()?;
//! assert_eq!((place.place.as_str(), place.baud), ("/dev/ttyUSB0", 230_400));
//! let mut lidar = Lidar::new(place.kind);
//! lidar.receive(b"what the port has read", Stamp(0));
//! assert!(lidar.next_scan().is_none());
//! assert_eq!(lidar.counts().bytes_skipped, 22);
//! # Ok::<(), mapwright_lidars::LidarError>(())
//! ```
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod clock;
mod counts;
mod error;
mod fan;
mod kind;
mod ld06;
mod lidar;
mod revolution;
mod rplidar;
mod udp;

pub use counts::Counts;
pub use error::LidarError;
pub use fan::Fan;
pub use kind::{LidarKind, LidarPlace};
pub use ld06::{LD06_PACKET_BYTES, Ld06};
pub use lidar::Lidar;
pub use revolution::{Beam, Revolution};
pub use rplidar::{Request, Rplidar, RplidarInfo, ScanMode};
pub use udp::Udp;
