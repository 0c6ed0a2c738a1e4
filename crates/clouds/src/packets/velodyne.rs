//! Packets of Velodyne's VLP-16 and HDL-32E, after their manuals (63-9243 Rev. E, 63-9113 Rev. N).

use crate::error::CloudError;
use crate::notes::{NoteKind, Notes};
use crate::packets::capture::{Capture, Packet};
use crate::packets::udp::datagram;
use crate::packets::window::Window;
use crate::scalar::array;
use mapwright_geom::{Stamp, sin_cos};
use std::collections::{BTreeMap, VecDeque};

const PAYLOAD_BYTES: usize = 1206;
const BLOCKS: usize = 12;
const BLOCK_BYTES: usize = 100;
const FLAG: [u8; 2] = [0xff, 0xee];
/// Hundredths of a degree in a revolution.
const TURN: u32 = 36_000;
/// Metres of a distance's unit.
const DISTANCE_M: f64 = 0.002;
/// Both the strongest and the last return, in two blocks one after the other.
const DUAL: u8 = 0x39;
/// The sensor's clock counts microseconds of an hour.
const HOUR_US: i64 = 3_600_000_000;
/// Blocks farther apart are not of one stretch, hundredths of a degree: at 20 Hz a VLP-16's are 80 apart.
const GAP_MAX: u32 = 200;
/// The sensor's clock is not believed where it differs by more from that of the capture, nanoseconds.
const CLOCKS_APART_NS: i64 = 1_000_000_000;
/// Packets come every 1.4 ms at most; nothing is missing below, nanoseconds.
const SILENCE_NS: i64 = 5_000_000;
/// After such a silence nobody knows how often the sensor has turned, nanoseconds: at 20 Hz it is a turn.
const LOST_NS: i64 = 50_000_000;
/// Clouds of less are noted, hundredths of a degree.
const WHOLE: u32 = 35_000;
/// The slowest sensor turns at 5 Hz; a cloud is not longer, nanoseconds.
const SWEEP_NS_MAX: i64 = 300_000_000;

/// A kind of sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Model {
    Vlp16,
    Hdl32,
}

/// What a model's lasers do.
struct Lasers {
    /// Sine and cosine of each one's elevation.
    elevations: Vec<(f64, f64)>,
    /// How far above the origin each beam starts, metres.
    heights_m: Vec<f64>,
    /// From one laser to the next, nanoseconds.
    laser_ns: i64,
    /// From one firing of all to the next, nanoseconds.
    firing_ns: i64,
}

impl Model {
    /// By the last byte of a packet.
    fn of_product(product: u8) -> Option<Self> {
        match product {
            0x21 => Some(Self::Hdl32),
            0x22 => Some(Self::Vlp16),
            _ => None,
        }
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Vlp16 => "VLP-16",
            Self::Hdl32 => "HDL-32E",
        }
    }

    fn lasers(self) -> Lasers {
        let elevations = |degrees: &[f64]| degrees.iter().map(|d| sin_cos(d.to_radians())).collect();
        match self {
            Self::Vlp16 => Lasers {
                elevations: elevations(&[
                    -15.0, 1.0, -13.0, 3.0, -11.0, 5.0, -9.0, 7.0, -7.0, 9.0, -5.0, 11.0, -3.0, 13.0, -1.0, 15.0,
                ]),
                heights_m: [
                    11.2, -0.7, 9.7, -2.2, 8.1, -3.7, 6.6, -5.1, 5.1, -6.6, 3.7, -8.1, 2.2, -9.7, 0.7, -11.2_f64,
                ]
                .map(|millimetres| 1e-3 * millimetres)
                .to_vec(),
                laser_ns: 2304,
                firing_ns: 55_296,
            },
            Self::Hdl32 => Lasers {
                // the lower and the upper half of the fan in turns, a third of four degrees apart
                elevations: elevations(&std::array::from_fn::<f64, 32, _>(|laser| {
                    let step = (laser / 2 + if laser % 2 == 0 { 0 } else { 16 }) as f64;
                    -92.0 / 3.0 + step * 4.0 / 3.0
                })),
                heights_m: vec![0.0; 32],
                laser_ns: 1152,
                firing_ns: 46_080,
            },
        }
    }
}

/// Who sends packets: address, port, and the last byte.
type Sender = ([u8; 4], u16, u8);

/// A revolution.
#[derive(Debug, Clone, Default)]
pub(crate) struct Sweep {
    pub(crate) stamp: Stamp,
    pub(crate) points_m: Vec<[f32; 3]>,
    pub(crate) times_s: Vec<f32>,
    /// Where its first packet stands in the file.
    pub(crate) at: usize,
    turned: u32,
    has_begun: bool,
}

/// What is known of a capture after a look at all of it.
#[derive(Debug, Clone)]
pub(crate) struct Survey {
    pub(crate) model: Result<Model, u8>,
    pub(crate) sweeps: usize,
    pub(crate) sender: Sender,
    /// How many sensors there are.
    pub(crate) senders: usize,
    pub(crate) is_dual: bool,
}

/// So many sensors are told apart; what further ones send is not read.
const SENDERS_MAX: usize = 64;

/// What one sensor sends.
struct Sent {
    packets: usize,
    sweeps: usize,
    is_dual: bool,
    decoder: Option<Decoder>,
}

/// Looks through a capture; none where it has no Velodyne packets.
///
/// # Errors
/// What keeps it from being read before the first of them.
pub(crate) fn survey(window: &mut Window<'_>, mut capture: Capture) -> Result<Option<Survey>, CloudError> {
    let mut all: BTreeMap<Sender, Sent> = BTreeMap::new();
    let (file, mut notes) = (window.file.clone(), Notes::default());
    while let Some(packet) = capture.next(window, &mut notes) {
        let Some((sender, payload)) = data_of(&packet) else { continue };
        if all.len() >= SENDERS_MAX && !all.contains_key(&sender) {
            continue;
        }
        let sent = all.entry(sender).or_insert_with(|| Sent {
            packets: 0,
            sweeps: 0,
            is_dual: payload[PAYLOAD_BYTES - 2] == DUAL,
            decoder: Model::of_product(sender.2).map(|model| Decoder::new(model, true)),
        });
        sent.packets += 1;
        if let Some(decoder) = &mut sent.decoder {
            decoder.add(&file, &packet, payload, &mut notes);
            sent.sweeps += decoder.ready.drain(..).count();
        }
    }
    let senders = all.len();
    let Some((sender, sent)) = all.into_iter().max_by_key(|(_, sent)| sent.packets) else {
        return window.take_failure().map_or(Ok(None), Err);
    };
    let mut sweeps = sent.sweeps;
    if let Some(mut decoder) = sent.decoder {
        decoder.cut(&file, &mut notes);
        sweeps += decoder.ready.len();
    }
    let model = Model::of_product(sender.2).ok_or(sender.2);
    Ok(Some(Survey { model, sweeps, sender, senders, is_dual: sent.is_dual }))
}

/// Who sent a packet of points, and its 1206 bytes.
fn data_of<'a>(packet: &Packet<'a>) -> Option<(Sender, &'a [u8; PAYLOAD_BYTES])> {
    let datagram = datagram(packet)?;
    let payload: &[u8; PAYLOAD_BYTES] = datagram.payload.try_into().ok()?;
    payload.starts_with(&FLAG).then(|| ((datagram.source, datagram.port, payload[PAYLOAD_BYTES - 1]), payload))
}

/// The revolutions of one sensor in a capture.
pub(crate) struct Sweeps<'a> {
    window: Window<'a>,
    capture: Capture,
    sender: Sender,
    decoder: Decoder,
}

impl<'a> Sweeps<'a> {
    pub(crate) fn new(window: Window<'a>, capture: Capture, sender: Sender, model: Model) -> Self {
        Self { window, capture, sender, decoder: Decoder::new(model, false) }
    }

    /// The file's name.
    pub(crate) fn file(&self) -> &str {
        &self.window.file
    }

    /// The next revolution; none at the end of the capture.
    pub(crate) fn next(&mut self, notes: &mut Notes) -> Option<Sweep> {
        let file = self.window.file.clone();
        while self.decoder.ready.is_empty() {
            let Some(packet) = self.capture.next(&mut self.window, notes) else {
                self.decoder.cut(&file, notes);
                break;
            };
            match data_of(&packet) {
                Some((sender, payload)) if sender == self.sender => self.decoder.add(&file, &packet, payload, notes),
                _ => note_other(&file, &packet, notes),
            }
        }
        self.decoder.ready.pop_front()
    }
}

/// Makes revolutions of the packets of one sensor.
struct Decoder {
    lasers: Lasers,
    /// Whether only revolutions are counted.
    is_counting: bool,
    clock: Option<Clock>,
    azimuth: Option<u32>,
    /// From block to block, hundredths of a degree, as it was last.
    gap: u32,
    sweep: Sweep,
    ready: VecDeque<Sweep>,
}

/// The sensor's clock and that of the capture, at the last packet.
#[derive(Clone, Copy)]
struct Clock {
    stamp: Stamp,
    sensor_us: u32,
    captured: Stamp,
}

impl Decoder {
    fn new(model: Model, is_counting: bool) -> Self {
        Self {
            lasers: model.lasers(),
            is_counting,
            clock: None,
            azimuth: None,
            gap: 0,
            sweep: Sweep::default(),
            ready: VecDeque::new(),
        }
    }

    fn add(&mut self, file: &str, packet: &Packet<'_>, payload: &[u8; PAYLOAD_BYTES], notes: &mut Notes) {
        let stamp = self.time(file, packet, payload, notes);
        let azimuths: [Option<u32>; BLOCKS] = std::array::from_fn(|block| azimuth(payload, block));
        let is_dual = payload[PAYLOAD_BYTES - 2] == DUAL;
        let step = if is_dual { 2 } else { 1 };
        let firings = 32 / self.lasers.elevations.len() as i64;
        for block in 0..BLOCKS {
            let Some(azimuth) = azimuths[block] else {
                let at = packet.at + packet.bytes.len().saturating_sub(PAYLOAD_BYTES) + block * BLOCK_BYTES;
                notes.note(NoteKind::BadPacket, file, at, || ("a block with its angle", "something else"));
                continue;
            };
            let block_ns = (block / step) as i64 * firings * self.lasers.firing_ns;
            let begin = Stamp(stamp.0.saturating_add(block_ns));
            self.turn(file, packet.at, azimuth, begin, notes);
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
    fn time(&mut self, file: &str, packet: &Packet<'_>, payload: &[u8; PAYLOAD_BYTES], notes: &mut Notes) -> Stamp {
        let sensor_us = array(payload, PAYLOAD_BYTES - 6).map_or(0, u32::from_le_bytes);
        let captured = packet.stamp;
        let stamp = match self.clock {
            None => captured,
            Some(last) => {
                let passed_ns = 1000 * (i64::from(sensor_us) - i64::from(last.sensor_us)).rem_euclid(HOUR_US);
                let captured_ns = captured.0.saturating_sub(last.captured.0);
                if (passed_ns.saturating_sub(captured_ns)).saturating_abs() > CLOCKS_APART_NS {
                    let words = || (format!("{} us later", captured_ns / 1000), format!("{} us", passed_ns / 1000));
                    notes.note(NoteKind::ClockJump, file, packet.at, words);
                    self.cut(file, notes);
                    Stamp(last.stamp.0.saturating_add(captured_ns))
                } else {
                    self.note_silence(file, packet.at, passed_ns, notes);
                    Stamp(last.stamp.0.saturating_add(passed_ns))
                }
            }
        };
        self.clock = Some(Clock { stamp, sensor_us, captured });
        stamp
    }

    fn note_silence(&mut self, file: &str, at: usize, passed_ns: i64, notes: &mut Notes) {
        if passed_ns > SILENCE_NS {
            let words = || ("a packet every 1.4 ms", format!("none for {:.1} ms", passed_ns as f64 * 1e-6));
            notes.note(NoteKind::MissingPackets, file, at, words);
        }
        if passed_ns > LOST_NS {
            self.cut(file, notes);
        }
    }

    /// Goes on to an azimuth; a cloud ends where the sensor has turned once since it began.
    fn turn(&mut self, file: &str, at: usize, azimuth: u32, stamp: Stamp, notes: &mut Notes) {
        let advance = self.azimuth.map_or(0, |last| (azimuth + TURN - last) % TURN);
        self.azimuth = Some(azimuth);
        // half a turn forward is a step back: the sensor trembles
        self.sweep.turned += if advance < TURN / 2 { advance } else { 0 };
        let is_too_long = self.sweep.has_begun && stamp.0.saturating_sub(self.sweep.stamp.0) > SWEEP_NS_MAX;
        if self.sweep.turned >= TURN || is_too_long {
            let beyond = self.sweep.turned.saturating_sub(TURN);
            self.cut(file, notes);
            self.sweep.turned = beyond;
            self.azimuth = Some(azimuth);
        }
        if !self.sweep.has_begun {
            self.sweep = Sweep { stamp, at, has_begun: true, turned: self.sweep.turned, ..Sweep::default() };
        }
    }

    /// Ends a cloud, if one has begun.
    fn cut(&mut self, file: &str, notes: &mut Notes) {
        let sweep = std::mem::take(&mut self.sweep);
        self.azimuth = None;
        if !sweep.has_begun {
            return;
        }
        if sweep.turned < WHOLE {
            let found = || ("360 degrees", format!("{:.1}", f64::from(sweep.turned) * 0.01));
            notes.note(NoteKind::PartialRevolution, file, sweep.at, found);
        }
        self.ready.push_back(sweep);
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
        let lasers = self.lasers.elevations.len();
        let period_ns = (32 / lasers) as i64 * self.lasers.firing_ns;
        for channel in 0..32 {
            let distance = distance(payload, block, channel);
            if distance == 0 || twin.is_some_and(|twin| self::distance(payload, twin, channel) == distance) {
                continue;
            }
            let (firing, laser) = (channel / lasers, channel % lasers);
            let after_ns = firing as i64 * self.lasers.firing_ns + laser as i64 * self.lasers.laser_ns;
            let turned = f64::from(self.gap) * after_ns as f64 / period_ns as f64;
            let (sin, cos) = sin_cos((0.01 * (f64::from(azimuth) + turned)).to_radians());
            let (up, out) = self.lasers.elevations[laser];
            let range_m = f64::from(distance) * DISTANCE_M;
            let level_m = range_m * out;
            // the manuals' y is ahead and x to the right; here x is ahead and y to the left
            let point = [level_m * cos, -level_m * sin, range_m * up + self.lasers.heights_m[laser]];
            self.sweep.points_m.push(point.map(|v| v as f32));
            let time_ns = begin.0.saturating_add(after_ns).saturating_sub(self.sweep.stamp.0);
            self.sweep.times_s.push((time_ns as f64 * 1e-9) as f32);
        }
    }
}

/// A block's angle, hundredths of a degree; none where it is no block. Below twelve, blocks lie in the payload.
fn azimuth(payload: &[u8; PAYLOAD_BYTES], block: usize) -> Option<u32> {
    let at = block * BLOCK_BYTES;
    let azimuth = u32::from(u16::from_le_bytes(array(payload, at + 2)?));
    (payload[at..at + 2] == FLAG && azimuth < TURN).then_some(azimuth)
}

fn distance(payload: &[u8; PAYLOAD_BYTES], block: usize, channel: usize) -> u16 {
    array(payload, block * BLOCK_BYTES + 4 + 3 * channel).map_or(0, u16::from_le_bytes)
}

/// Notes a packet that holds no points of the sensor's.
fn note_other(file: &str, packet: &Packet<'_>, notes: &mut Notes) {
    let cut = datagram(packet).filter(|d| d.claimed == PAYLOAD_BYTES && d.payload.len() < PAYLOAD_BYTES);
    match cut {
        Some(cut) => {
            let words = || (format!("{PAYLOAD_BYTES} bytes"), format!("{}: the capture cut it", cut.payload.len()));
            notes.note(NoteKind::BadPacket, file, packet.at, words);
        }
        None => {
            let words = || ("points of the sensor", format!("a packet of {} bytes", packet.bytes.len()));
            notes.note(NoteKind::ForeignPacket, file, packet.at, words);
        }
    }
}

#[cfg(test)]
mod tests;
