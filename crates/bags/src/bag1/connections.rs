//! Descriptions of connections in a ROS 1 bag.

use super::record::{self, Record};
use crate::catalog::Catalog;
use crate::message::{Connection, DefinitionFormat, Encoding};
use crate::report::DamageKind;
use crate::window::{Bytes, excerpt};
use std::collections::BTreeMap;
use std::io;

/// The numbers that connections have in the file.
#[derive(Debug, Default)]
pub(crate) struct Ids {
    pub(crate) by_conn: BTreeMap<u32, u32>,
}

/// Takes in the description of a connection; the last one read counts.
pub(crate) fn take_connection(
    bytes: &mut impl Bytes,
    record: &Record,
    offset_bytes: u64,
    ids: &mut Ids,
    catalog: &mut Catalog,
) -> io::Result<()> {
    let Some(conn) = record.header.conn else { return Ok(()) };
    let topic = topic(bytes.get(record.header_at(), record.header_bytes as usize)?);
    let data = bytes.get(record.data_at(), record.data_bytes as usize)?;
    let Some(connection) = topic.zip(connection_of(data)).map(|(topic, c)| Connection { topic, ..c }) else {
        let skipped = record.end() - record.at;
        let (expected, found) = ("a connection with topic and type", excerpt(data));
        catalog.damage(DamageKind::BadRecord, offset_bytes, expected, found, skipped);
        return Ok(());
    };
    let before = ids.by_conn.get(&conn).copied();
    let Some(id) = catalog.add(connection) else {
        catalog.damage(DamageKind::TooLarge, offset_bytes, "at most 65536 connections", "more", 0);
        return Ok(());
    };
    if before.is_some_and(|before| before != id) {
        let found = format!("connection {conn} described in two ways");
        catalog.damage(DamageKind::ConflictingConnection, offset_bytes, "one description", found, 0);
    }
    ids.by_conn.insert(conn, id);
    Ok(())
}

fn topic(header: &[u8]) -> Option<String> {
    let topic = record::fields(header).flatten().find(|(name, _)| *name == b"topic");
    topic.map(|(_, value)| String::from_utf8_lossy(value).into_owned())
}

/// The connection header that a publisher sends, without its topic, which may be one before remapping.
fn connection_of(data: &[u8]) -> Option<Connection> {
    let mut connection = Connection::new("", "", Encoding::Ros1);
    for field in record::fields(data) {
        let (name, value) = field?;
        let (name, value) = (String::from_utf8_lossy(name), String::from_utf8_lossy(value));
        match &*name {
            "type" => connection.type_name = value.into_owned(),
            "message_definition" => connection = connection.with_definition(DefinitionFormat::Ros1Msg, &value),
            "topic" => {}
            _ => connection = connection.with_metadata(&name, value),
        }
    }
    (!connection.type_name.is_empty()).then_some(connection)
}
