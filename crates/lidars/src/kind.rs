//! Names of lidars, and where they are.

use crate::error::LidarError;
use crate::rplidar::ScanMode;
use std::str::FromStr;

/// A kind of lidar that is known here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum LidarKind {
    /// `ld06` or `ld19`: the same packets.
    Ld06,
    /// `rplidar`, `rplidar-standard`, `rplidar-express`.
    Rplidar(ScanMode),
    /// `velodyne`.
    Velodyne,
    /// `ouster`.
    Ouster,
    /// `hesai`.
    Hesai,
}

impl FromStr for LidarKind {
    type Err = LidarError;

    fn from_str(name: &str) -> Result<Self, LidarError> {
        match name.to_ascii_lowercase().as_str() {
            "ld06" | "ld19" => Ok(Self::Ld06),
            "rplidar" => Ok(Self::Rplidar(ScanMode::Typical)),
            "rplidar-standard" => Ok(Self::Rplidar(ScanMode::Standard)),
            "rplidar-express" => Ok(Self::Rplidar(ScanMode::Express)),
            "velodyne" => Ok(Self::Velodyne),
            "ouster" => Ok(Self::Ouster),
            "hesai" => Ok(Self::Hesai),
            _ => Err(LidarError::Name { name: name.to_owned() }),
        }
    }
}

impl LidarKind {
    /// Whether it is on a serial line, not on a network.
    #[must_use]
    pub fn is_serial(self) -> bool {
        matches!(self, Self::Ld06 | Self::Rplidar(_))
    }

    /// Speed of its serial line, baud, with 8 bits, no parity and one stop bit; zero for lidars on a network. An RPLIDAR A3, S1 and A2M12 have 256,000,
    /// a C1 460,800, an S2 and S3 1,000,000: that is to be said.
    #[must_use]
    pub fn baud(self) -> u32 {
        match self {
            Self::Ld06 => 230_400,
            Self::Rplidar(_) => 115_200,
            Self::Velodyne | Self::Ouster | Self::Hesai => 0,
        }
    }

    /// Ports at which its datagrams arrive unless it was set otherwise: points, then inertial readings. None for a serial line.
    #[must_use]
    pub fn udp_ports(self) -> &'static [u16] {
        match self {
            Self::Velodyne | Self::Hesai => &[2368],
            Self::Ouster => &[7502, 7503],
            Self::Ld06 | Self::Rplidar(_) => &[],
        }
    }

    /// Nearest and farthest return, metres, by the data sheets; for an RPLIDAR of any family (see [`RplidarInfo::range_max_m`](crate::RplidarInfo::range_max_m)).
    #[must_use]
    pub fn ranges_m(self) -> [f64; 2] {
        match self {
            Self::Ld06 => [0.02, 12.0],
            Self::Rplidar(_) => [0.05, 40.0],
            Self::Velodyne | Self::Ouster | Self::Hesai => [0.5, 120.0],
        }
    }

    fn example(self) -> &'static str {
        match self {
            Self::Ld06 => "ld06:/dev/ttyUSB0",
            Self::Rplidar(_) => "rplidar:/dev/ttyUSB0 or rplidar:/dev/ttyUSB0@256000",
            Self::Velodyne => "velodyne:2368",
            Self::Ouster => "ouster:7502",
            Self::Hesai => "hesai:2368",
        }
    }
}

/// Which lidar is where, as `ld06:/dev/ttyUSB0`, `rplidar:/dev/ttyUSB0@256000` or `velodyne:2368`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LidarPlace {
    /// Which lidar.
    pub kind: LidarKind,
    /// The serial port, or the address or port at which datagrams arrive, as it was said.
    pub place: String,
    /// Speed of the serial line, baud; zero for lidars on a network.
    pub baud: u32,
}

impl FromStr for LidarPlace {
    type Err = LidarError;

    fn from_str(said: &str) -> Result<Self, LidarError> {
        let (name, place) = said.split_once(':').unwrap_or((said, ""));
        let kind: LidarKind = name.parse()?;
        let (place, baud) = match place.rsplit_once('@').filter(|_| kind.is_serial()) {
            Some((place, baud)) => (place, baud.parse().ok().filter(|&baud| baud > 0)),
            None => (place, Some(kind.baud())),
        };
        if place.is_empty() {
            return Err(LidarError::Place { found: said.to_owned(), example: kind.example() });
        }
        let baud = baud.ok_or_else(|| LidarError::Baud { found: said.to_owned() })?;
        Ok(Self { kind, place: place.to_owned(), baud })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_places_are_read_or_refused_with_what_to_say() {
        let read = |said: &str| said.parse::<LidarPlace>().map(|at| (at.kind, at.place, at.baud));
        let rplidar = LidarKind::Rplidar(ScanMode::Typical);
        assert_eq!(read("ld19:/dev/ttyUSB0"), Ok((LidarKind::Ld06, "/dev/ttyUSB0".to_owned(), 230_400)));
        assert_eq!(read("rplidar:/dev/ttyUSB0@256000"), Ok((rplidar, "/dev/ttyUSB0".to_owned(), 256_000)));
        assert_eq!(read("rplidar:COM3"), Ok((rplidar, "COM3".to_owned(), 115_200)));
        assert_eq!(read("ouster:0.0.0.0:7502"), Ok((LidarKind::Ouster, "0.0.0.0:7502".to_owned(), 0)));
        let words = |said: &str| read(said).unwrap_err().to_string();
        assert!(words("ld06").contains("such as ld06:/dev/ttyUSB0"));
        assert!(words("rplidar:/dev/ttyUSB0@fast").contains("baud"));
        assert!(words("sick:/dev/ttyUSB0").contains("found \"sick\""));
    }
}
