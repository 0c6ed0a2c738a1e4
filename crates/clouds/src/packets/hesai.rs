//! Packets of Hesai's PandarXT-32 (XT32 user manual, "Point cloud data packet" and appendices on channels and firing times).

use super::clock::{Clock, Tick};
use super::sweep::{Place, Revolutions, Sweep, TURN};
use crate::notes::{NoteKind, Notes};
use crate::scalar::array;
use crate::text::seconds_of_date;
use mapwright_geom::{Stamp, sin_cos};

const FLAG: [u8; 2] = [0xee, 0xff];
const HEAD_BYTES: usize = 12;
const LASERS: usize = 32;
const BLOCKS: usize = 8;
const BLOCK_BYTES: usize = 2 + 4 * LASERS;
/// Behind the blocks: reserved, mode, speed, date, microseconds, factory, number of the packet.
const TAIL: usize = HEAD_BYTES + BLOCKS * BLOCK_BYTES;
const PAYLOAD_BYTES: usize = TAIL + 28;
/// From one firing of all lasers to the next, of one laser to the next, and of a firing's start to the first, nanoseconds.
const FIRING_NS: i64 = 50_000;
const LASER_NS: i64 = 1512;
const FIRST_NS: i64 = 368;
/// The last firing of a packet begins so long after the packet's time, nanoseconds.
const LAST_NS: i64 = 5632;
/// Blocks farther apart are not of one stretch, hundredths of a degree: at 20 Hz they are 36 apart.
const GAP_MAX: u32 = 100;
/// With two returns a packet comes every 0.2 ms, else every 0.4 ms; nothing is missing below, nanoseconds.
const SILENCE_NS: i64 = 2_000_000;
/// After such a silence nobody knows how often the sensor has turned, nanoseconds: at 20 Hz it is a turn.
const LOST_NS: i64 = 50_000_000;
/// The farthest that it sees, metres.
pub(super) const RANGE_MAX_M: f64 = 120.0;

/// What a packet of points says that it is: the protocol's version, lasers and blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Head {
    version: [u8; 2],
    lasers: u8,
    blocks: u8,
}

impl Head {
    /// Of a packet of points.
    pub(super) fn of(payload: &[u8]) -> Option<Self> {
        let head: [u8; HEAD_BYTES] = array(payload, 0)?;
        let is_points = head.starts_with(&FLAG) && payload.len() > HEAD_BYTES + 64;
        is_points.then_some(Self { version: [head[2], head[3]], lasers: head[6], blocks: head[7] })
    }

    /// Whether it is that of a PandarXT-32.
    pub(super) fn is_xt32(self) -> bool {
        self.version[0] == 6 && usize::from(self.lasers) == LASERS && usize::from(self.blocks) == BLOCKS
    }
}

impl std::fmt::Display for Head {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { version: [major, minor], lasers, blocks } = self;
        write!(f, "protocol {major}.{minor}, {lasers} lasers in {blocks} blocks")
    }
}

/// Makes revolutions of the packets of one sensor.
#[derive(Debug)]
pub(super) struct Decoder {
    /// Whether only revolutions are counted.
    is_counting: bool,
    clock: Clock,
    /// Sine and cosine of each laser's elevation.
    elevations: Vec<(f64, f64)>,
    /// From firing to firing, hundredths of a degree, as it was last.
    gap: u32,
    pub(super) revolutions: Revolutions,
}

impl Decoder {
    pub(super) fn new(is_counting: bool) -> Self {
        Self {
            is_counting,
            clock: Clock::default(),
            // the first looks up by 15 degrees, each further one by a degree less
            elevations: (0..LASERS).map(|laser| sin_cos((15.0 - laser as f64).to_radians())).collect(),
            gap: 0,
            revolutions: Revolutions::default(),
        }
    }

    pub(super) fn add(&mut self, place: Place<'_>, captured: Stamp, payload: &[u8], notes: &mut Notes) {
        let Some(payload) = payload.first_chunk::<PAYLOAD_BYTES>().filter(|_| Head::of(payload).is_some()) else {
            let found = payload.len();
            let words = || (format!("{PAYLOAD_BYTES} bytes of a PandarXT-32"), format!("{found} bytes"));
            return notes.note(NoteKind::BadPacket, place.file, place.at, words);
        };
        let stamp = self.time(place, captured, payload, notes);
        let azimuths: [Option<u32>; BLOCKS] = std::array::from_fn(|block| azimuth(payload, block));
        let returns = if payload[10] == 2 { 2 } else { 1 };
        for block in 0..BLOCKS {
            let Some(azimuth) = azimuths[block] else {
                let at = place.at + HEAD_BYTES + block * BLOCK_BYTES;
                notes.note(NoteKind::BadPacket, place.file, at, || ("an angle below 360 degrees", "another"));
                continue;
            };
            let before_last = ((BLOCKS - 1 - block) / returns) as i64;
            let begin = Stamp(stamp.0.saturating_add(LAST_NS - FIRING_NS * before_last));
            self.revolutions.turn(place, azimuth, begin, notes);
            if let Some(next) = azimuths.get(block + returns).copied().flatten() {
                let gap = (next + TURN - azimuth) % TURN;
                self.gap = if gap <= GAP_MAX { gap } else { self.gap };
            }
            if !self.is_counting {
                let is_second = returns == 2 && block % 2 == 1 && azimuths[block - 1] == Some(azimuth);
                self.add_block(payload, block, is_second.then(|| block - 1), azimuth, begin);
            }
        }
    }

    /// A packet's time.
    fn time(&mut self, place: Place<'_>, captured: Stamp, payload: &[u8; PAYLOAD_BYTES], notes: &mut Notes) -> Stamp {
        let sensor_ns = seconds(payload).saturating_mul(1_000_000_000);
        let us = array(payload, TAIL + 19).map_or(0, u32::from_le_bytes);
        let (stamp, tick) = self.clock.read(sensor_ns.saturating_add(1000 * i64::from(us)), captured);
        match tick {
            Tick::First => {}
            Tick::Passed(passed_ns) => {
                if passed_ns > SILENCE_NS {
                    let words = || ("a packet every 0.4 ms", format!("none for {:.1} ms", passed_ns as f64 * 1e-6));
                    notes.note(NoteKind::MissingPackets, place.file, place.at, words);
                }
                if passed_ns > LOST_NS {
                    self.revolutions.cut(place.file, notes);
                }
            }
            Tick::Jumped { captured_ns, sensor_ns } => {
                let words = || (format!("{} us later", captured_ns / 1000), format!("{} us", sensor_ns / 1000));
                notes.note(NoteKind::ClockJump, place.file, place.at, words);
                self.revolutions.cut(place.file, notes);
            }
        }
        stamp
    }

    /// The points of a block; what its twin has as well is left out.
    fn add_block(
        &mut self,
        payload: &[u8; PAYLOAD_BYTES],
        block: usize,
        twin: Option<usize>,
        azimuth: u32,
        begin: Stamp,
    ) {
        let unit_m = f64::from(payload[9]) * 1e-3;
        let Some(sweep) = self.revolutions.open() else { return };
        for (laser, (up, out)) in self.elevations.iter().enumerate() {
            let distance = distance(payload, block, laser);
            if distance == 0 || twin.is_some_and(|twin| self::distance(payload, twin, laser) == distance) {
                continue;
            }
            let after_ns = FIRST_NS + LASER_NS * laser as i64;
            let turned = f64::from(self.gap) * after_ns as f64 / FIRING_NS as f64;
            let (sin, cos) = sin_cos((0.01 * (f64::from(azimuth) + turned)).to_radians());
            let range_m = f64::from(distance) * unit_m;
            // the manual's frame: y where the azimuth is zero, which grows to the right, to x
            let point = [range_m * out * sin, range_m * out * cos, range_m * up];
            sweep.push(point, f32::from(reflectivity(payload, block, laser)), Stamp(begin.0.saturating_add(after_ns)));
        }
    }

    pub(super) fn pop(&mut self) -> Option<Sweep> {
        self.revolutions.ready.pop_front()
    }
}

/// A block's angle, hundredths of a degree; none where it is none.
fn azimuth(payload: &[u8; PAYLOAD_BYTES], block: usize) -> Option<u32> {
    let azimuth = array(payload, HEAD_BYTES + block * BLOCK_BYTES).map(u16::from_le_bytes).map(u32::from)?;
    (azimuth < TURN).then_some(azimuth)
}

fn distance(payload: &[u8; PAYLOAD_BYTES], block: usize, laser: usize) -> u16 {
    array(payload, HEAD_BYTES + block * BLOCK_BYTES + 2 + 4 * laser).map_or(0, u16::from_le_bytes)
}

fn reflectivity(payload: &[u8; PAYLOAD_BYTES], block: usize, laser: usize) -> u8 {
    payload.get(HEAD_BYTES + block * BLOCK_BYTES + 4 + 4 * laser).copied().unwrap_or(0)
}

/// The date of a packet, seconds of Unix: years from 1900, month, day, hour, minute, second.
fn seconds(payload: &[u8; PAYLOAD_BYTES]) -> i64 {
    let [year, month, day, hour, minute, second] = array(payload, TAIL + 13).unwrap_or_default().map(i64::from);
    seconds_of_date([1900 + year, month, day, hour, minute, second])
}

#[cfg(test)]
mod tests;
