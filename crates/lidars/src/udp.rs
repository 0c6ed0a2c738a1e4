//! Lidars of space that send datagrams: the decoders that read captures.

use crate::counts::Counts;
use crate::error::LidarError;
use mapwright_clouds::{
    self as clouds, NoteKind, Notes, OUSTER_IMU_BYTES, OUSTER_METADATA, OusterInfo, PacketDecoder, Place,
};
use mapwright_geom::Stamp;
use mapwright_sensor::{Cloud, ImuReading, SpaceSensor};
use std::collections::VecDeque;
use std::sync::Arc;

/// So many clouds wait to be asked for; more push out the oldest.
const CLOUDS_MOST: usize = 8;
/// And so many inertial readings.
const READINGS_MOST: usize = 4096;

/// Makes clouds and inertial readings of the datagrams of one Velodyne, Ouster or Hesai. Which it is the first packet says; packets of
/// others are passed over and counted.
#[derive(Debug, Default)]
pub struct Udp {
    info: Option<Arc<OusterInfo>>,
    found: Option<(clouds::Lidar, PacketDecoder, Arc<SpaceSensor>)>,
    clouds: VecDeque<Cloud>,
    readings: VecDeque<ImuReading>,
    notes: Notes,
    counts: Counts,
    problem: Option<String>,
}

impl Udp {
    /// A lidar of which nothing has arrived yet; an Ouster is not read without its metadata.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// An Ouster, with what it says of itself as JSON (`curl http://SENSOR/api/v1/sensor/metadata`).
    ///
    /// # Errors
    /// Why the metadata cannot be read, in words.
    pub fn ouster(metadata: &str) -> Result<Self, LidarError> {
        let info = OusterInfo::parse(metadata).map_err(|reason| LidarError::Metadata { reason })?;
        Ok(Self { info: Some(Arc::new(info)), ..Self::default() })
    }

    /// Takes in the payload of one datagram that arrived at a time.
    pub fn receive(&mut self, payload: &[u8], arrived: Stamp) {
        let bytes = payload.len() as u64;
        self.counts.bytes_received += bytes;
        if self.take(payload, arrived) {
            self.counts.bytes_used += bytes;
        } else {
            self.counts.bytes_skipped += bytes;
        }
    }

    /// The next whole revolution, in the sensor's frame.
    pub fn next_cloud(&mut self) -> Option<Cloud> {
        self.clouds.pop_front()
    }

    /// The next reading of the inertial sensor in an Ouster.
    pub fn next_reading(&mut self) -> Option<ImuReading> {
        self.readings.pop_front()
    }

    /// What became of all datagrams.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// What was wrong within packets and between them, as of captures; the byte of a note is the number of the packet.
    #[must_use]
    pub fn notes(&self) -> &Notes {
        &self.notes
    }

    /// Why the packets that arrive are not read, in words; none while they are.
    #[must_use]
    pub fn problem(&self) -> Option<&str> {
        self.problem.as_deref()
    }

    /// The cable was pulled out and put back: the cloud that has begun is left out.
    pub fn restart(&mut self) {
        self.counts.restarts += 1;
        if self.found.take().is_some() {
            self.counts.partial_revolutions += 1;
        }
    }

    /// Whether it is a packet of the lidar's.
    fn take(&mut self, payload: &[u8], arrived: Stamp) -> bool {
        let lidar = clouds::Lidar::of(payload, self.info.as_deref());
        if self.found.is_none()
            && let Some(lidar) = lidar
        {
            self.begin(lidar);
        }
        let Some((found, decoder, _)) = &mut self.found else { return false };
        if lidar == Some(*found) {
            let place = Place { file: "datagrams", at: self.counts.packets as usize };
            self.counts.packets += 1;
            decoder.add(place, arrived, payload, &mut self.notes);
            self.drain();
            return true;
        }
        let reading = if payload.len() == OUSTER_IMU_BYTES { decoder.reading(payload) } else { None };
        self.readings.extend(reading);
        if self.readings.len() > READINGS_MOST {
            self.readings.pop_front();
        }
        reading.is_some()
    }

    fn begin(&mut self, lidar: clouds::Lidar) {
        let info = self.info.as_ref();
        let made = lidar.name(info.map(|info| &**info)).and_then(|name| Ok((name, PacketDecoder::new(lidar, info)?)));
        match made {
            Ok((name, decoder)) => {
                let range_max_m = lidar.range_max_m(info.map(|info| &**info));
                let sensor = SpaceSensor { range_max_m, ..SpaceSensor::lidar(&name) };
                (self.found, self.problem) = (Some((lidar, decoder, Arc::new(sensor))), None);
            }
            Err(words) if lidar.is_ouster() => self.problem = Some(format!("{words}; {OUSTER_METADATA}")),
            Err(words) => self.problem = Some(words),
        }
    }

    fn drain(&mut self) {
        let Some((_, decoder, sensor)) = &mut self.found else { return };
        while let Some(sweep) = decoder.next_sweep() {
            self.counts.revolutions += 1;
            self.clouds.push_back(Cloud {
                stamp: sweep.stamp,
                sensor: Arc::clone(sensor),
                points_m: sweep.points_m,
                times_s: sweep.times_s,
                colours: Vec::new(),
                intensities: sweep.intensities,
                sigmas_m: Vec::new(),
                odom_from_robot: None,
            });
            if self.clouds.len() > CLOUDS_MOST {
                self.clouds.pop_front();
                self.counts.overtaken += 1;
            }
        }
        self.counts.lost = self.notes.count(NoteKind::MissingPackets);
        self.counts.implausible = self.notes.count(NoteKind::BadPacket);
    }
}
