//! LD06 and LD19 of LDROBOT: one-way, 47 bytes a packet, twelve readings each ("LD06 Development manual" 2.3, "LD19 Development manual" 2.5).

use crate::clock::Clock;
use crate::counts::Counts;
use crate::revolution::{Reading, Revolution, Turns};
use mapwright_geom::Stamp;

/// Bytes of a packet.
pub const LD06_PACKET_BYTES: usize = 47;
/// Begins a packet of twelve readings.
const HEAD: [u8; 2] = [0x54, 0x2C];
const READINGS: usize = 12;
/// From reading to reading: both lidars measure 4,500 times a second, nanoseconds.
const READING_NS: i64 = 222_222;
/// So many bytes without a packet are of something else: they are a hundred packets.
const OTHER_BYTES: u64 = 4700;
/// After so long the lidar's clock begins anew, milliseconds.
const CLOCK_MS: i64 = 30_000;
/// Hundredths of a degree in a turn.
const TURN: u32 = 36_000;
/// Twelve readings at 4,500 a second are 10 degrees at 10 Hz; more than so much is no packet, hundredths of a degree.
const SPAN_MOST: u32 = 9_000;
/// On the wire for so long: 47 bytes of 10 bits at 230,400 baud, nanoseconds.
const WIRE_NS: i64 = 2_040_000;
/// After a silence of so long the lidar's clock no longer says how many packets were lost, nanoseconds.
const SILENCE_NS: i64 = 1_000_000_000;

/// Makes revolutions of what an LD06 or LD19 sends. Nothing is sent to it.
#[derive(Debug, Default)]
pub struct Ld06 {
    pending: Vec<u8>,
    /// The next packet should begin where the last one ended.
    is_in_step: bool,
    clock: Clock,
    last: Option<Last>,
    number: u64,
    turns: Turns,
    counts: Counts,
}

#[derive(Debug, Clone, Copy)]
struct Last {
    /// Of the packet's last reading, by the lidar's clock from where it was first read on.
    lidar_ns: i64,
    said_ms: i64,
    arrived: Stamp,
}

/// A packet with a good checksum.
struct Packet<'a>(&'a [u8]);

impl Ld06 {
    /// A lidar of which nothing has arrived yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes in bytes, in any pieces, that arrived at a time.
    pub fn receive(&mut self, bytes: &[u8], arrived: Stamp) {
        self.counts.bytes_received += bytes.len() as u64;
        self.pending.extend_from_slice(bytes);
        let pending = std::mem::take(&mut self.pending);
        let mut rest = &pending[..];
        while let Some(taken) = self.step(rest, arrived) {
            rest = &rest[taken..];
        }
        self.pending = rest.to_vec();
    }

    /// The next whole revolution.
    pub fn next_scan(&mut self) -> Option<Revolution> {
        self.turns.next()
    }

    /// What became of all bytes.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Why nothing can be read of it, in words; none while packets arrive, or nothing.
    #[must_use]
    pub fn problem(&self) -> Option<&'static str> {
        let is_other = self.counts.packets == 0 && self.counts.bytes_skipped > OTHER_BYTES;
        is_other.then_some(
            "expected packets of an LD06 or LD19, found other bytes (another lidar, or another speed of the line?)",
        )
    }

    /// The cable was pulled out and put back: what has begun is left out, and reading begins anew.
    pub fn restart(&mut self) {
        self.counts.restarts += 1;
        self.counts.bytes_skipped += self.pending.len() as u64;
        self.turns.break_off(&mut self.counts);
        (self.is_in_step, self.last, self.clock) = (false, None, Clock::default());
        self.pending.clear();
    }

    /// Reads a packet, or passes over a byte that begins none: how many bytes were done with; none where more are needed.
    fn step(&mut self, rest: &[u8], arrived: Stamp) -> Option<usize> {
        if !HEAD.starts_with(&rest[..rest.len().min(HEAD.len())]) {
            return Some(self.skip());
        }
        let packet = rest.get(..LD06_PACKET_BYTES)?;
        if crc(packet) != 0 {
            return Some(self.skip());
        }
        let packet = Packet(packet);
        self.is_in_step = true;
        if packet.is_plausible() {
            self.counts.packets += 1;
            self.counts.bytes_used += LD06_PACKET_BYTES as u64;
            self.add(&packet, arrived);
        } else {
            self.counts.implausible += 1;
            self.counts.bytes_skipped += LD06_PACKET_BYTES as u64;
        }
        Some(LD06_PACKET_BYTES)
    }

    fn skip(&mut self) -> usize {
        self.counts.bad_checksums += u64::from(std::mem::take(&mut self.is_in_step));
        self.counts.bytes_skipped += 1;
        1
    }

    fn add(&mut self, packet: &Packet<'_>, arrived: Stamp) {
        let last_ns = self.tick(packet, arrived);
        let stamp = self.clock.read(last_ns, Stamp(arrived.0.saturating_sub(WIRE_NS)));
        for (place, (range_m, intensity)) in packet.readings().enumerate() {
            let before_ns = READING_NS * (READINGS - 1 - place) as i64;
            let reading = Reading {
                clockwise_deg: packet.clockwise_deg(place),
                range_m,
                intensity,
                number: self.number,
                lidar_ns: last_ns.saturating_sub(before_ns),
                stamp: Stamp(stamp.0.saturating_sub(before_ns)),
            };
            self.turns.push(reading, &mut self.counts);
            self.number += 1;
        }
    }

    /// When the packet's last reading was taken by the lidar's clock, which goes on where it begins anew; and how many packets it says were lost.
    fn tick(&mut self, packet: &Packet<'_>, arrived: Stamp) -> i64 {
        let said_ms = i64::from(packet.said_ms());
        let silence_ns = self.last.map_or(0, |last| arrived.0.saturating_sub(last.arrived.0));
        if silence_ns > SILENCE_NS {
            self.turns.break_off(&mut self.counts);
            (self.last, self.clock) = (None, Clock::default());
        }
        let lidar_ns = match self.last {
            Some(last) => {
                let passed_ns = (said_ms - last.said_ms).rem_euclid(CLOCK_MS) * 1_000_000;
                self.lose(passed_ns, packet.turn_ns());
                last.lidar_ns.saturating_add(passed_ns)
            }
            None => 0,
        };
        self.last = Some(Last { lidar_ns, said_ms, arrived });
        lidar_ns
    }

    fn lose(&mut self, passed_ns: i64, turn_ns: i64) {
        let packet_ns = READING_NS * READINGS as i64;
        let lost = ((passed_ns + packet_ns / 2) / packet_ns - 1).max(0) as u64;
        self.counts.lost += lost;
        self.number += lost * READINGS as u64;
        if lost > 0 && passed_ns > turn_ns {
            self.turns.break_off(&mut self.counts);
        }
    }
}

impl Packet<'_> {
    fn number(&self, at: usize) -> u16 {
        u16::from_le_bytes([self.0[at], self.0[at + 1]])
    }

    fn deg_per_s(&self) -> u16 {
        self.number(2)
    }

    /// Of the packet's last reading.
    fn said_ms(&self) -> u16 {
        self.number(44)
    }

    /// Angles of the first and the last reading, hundredths of a degree clockwise.
    fn ends(&self) -> [u32; 2] {
        [self.number(4), self.number(42)].map(u32::from)
    }

    fn span(&self) -> u32 {
        let [first, last] = self.ends();
        (last + TURN - first.min(TURN)) % TURN
    }

    fn is_plausible(&self) -> bool {
        self.ends().iter().all(|&angle| angle <= TURN)
            && self.span() <= SPAN_MOST
            && i64::from(self.said_ms()) <= CLOCK_MS
    }

    fn clockwise_deg(&self, place: usize) -> f64 {
        let [first, _] = self.ends();
        let from_first = f64::from(self.span()) * place as f64 / (READINGS - 1) as f64;
        (f64::from(first) + from_first) % f64::from(TURN) * 0.01
    }

    fn readings(&self) -> impl Iterator<Item = (f32, u8)> + '_ {
        let triples = self.0[6..6 + 3 * READINGS].chunks_exact(3);
        triples.map(|three| (f32::from(u16::from_le_bytes([three[0], three[1]])) / 1000.0, three[2]))
    }

    fn turn_ns(&self) -> i64 {
        360_000_000_000 / i64::from(self.deg_per_s().max(1))
    }
}

/// CRC-8 of polynomial 0x4D from 0 on; zero for a packet with its own.
fn crc(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |crc, byte| CRC[usize::from(crc ^ byte)])
}

const CRC: [u8; 256] = {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let (mut crc, mut bit) = (byte as u8, 0);
        while bit < 8 {
            crc = if crc & 0x80 == 0 { crc << 1 } else { crc << 1 ^ 0x4D };
            bit += 1;
        }
        table[byte] = crc;
        byte += 1;
    }
    table
};

#[cfg(test)]
mod tests {
    use super::*;

    /// The example of the manual.
    const MANUAL: [u8; LD06_PACKET_BYTES] = [
        0x54, 0x2C, 0x68, 0x08, 0xAB, 0x7E, 0xE0, 0x00, 0xE4, 0xDC, 0x00, 0xE2, 0xD9, 0x00, 0xE5, 0xD5, 0x00, 0xE3,
        0xD3, 0x00, 0xE4, 0xD0, 0x00, 0xE9, 0xCD, 0x00, 0xE4, 0xCA, 0x00, 0xE2, 0xC7, 0x00, 0xE9, 0xC5, 0x00, 0xE5,
        0xC2, 0x00, 0xE5, 0xC0, 0x00, 0xE5, 0xBE, 0x82, 0x3A, 0x1A, 0x50,
    ];

    #[test]
    fn the_manual_s_example_is_what_the_manual_says() {
        assert_eq!(crc(&MANUAL), 0);
        let packet = Packet(&MANUAL);
        assert_eq!((packet.deg_per_s(), packet.ends(), packet.said_ms()), (2152, [32_427, 33_470], 6714));
        let first: Vec<_> = packet.readings().take(2).collect();
        assert_eq!(first, [(0.224, 228), (0.220, 226)]);
        assert!((packet.clockwise_deg(11) - 334.70).abs() < 1e-9);
    }

    #[test]
    fn rests_and_damage_are_skipped_and_counted() {
        let mut damaged = MANUAL;
        damaged[20] ^= 1;
        let bytes = [&MANUAL[30..], &MANUAL, &damaged, &MANUAL, &MANUAL[..9]].concat();
        let mut lidar = Ld06::new();
        bytes.iter().for_each(|byte| lidar.receive(&[*byte], Stamp(0)));
        let counts = *lidar.counts();
        assert_eq!((counts.packets, counts.bad_checksums, counts.bytes_used), (2, 1, 94));
        assert_eq!((counts.bytes_skipped, counts.bytes_received), (17 + 47, bytes.len() as u64));
        lidar.restart();
        assert_eq!(lidar.counts().bytes_skipped, 17 + 47 + 9);
        assert_eq!((lidar.counts().restarts, lidar.counts().partial_revolutions), (1, 1));
    }
}
