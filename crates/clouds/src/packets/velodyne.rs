//! Packets of Velodyne's lidars with 16 and 32 lasers, after their manuals (63-9243 Rev. E, 63-9113 Rev. N, 63-9318 Rev. E,
//! 63-9325 Rev. D).

mod models;

use super::clock::{Clock, Tick};
use super::sweep::{Place, Revolutions, Sweep, TURN};
use crate::notes::{NoteKind, Notes};
use crate::scalar::array;
use mapwright_geom::{Stamp, sin_cos};
use models::Lasers;
pub(crate) use models::Model;

pub(crate) const PAYLOAD_BYTES: usize = 1206;
const BLOCKS: usize = 12;
const BLOCK_BYTES: usize = 100;
const FLAG: [u8; 2] = [0xff, 0xee];
/// Both the strongest and the last return, in two blocks one after the other.
const DUAL: u8 = 0x39;
/// The sensor's clock counts microseconds of an hour.
const HOUR_US: i64 = 3_600_000_000;
/// Blocks farther apart are not of one stretch, hundredths of a degree: at 20 Hz a VLP-16's are 80 apart.
const GAP_MAX: u32 = 200;
/// Packets come every 1.4 ms at most; nothing is missing below, nanoseconds.
const SILENCE_NS: i64 = 5_000_000;
/// After such a silence nobody knows how often the sensor has turned, nanoseconds: at 20 Hz it is a turn.
const LOST_NS: i64 = 50_000_000;

/// A packet of points.
type Payload = [u8; PAYLOAD_BYTES];

/// Which product sent a packet, if a Velodyne did.
pub(super) fn product(payload: &[u8]) -> Option<u8> {
    (payload.len() == PAYLOAD_BYTES && payload.starts_with(&FLAG)).then(|| payload[PAYLOAD_BYTES - 1])
}

/// Whether its packets have both returns of a beam.
pub(super) fn is_dual(payload: &[u8]) -> bool {
    payload.get(PAYLOAD_BYTES - 2) == Some(&DUAL)
}

/// Makes revolutions of the packets of one sensor.
pub(super) struct Decoder {
    lasers: Lasers,
    /// Whether only revolutions are counted.
    is_counting: bool,
    clock: Clock,
    /// From block to block, hundredths of a degree, as it was last.
    gap: u32,
    pub(super) revolutions: Revolutions,
}

impl Decoder {
    pub(super) fn new(model: Model, is_counting: bool) -> Self {
        Self {
            lasers: model.lasers(),
            is_counting,
            clock: Clock::of_period(1000 * HOUR_US),
            gap: 0,
            revolutions: Revolutions::default(),
        }
    }

    pub(super) fn add(&mut self, place: Place<'_>, captured: Stamp, payload: &[u8], notes: &mut Notes) {
        let Some(payload) = payload.first_chunk::<PAYLOAD_BYTES>() else { return };
        let stamp = self.time(place, captured, payload, notes);
        let azimuths: [Option<u32>; BLOCKS] = std::array::from_fn(|block| azimuth(payload, block));
        let is_dual = is_dual(payload);
        let step = if is_dual { 2 } else { 1 };
        let firings = 32 / self.lasers.elevations.len() as i64;
        for block in 0..BLOCKS {
            let Some(azimuth) = azimuths[block] else {
                let at = place.at + block * BLOCK_BYTES;
                notes.note(NoteKind::BadPacket, place.file, at, || ("a block with its angle", "something else"));
                continue;
            };
            let block_ns = (block / step) as i64 * firings * self.lasers.firing_ns;
            let begin = Stamp(stamp.0.saturating_add(block_ns));
            self.revolutions.turn(place, azimuth, begin, notes);
            if let Some(next) = azimuths.get(block + step).copied().flatten() {
                let gap = (next + TURN - azimuth) % TURN;
                self.gap = if gap <= GAP_MAX { gap } else { self.gap };
            }
            if !self.is_counting {
                let twin = (is_dual && block % 2 == 1 && azimuths[block - 1] == Some(azimuth)).then(|| block - 1);
                self.add_block(payload, block, twin, azimuth, begin);
            }
        }
    }

    /// When a packet's first laser fired.
    fn time(&mut self, place: Place<'_>, captured: Stamp, payload: &Payload, notes: &mut Notes) -> Stamp {
        let sensor_us = array(payload, PAYLOAD_BYTES - 6).map_or(0, u32::from_le_bytes);
        let (stamp, tick) = self.clock.read(1000 * i64::from(sensor_us), captured);
        match tick {
            Tick::First => {}
            Tick::Passed(passed_ns) => self.note_silence(place, passed_ns, notes),
            Tick::Jumped { captured_ns, sensor_ns } => {
                let words = || (format!("{} us later", captured_ns / 1000), format!("{} us", sensor_ns / 1000));
                notes.note(NoteKind::ClockJump, place.file, place.at, words);
                self.revolutions.cut(place.file, notes);
            }
        }
        stamp
    }

    fn note_silence(&mut self, place: Place<'_>, passed_ns: i64, notes: &mut Notes) {
        if passed_ns > SILENCE_NS {
            let words = || ("a packet every 1.4 ms", format!("none for {:.1} ms", passed_ns as f64 * 1e-6));
            notes.note(NoteKind::MissingPackets, place.file, place.at, words);
        }
        if passed_ns > LOST_NS {
            self.revolutions.cut(place.file, notes);
        }
    }

    /// The points of a block; what its twin has as well is left out.
    fn add_block(&mut self, payload: &Payload, block: usize, twin: Option<usize>, azimuth: u32, begin: Stamp) {
        let Some(sweep) = self.revolutions.open() else { return };
        let lasers = self.lasers.elevations.len();
        let period_ns = (32 / lasers) as i64 * self.lasers.firing_ns;
        for channel in 0..32 {
            let distance = distance(payload, block, channel);
            if distance == 0 || twin.is_some_and(|twin| self::distance(payload, twin, channel) == distance) {
                continue;
            }
            let (firing, laser) = (channel / lasers, channel % lasers);
            let after_ns = firing as i64 * self.lasers.firing_ns + self.lasers.after_ns[laser];
            let turned = f64::from(self.gap) * after_ns as f64 / period_ns as f64;
            let right_deg = 0.01 * (f64::from(azimuth) + turned) - self.lasers.left_deg[laser];
            let (sin, cos) = sin_cos(right_deg.to_radians());
            let (up, out) = self.lasers.elevations[laser];
            let range_m = f64::from(distance) * self.lasers.distance_m;
            let level_m = range_m * out;
            // the manuals' y is ahead and x to the right; here x is ahead and y to the left
            let point = [level_m * cos, -level_m * sin, range_m * up + self.lasers.heights_m[laser]];
            sweep.push(
                point,
                f32::from(reflectivity(payload, block, channel)),
                Stamp(begin.0.saturating_add(after_ns)),
            );
        }
    }

    pub(super) fn pop(&mut self) -> Option<Sweep> {
        self.revolutions.ready.pop_front()
    }
}

/// A block's angle, hundredths of a degree; none where it is no block. Below twelve, blocks lie in the payload.
fn azimuth(payload: &Payload, block: usize) -> Option<u32> {
    let at = block * BLOCK_BYTES;
    let azimuth = u32::from(u16::from_le_bytes(array(payload, at + 2)?));
    (payload[at..at + 2] == FLAG && azimuth < TURN).then_some(azimuth)
}

fn distance(payload: &Payload, block: usize, channel: usize) -> u16 {
    array(payload, block * BLOCK_BYTES + 4 + 3 * channel).map_or(0, u16::from_le_bytes)
}

fn reflectivity(payload: &Payload, block: usize, channel: usize) -> u8 {
    payload.get(block * BLOCK_BYTES + 6 + 3 * channel).copied().unwrap_or(0)
}
