//! Recordings of packets, and the sensors that send them.

pub(crate) mod capture;
mod udp;
pub(crate) mod velodyne;
pub(crate) mod window;
