//! From a recording's connections to decoders of its messages.

use crate::foxglove;
use mapwright_bags::{Connection, DefinitionFormat, Encoding};
use mapwright_ros::messages::{
    CameraInfo, CompressedImage, Image, Imu, Kind, LaserScan, LidarPackets, LivoxScan, MultiEchoLaserScan, Odometry,
    OusterPacket, PointCloud2, Range, Text, TfMessage,
};
use mapwright_ros::{Channel, Decoder};

/// What a topic's messages are good for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum TopicKind {
    /// `sensor_msgs/LaserScan`.
    Scan,
    /// `sensor_msgs/MultiEchoLaserScan`.
    MultiEcho,
    /// `sensor_msgs/PointCloud2`.
    Cloud,
    /// `nav_msgs/Odometry`.
    Odometry,
    /// `tf2_msgs/TFMessage`.
    Transforms,
    /// `sensor_msgs/Imu`.
    Imu,
    /// `sensor_msgs/Image`.
    Image,
    /// `sensor_msgs/CompressedImage`.
    CompressedImage,
    /// `sensor_msgs/CameraInfo`.
    CameraInfo,
    /// `livox_ros_driver/CustomMsg` and its like.
    Livox,
    /// `foxglove.PointCloud`.
    Foxglove,
    /// `velodyne_msgs/VelodyneScan`, `pandar_msgs/PandarScan` and their like.
    LidarPackets,
    /// `ouster_ros/PacketMsg` and its like.
    OusterPackets,
    /// `sensor_msgs/Range`.
    Range,
    /// `std_msgs/String`.
    Text,
    /// Anything else.
    Other,
}

impl TopicKind {
    /// By the name of a type, with or without `msg` in the middle.
    #[must_use]
    pub fn of(type_name: &str) -> Self {
        match type_name {
            name if LaserScan::is(name) => Self::Scan,
            name if MultiEchoLaserScan::is(name) => Self::MultiEcho,
            name if PointCloud2::is(name) => Self::Cloud,
            name if Odometry::is(name) => Self::Odometry,
            name if TfMessage::is(name) => Self::Transforms,
            name if Imu::is(name) => Self::Imu,
            name if Image::is(name) => Self::Image,
            name if CompressedImage::is(name) => Self::CompressedImage,
            name if CameraInfo::is(name) => Self::CameraInfo,
            name if LivoxScan::is(name) => Self::Livox,
            name if LidarPackets::is(name) => Self::LidarPackets,
            name if OusterPacket::is(name) => Self::OusterPackets,
            name if Range::is(name) => Self::Range,
            name if Text::is(name) => Self::Text,
            foxglove::POINT_CLOUD => Self::Foxglove,
            _ => Self::Other,
        }
    }

    /// Whether its messages can become scans.
    #[must_use]
    pub fn is_scans(self) -> bool {
        matches!(self, Self::Scan | Self::MultiEcho | Self::Cloud)
    }

    /// Whether its messages are of planar lasers.
    #[must_use]
    pub fn is_planar(self) -> bool {
        matches!(self, Self::Scan | Self::MultiEcho)
    }

    /// Whether its messages are images, of depth or of anything else.
    #[must_use]
    pub fn is_images(self) -> bool {
        matches!(self, Self::Image | Self::CompressedImage)
    }

    /// Whether its messages have points in space, or packets of them.
    #[must_use]
    pub fn is_clouds(self) -> bool {
        matches!(self, Self::Cloud | Self::Livox | Self::Foxglove) || self.is_packets()
    }

    /// Whether its messages have packets as they came from the network.
    #[must_use]
    pub fn is_packets(self) -> bool {
        matches!(self, Self::LidarPackets | Self::OusterPackets)
    }

    /// Whether its messages can say how a robot moves or turns.
    pub(crate) fn is_motion(self) -> bool {
        matches!(self, Self::Odometry | Self::Transforms | Self::Imu)
    }
}

/// A decoder of one connection's messages.
#[derive(Debug)]
pub(crate) enum Messages {
    Scan(Decoder<LaserScan<'static>>),
    MultiEcho(Decoder<MultiEchoLaserScan<'static>>),
    Cloud(Decoder<PointCloud2<'static>>),
    Odometry(Decoder<Odometry<'static>>),
    Transforms(Decoder<TfMessage<'static>>),
    Imu(Decoder<Imu<'static>>),
    Image(Decoder<Image<'static>>),
    CompressedImage(Decoder<CompressedImage<'static>>),
    CameraInfo(Decoder<CameraInfo<'static>>),
    Livox(Decoder<LivoxScan<'static>>),
    Foxglove(foxglove::Layout),
    LidarPackets(Decoder<LidarPackets<'static>>),
    OusterPackets(Decoder<OusterPacket<'static>>),
    Range(Decoder<Range<'static>>),
    Text(Decoder<Text<'static>>),
    /// Nothing to decode, or nothing that can be: why, where it should have been.
    None(Option<String>),
}

impl Messages {
    pub(crate) fn of(connection: &Connection) -> Self {
        let kind = TopicKind::of(&connection.type_name);
        if kind == TopicKind::Other {
            return Self::None(None);
        }
        Self::decoder(kind, connection).unwrap_or_else(|reason| Self::None(Some(reason)))
    }

    fn decoder(kind: TopicKind, connection: &Connection) -> Result<Self, String> {
        if kind == TopicKind::Foxglove {
            return foxglove::Layout::of(connection).map(Self::Foxglove);
        }
        let channel = channel(connection)?;
        let made = match kind {
            TopicKind::Scan => Decoder::new(&channel).map(Self::Scan),
            TopicKind::MultiEcho => Decoder::new(&channel).map(Self::MultiEcho),
            TopicKind::Cloud => Decoder::new(&channel).map(Self::Cloud),
            TopicKind::Odometry => Decoder::new(&channel).map(Self::Odometry),
            TopicKind::Transforms => Decoder::new(&channel).map(Self::Transforms),
            TopicKind::Imu => Decoder::new(&channel).map(Self::Imu),
            TopicKind::Image => Decoder::new(&channel).map(Self::Image),
            TopicKind::CompressedImage => Decoder::new(&channel).map(Self::CompressedImage),
            TopicKind::CameraInfo => Decoder::new(&channel).map(Self::CameraInfo),
            TopicKind::Livox => Decoder::new(&channel).map(Self::Livox),
            TopicKind::LidarPackets => Decoder::new(&channel).map(Self::LidarPackets),
            TopicKind::OusterPackets => Decoder::new(&channel).map(Self::OusterPackets),
            TopicKind::Range => Decoder::new(&channel).map(Self::Range),
            TopicKind::Text => Decoder::new(&channel).map(Self::Text),
            TopicKind::Foxglove | TopicKind::Other => return Ok(Self::None(None)),
        };
        made.map_err(|error| error.to_string())
    }
}

fn channel(connection: &Connection) -> Result<Channel, String> {
    let encoding = match &connection.encoding {
        Encoding::Ros1 => mapwright_ros::Encoding::Ros1,
        Encoding::Cdr => mapwright_ros::Encoding::Cdr,
        other => return Err(format!("messages encoded as {other} are not read, expected ros1 or cdr")),
    };
    let definition = connection.definition.as_ref().and_then(|definition| {
        let format = match definition.format {
            DefinitionFormat::Ros1Msg => mapwright_ros::DefinitionFormat::Ros1Msg,
            DefinitionFormat::Ros2Msg => mapwright_ros::DefinitionFormat::Ros2Msg,
            DefinitionFormat::Ros2Idl => mapwright_ros::DefinitionFormat::Ros2Idl,
            _ => return None,
        };
        Some((format, &*definition.text))
    });
    Channel::new(&connection.type_name, encoding, definition).map_err(|error| error.to_string())
}

/// Decoders by connection, made when a connection first delivers.
#[derive(Debug, Default)]
pub(crate) struct Decoders(Vec<Option<Messages>>);

impl Decoders {
    pub(crate) fn of(&mut self, connection: &Connection) -> &mut Messages {
        let at = connection.id as usize;
        if self.0.len() <= at {
            self.0.resize_with(at + 1, || None);
        }
        self.0[at].get_or_insert_with(|| Messages::of(connection))
    }
}
