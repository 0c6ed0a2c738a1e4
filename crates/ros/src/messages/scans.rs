//! Laser scans and point clouds.

use super::{Header, message};
use crate::slice::Slice;
use std::borrow::Cow;

message! {
    /// One sweep of a planar laser.
    LaserScan<'a> = ["sensor_msgs/LaserScan"];
    /// When the first beam was taken, and the laser's frame.
    header: Header<'a>,
    /// Bearing of the first beam, radians.
    angle_min: f32,
    /// Bearing of the last beam, radians.
    angle_max: f32,
    /// From one beam to the next, radians.
    angle_increment: f32,
    /// From one beam to the next, seconds; zero where not known.
    time_increment: f32,
    /// From one sweep to the next, seconds.
    scan_time: f32,
    /// Readings below are not returns, metres.
    range_min: f32,
    /// Readings above are not returns, metres.
    range_max: f32,
    /// Readings, metres.
    ranges: Slice<'a, f32>,
    /// How bright each return was, in units of the device; optional.
    intensities: Slice<'a, f32> = optional,
}

message! {
    /// What one beam brought back, nearest first.
    LaserEcho<'a> = ["sensor_msgs/LaserEcho"];
    /// One reading an echo.
    echoes: Slice<'a, f32>,
}

message! {
    /// One sweep of a planar laser with several echoes a beam.
    MultiEchoLaserScan<'a> = ["sensor_msgs/MultiEchoLaserScan"];
    /// When the first beam was taken, and the laser's frame.
    header: Header<'a>,
    /// Bearing of the first beam, radians.
    angle_min: f32,
    /// Bearing of the last beam, radians.
    angle_max: f32,
    /// From one beam to the next, radians.
    angle_increment: f32,
    /// From one beam to the next, seconds; zero where not known.
    time_increment: f32,
    /// From one sweep to the next, seconds.
    scan_time: f32,
    /// Readings below are not returns, metres.
    range_min: f32,
    /// Readings above are not returns, metres.
    range_max: f32,
    /// Readings, metres.
    ranges: Vec<LaserEcho<'a>>,
    /// How bright each return was; optional.
    intensities: Vec<LaserEcho<'a>> = optional,
}

message! {
    /// Where in a point one of its numbers is.
    PointField<'a> = ["sensor_msgs/PointField"];
    /// Its name, such as `x`.
    name: Cow<'a, str>,
    /// Bytes from the point's beginning.
    offset: u32,
    /// Its type: 1 int8, 2 uint8, 3 int16, 4 uint16, 5 int32, 6 uint32, 7 float32, 8 float64.
    datatype: u8,
    /// How many of them.
    count: u32,
}

message! {
    /// A point cloud. [`Cloud`](crate::Cloud) finds the points in it.
    PointCloud2<'a> = ["sensor_msgs/PointCloud2"];
    /// When, and the sensor's frame.
    header: Header<'a>,
    /// Rows; 1 where the points are in no order.
    height: u32,
    /// Points a row.
    width: u32,
    /// What a point consists of.
    fields: Vec<PointField<'a>>,
    /// Whether numbers have their most significant byte first.
    is_bigendian: bool,
    /// Bytes from one point to the next.
    point_step: u32,
    /// Bytes from one row to the next.
    row_step: u32,
    /// The points.
    data: &'a [u8],
    /// Whether every point is valid; optional.
    is_dense: bool = optional,
}
