//! What tests of recordings have in common: files of messages made here.

use mapwright_bags::{Connection, Encoding, McapCompression, McapWriter};
use mapwright_geom::Stamp;
use mapwright_ros::{Encoding as Layout, Field, encode};
use std::fs::File;
use std::path::{Path, PathBuf};

pub(crate) fn ms(ms: i64) -> Stamp {
    Stamp(1_000_000_000_000 + ms * 1_000_000)
}

/// An MCAP file being written; topics are added when they are first used.
pub(crate) struct Recorder {
    writer: McapWriter<File>,
    topics: Vec<(String, u32)>,
    path: PathBuf,
    /// Where not zero, bits of messages are flipped by it.
    pub(crate) flips: u64,
}

impl Recorder {
    pub(crate) fn new(name: &str) -> Self {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        let writer = McapWriter::new(File::create(&path).unwrap(), McapCompression::None).unwrap();
        Self { writer, topics: Vec::new(), path, flips: 0 }
    }

    pub(crate) fn add(&mut self, connection: &Connection, recorded: Stamp, data: &[u8]) {
        let known = self.topics.iter().find(|(name, _)| *name == connection.topic).map(|(_, id)| *id);
        let id = known.unwrap_or_else(|| {
            let id = self.writer.add_connection(connection).unwrap();
            self.topics.push((connection.topic.clone(), id));
            id
        });
        let mut data = data.to_vec();
        for _ in 0..if self.flips == 0 { 0 } else { 2 } {
            self.flips = self.flips.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let at = (self.flips >> 20) as usize % data.len();
            data[at] ^= 1 << (self.flips >> 61);
        }
        self.writer.write(id, recorded, recorded, &data).unwrap();
    }

    pub(crate) fn raw(&mut self, topic: &str, kind: &str, recorded: Stamp, data: &[u8]) {
        self.add(&Connection::new(topic, kind, Encoding::Cdr), recorded, data);
    }

    pub(crate) fn write<'a>(&mut self, topic: &str, kind: &str, recorded: Stamp, message: &impl Field<'a>) {
        self.raw(topic, kind, recorded, &encode(message, Layout::Cdr).unwrap());
    }

    pub(crate) fn finish(self) -> PathBuf {
        self.writer.finish().unwrap();
        self.path
    }
}
