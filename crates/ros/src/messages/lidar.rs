//! What drivers of lidars publish beside clouds: their own points, and packets as they came from the network.

use super::{Header, message};
use crate::encoder::Encoder;
use crate::error::RosError;
use crate::field::{Field, FitCheck, mismatch};
use crate::schema::{Arity, Base, FieldType, Primitive};
use crate::value::Value;
use crate::wire::Cursor;
use mapwright_geom::Stamp;
use std::borrow::Cow;

message! {
    /// A point of a Livox lidar.
    LivoxPoint = ["livox_ros_driver/CustomPoint", "livox_ros_driver2/CustomPoint", "livox_interfaces/CustomPoint"];
    /// After the time base, nanoseconds.
    offset_time: u32,
    /// Ahead, metres.
    x: f32,
    /// To the left, metres.
    y: f32,
    /// Up, metres.
    z: f32,
    /// 0 to 255.
    reflectivity: u8,
    /// Which return it is, and whether it is taken for noise.
    tag: u8,
    /// The laser's number.
    line: u8,
}

message! {
    /// Points of a Livox lidar as its driver has them. [`LivoxScan::to_points`] are those that count.
    LivoxScan<'a> = ["livox_ros_driver/CustomMsg", "livox_ros_driver2/CustomMsg", "livox_interfaces/CustomMsg"];
    /// When, and the sensor's frame.
    header: Header<'a>,
    /// When the first point was taken, by the lidar's clock, nanoseconds.
    timebase: u64,
    /// How many points.
    point_num: u32,
    /// Number of the device.
    lidar_id: u8,
    /// Of no meaning.
    rsvd: [u8; 3],
    /// The points.
    points: Vec<LivoxPoint>,
}

message! {
    /// A packet as it came from the network, and when.
    LidarPacket<'a> = ["velodyne_msgs/VelodynePacket"];
    /// When it came; optional.
    stamp: Stamp = optional,
    /// Its bytes, and room behind them where `size` says so.
    data: Bytes<'a>,
    /// How many of the bytes count; optional.
    size: u32 = optional,
}

message! {
    /// Packets of about one revolution of a lidar.
    LidarPackets<'a> = [
        "velodyne_msgs/VelodyneScan",
        "pandar_msgs/PandarScan",
        "hesai_lidar/PandarScan",
        "nebula_msgs/NebulaPackets",
        "hesai_ros_driver/UdpFrame",
    ];
    /// When, and the sensor's frame.
    header: Header<'a>,
    /// The packets.
    packets: Vec<LidarPacket<'a>>,
}

message! {
    /// One packet of an Ouster lidar, of points or of its inertial sensor.
    OusterPacket<'a> = ["ouster_ros/PacketMsg", "ouster_sensor_msgs/PacketMsg", "ouster_msgs/PacketMsg"];
    /// Its bytes.
    buf: &'a [u8],
}

message! {
    /// A text.
    Text<'a> = ["std_msgs/String"];
    /// It.
    data: Cow<'a, str>,
}

/// Bytes of a list, however its length is said: such messages are read by name, and written as lists of any length only.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Bytes<'a>(pub &'a [u8]);

impl<'a> Field<'a> for Bytes<'a> {
    const MIN_BYTES: usize = 0;

    fn fit(ty: &FieldType, check: &mut FitCheck<'_>) -> Result<(), RosError> {
        if ty.base != Base::Number(Primitive::U8) || ty.arity == Arity::One {
            return Err(check.refuse(ty, "uint8[]"));
        }
        check.read_by_name();
        Ok(())
    }

    fn read(cursor: &mut Cursor<'a>) -> Result<Self, RosError> {
        <&[u8]>::read(cursor).map(Self)
    }

    fn pick(value: &Value<'a>) -> Result<Self, RosError> {
        <&[u8]>::pick(value).map(Self)
    }

    fn write(&self, out: &mut Encoder) {
        self.0.write(out);
    }
}

impl<'a> Field<'a> for [u8; 3] {
    const MIN_BYTES: usize = 3;

    fn fit(ty: &FieldType, check: &mut FitCheck<'_>) -> Result<(), RosError> {
        let expected = FieldType { base: Base::Number(Primitive::U8), arity: Arity::Fixed(3) };
        if *ty == expected { Ok(()) } else { Err(check.refuse(ty, &expected.to_string())) }
    }

    fn read(cursor: &mut Cursor<'a>) -> Result<Self, RosError> {
        Ok(cursor.numbers(1, 3)?.first_chunk().copied().unwrap_or_default())
    }

    fn pick(value: &Value<'a>) -> Result<Self, RosError> {
        let bytes = <&[u8]>::pick(value)?;
        bytes.try_into().map_err(|_| mismatch("uint8[3]", value))
    }

    fn write(&self, out: &mut Encoder) {
        out.bytes(self);
    }
}

impl<'a> LidarPacket<'a> {
    /// The bytes that came from the network.
    #[must_use]
    pub fn payload(&self) -> &'a [u8] {
        let all = self.data.0;
        let size = self.size as usize;
        if size == 0 { all } else { all.get(..size).unwrap_or(all) }
    }
}
