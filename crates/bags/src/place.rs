//! A message that was found but not yet lent, in the containers that are read as bytes.

use crate::message::{Connection, RawMessage};
use crate::window::Bytes;
use mapwright_geom::Stamp;
use std::io;

/// A message found, as numbers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    pub(crate) id: u32,
    pub(crate) log_stamp: Stamp,
    pub(crate) publish_stamp: Option<Stamp>,
    pub(crate) offset_bytes: u64,
    pub(crate) data_at: u64,
    pub(crate) data_bytes: usize,
    pub(crate) in_memory: bool,
}

/// What one step of a reader came to.
pub(crate) enum Step {
    Message(Place),
    GoOn,
    End,
}

impl Place {
    /// The message, from the decompressed chunk or from the file.
    pub(crate) fn lend<'a>(
        self,
        connections: &'a [Connection],
        memory: &'a mut impl Bytes,
        file: &'a mut impl Bytes,
    ) -> io::Result<RawMessage<'a>> {
        let Self { data_at, data_bytes, .. } = self;
        let data = if self.in_memory { memory.get(data_at, data_bytes)? } else { file.get(data_at, data_bytes)? };
        Ok(RawMessage {
            connection: &connections[self.id as usize],
            log_stamp: self.log_stamp,
            publish_stamp: self.publish_stamp,
            offset_bytes: self.offset_bytes,
            data,
        })
    }
}
