//! Captures of a network: pcap of either byte order and resolution, and pcapng.

use crate::notes::{NoteKind, Notes};
use crate::packets::window::Window;
use crate::scalar::array;
use mapwright_geom::Stamp;

/// No packet is larger (libpcap's own limit).
const PACKET_BYTES_MAX: usize = 262_144;
const SECTION: u32 = 0x0a0d_0d0a;
/// Bytes of pcap's header, and of the one before each packet.
pub(crate) const HEADER_BYTES: usize = 24;
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
    /// Of the last packet.
    seconds: Option<u32>,
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
/// No block of pcapng that is looked into is larger.
const BLOCK_BYTES_MAX: usize = 1 << 20;
/// Behind damage a packet is believed to begin where it was captured within so many seconds of the last.
const RESUMED_S: u32 = 60;

/// What stands at a place.
enum Step {
    /// A packet: where its bytes begin, how many they are, when it was captured and how it begins.
    Packet(usize, usize, Stamp, u32),
    Other,
}

impl Capture {
    /// The beginning of a capture, if the first bytes are those of one.
    pub(crate) fn begin(head: &[u8]) -> Option<Self> {
        let magic = u32::from_le_bytes(array(head, 0)?);
        let capture = |at, is_big, kind| Self { at, is_big, kind, seconds: None };
        let (is_big, fraction_ns) = match magic {
            0xa1b2_c3d4 => (false, 1000),
            0xa1b2_3c4d => (false, 1),
            0xd4c3_b2a1 => (true, 1000),
            0x4d3c_b2a1 => (true, 1),
            SECTION => return Some(capture(0, false, Kind::PcapNg { interfaces: Vec::new() })),
            _ => return None,
        };
        let link = u32_of(is_big, array(head, 20)?) & 0x0fff_ffff; // above it are flags of the checksum
        Some(capture(HEADER_BYTES, is_big, Kind::Pcap { fraction_ns, link }))
    }

    /// The next packet; none at the end. Damage is noted; a pcap goes on behind it where a packet begins again.
    pub(crate) fn next<'w>(&mut self, window: &'w mut Window<'_>, notes: &mut Notes) -> Option<Packet<'w>> {
        while window.goes_on(self.at) {
            let before = self.at;
            let step = match self.kind {
                Kind::Pcap { fraction_ns, link } => self.pcap(window, fraction_ns, link),
                Kind::PcapNg { .. } => self.pcapng(window),
            };
            match step {
                Some(Step::Packet(at, length, stamp, link)) => {
                    return window.get(at, length).map(|bytes| Packet { at, stamp, link, bytes });
                }
                Some(Step::Other) => {}
                None => self.resume(before, window, notes),
            }
        }
        None
    }

    /// Goes to the next place that may be a packet, or to the end.
    fn resume(&mut self, broken: usize, window: &mut Window<'_>, notes: &mut Notes) {
        let file = window.file.clone();
        let mut at = broken + 1;
        while let (Kind::Pcap { .. }, true) = (&self.kind, window.goes_on(at + RECORD_BYTES)) {
            let next = self.plausible(at, window);
            if next.is_some_and(|next| !window.goes_on(next) || self.plausible(next, window).is_some()) {
                let words = || ("a whole packet", format!("the next one {} bytes on", at - broken));
                notes.note(NoteKind::BadPacket, &file, broken, words);
                self.at = at;
                return;
            }
            at += 1;
        }
        let reason = window.failure().map_or_else(|| "none to the end".to_owned(), ToString::to_string);
        notes.note(NoteKind::Truncated, &file, broken, || ("a whole packet", reason));
        self.at = usize::MAX;
    }

    /// The end of what may be a packet of pcap: it is whole, and was captured soon before or after the last one.
    fn plausible(&self, at: usize, window: &mut Window<'_>) -> Option<usize> {
        let [seconds, _, length, sent] = self.record(at, window)?;
        let is_near = self.seconds.is_some_and(|last| last.abs_diff(seconds) <= RESUMED_S);
        let is_one = is_near && length > 0 && length <= sent && sent as usize <= PACKET_BYTES_MAX;
        let end = at + RECORD_BYTES + length as usize;
        (is_one && window.goes_on(end - 1)).then_some(end)
    }

    /// What stands before a packet of pcap: seconds, their fraction, bytes captured, bytes sent.
    fn record(&self, at: usize, window: &mut Window<'_>) -> Option<[u32; 4]> {
        let head = window.get(at, RECORD_BYTES)?;
        Some([0, 4, 8, 12].map(|at| array(head, at).map_or(0, |bytes| u32_of(self.is_big, bytes))))
    }

    fn pcap(&mut self, window: &mut Window<'_>, fraction_ns: i64, link: u32) -> Option<Step> {
        let [seconds, fraction, length, _] = self.record(self.at, window)?;
        let at = self.at + RECORD_BYTES;
        let length = Some(length as usize).filter(|length| *length <= PACKET_BYTES_MAX)?;
        window.get(at, length)?;
        (self.at, self.seconds) = (at + length, Some(seconds));
        let stamp = Stamp(i64::from(seconds) * 1_000_000_000 + i64::from(fraction) * fraction_ns);
        Some(Step::Packet(at, length, stamp, link))
    }

    /// A block, which may hold a packet; none where it is no block.
    fn pcapng(&mut self, window: &mut Window<'_>) -> Option<Step> {
        let begin = self.at;
        let head: [u8; 12] = array(window.get(begin, 12)?, 0)?;
        if self.u32(&head, 0)? == SECTION {
            self.is_big = match self.u32(&head, 8)? {
                0x1a2b_3c4d => self.is_big,
                0x4d3c_2b1a => !self.is_big,
                _ => return None,
            };
            self.kind = Kind::PcapNg { interfaces: Vec::new() };
        }
        let (kind, length) = (self.u32(&head, 0)?, self.u32(&head, 4)? as usize);
        if length < 12 || !length.is_multiple_of(4) || !window.goes_on(begin + length - 1) {
            return None;
        }
        self.at = begin + length;
        if !matches!(kind, 1 | 6) || length > BLOCK_BYTES_MAX {
            return Some(Step::Other);
        }
        let body = window.get(begin + 8, length - 12)?;
        if kind == 1 {
            self.add_interface(body);
            return Some(Step::Other);
        }
        Some(self.enhanced_packet(begin + 8, body).unwrap_or(Step::Other))
    }

    fn u32(&self, bytes: &[u8], at: usize) -> Option<u32> {
        array(bytes, at).map(|bytes| u32_of(self.is_big, bytes))
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

    fn enhanced_packet(&self, at: usize, body: &[u8]) -> Option<Step> {
        let [interface, high, low, length] = [0, 4, 8, 12].map(|at| self.u32(body, at));
        let Kind::PcapNg { interfaces } = &self.kind else { return None };
        let (link, units) = *interfaces.get(interface? as usize)?;
        let time = u128::from(high?) << 32 | u128::from(low?);
        let stamp = Stamp(i64::try_from(time * 1_000_000_000 / u128::from(units)).ok()?);
        let length = length? as usize;
        body.get(20..)?.get(..length)?;
        Some(Step::Packet(at + 20, length, stamp, link))
    }
}

fn u32_of(is_big: bool, bytes: [u8; 4]) -> u32 {
    if is_big { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) }
}

/// Units of time in a second: a power of ten, or of two where the highest bit is set.
fn units_of(resolution: u8) -> u64 {
    let base: u64 = if resolution & 0x80 == 0 { 10 } else { 2 };
    base.checked_pow(u32::from(resolution & 0x7f)).unwrap_or(1_000_000)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::packets::window::in_memory::File;
    use proptest::prelude::*;

    fn all(bytes: &[u8]) -> (Vec<(i64, Vec<u8>)>, Notes) {
        let mut notes = Notes::default();
        let mut found = Vec::new();
        let file = File(bytes);
        let mut window = Window::open(&file, "a.pcap");
        if let Some(mut capture) = Capture::begin(bytes) {
            while let Some(packet) = capture.next(&mut window, &mut notes) {
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

    #[test]
    fn a_pcap_goes_on_behind_damage() {
        let packets: Vec<Vec<u8>> = (0..5).map(|k| vec![k; 60]).collect();
        let mut file = pcap(u32::to_le_bytes, 0xa1b2_c3d4, &packets);
        let second = HEADER_BYTES + RECORD_BYTES + 60;
        file[second + 8..second + 12].copy_from_slice(&[0xff; 4]);
        let (found, notes) = all(&file);
        assert_eq!(found.iter().map(|(_, bytes)| bytes[0]).collect::<Vec<_>>(), [0, 2, 3, 4]);
        let note = &notes.kinds[&NoteKind::BadPacket].first[0];
        assert_eq!((note.offset_bytes, note.found.as_str()), (second as u64, "the next one 76 bytes on"));
    }
}
