//! The index at the end of a ROS 1 bag.

use super::connections::{Ids, take_connection};
use super::record::{Found, Header, OP_BAG, OP_CHUNK, OP_CHUNK_INFO, OP_CONNECTION, Record, record_at};
use crate::catalog::Catalog;
use crate::report::DamageKind;
use crate::window::Bytes;
use std::io;

/// What the bag's header and the index at its end say.
#[derive(Debug, Default)]
pub(crate) struct Index {
    pub(crate) at: u64,
    pub(crate) chunk_count: u32,
    /// Where chunks begin, ascending.
    chunks_at: Vec<u64>,
}

impl Index {
    /// Looks at the bag's header at `at` and at the index that it names, of which connections are taken in.
    pub(crate) fn find(bytes: &mut impl Bytes, at: u64, ids: &mut Ids, catalog: &mut Catalog) -> io::Result<Self> {
        let header = match record_at(bytes, at)? {
            Found::Record(Record { header: header @ Header { op: OP_BAG, .. }, .. }) => header,
            _ => Header::default(),
        };
        let mut index = Self {
            at: header.index_at.unwrap_or(0),
            chunk_count: header.chunk_count.unwrap_or(0),
            chunks_at: Vec::new(),
        };
        let header_at = at;
        let mut at = index.at;
        let has_index = at > header_at && at < bytes.end();
        catalog.report.note_index(has_index);
        while has_index && at < bytes.end() {
            let record = match record_at(bytes, at)? {
                Found::Record(record) if record.end() <= bytes.end() => record,
                _ => {
                    catalog.damage(DamageKind::BadIndex, at, "an index of connections and chunks", "others", 0);
                    break;
                }
            };
            match (record.header.op, record.header.chunk_at) {
                (OP_CONNECTION, _) => {
                    take_connection(bytes, &record, at, ids, catalog)?;
                }
                (OP_CHUNK_INFO, Some(chunk_at)) => index.chunks_at.push(chunk_at),
                _ => break,
            }
            at = record.end();
        }
        index.chunks_at.sort_unstable();
        Ok(index)
    }

    /// The next chunk that the index names behind a place, and that is there.
    pub(crate) fn next_chunk(&self, bytes: &mut impl Bytes, behind: u64) -> io::Result<Option<u64>> {
        let from = self.chunks_at.partition_point(|at| *at <= behind);
        for place in from..self.chunks_at.len() {
            let at = self.chunks_at[place];
            let is_chunk = matches!(record_at(bytes, at)?, Found::Record(r) if r.header.op == OP_CHUNK);
            if is_chunk {
                return Ok(Some(at));
            }
        }
        Ok(None)
    }
}
