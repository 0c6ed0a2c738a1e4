//! Which lidar sends packets, and its decoder.

use super::ouster::OusterInfo;
use super::sweep::{Place, Sweep};
use super::velodyne::Model;
use super::{hesai, ouster, velodyne};
use crate::notes::Notes;
use crate::points::telling;
use mapwright_geom::Stamp;
use mapwright_sensor::ImuReading;
use std::sync::Arc;

/// How to come by an Ouster's metadata, in words.
pub const OUSTER_METADATA: &str =
    "`curl http://SENSOR/api/v1/sensor/metadata` or `ouster-cli source SENSOR metadata` write it";

/// A kind of lidar, told by a packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Lidar(Family);

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Family {
    /// By the product's number.
    Velodyne(u8),
    Hesai(hesai::Head),
    /// By the bytes of a packet.
    Ouster(usize),
}

impl Lidar {
    /// What sends such packets of points; none where it is none that is known here.
    #[must_use]
    pub fn of(payload: &[u8], info: Option<&OusterInfo>) -> Option<Self> {
        if let Some(product) = velodyne::product(payload) {
            return Some(Self(Family::Velodyne(product)));
        }
        if let Some(head) = hesai::Head::of(payload) {
            return Some(Self(Family::Hesai(head)));
        }
        let is_ouster = info.map_or_else(|| ouster::is_like(payload), |info| info.packet_bytes() == payload.len());
        is_ouster.then_some(Self(Family::Ouster(payload.len())))
    }

    /// An Ouster whose packets of points have so many bytes.
    #[must_use]
    pub fn ouster(packet_bytes: usize) -> Self {
        Self(Family::Ouster(packet_bytes))
    }

    /// Whether only its metadata say what its packets mean.
    #[must_use]
    pub fn is_ouster(self) -> bool {
        matches!(self.0, Family::Ouster(_))
    }

    /// Its name.
    ///
    /// # Errors
    /// Why its packets are not read, and what can be done, in words.
    pub fn name(self, info: Option<&OusterInfo>) -> Result<String, String> {
        match self.0 {
            Family::Velodyne(product) => Ok(model(product)?.name().to_owned()),
            Family::Hesai(head) if head.is_xt32() => Ok("PandarXT-32".to_owned()),
            Family::Hesai(head) => Err(format!(
                "expected packets of a Hesai PandarXT-32 (protocol 6, 32 lasers in 8 blocks), found {head}: play it through its \
                 driver (hesai_ros_driver with `source_type: 2` for pcap and 3 for its bags, nebula_ros with `launch_hw:=false` for \
                 pandar_msgs) and record its PointCloud2"
            )),
            Family::Ouster(bytes) => match info {
                Some(info) if info.packet_bytes() == bytes => Ok(format!("Ouster {}", info.product)),
                Some(info) => Err(format!(
                    "expected packets of {} bytes, as the metadata say ({}), found {bytes}: these metadata are another sensor's; \
                     {OUSTER_METADATA}",
                    info.packet_bytes(),
                    info.words()
                )),
                None => Err(format!(
                    "packets of {bytes} bytes, as an Ouster sends them, and nothing says where its beams look"
                )),
            },
        }
    }

    /// The farthest that it sees, metres.
    #[must_use]
    pub fn range_max_m(self, info: Option<&OusterInfo>) -> f64 {
        match self.0 {
            Family::Velodyne(product) => model(product).map_or(100.0, Model::range_max_m),
            Family::Hesai(_) => hesai::RANGE_MAX_M,
            Family::Ouster(_) if info.is_some_and(|info| info.product.starts_with("OS-2")) => 240.0,
            Family::Ouster(_) => 120.0,
        }
    }

    /// What was decided about it, in words.
    #[must_use]
    pub fn decisions(self, info: Option<&OusterInfo>) -> Vec<String> {
        let name = self.name(info).unwrap_or_default();
        match (self.0, info) {
            (Family::Velodyne(_), _) => {
                vec![format!("{name}, its default angles; x is ahead, where its azimuth is zero, y to the left")]
            }
            (Family::Hesai(_), _) => {
                vec![format!("{name}, its default angles; y is where its azimuth is zero, x to the right")]
            }
            (Family::Ouster(_), Some(info)) => vec![info.words(), "points are in the sensor's frame".to_owned()],
            (Family::Ouster(_), None) => Vec::new(),
        }
    }

    /// Whether its packets have several returns of a beam.
    #[must_use]
    pub fn is_dual(self, payload: &[u8]) -> bool {
        matches!(self.0, Family::Velodyne(_)) && velodyne::is_dual(payload)
    }
}

fn model(product: u8) -> Result<Model, String> {
    Model::of_product(product).ok_or_else(|| {
        format!(
            "expected packets of a VLP-16 (0x22), Puck LITE (0x23), Puck Hi-Res (0x24), VLP-32C (0x28) or HDL-32E (0x21), found those of \
             product {product:#04x}: play it through velodyne_driver (`pcap:=FILE`) and velodyne_pointcloud of its model and record its PointCloud2"
        )
    })
}

/// Makes clouds of a lidar's packets, one a revolution.
#[derive(Debug)]
pub struct PacketDecoder(Decoder);

enum Decoder {
    Velodyne(Box<velodyne::Decoder>),
    Hesai(Box<hesai::Decoder>),
    Ouster(Box<ouster::Decoder>),
}

impl std::fmt::Debug for Decoder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Velodyne(_) => "Velodyne",
            Self::Hesai(_) => "Hesai",
            Self::Ouster(_) => "Ouster",
        })
    }
}

impl PacketDecoder {
    /// A decoder of what a lidar sends.
    ///
    /// # Errors
    /// As [`Lidar::name`].
    pub fn new(lidar: Lidar, info: Option<&Arc<OusterInfo>>) -> Result<Self, String> {
        Self::of(lidar, info, false)
    }

    /// One that only counts revolutions: its clouds have no points.
    pub(super) fn counting(lidar: Lidar, info: Option<&Arc<OusterInfo>>) -> Result<Self, String> {
        Self::of(lidar, info, true)
    }

    fn of(lidar: Lidar, info: Option<&Arc<OusterInfo>>, is_counting: bool) -> Result<Self, String> {
        lidar.name(info.map(|info| &**info))?;
        let decoder = match (lidar.0, info) {
            (Family::Velodyne(product), _) => {
                Decoder::Velodyne(Box::new(velodyne::Decoder::new(model(product)?, is_counting)))
            }
            (Family::Hesai(_), _) => Decoder::Hesai(Box::new(hesai::Decoder::new(is_counting))),
            (Family::Ouster(_), Some(info)) => Decoder::Ouster(Box::new(ouster::Decoder::new(info, is_counting))),
            (Family::Ouster(_), None) => return Err(OUSTER_METADATA.to_owned()),
        };
        Ok(Self(decoder))
    }

    /// Takes in a packet that was captured at a time.
    pub fn add(&mut self, place: Place<'_>, captured: Stamp, payload: &[u8], notes: &mut Notes) {
        match &mut self.0 {
            Decoder::Velodyne(decoder) => decoder.add(place, captured, payload, notes),
            Decoder::Hesai(decoder) => decoder.add(place, captured, payload, notes),
            Decoder::Ouster(decoder) => decoder.add(place, captured, payload, notes),
        }
    }

    /// Ends the cloud that has begun, as at the end of a recording.
    pub fn finish(&mut self, file: &str, notes: &mut Notes) {
        match &mut self.0 {
            Decoder::Velodyne(decoder) => decoder.revolutions.cut(file, notes),
            Decoder::Hesai(decoder) => decoder.revolutions.cut(file, notes),
            Decoder::Ouster(decoder) => decoder.cut(file, notes),
        }
    }

    /// The next cloud that has ended.
    pub fn next_sweep(&mut self) -> Option<Sweep> {
        let sweep = match &mut self.0 {
            Decoder::Velodyne(decoder) => decoder.pop(),
            Decoder::Hesai(decoder) => decoder.pop(),
            Decoder::Ouster(decoder) => decoder.pop(),
        }?;
        Some(Sweep { intensities: telling(sweep.intensities), ..sweep })
    }

    /// Whether a cloud has ended that was not asked for.
    pub(super) fn is_ready(&self) -> bool {
        match &self.0 {
            Decoder::Velodyne(decoder) => !decoder.revolutions.ready.is_empty(),
            Decoder::Hesai(decoder) => !decoder.revolutions.ready.is_empty(),
            Decoder::Ouster(decoder) => decoder.is_ready(),
        }
    }

    /// The reading of a packet of the inertial sensor in the lidar, by the clock of its clouds; none before the first packet of points,
    /// or where it is none.
    #[must_use]
    pub fn reading(&self, payload: &[u8]) -> Option<ImuReading> {
        match &self.0 {
            Decoder::Ouster(decoder) => decoder.reading(payload),
            Decoder::Velodyne(_) | Decoder::Hesai(_) => None,
        }
    }
}
