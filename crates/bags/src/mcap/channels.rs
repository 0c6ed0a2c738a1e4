//! The schemas and channels of an MCAP file as connections.

use super::record::{self, OP_CHANNEL, OP_SCHEMA, Record};
use crate::catalog::Catalog;
use crate::message::{Connection, Definition, DefinitionFormat, Encoding};
use crate::report::DamageKind;
use crate::window::{Bytes, excerpt};
use std::collections::BTreeMap;
use std::io;
use std::sync::Arc;

/// Schemas by id, and the connections of channels.
#[derive(Debug, Default)]
pub(crate) struct Channels {
    schemas: BTreeMap<u16, (String, Definition)>,
    ids: BTreeMap<u16, u32>,
}

impl Channels {
    pub(crate) fn connection(&self, channel: u16) -> Option<u32> {
        self.ids.get(&channel).copied()
    }

    /// Takes in a schema or a channel, and leaves other records alone; the last description read counts.
    pub(crate) fn take(
        &mut self,
        bytes: &mut impl Bytes,
        record: Record,
        offset_bytes: u64,
        catalog: &mut Catalog,
    ) -> io::Result<()> {
        if !matches!(record.op, OP_SCHEMA | OP_CHANNEL) {
            return Ok(());
        }
        let body = bytes.get(record.body_at(), record.length as usize)?;
        let taken = if record.op == OP_SCHEMA {
            self.take_schema(body)
        } else {
            self.take_channel(body, offset_bytes, catalog)
        };
        if taken.is_none() {
            let skipped = record.end() - record.at;
            catalog.damage(DamageKind::BadRecord, offset_bytes, "a schema or channel", excerpt(body), skipped);
        }
        Ok(())
    }

    fn take_schema(&mut self, body: &[u8]) -> Option<()> {
        let schema = record::schema(body)?;
        let text = String::from_utf8_lossy(schema.data);
        let format = DefinitionFormat::from_name(&schema.encoding);
        // repeated in the summary and in chunks: one text is enough
        let known = self.schemas.get(&schema.id).filter(|(_, known)| *known.text == *text && known.format == format);
        let text = known.map_or_else(|| text.into(), |(_, known)| Arc::clone(&known.text));
        self.schemas.insert(schema.id, (schema.name, Definition { format, text }));
        Some(())
    }

    fn take_channel(&mut self, body: &[u8], offset_bytes: u64, catalog: &mut Catalog) -> Option<()> {
        let channel = record::channel(body)?;
        let (type_name, definition) = match self.schemas.get(&channel.schema_id) {
            Some((name, definition)) => (name.clone(), Some(definition.clone())),
            None => (String::new(), None),
        };
        // an empty definition, as for types without any, is none
        let definition = definition.filter(|definition| !definition.text.is_empty());
        let encoding = Encoding::from_name(&channel.encoding);
        let (topic, metadata) = (channel.topic, channel.metadata);
        let connection = Connection { id: 0, topic, type_name, encoding, definition, metadata };
        let Some(id) = catalog.add(connection) else {
            catalog.damage(DamageKind::TooLarge, offset_bytes, "at most 65536 connections", "more", 0);
            return Some(());
        };
        if self.ids.insert(channel.id, id).is_some_and(|before| before != id) {
            let found = format!("channel {} described in two ways", channel.id);
            catalog.damage(DamageKind::ConflictingConnection, offset_bytes, "one description", found, 0);
        }
        Some(())
    }
}
