//! Recordings of packets, and the sensors that send them.

pub(crate) mod capture;
mod clock;
pub(crate) mod flows;
mod hesai;
pub(crate) mod lidar;
pub(crate) mod ouster;
pub(crate) mod sweep;
mod udp;
mod velodyne;
pub(crate) mod window;
