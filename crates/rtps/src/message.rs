//! Messages of RTPS and what they are made of (DDSI-RTPS 2.5, 8.3 and 9.4): read from any bytes, written for one peer.

use crate::bytes::{Put, Reader};
use crate::ids::{EntityId, Prefix, VENDOR, VERSION};
use crate::parameters::Parameters;

const MAGIC: &[u8; 4] = b"RTPS";
const HEADER_BYTES: usize = 20;

const PAD: u8 = 0x01;
const ACKNACK: u8 = 0x06;
const HEARTBEAT: u8 = 0x07;
const GAP: u8 = 0x08;
const INFO_TS: u8 = 0x09;
const INFO_SRC: u8 = 0x0c;
const INFO_DST: u8 = 0x0e;
const NACK_FRAG: u8 = 0x12;
const DATA: u8 = 0x15;
const DATA_FRAG: u8 = 0x16;

const LITTLE: u8 = 0x01;
/// DATA, `DATA_FRAG`: parameters stand in front of the payload.
const INLINE: u8 = 0x02;
/// HEARTBEAT, ACKNACK: needs no answer.
const FINAL: u8 = 0x02;
const HAS_DATA: u8 = 0x04;
/// DATA: the payload is a key.
const HAS_KEY: u8 = 0x08;

/// Numbers that are missing: of samples, or of the fragments of one, from a base on (9.4.2.6, 9.4.2.8).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Missing {
    /// All below are there.
    pub(crate) base: i64,
    bits: u32,
    words: [u32; 8],
}

/// No set holds more.
pub(crate) const SET_MOST: u32 = 256;

impl Missing {
    /// None of those from a base on.
    pub(crate) fn none(base: i64) -> Self {
        Self { base, bits: 0, words: [0; 8] }
    }

    pub(crate) fn of(base: i64, numbers: impl IntoIterator<Item = i64>) -> Self {
        let mut set = Self::none(base);
        for number in numbers {
            let Some(bit) = number.checked_sub(base).and_then(|bit| u32::try_from(bit).ok()) else { continue };
            if bit < SET_MOST {
                set.words[bit as usize / 32] |= 1 << (31 - bit % 32);
                set.bits = set.bits.max(bit + 1);
            }
        }
        set
    }

    pub(crate) fn numbers(self) -> impl Iterator<Item = i64> {
        (0..self.bits.min(SET_MOST))
            .filter(move |bit| self.words[*bit as usize / 32] & 1 << (31 - bit % 32) != 0)
            .filter_map(move |bit| self.base.checked_add(i64::from(bit)))
    }

    fn read(reader: &mut Reader<'_>, base: i64) -> Option<Self> {
        let mut set = Self::none(base);
        set.bits = reader.u32().filter(|bits| *bits <= SET_MOST)?;
        for word in set.words.iter_mut().take(set.bits.div_ceil(32) as usize) {
            *word = reader.u32()?;
        }
        Some(set)
    }

    fn write(self, out: &mut Vec<u8>) {
        out.put_u32(self.bits);
        self.words.iter().take(self.bits.div_ceil(32) as usize).for_each(|word| out.put_u32(*word));
    }
}

/// What a part of a message says.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Submessage<'a> {
    /// A sample of a writer.
    Data { writer: EntityId, number: i64, inline: Parameters<'a>, payload: Option<&'a [u8]> },
    /// A part of a sample that is too long for one message.
    Fragment { writer: EntityId, number: i64, inline: Parameters<'a>, fragment: Fragment<'a> },
    /// Which samples a writer has.
    Heartbeat { writer: EntityId, first: i64, last: i64, is_final: bool },
    /// Which samples a reader lacks.
    AckNack { reader: EntityId, writer: EntityId, missing: Missing, is_final: bool },
    /// Which fragments of a sample a reader lacks.
    NackFragments { reader: EntityId, writer: EntityId, number: i64, missing: Missing },
    /// Samples that will not come: from the first to below the base, and those of the set.
    Gap { writer: EntityId, first: i64, set: Missing },
    /// Whom the next parts are for.
    Destination(Prefix),
    /// Whom the next parts are from.
    Source(Prefix),
}

/// Where a part of a sample belongs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fragment<'a> {
    /// From 1 on.
    pub(crate) first: u32,
    /// Bytes of each fragment but the last.
    pub(crate) size: u16,
    /// Bytes of the whole sample.
    pub(crate) whole: u32,
    pub(crate) bytes: &'a [u8],
}

/// A message's parts, and who sent it.
#[derive(Debug, Clone)]
pub(crate) struct Message<'a> {
    pub(crate) source: Prefix,
    rest: &'a [u8],
}

impl<'a> Message<'a> {
    /// A message; none where the bytes are no message of RTPS 2.
    pub(crate) fn read(bytes: &'a [u8]) -> Option<Self> {
        let (header, rest) = bytes.split_at_checked(HEADER_BYTES)?;
        let is_ours = header.starts_with(MAGIC) && header[4] == VERSION[0];
        let mut source = [0; 12];
        source.copy_from_slice(&header[8..]);
        is_ours.then_some(Self { source, rest })
    }
}

impl<'a> Iterator for Message<'a> {
    type Item = Submessage<'a>;

    /// The next part that is known; what is not is passed over, and what is torn ends the message.
    fn next(&mut self) -> Option<Submessage<'a>> {
        loop {
            let (header, rest) = self.rest.split_at_checked(4)?;
            let (kind, flags) = (header[0], header[1]);
            let is_little = flags & LITTLE != 0;
            let length = usize::from(Reader::new(&header[2..], is_little).u16()?);
            // none stands for all that is left (9.4.5.1.3)
            let length = if length == 0 && kind != PAD && kind != INFO_TS { rest.len() } else { length };
            let (body, rest) = rest.split_at_checked(length)?;
            self.rest = rest;
            if let Some(submessage) = submessage(kind, flags, Reader::new(body, is_little)) {
                return Some(submessage);
            }
        }
    }
}

fn submessage<'a>(kind: u8, flags: u8, mut reader: Reader<'a>) -> Option<Submessage<'a>> {
    match kind {
        INFO_DST => return Some(Submessage::Destination(reader.array()?)),
        INFO_SRC => {
            reader.take(8)?;
            return Some(Submessage::Source(reader.array()?));
        }
        DATA | DATA_FRAG => return sample(kind, flags, reader),
        HEARTBEAT | ACKNACK | GAP | NACK_FRAG => {}
        _ => return None,
    }
    let (from, to) = (reader.array()?, reader.array()?);
    let is_final = flags & FINAL != 0;
    let number = reader.sequence_number()?;
    Some(match kind {
        HEARTBEAT => {
            let last = reader.sequence_number()?;
            Submessage::Heartbeat { writer: to, first: number, last, is_final }
        }
        ACKNACK => {
            let missing = Missing::read(&mut reader, number)?;
            Submessage::AckNack { reader: from, writer: to, missing, is_final }
        }
        GAP => {
            let base = reader.sequence_number()?;
            Submessage::Gap { writer: to, first: number, set: Missing::read(&mut reader, base)? }
        }
        _ => {
            let base = i64::from(reader.u32()?);
            let missing = Missing::read(&mut reader, base)?;
            Submessage::NackFragments { reader: from, writer: to, number, missing }
        }
    })
}

fn sample<'a>(kind: u8, flags: u8, mut all: Reader<'a>) -> Option<Submessage<'a>> {
    all.u16()?;
    let to_inline = usize::from(all.u16()?);
    let mut at = all;
    at.array::<4>()?;
    let (writer, number) = (at.array()?, at.sequence_number()?);
    let mut fragment = Fragment { first: 0, size: 0, whole: 0, bytes: &[] };
    if kind == DATA_FRAG {
        fragment.first = at.u32()?;
        at.u16()?;
        (fragment.size, fragment.whole) = (at.u16()?, at.u32()?);
    }
    all.take(to_inline)?;
    let inline = if flags & INLINE != 0 { Parameters::read(&mut all)? } else { Parameters::none() };
    Some(if kind == DATA_FRAG {
        fragment.bytes = all.rest();
        Submessage::Fragment { writer, number, inline, fragment }
    } else {
        let payload = (flags & (HAS_DATA | HAS_KEY) != 0).then_some(all.rest());
        Submessage::Data { writer, number, inline, payload }
    })
}

/// What a writer tells.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Sample {
    /// Parameters in front of the payload, with their end; none where it is empty.
    pub(crate) inline: Vec<u8>,
    pub(crate) payload: Vec<u8>,
    /// The payload is the key of what has gone.
    pub(crate) is_key: bool,
}

/// A sample longer than that, bytes, goes in fragments of that size: with all that stands in front of it, it fits into one packet of Ethernet.
pub(crate) const FRAGMENT_BYTES: usize = 1280;

/// A message under way to one peer.
#[derive(Debug)]
pub(crate) struct Outgoing(Vec<u8>);

impl Outgoing {
    /// From a participant to another one; to all where it is none.
    pub(crate) fn new(from: Prefix, to: Option<Prefix>) -> Self {
        let mut out = Self([&MAGIC[..], &VERSION, &VENDOR, &from].concat());
        if let Some(prefix) = to {
            out.part(INFO_DST, 0, |out| out.extend(prefix));
        }
        out
    }

    pub(crate) fn bytes(self) -> Vec<u8> {
        self.0
    }

    fn part(&mut self, kind: u8, flags: u8, body: impl FnOnce(&mut Vec<u8>)) {
        self.0.extend([kind, flags | LITTLE, 0, 0]);
        let begun = self.0.len();
        body(&mut self.0);
        self.0.resize(begun + (self.0.len() - begun).next_multiple_of(4), 0);
        // A payload is never longer than a fragment, and parameters are few.
        let length = u16::try_from(self.0.len() - begun).unwrap_or(0);
        self.0[begun - 2..begun].copy_from_slice(&length.to_le_bytes());
    }

    pub(crate) fn data(&mut self, [reader, writer]: [EntityId; 2], number: i64, sample: &Sample) {
        let inline = if sample.inline.is_empty() { 0 } else { INLINE };
        let flags = inline | if sample.is_key { HAS_KEY } else { HAS_DATA };
        self.part(DATA, flags, |out| {
            out.put_u16(0);
            out.put_u16(16);
            out.extend([reader, writer].concat());
            out.put_sequence_number(number);
            out.extend(&sample.inline);
            out.extend(&sample.payload);
        });
    }

    /// One fragment, from 1 on; nothing where there is none.
    pub(crate) fn fragment(&mut self, [reader, writer]: [EntityId; 2], number: i64, sample: &Sample, fragment: u32) {
        let at = (fragment.saturating_sub(1) as usize).saturating_mul(FRAGMENT_BYTES);
        let Some(bytes) = sample.payload.get(at..).and_then(|rest| rest.chunks(FRAGMENT_BYTES).next()) else { return };
        let flags = if sample.inline.is_empty() { 0 } else { INLINE };
        self.part(DATA_FRAG, flags, |out| {
            out.put_u16(0);
            out.put_u16(28);
            out.extend([reader, writer].concat());
            out.put_sequence_number(number);
            out.put_u32(fragment);
            out.put_u16(1);
            out.put_u16(FRAGMENT_BYTES as u16);
            out.put_u32(u32::try_from(sample.payload.len()).unwrap_or(u32::MAX));
            out.extend(&sample.inline);
            out.extend(bytes);
        });
    }

    pub(crate) fn heartbeat(&mut self, [reader, writer]: [EntityId; 2], [first, last]: [i64; 2], count: u32) {
        self.part(HEARTBEAT, 0, |out| {
            out.extend([reader, writer].concat());
            out.put_sequence_number(first);
            out.put_sequence_number(last);
            out.put_u32(count);
        });
    }

    pub(crate) fn acknack(&mut self, [reader, writer]: [EntityId; 2], missing: Missing, is_final: bool, count: u32) {
        self.part(ACKNACK, if is_final { FINAL } else { 0 }, |out| {
            out.extend([reader, writer].concat());
            out.put_sequence_number(missing.base);
            missing.write(out);
            out.put_u32(count);
        });
    }

    #[cfg(test)]
    pub(crate) fn nack_fragments(&mut self, [reader, writer]: [EntityId; 2], number: i64, missing: Missing) {
        self.part(NACK_FRAG, 0, |out| {
            out.extend([reader, writer].concat());
            out.put_sequence_number(number);
            out.put_u32(missing.base as u32);
            missing.write(out);
            out.put_u32(1);
        });
    }

    /// Samples from the first to below an end will not come.
    pub(crate) fn gap(&mut self, [reader, writer]: [EntityId; 2], first: i64, end: i64) {
        self.part(GAP, 0, |out| {
            out.extend([reader, writer].concat());
            out.put_sequence_number(first);
            out.put_sequence_number(end);
            Missing::none(end).write(out);
        });
    }
}
