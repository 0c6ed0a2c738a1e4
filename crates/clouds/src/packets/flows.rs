//! Who sends packets in a capture, and the clouds of the one that sends most.

use super::capture::{Capture, Packet};
use super::lidar::{Lidar, PacketDecoder};
use super::ouster::{OUSTER_IMU_BYTES, OusterInfo};
use super::sweep::{Place, Sweep};
use super::udp::{Datagram, Fragments};
use super::window::Window;
use crate::error::CloudError;
use crate::notes::{NoteKind, Notes};
use mapwright_geom::Stamp;
use mapwright_sensor::ImuReading;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

/// So many sensors are told apart; what further ones send is not read.
const SENDERS_MAX: usize = 64;
/// Readings that wait for who asks for clouds.
const READINGS_MAX: usize = 1 << 16;

/// Who sends packets: address, port, and what it is.
pub(crate) type Sender = ([u8; 4], u16, Lidar);

/// What is known of a capture after a look at all of it.
#[derive(Debug, Clone)]
pub(crate) struct Survey {
    pub(crate) sender: Sender,
    pub(crate) info: Option<Arc<OusterInfo>>,
    pub(crate) sweeps: usize,
    /// How many sensors there are.
    pub(crate) senders: usize,
    pub(crate) is_dual: bool,
    /// Packets of an inertial sensor.
    pub(crate) readings: usize,
}

/// What one sensor sends.
struct Sent {
    packets: usize,
    sweeps: usize,
    is_dual: bool,
    decoder: Option<PacketDecoder>,
}

/// Looks through a capture; none where it has no packets of a lidar that is known here.
///
/// # Errors
/// What keeps it from being read before the first of them.
pub(crate) fn survey(
    window: &mut Window<'_>,
    mut capture: Capture,
    info: Option<Arc<OusterInfo>>,
) -> Result<Option<Survey>, CloudError> {
    let mut all: BTreeMap<Sender, Sent> = BTreeMap::new();
    let (file, mut notes) = (window.file.clone(), Notes::default());
    let (mut fragments, mut readings) = (Fragments::default(), 0);
    while let Some(packet) = capture.next(window, &mut notes) {
        let Some(datagram) = fragments.add(&packet) else { continue };
        readings += usize::from(info.is_some() && datagram.payload.len() == OUSTER_IMU_BYTES);
        let Some(lidar) = Lidar::of(&datagram.payload, info.as_deref()) else { continue };
        let sender = (datagram.source, datagram.port, lidar);
        if all.len() >= SENDERS_MAX && !all.contains_key(&sender) {
            continue;
        }
        let sent = all.entry(sender).or_insert_with(|| Sent {
            packets: 0,
            sweeps: 0,
            is_dual: lidar.is_dual(&datagram.payload),
            decoder: PacketDecoder::counting(lidar, info.as_ref()).ok(),
        });
        sent.packets += 1;
        if let Some(decoder) = &mut sent.decoder {
            decoder.add(Place { file: &file, at: packet.at }, packet.stamp, &datagram.payload, &mut notes);
            sent.sweeps += std::iter::from_fn(|| decoder.next_sweep()).count();
        }
    }
    let senders = all.len();
    let Some((sender, sent)) = all.into_iter().max_by_key(|(_, sent)| sent.packets) else {
        return window.take_failure().map_or(Ok(None), Err);
    };
    let mut sweeps = sent.sweeps;
    if let Some(mut decoder) = sent.decoder {
        decoder.finish(&file, &mut notes);
        sweeps += std::iter::from_fn(|| decoder.next_sweep()).count();
    }
    Ok(Some(Survey { sender, info, sweeps, senders, is_dual: sent.is_dual, readings }))
}

/// The revolutions of one sensor in a capture.
pub(crate) struct Sweeps<'a> {
    window: Window<'a>,
    capture: Capture,
    fragments: Fragments,
    sender: Sender,
    info: Option<Arc<OusterInfo>>,
    decoder: PacketDecoder,
    /// Readings that were not asked for, and the stamp of the last one.
    readings: VecDeque<ImuReading>,
    last_reading: Option<Stamp>,
    /// A cloud that waits for inertial readings up to its end.
    waiting: Option<Sweep>,
}

impl<'a> Sweeps<'a> {
    /// # Errors
    /// Why the sensor's packets are not read, in words.
    pub(crate) fn new(window: Window<'a>, capture: Capture, survey: &Survey) -> Result<Self, String> {
        Ok(Self {
            window,
            capture,
            fragments: Fragments::default(),
            sender: survey.sender,
            info: survey.info.clone(),
            decoder: PacketDecoder::new(survey.sender.2, survey.info.as_ref())?,
            readings: VecDeque::new(),
            last_reading: None,
            waiting: None,
        })
    }

    /// The file's name.
    pub(crate) fn file(&self) -> &str {
        &self.window.file
    }

    /// Inertial readings that came before the last cloud ended and were not asked for.
    pub(crate) fn readings(&mut self) -> impl Iterator<Item = ImuReading> + use<'_, 'a> {
        self.readings.drain(..)
    }

    /// The next revolution; none at the end of the capture.
    pub(crate) fn next(&mut self, notes: &mut Notes) -> Option<Sweep> {
        let file = self.window.file.clone();
        loop {
            if self.waiting.is_none() {
                self.waiting = self.decoder.next_sweep();
            }
            if self.waiting.as_ref().is_some_and(|sweep| self.is_felt(sweep)) {
                return self.waiting.take();
            }
            let Some(packet) = self.capture.next(&mut self.window, notes) else {
                self.decoder.finish(&file, notes);
                return self.waiting.take().or_else(|| self.decoder.next_sweep());
            };
            let datagram = self.fragments.add(&packet);
            let place = Place { file: &file, at: packet.at };
            match datagram {
                Some(datagram) if is_of(&datagram, self.sender, self.info.as_deref()) => {
                    self.decoder.add(place, packet.stamp, &datagram.payload, notes);
                }
                Some(datagram) if datagram.source == self.sender.0 && datagram.payload.len() == OUSTER_IMU_BYTES => {
                    let reading = self.decoder.reading(&datagram.payload);
                    self.readings.extend(reading.filter(|_| self.readings.len() < READINGS_MAX));
                    self.last_reading = reading.map(|reading| reading.stamp).or(self.last_reading);
                }
                Some(datagram) => note_other(place, &packet, Some(&datagram), notes),
                None if self.fragments.has_taken() => {}
                None => note_other(place, &packet, None, notes),
            }
        }
    }

    /// Whether inertial readings reach to a cloud's end, or need not be waited for: there are none, or the next cloud has ended.
    fn is_felt(&self, sweep: &Sweep) -> bool {
        self.last_reading.is_none_or(|last| last >= sweep.end()) || self.decoder.is_ready()
    }
}

/// Whether it has points of the sender's.
fn is_of(datagram: &Datagram<'_>, (source, port, lidar): Sender, info: Option<&OusterInfo>) -> bool {
    (datagram.source, datagram.port) == (source, port) && Lidar::of(&datagram.payload, info) == Some(lidar)
}

/// Notes a packet that holds no points of the sensor's.
fn note_other(place: Place<'_>, packet: &Packet<'_>, datagram: Option<&Datagram<'_>>, notes: &mut Notes) {
    match datagram.filter(|datagram| datagram.payload.len() < datagram.claimed) {
        Some(cut) => {
            let words = || (format!("{} bytes", cut.claimed), format!("{}: the capture cut it", cut.payload.len()));
            notes.note(NoteKind::BadPacket, place.file, place.at, words);
        }
        None => {
            let words = || ("points of the sensor", format!("a packet of {} bytes", packet.bytes.len()));
            notes.note(NoteKind::ForeignPacket, place.file, place.at, words);
        }
    }
}

#[cfg(test)]
mod tests;
