//! The tables of a ROS 2 bag, which differ from version to version.

use super::HEADER_BYTES;
use crate::catalog::Catalog;
use crate::message::{Connection, Definition, DefinitionFormat, Encoding};
use crate::report::DamageKind;
use rusqlite::types::ValueRef;
use rusqlite::{Connection as Database, Result as SqlResult, Row};
use std::collections::{BTreeMap, BTreeSet};

/// Columns of a table that may be there or not.
fn columns(database: &Database, table: &str) -> BTreeSet<String> {
    let names = || -> SqlResult<BTreeSet<String>> {
        let mut statement = database.prepare("SELECT name FROM pragma_table_info(?1)")?;
        statement.query_map([table], |row| text(row, 0))?.collect()
    };
    names().unwrap_or_default()
}

/// Text whatever the column holds.
fn text(row: &Row<'_>, column: usize) -> SqlResult<String> {
    Ok(match row.get_ref(column)? {
        ValueRef::Text(bytes) | ValueRef::Blob(bytes) => String::from_utf8_lossy(bytes).into_owned(),
        ValueRef::Integer(number) => number.to_string(),
        _ => String::new(),
    })
}

/// Refuses what is no ROS 2 bag: both tables must be there, and be plain tables.
pub(super) fn check(database: &Database) -> Result<(), String> {
    let sql = "SELECT name FROM sqlite_master WHERE type = 'table' AND name IN ('messages', 'topics') \
               AND sql LIKE 'CREATE TABLE%'";
    let tables = || -> SqlResult<BTreeSet<String>> {
        let mut statement = database.prepare(sql)?;
        statement.query_map([], |row| text(row, 0))?.collect()
    };
    let listed = format!("the list of tables from byte {HEADER_BYTES} on");
    let tables = tables().map_err(|error| format!("{error}, reading {listed}"))?;
    match ["messages", "topics"].iter().find(|name| !tables.contains(**name)) {
        Some(missing) => Err(format!("no table `{missing}` in {listed}")),
        None => Ok(()),
    }
}

/// Takes in all topics; connections by the topic's id in the database.
pub(super) fn read_topics(database: &Database, catalog: &mut Catalog) -> BTreeMap<i64, u32> {
    let mut ids = BTreeMap::new();
    let definitions = Definitions::read(database, catalog);
    let there = columns(database, "topics");
    let column = |name: &'static str| if there.contains(name) { name } else { "''" };
    let sql = format!(
        "SELECT id, name, type, {}, {}, {} FROM topics ORDER BY id",
        column("serialization_format"),
        column("offered_qos_profiles"),
        column("type_description_hash"),
    );
    let mut read = || -> SqlResult<()> {
        let mut statement = database.prepare(&sql)?;
        let mut rows = statement.query([])?;
        while let Some(row) = rows.next()? {
            let connection = connection(row, &definitions)?;
            match catalog.add(connection) {
                Some(id) => drop(ids.insert(row.get(0)?, id)),
                None => catalog.damage(DamageKind::TooLarge, 0, "at most 65536 topics", "more", 0),
            }
        }
        Ok(())
    };
    if let Err(error) = read() {
        catalog.damage(DamageKind::Database, 0, "a readable table of topics", error.to_string(), 0);
    }
    ids
}

fn connection(row: &Row<'_>, definitions: &Definitions) -> SqlResult<Connection> {
    let format = text(row, 3)?;
    let encoding = if format.is_empty() { Encoding::Cdr } else { Encoding::from_name(&format) };
    let mut connection = Connection::new(text(row, 1)?, text(row, 2)?, encoding);
    for (key, column) in [("offered_qos_profiles", 4), ("type_description_hash", 5)] {
        let value = text(row, column)?;
        if !value.is_empty() {
            connection = connection.with_metadata(key, value);
        }
    }
    connection.definition = definitions.of(&connection);
    Ok(connection)
}

/// Definitions by type and hash.
#[derive(Debug, Default)]
struct Definitions(BTreeMap<(String, String), Definition>);

impl Definitions {
    /// Those that the database carries: newer ones do.
    fn read(database: &Database, catalog: &mut Catalog) -> Self {
        let mut definitions = Self::default();
        let there = columns(database, "message_definitions");
        if !there.contains("encoded_message_definition") {
            return definitions;
        }
        let hash = if there.contains("type_description_hash") { "type_description_hash" } else { "''" };
        let sql = format!("SELECT topic_type, {hash}, encoding, encoded_message_definition FROM message_definitions");
        let mut read = || -> SqlResult<()> {
            let mut statement = database.prepare(&sql)?;
            let mut rows = statement.query([])?;
            while let Some(row) = rows.next()? {
                let (format, definition) = (DefinitionFormat::from_name(&text(row, 2)?), text(row, 3)?);
                if !definition.is_empty() {
                    let definition = Definition { format, text: definition.into() };
                    definitions.0.insert((text(row, 0)?, text(row, 1)?), definition);
                }
            }
            Ok(())
        };
        if let Err(error) = read() {
            catalog.damage(DamageKind::BadIndex, 0, "a readable table of definitions", error.to_string(), 0);
        }
        definitions
    }

    /// That of the same hash, or else of the same name.
    fn of(&self, connection: &Connection) -> Option<Definition> {
        let hash = connection.metadata.get("type_description_hash").cloned().unwrap_or_default();
        let exact = self.0.get(&(connection.type_name.clone(), hash));
        let by_name = || self.0.iter().find(|((name, _), _)| *name == connection.type_name).map(|(_, found)| found);
        exact.or_else(by_name).cloned()
    }
}
