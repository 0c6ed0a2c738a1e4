//! The summary at the end of an MCAP file.

use super::MAGIC;
use super::channels::Channels;
use super::record::{self, Found, OP_CHANNEL, OP_CHUNK_INDEX, OP_FOOTER, OP_SCHEMA, Record, record_at};
use crate::catalog::Catalog;
use crate::report::DamageKind;
use crate::window::{Bytes, u32_at, u64_at};
use std::io;

/// Takes in the channels that the summary names, if there is one, and returns where it says that chunks begin, ascending.
pub(crate) fn look(bytes: &mut impl Bytes, channels: &mut Channels, catalog: &mut Catalog) -> io::Result<Vec<u64>> {
    let end = bytes.end();
    let footer_at = end.saturating_sub(MAGIC.len() as u64 + 20 + record::HEAD_BYTES);
    let footer = match record_at(bytes, footer_at)? {
        Found::Record(Record { op: OP_FOOTER, length: 20, .. }) => bytes.get(footer_at + 9, 20)?,
        _ => &[],
    };
    let (start, crc) = (u64_at(footer, 0).unwrap_or(0), u32_at(footer, 16).unwrap_or(0));
    let is_there = start >= MAGIC.len() as u64 && start < footer_at;
    catalog.report.note_index(is_there);
    if !is_there {
        return Ok(Vec::new());
    }
    // the checksum covers the summary and the footer up to the checksum itself
    let calculated = if crc == 0 { 0 } else { checksum(bytes, start, footer_at + 9 + 16)? };
    if calculated != crc {
        let (expected, found) = (format!("summary checksum {crc:08x}"), format!("{calculated:08x}"));
        catalog.damage(DamageKind::BadIndex, start, expected, found, 0);
        return Ok(Vec::new());
    }
    read(bytes, (start, footer_at), channels, catalog)
}

fn checksum(bytes: &mut impl Bytes, start: u64, end: u64) -> io::Result<u32> {
    let (mut hasher, mut at) = (crc32fast::Hasher::new(), start);
    while at < end {
        let piece = bytes.get(at, (end - at).min(1 << 16) as usize)?;
        if piece.is_empty() {
            break;
        }
        hasher.update(piece);
        at += piece.len() as u64;
    }
    Ok(hasher.finalize())
}

fn read(
    bytes: &mut impl Bytes,
    (start, end): (u64, u64),
    channels: &mut Channels,
    catalog: &mut Catalog,
) -> io::Result<Vec<u64>> {
    let mut chunks_at = Vec::new();
    let mut at = start;
    while at < end {
        let record = match record_at(bytes, at)? {
            Found::Record(record) if record.end() <= end => record,
            _ => {
                catalog.damage(DamageKind::BadIndex, at, "a record of the summary", "none", 0);
                break;
            }
        };
        match record.op {
            OP_SCHEMA | OP_CHANNEL => channels.take(bytes, record, at, catalog)?,
            OP_CHUNK_INDEX => {
                chunks_at.extend(u64_at(bytes.get(record.body_at(), 24)?, 16));
            }
            _ => {}
        }
        at = record.end();
    }
    chunks_at.sort_unstable();
    Ok(chunks_at)
}
