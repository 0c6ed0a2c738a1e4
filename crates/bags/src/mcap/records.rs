//! Messages among the records of an MCAP file, in a chunk or not.

use super::channels::Channels;
use super::record::{self, Found, OP_MESSAGE, Record, follows, record_at};
use crate::catalog::Catalog;
use crate::place::{Place, Step};
use crate::report::DamageKind;
use crate::window::{Bytes, excerpt};
use std::io;

/// A chunk that is being read.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OpenChunk {
    /// Where it lies in the file.
    pub(crate) at: u64,
    pub(crate) in_memory: bool,
    /// Where the next record is, in memory or in the file, and where the records end.
    pub(crate) inside: u64,
    pub(crate) end: u64,
    /// Whether it was cut short, so that its last record may be too.
    pub(crate) torn: bool,
}

/// The record at which a chunk stands, and the chunk as it is then; none at its end or where the way is lost.
pub(crate) fn record_in_chunk(
    bytes: &mut impl Bytes,
    chunk: OpenChunk,
    channels: &mut Channels,
    catalog: &mut Catalog,
) -> io::Result<(Step, Option<OpenChunk>)> {
    if chunk.inside >= chunk.end {
        return Ok((Step::GoOn, None));
    }
    let record = match record_at(bytes, chunk.inside)? {
        Found::Record(r) if r.end() == chunk.end || (r.end() < chunk.end && follows(bytes, r.end())?) => r,
        _ => {
            if !chunk.torn {
                let found = excerpt(bytes.get(chunk.inside, 9)?);
                let expected = format!("a record {} bytes before the end of the chunk here", chunk.end - chunk.inside);
                catalog.damage(DamageKind::BadRecord, chunk.at, expected, found, 0);
            }
            return Ok((Step::GoOn, None));
        }
    };
    channels.take(bytes, record, chunk.at, catalog)?;
    let offset_bytes = if chunk.in_memory { chunk.at } else { record.at };
    let step = message(bytes, record, (offset_bytes, chunk.in_memory), channels, catalog)?;
    Ok((step, Some(OpenChunk { inside: record.end(), ..chunk })))
}

/// A message, if the record is one and its channel is known.
pub(crate) fn message(
    bytes: &mut impl Bytes,
    record: Record,
    (offset_bytes, in_memory): (u64, bool),
    channels: &Channels,
    catalog: &mut Catalog,
) -> io::Result<Step> {
    if record.op != OP_MESSAGE {
        return Ok(Step::GoOn);
    }
    let body = bytes.get(record.body_at(), record.length as usize)?;
    let Some(head) = record::message_head(body) else {
        let found = format!("{} bytes", record.length);
        catalog.damage(DamageKind::BadRecord, offset_bytes, "a message's head", found, record.length);
        return Ok(Step::GoOn);
    };
    let Some(id) = channels.connection(head.channel) else {
        let found = format!("channel {}", head.channel);
        let skipped = record.end() - record.at;
        catalog.damage(DamageKind::UnknownConnection, offset_bytes, "a channel that is described", found, skipped);
        return Ok(Step::GoOn);
    };
    let data_at = record.body_at() + record::MESSAGE_HEAD_BYTES;
    let data_bytes = (record.length - record::MESSAGE_HEAD_BYTES) as usize;
    Ok(Step::Message(Place {
        id,
        log_stamp: head.log_stamp,
        publish_stamp: Some(head.publish_stamp),
        offset_bytes,
        data_at,
        data_bytes,
        in_memory,
    }))
}
