//! Captures of a network: pcap of either byte order and resolution, and pcapng.

use crate::notes::{NoteKind, Notes};
use crate::scalar::array;
use mapwright_geom::Stamp;

/// No packet is larger (libpcap's own limit).
const PACKET_BYTES_MAX: usize = 262_144;
const SECTION: u32 = 0x0a0d_0d0a;
/// Bytes of pcap's header, and of the one before each packet.
const HEADER_BYTES: usize = 24;
const RECORD_BYTES: usize = 16;

/// A packet as it was captured.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Packet<'a> {
    /// Where its bytes begin.
    pub(crate) at: usize,
    pub(crate) stamp: Stamp,
    /// How its bytes begin: the number that libpcap gives the kind of network.
    pub(crate) link: u32,
    pub(crate) bytes: &'a [u8],
}

/// A place in a capture.
#[derive(Debug, Clone)]
pub(crate) struct Capture {
    at: usize,
    is_big: bool,
    kind: Kind,
}

#[derive(Debug, Clone)]
enum Kind {
    /// How many nanoseconds a fraction counts, and the kind of network.
    Pcap { fraction_ns: i64, link: u32 },
    /// The section's interfaces: kind of network, and how many units of time make a second.
    PcapNg { interfaces: Vec<(u32, u64)> },
}

/// No section has more interfaces.
const INTERFACES_MAX: usize = 256;

impl Capture {
    /// The beginning of a capture, if the bytes are one.
    pub(crate) fn begin(bytes: &[u8]) -> Option<Self> {
        let magic = u32::from_le_bytes(array(bytes, 0)?);
        let (is_big, fraction_ns) = match magic {
            0xa1b2_c3d4 => (false, 1000),
            0xa1b2_3c4d => (false, 1),
            0xd4c3_b2a1 => (true, 1000),
            0x4d3c_b2a1 => (true, 1),
            SECTION => return Some(Self { at: 0, is_big: false, kind: Kind::PcapNg { interfaces: Vec::new() } }),
            _ => return None,
        };
        let mut capture = Self { at: HEADER_BYTES, is_big, kind: Kind::Pcap { fraction_ns, link: 0 } };
        let network = capture.u32(bytes, 20)? & 0x0fff_ffff; // above it are flags of the checksum
        capture.kind = Kind::Pcap { fraction_ns, link: network };
        Some(capture)
    }

    /// The next packet; none at the end, or where the capture breaks off, which is noted.
    pub(crate) fn next<'a>(&mut self, file: &str, bytes: &'a [u8], notes: &mut Notes) -> Option<Packet<'a>> {
        while self.at < bytes.len() {
            let at = self.at;
            let step = match self.kind {
                Kind::Pcap { fraction_ns, link } => self.pcap(bytes, fraction_ns, link).map(Some),
                Kind::PcapNg { .. } => self.pcapng(bytes),
            };
            match step {
                Some(Some(packet)) => return Some(packet),
                Some(None) => {}
                None => {
                    let found = || ("a whole packet", format!("{} bytes that are none", bytes.len() - at));
                    notes.note(NoteKind::Truncated, file, at, found);
                    self.at = bytes.len();
                }
            }
        }
        None
    }

    fn u32(&self, bytes: &[u8], at: usize) -> Option<u32> {
        array(bytes, at).map(if self.is_big { u32::from_be_bytes } else { u32::from_le_bytes })
    }

    fn pcap<'a>(&mut self, bytes: &'a [u8], fraction_ns: i64, link: u32) -> Option<Packet<'a>> {
        let [seconds, fraction, length] =
            [self.u32(bytes, self.at)?, self.u32(bytes, self.at + 4)?, self.u32(bytes, self.at + 8)?];
        let at = self.at + RECORD_BYTES;
        let length = Some(length as usize).filter(|length| *length <= PACKET_BYTES_MAX)?;
        let packet = bytes.get(at..at + length)?;
        self.at = at + length;
        let stamp = Stamp(i64::from(seconds) * 1_000_000_000 + i64::from(fraction) * fraction_ns);
        Some(Packet { at, stamp, link, bytes: packet })
    }

    /// A block, which may hold a packet; none where it is no block.
    fn pcapng<'a>(&mut self, bytes: &'a [u8]) -> Option<Option<Packet<'a>>> {
        let begin = self.at;
        if self.u32(bytes, begin)? == SECTION {
            self.is_big = match self.u32(bytes, begin + 8)? {
                0x1a2b_3c4d => self.is_big,
                0x4d3c_2b1a => !self.is_big,
                _ => return None,
            };
            self.kind = Kind::PcapNg { interfaces: Vec::new() };
        }
        let (kind, length) = (self.u32(bytes, begin)?, self.u32(bytes, begin + 4)? as usize);
        let end = begin.checked_add(length).filter(|_| length >= 12 && length.is_multiple_of(4))?;
        let body = bytes.get(begin + 8..end - 4)?;
        self.at = end;
        Some(match kind {
            1 => {
                self.add_interface(body);
                None
            }
            6 => self.enhanced_packet(begin + 8, body),
            _ => None,
        })
    }

    fn add_interface(&mut self, body: &[u8]) {
        let order = if self.is_big { u16::from_be_bytes } else { u16::from_le_bytes };
        let u16_at = |at: usize| array(body, at).map(order);
        let link = u16_at(0).map_or(0, u32::from);
        let mut units = 1_000_000;
        let mut at = 8;
        while let (Some(code), Some(length)) = (u16_at(at), u16_at(at + 2)) {
            if code == 9 && length == 1 {
                units = units_of(body.get(at + 4).copied().unwrap_or(6));
            }
            if code == 0 {
                break;
            }
            at += 4 + usize::from(length).next_multiple_of(4);
        }
        if let Kind::PcapNg { interfaces } = &mut self.kind
            && interfaces.len() < INTERFACES_MAX
        {
            interfaces.push((link, units));
        }
    }

    fn enhanced_packet<'a>(&self, at: usize, body: &'a [u8]) -> Option<Packet<'a>> {
        let [interface, high, low, length] = [0, 4, 8, 12].map(|at| self.u32(body, at));
        let Kind::PcapNg { interfaces } = &self.kind else { return None };
        let (link, units) = *interfaces.get(interface? as usize)?;
        let time = u128::from(high?) << 32 | u128::from(low?);
        let stamp = Stamp(i64::try_from(time * 1_000_000_000 / u128::from(units)).ok()?);
        let bytes = body.get(20..)?.get(..length? as usize)?;
        Some(Packet { at: at + 20, stamp, link, bytes })
    }
}

/// Units of time in a second: a power of ten, or of two where the highest bit is set.
fn units_of(resolution: u8) -> u64 {
    let base: u64 = if resolution & 0x80 == 0 { 10 } else { 2 };
    base.checked_pow(u32::from(resolution & 0x7f)).unwrap_or(1_000_000)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn all(bytes: &[u8]) -> (Vec<(i64, Vec<u8>)>, Notes) {
        let mut notes = Notes::default();
        let mut found = Vec::new();
        if let Some(mut capture) = Capture::begin(bytes) {
            while let Some(packet) = capture.next("a.pcap", bytes, &mut notes) {
                assert_eq!(&bytes[packet.at..packet.at + packet.bytes.len()], packet.bytes);
                found.push((packet.stamp.0, packet.bytes.to_vec()));
            }
        }
        (found, notes)
    }

    fn pcap(order: fn(u32) -> [u8; 4], magic: u32, packets: &[Vec<u8>]) -> Vec<u8> {
        let mut file: Vec<u8> = [magic, 0x0004_0002, 0, 0, 65_535, 1].into_iter().flat_map(order).collect();
        for (at, packet) in packets.iter().enumerate() {
            let length = packet.len() as u32;
            file.extend([7, at as u32, length, length].into_iter().flat_map(order));
            file.extend(packet);
        }
        file
    }

    fn pcapng(packets: &[Vec<u8>]) -> Vec<u8> {
        let block = |kind: u32, body: &[u8]| {
            let padded = body.len().next_multiple_of(4);
            let length = (padded as u32 + 12).to_le_bytes();
            [&kind.to_le_bytes(), &length[..], body, &vec![0; padded - body.len()], &length].concat()
        };
        let section = block(SECTION, &[&0x1a2b_3c4d_u32.to_le_bytes()[..], &[1, 0, 0, 0], &[0xff; 8]].concat());
        let mut file = [section, block(1, &[1, 0, 0, 0, 0, 0, 0, 0, 9, 0, 1, 0, 9, 0, 0, 0])].concat();
        for packet in packets {
            let head = [0, 0, 1000, packet.len() as u32, packet.len() as u32].map(u32::to_le_bytes).concat();
            file.extend(block(6, &[head, packet.clone()].concat()));
        }
        file
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(packets in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..40), 0..6)) {
            let bodies = |found: Vec<(i64, Vec<u8>)>| found.into_iter().map(|(_, body)| body).collect::<Vec<_>>();
            for file in [
                pcap(u32::to_le_bytes, 0xa1b2_c3d4, &packets),
                pcap(u32::to_be_bytes, 0xa1b2_3c4d, &packets),
                pcapng(&packets),
            ] {
                let (found, notes) = all(&file);
                prop_assert_eq!(bodies(found), packets.clone());
                prop_assert_eq!(notes, Notes::default());
            }
        }

        #[test]
        fn any_bytes(bytes: Vec<u8>, cut in 0..200_usize, at in 0..200_usize, byte: u8) {
            all(&bytes);
            let packets = [vec![1, 2, 3], vec![4; 20]];
            for mut file in [pcap(u32::to_le_bytes, 0xa1b2_c3d4, &packets), pcapng(&packets)] {
                let at = at.min(file.len() - 1);
                file[at] = byte;
                file.truncate(file.len() - cut.min(file.len()));
                all(&file);
            }
        }
    }

    #[test]
    fn stamps_and_a_torn_end() {
        let file = pcap(u32::to_le_bytes, 0xa1b2_c3d4, &[vec![1], vec![2]]);
        assert_eq!(all(&file).0[1].0, 7_000_001_000);
        let (found, notes) = all(&file[..file.len() - 1]);
        assert_eq!((found.len(), notes.kinds[&NoteKind::Truncated].first[0].offset_bytes), (1, 41));
        assert_eq!(all(&pcapng(&[vec![1]])).0[0].0, 1000);
    }
}
