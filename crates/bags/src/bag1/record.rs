//! Records of a ROS 1 bag: a header of named fields, and data.

use crate::decode::Codec;
use crate::window::{Bytes, excerpt, u32_at, u64_at};
use mapwright_geom::Stamp;
use std::io;

/// Longer headers are none; the longest there are hold a topic's name.
const HEADER_BYTES_MAX: u32 = 1 << 16;

pub(crate) const OP_MESSAGE: u8 = 2;
pub(crate) const OP_BAG: u8 = 3;
pub(crate) const OP_INDEX: u8 = 4;
pub(crate) const OP_CHUNK: u8 = 5;
pub(crate) const OP_CHUNK_INFO: u8 = 6;
pub(crate) const OP_CONNECTION: u8 = 7;

/// What a record's header says, as far as it is of use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Header {
    pub(crate) op: u8,
    pub(crate) conn: Option<u32>,
    pub(crate) stamp: Option<Stamp>,
    pub(crate) version: Option<u32>,
    pub(crate) count: Option<u32>,
    pub(crate) size: Option<u32>,
    pub(crate) index_at: Option<u64>,
    pub(crate) chunk_count: Option<u32>,
    pub(crate) chunk_at: Option<u64>,
    /// None where a compression is named that is not known.
    pub(crate) codec: Option<Codec>,
}

impl Header {
    pub(crate) fn parse(bytes: &[u8]) -> Option<Self> {
        let mut header = Self::default();
        for field in fields(bytes) {
            let (name, value) = field?;
            match name {
                b"op" => header.op = *value.first().filter(|_| value.len() == 1)?,
                b"conn" => header.conn = u32_at(value, 0),
                b"time" => header.stamp = stamp(value),
                b"ver" => header.version = u32_at(value, 0),
                b"count" => header.count = u32_at(value, 0),
                b"size" => header.size = u32_at(value, 0),
                b"index_pos" => header.index_at = u64_at(value, 0),
                b"chunk_count" => header.chunk_count = u32_at(value, 0),
                b"chunk_pos" => header.chunk_at = u64_at(value, 0),
                b"compression" => header.codec = Codec::from_name(value),
                _ => {}
            }
        }
        header.is_whole().then_some(header)
    }

    /// Whether it is of a known kind and has the fields of that kind.
    fn is_whole(&self) -> bool {
        match self.op {
            OP_MESSAGE => self.conn.is_some() && self.stamp.is_some(),
            OP_BAG => self.index_at.is_some(),
            OP_INDEX => self.conn.is_some() && self.count.is_some(),
            OP_CHUNK => self.size.is_some(),
            OP_CHUNK_INFO => self.chunk_at.is_some(),
            OP_CONNECTION => self.conn.is_some(),
            _ => false,
        }
    }
}

/// Names and values of a header's fields; none for what is no field, and then no more.
pub(crate) fn fields(mut bytes: &[u8]) -> impl Iterator<Item = Option<(&[u8], &[u8])>> {
    std::iter::from_fn(move || {
        if bytes.is_empty() {
            return None;
        }
        let rest = std::mem::take(&mut bytes);
        let length = u32_at(rest, 0).map(|n| n as usize);
        let field = length.and_then(|n| rest[4..].get(..n));
        let Some(split) = field.and_then(|field| Some((field, memchr::memchr(b'=', field)?))) else {
            return Some(None);
        };
        let (field, equals) = split;
        bytes = &rest[4 + field.len()..];
        Some(Some((&field[..equals], &field[equals + 1..])))
    })
}

/// Seconds and nanoseconds.
fn stamp(value: &[u8]) -> Option<Stamp> {
    Some(Stamp(i64::from(u32_at(value, 0)?) * 1_000_000_000 + i64::from(u32_at(value, 4)?)))
}

/// Where a record lies, and what its header says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Record {
    pub(crate) at: u64,
    pub(crate) header: Header,
    pub(crate) header_bytes: u32,
    pub(crate) data_bytes: u32,
}

impl Record {
    pub(crate) fn header_at(&self) -> u64 {
        self.at + 4
    }

    pub(crate) fn data_at(&self) -> u64 {
        self.at + 8 + u64::from(self.header_bytes)
    }

    pub(crate) fn end(&self) -> u64 {
        self.data_at() + u64::from(self.data_bytes)
    }
}

/// What stands where a record should.
#[derive(Debug)]
pub(crate) enum Found {
    /// A record; its data may go on beyond the end.
    Record(Record),
    /// The beginning of one, and then the end.
    Torn,
    /// Something else.
    Other(String),
}

/// The record at `at`.
pub(crate) fn record_at(bytes: &mut impl Bytes, at: u64) -> io::Result<Found> {
    let end = bytes.end();
    let Some(header_bytes) = u32_at(bytes.get(at, 4)?, 0) else {
        return Ok(Found::Torn);
    };
    if header_bytes > HEADER_BYTES_MAX {
        return Ok(Found::Other(excerpt(bytes.get(at, 25)?)));
    }
    let length = header_bytes as usize;
    let head = bytes.get(at, length + 8)?;
    if head.len() < 4 + length {
        // the beginning of a header can still be told from anything else
        let begins_well = fields(&head[4..]).next().flatten().is_some() || end - at < 16;
        return Ok(if begins_well { Found::Torn } else { Found::Other(excerpt(head)) });
    }
    let Some(header) = Header::parse(&head[4..4 + length]) else {
        return Ok(Found::Other(excerpt(head)));
    };
    let Some(data_bytes) = u32_at(head, 4 + length) else {
        return Ok(Found::Torn);
    };
    Ok(Found::Record(Record { at, header, header_bytes, data_bytes }))
}

/// Whether a record, or the end, follows at `at`: a length that was damaged rarely leads to one. A record that is itself
/// damaged still shows by its lengths, which lead to a further one, or by how it begins.
pub(crate) fn follows(bytes: &mut impl Bytes, at: u64) -> io::Result<bool> {
    if at >= bytes.end() {
        return Ok(at == bytes.end());
    }
    Ok(!matches!(record_at(bytes, at)?, Found::Other(_))
        || behind_damaged(bytes, at)?.is_some()
        || begins_like_record(bytes.get(at, 4 + FIRST_FIELD_BYTES)?))
}

/// The longest first field is a chunk's compression, or a position in the bag's header.
const FIRST_FIELD_BYTES: usize = 32;

fn begins_like_record(bytes: &[u8]) -> bool {
    let Some(field) = bytes.get(8..) else { return false };
    let length = u32_at(bytes, 4).unwrap_or(0) as usize;
    let names: [&[u8]; 5] = [b"op=", b"conn=", b"time=", b"ver=", b"count="];
    let others: [&[u8]; 4] = [b"compression=", b"size=", b"topic=", b"chunk_pos="];
    length <= 256 && names.iter().chain(&others).any(|name| field.starts_with(name))
}

/// Where the lengths of a damaged record lead to, if that is a record.
pub(crate) fn behind_damaged(bytes: &mut impl Bytes, at: u64) -> io::Result<Option<u64>> {
    let Some(header_bytes) = u32_at(bytes.get(at, 4)?, 0).filter(|n| *n <= HEADER_BYTES_MAX) else {
        return Ok(None);
    };
    let data_at = at + 8 + u64::from(header_bytes);
    let Some(data_bytes) = u32_at(bytes.get(data_at - 4, 4)?, 0) else { return Ok(None) };
    let next = data_at + u64::from(data_bytes);
    let is_record = next < bytes.end() && matches!(record_at(bytes, next)?, Found::Record(_));
    Ok((is_record || next == bytes.end()).then_some(next))
}
