//! What the first pass sees of a lidar's packets, and of what an Ouster sensor says of itself.

use mapwright_clouds::{Lidar, OUSTER_IMU_BYTES, OusterInfo, ouster_numbers};
use std::sync::Arc;

/// The frame of an Ouster's points, after its driver.
pub(crate) const OUSTER_FRAME: &str = "os_sensor";

/// What an Ouster says of itself, or why it cannot be read.
pub(crate) type Metadata = Result<Arc<OusterInfo>, String>;

/// What is known of a topic's packets.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct PacketSurvey {
    /// What sends them, by the first that tells.
    pub(crate) lidar: Option<Lidar>,
    /// Whether they are an inertial sensor's.
    pub(crate) is_inertial: bool,
    /// Numbers of revolutions by where they may stand in an Ouster's packets: the last, and how often they changed.
    numbers: Option<[u16; 2]>,
    pub(crate) changes: [u64; 2],
}

impl PacketSurvey {
    /// Takes in a packet.
    pub(crate) fn see(&mut self, payload: &[u8]) {
        self.lidar = self.lidar.or_else(|| Lidar::of(payload, None));
    }

    /// Takes in an Ouster's packet.
    pub(crate) fn see_ouster(&mut self, payload: &[u8]) {
        if self.lidar.is_none() {
            self.is_inertial = payload.len() == OUSTER_IMU_BYTES;
            self.lidar = Some(Lidar::ouster(payload.len()));
        }
        let numbers = ouster_numbers(payload);
        for (place, changes) in self.changes.iter_mut().enumerate() {
            *changes += u64::from(self.numbers.is_none_or(|last| last[place] != numbers[place]));
        }
        self.numbers = Some(numbers);
    }
}
