//! One lidar of any kind.

use crate::counts::Counts;
use crate::kind::LidarKind;
use crate::ld06::Ld06;
use crate::revolution::Revolution;
use crate::rplidar::{Request, Rplidar};
use crate::udp::Udp;
use mapwright_geom::Stamp;
use mapwright_sensor::Cloud;

/// A lidar of any kind that is known here.
#[derive(Debug)]
#[non_exhaustive]
pub enum Lidar {
    /// An LD06 or LD19.
    Ld06(Box<Ld06>),
    /// An RPLIDAR.
    Rplidar(Box<Rplidar>),
    /// A lidar of space.
    Udp(Box<Udp>),
}

impl Lidar {
    /// A lidar of a kind; an Ouster is [`Lidar::Udp`] of [`Udp::ouster`].
    #[must_use]
    pub fn new(kind: LidarKind) -> Self {
        match kind {
            LidarKind::Ld06 => Self::Ld06(Box::default()),
            LidarKind::Rplidar(mode) => Self::Rplidar(Box::new(Rplidar::of(mode))),
            LidarKind::Velodyne | LidarKind::Ouster | LidarKind::Hesai => Self::Udp(Box::default()),
        }
    }

    /// Takes in what arrived at a time: bytes of a serial line in any pieces, or the payload of one datagram.
    pub fn receive(&mut self, bytes: &[u8], arrived: Stamp) {
        match self {
            Self::Ld06(lidar) => lidar.receive(bytes, arrived),
            Self::Rplidar(lidar) => lidar.receive(bytes, arrived),
            Self::Udp(lidar) => lidar.receive(bytes, arrived),
        }
    }

    /// The next thing to do to the line, if there is one now: to be asked until there is none, after each receipt and ten times a second.
    pub fn next_request(&mut self, now: Stamp) -> Option<Request> {
        match self {
            Self::Rplidar(lidar) => lidar.next_request(now),
            Self::Ld06(_) | Self::Udp(_) => None,
        }
    }

    /// What is to be done to the line before it is left alone.
    #[must_use]
    pub fn last_requests(&self) -> Vec<Request> {
        match self {
            Self::Rplidar(lidar) => lidar.last_requests().to_vec(),
            Self::Ld06(_) | Self::Udp(_) => Vec::new(),
        }
    }

    /// The next whole revolution of a lidar of the plane.
    pub fn next_scan(&mut self) -> Option<Revolution> {
        match self {
            Self::Ld06(lidar) => lidar.next_scan(),
            Self::Rplidar(lidar) => lidar.next_scan(),
            Self::Udp(_) => None,
        }
    }

    /// The next whole revolution of a lidar of space.
    pub fn next_cloud(&mut self) -> Option<Cloud> {
        match self {
            Self::Udp(lidar) => lidar.next_cloud(),
            Self::Ld06(_) | Self::Rplidar(_) => None,
        }
    }

    /// What became of all that arrived.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        match self {
            Self::Ld06(lidar) => lidar.counts(),
            Self::Rplidar(lidar) => lidar.counts(),
            Self::Udp(lidar) => lidar.counts(),
        }
    }

    /// What keeps it from being read, in words; none while it is.
    #[must_use]
    pub fn problem(&self) -> Option<&str> {
        match self {
            Self::Ld06(lidar) => lidar.problem(),
            Self::Rplidar(lidar) => lidar.problem(),
            Self::Udp(lidar) => lidar.problem(),
        }
    }

    /// The cable was pulled out and put back: what has begun is left out, and the lidar is started anew.
    pub fn restart(&mut self) {
        match self {
            Self::Ld06(lidar) => lidar.restart(),
            Self::Rplidar(lidar) => lidar.restart(),
            Self::Udp(lidar) => lidar.restart(),
        }
    }
}
