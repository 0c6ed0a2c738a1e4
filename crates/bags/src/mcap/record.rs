//! Records of MCAP.

use crate::window::{Bytes, excerpt, u16_at, u32_at, u64_at};
use mapwright_geom::Stamp;
use std::collections::BTreeMap;
use std::io;

pub(crate) const OP_FOOTER: u8 = 2;
pub(crate) const OP_SCHEMA: u8 = 3;
pub(crate) const OP_CHANNEL: u8 = 4;
pub(crate) const OP_MESSAGE: u8 = 5;
pub(crate) const OP_CHUNK: u8 = 6;
pub(crate) const OP_CHUNK_INDEX: u8 = 8;
pub(crate) const OP_ATTACHMENT: u8 = 9;
pub(crate) const OP_DATA_END: u8 = 15;
/// Records of kinds beyond are private.
const OP_PRIVATE: u8 = 0x80;

/// Kind and length.
pub(crate) const HEAD_BYTES: u64 = 9;
/// Larger records are none.
pub(crate) const RECORD_BYTES_MAX: u64 = 1 << 32;
/// Channel, sequence, log time and publish time before a message's data.
pub(crate) const MESSAGE_HEAD_BYTES: u64 = 22;

/// Where a record lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Record {
    pub(crate) at: u64,
    pub(crate) op: u8,
    pub(crate) length: u64,
}

impl Record {
    pub(crate) fn body_at(&self) -> u64 {
        self.at + HEAD_BYTES
    }

    pub(crate) fn end(&self) -> u64 {
        self.body_at() + self.length
    }
}

/// What stands where a record should.
#[derive(Debug)]
pub(crate) enum Found {
    /// A record; its body may go on beyond the end.
    Record(Record),
    /// The beginning of one, and then the end.
    Torn,
    /// Something else.
    Other(String),
}

/// The record at `at`.
pub(crate) fn record_at(bytes: &mut impl Bytes, at: u64) -> io::Result<Found> {
    let head = bytes.get(at, HEAD_BYTES as usize)?;
    let is_known = |op: u8| (1..=OP_DATA_END).contains(&op) || op >= OP_PRIVATE;
    Ok(match (head.first(), u64_at(head, 1)) {
        (Some(op), Some(length)) if is_known(*op) && length < RECORD_BYTES_MAX => {
            Found::Record(Record { at, op: *op, length })
        }
        (Some(op), None) if is_known(*op) => Found::Torn,
        (None, _) => Found::Torn,
        _ => Found::Other(excerpt(head)),
    })
}

/// Whether a record, or the end, follows at `at`: a length that was damaged rarely leads to one. A record of which only the
/// kind is damaged still shows by its length, which leads to a further one.
pub(crate) fn follows(bytes: &mut impl Bytes, at: u64) -> io::Result<bool> {
    if at >= bytes.end() {
        return Ok(at == bytes.end());
    }
    Ok(!matches!(record_at(bytes, at)?, Found::Other(_)) || behind_damaged(bytes, at)?.is_some())
}

/// Where the length of a record of a damaged kind leads to, if that is a record.
pub(crate) fn behind_damaged(bytes: &mut impl Bytes, at: u64) -> io::Result<Option<u64>> {
    let length = u64_at(bytes.get(at, HEAD_BYTES as usize)?, 1).filter(|length| *length < RECORD_BYTES_MAX);
    let Some(next) = length.map(|length| at + HEAD_BYTES + length) else { return Ok(None) };
    let is_record = next < bytes.end() && matches!(record_at(bytes, next)?, Found::Record(_));
    Ok(is_record.then_some(next))
}

/// A text with its length before it, and where it ends.
fn text_at(bytes: &[u8], at: usize) -> Option<(&[u8], usize)> {
    let end = (at + 4).checked_add(u32_at(bytes, at)? as usize)?;
    Some((bytes.get(at + 4..end)?, end))
}

fn lossy(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A type with its definition.
#[derive(Debug)]
pub(crate) struct Schema<'a> {
    pub(crate) id: u16,
    pub(crate) name: String,
    pub(crate) encoding: String,
    pub(crate) data: &'a [u8],
}

pub(crate) fn schema(body: &[u8]) -> Option<Schema<'_>> {
    let id = u16_at(body, 0)?;
    let (name, at) = text_at(body, 2)?;
    let (encoding, at) = text_at(body, at)?;
    let (data, _) = text_at(body, at)?;
    Some(Schema { id, name: lossy(name), encoding: lossy(encoding), data })
}

/// A stream of messages.
#[derive(Debug)]
pub(crate) struct Channel {
    pub(crate) id: u16,
    pub(crate) schema_id: u16,
    pub(crate) topic: String,
    pub(crate) encoding: String,
    pub(crate) metadata: BTreeMap<String, String>,
}

pub(crate) fn channel(body: &[u8]) -> Option<Channel> {
    let (id, schema_id) = (u16_at(body, 0)?, u16_at(body, 2)?);
    let (topic, at) = text_at(body, 4)?;
    let (encoding, at) = text_at(body, at)?;
    let (map, _) = text_at(body, at)?;
    let mut metadata = BTreeMap::new();
    let mut at = 0;
    while at < map.len() {
        let (key, value_at) = text_at(map, at)?;
        let (value, end) = text_at(map, value_at)?;
        metadata.insert(lossy(key), lossy(value));
        at = end;
    }
    Some(Channel { id, schema_id, topic: lossy(topic), encoding: lossy(encoding), metadata })
}

/// A message up to its data.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MessageHead {
    pub(crate) channel: u16,
    pub(crate) log_stamp: Stamp,
    pub(crate) publish_stamp: Stamp,
}

pub(crate) fn message_head(body: &[u8]) -> Option<MessageHead> {
    let stamp = |nanoseconds: u64| Stamp(i64::try_from(nanoseconds).unwrap_or(i64::MAX));
    Some(MessageHead {
        channel: u16_at(body, 0)?,
        log_stamp: stamp(u64_at(body, 6)?),
        publish_stamp: stamp(u64_at(body, 14)?),
    })
}

/// A chunk up to its records.
#[derive(Debug, Clone)]
pub(crate) struct ChunkHead {
    pub(crate) size: u64,
    pub(crate) crc: u32,
    pub(crate) compression: Vec<u8>,
    pub(crate) stored: u64,
    /// Where in the body its records begin.
    pub(crate) records_at: u64,
}

pub(crate) fn chunk_head(body: &[u8]) -> Option<ChunkHead> {
    let (compression, at) = text_at(body, 28)?;
    Some(ChunkHead {
        size: u64_at(body, 16)?,
        crc: u32_at(body, 24)?,
        compression: compression.to_vec(),
        stored: u64_at(body, at)?,
        records_at: at as u64 + 8,
    })
}
