//! What the tests of this crate share: made-up recordings, and what is read from them.
#![allow(clippy::explicit_write, dead_code)] // no test uses all of it
#![allow(clippy::print_stdout)] // skipping is said

use mapwright_bags::{
    Bag1Compression, Bag1Writer, BagError, BagReader, Connection, DefinitionFormat, Encoding, McapCompression,
    McapWriter, RawMessage, ReadReport, Recording,
};
use mapwright_geom::Stamp;
use std::io::Cursor;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// splitmix64.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub(crate) fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }
}

/// A message as it was read, its data as length and checksum.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Seen {
    pub(crate) topic: String,
    pub(crate) type_name: String,
    pub(crate) stamp: i64,
    pub(crate) length: usize,
    pub(crate) crc: u32,
}

pub(crate) fn seen(message: &RawMessage<'_>) -> Seen {
    Seen {
        topic: message.connection.topic.clone(),
        type_name: message.connection.type_name.clone(),
        stamp: message.log_stamp.0,
        length: message.data.len(),
        crc: crc32fast::hash(message.data),
    }
}

/// Messages with their offsets, the report, and the most that buffers held.
pub(crate) type Read = (Vec<(Seen, u64)>, ReadReport, usize);

/// All messages of a stream.
pub(crate) fn read(content: &[u8]) -> Result<Read, BagError> {
    let mut reader = BagReader::open(Cursor::new(content))?;
    let mut messages = Vec::new();
    while let Some(message) = reader.next_message()? {
        messages.push((seen(&message), message.offset_bytes));
    }
    Ok((messages, reader.report().clone(), reader.held_bytes()))
}

pub(crate) fn read_path(path: &Path) -> Result<(Vec<Seen>, ReadReport, Vec<Connection>), BagError> {
    let mut recording = Recording::open(path)?;
    let mut messages = Vec::new();
    while let Some(message) = recording.next_message()? {
        messages.push(seen(&message));
    }
    Ok((messages, recording.report().clone(), recording.connections().to_vec()))
}

/// One made-up message: connection, stamp, data.
pub(crate) type Made = (u32, Stamp, Vec<u8>);

pub(crate) const TOPICS: [(&str, &str); 3] = [("/scan", "LaserScan"), ("/tf", "TFMessage"), ("/odom", "Odometry")];

/// Messages of 20 to 1,500 bytes, hardly compressible, each different.
pub(crate) fn messages(count: usize) -> Vec<Made> {
    let mut random = Random(7);
    (0..count)
        .map(|i| {
            let length = 20 + random.below(1480);
            let mut data: Vec<u8> = (0..length).map(|_| (random.next() >> 58) as u8).collect();
            data[..4].copy_from_slice(&(i as u32).to_be_bytes());
            (random.below(3) as u32, Stamp(1_600_000_000_000_000_000 + i as i64 * 25_000_001), data)
        })
        .collect()
}

pub(crate) fn connection(place: usize, ros1: bool) -> Connection {
    let (topic, name) = TOPICS[place];
    if ros1 {
        Connection::new(topic, format!("some_msgs/{name}"), Encoding::Ros1)
            .with_definition(DefinitionFormat::Ros1Msg, "Header header\nfloat32[] ranges\n")
            .with_metadata("md5sum", format!("{place:032x}"))
    } else {
        Connection::new(topic, format!("some_msgs/msg/{name}"), Encoding::Cdr)
            .with_definition(DefinitionFormat::Ros2Msg, "std_msgs/Header header\nfloat32[] ranges\n")
    }
}

pub(crate) const CHUNK_BYTES: usize = 20_000;

pub(crate) fn bag1(messages: &[Made], compression: Bag1Compression) -> Vec<u8> {
    let mut writer = Bag1Writer::new(Cursor::new(Vec::new()), compression).unwrap().with_chunk_bytes(CHUNK_BYTES);
    for place in 0..TOPICS.len() {
        assert_eq!(writer.add_connection(&connection(place, true)).unwrap(), place as u32);
    }
    for (connection, stamp, data) in messages {
        writer.write(*connection, *stamp, data).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

pub(crate) fn mcap(messages: &[Made], compression: McapCompression) -> Vec<u8> {
    let mut content = Cursor::new(Vec::new());
    let mut writer = McapWriter::with_chunk_bytes(&mut content, compression, CHUNK_BYTES as u64).unwrap();
    let ids: Vec<u32> = (0..TOPICS.len()).map(|p| writer.add_connection(&connection(p, false)).unwrap()).collect();
    for (connection, stamp, data) in messages {
        writer.write(ids[*connection as usize], *stamp, Stamp(stamp.0 - 5), data).unwrap();
    }
    writer.finish().unwrap();
    content.into_inner()
}

/// Straight through the official crate: without chunks, or without summary and checksums.
pub(crate) fn foreign_mcap(messages: &[Made], options: mcap::WriteOptions) -> Vec<u8> {
    let mut content = Cursor::new(Vec::new());
    let mut writer = options.create(&mut content).unwrap();
    let none = std::collections::BTreeMap::new();
    let ids: Vec<u16> = (0..TOPICS.len())
        .map(|place| {
            let c = connection(place, false);
            let schema = writer.add_schema(&c.type_name, "ros2msg", c.definition.unwrap().text.as_bytes()).unwrap();
            writer.add_channel(schema, &c.topic, "cdr", &none).unwrap()
        })
        .collect();
    for (connection, stamp, data) in messages {
        let (channel_id, log_time) = (ids[*connection as usize], stamp.0 as u64);
        let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time, publish_time: log_time };
        writer.write_to_known_channel(&header, data).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    content.into_inner()
}

/// What reading made-up messages should yield.
pub(crate) fn expected(messages: &[Made], ros1: bool) -> Vec<Seen> {
    let of = |(place, stamp, data): &Made| {
        let connection = connection(*place as usize, ros1);
        let (topic, type_name, crc) = (connection.topic, connection.type_name, crc32fast::hash(data));
        Seen { topic, type_name, stamp: stamp.0, length: data.len(), crc }
    };
    messages.iter().map(of).collect()
}

/// A database as rosbag2 writes it; old ones have fewer columns and no index.
#[cfg(feature = "sqlite")]
pub(crate) fn database(path: &Path, messages: &[Made], version: u32) {
    let messages = messages.iter().map(|(connection, stamp, data)| (*connection, *stamp, data));
    database_of(path, messages, version);
}

/// As [`database`], of messages that come one by one.
#[cfg(feature = "sqlite")]
pub(crate) fn database_of<D: rusqlite::ToSql>(
    path: &Path,
    messages: impl IntoIterator<Item = (u32, Stamp, D)>,
    version: u32,
) {
    let _ = std::fs::remove_file(path);
    let mut db = rusqlite::Connection::open(path).unwrap();
    let (columns, values) = match version {
        1 => ("", ""),
        2 => (", offered_qos_profiles TEXT NOT NULL", ", ''"),
        _ => {
            (", offered_qos_profiles TEXT NOT NULL, type_description_hash TEXT NOT NULL", ", '- depth: 1', 'RIHS01_x'")
        }
    };
    db.execute_batch(&format!(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, \
         serialization_format TEXT NOT NULL{columns}); \
         CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, \
         data BLOB NOT NULL);"
    ))
    .unwrap();
    if version > 1 {
        db.execute_batch("CREATE INDEX timestamp_idx ON messages (timestamp ASC);").unwrap();
    }
    if version > 3 {
        db.execute_batch(
            "CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL); \
             INSERT INTO schema VALUES (4, 'rolling'); \
             CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, \
             encoding TEXT NOT NULL, encoded_message_definition TEXT NOT NULL, type_description_hash TEXT NOT NULL);",
        )
        .unwrap();
    }
    let writing = db.transaction().unwrap();
    for place in 0..TOPICS.len() {
        let c = connection(place, false);
        writing
            .execute(
                &format!("INSERT INTO topics VALUES (?1, ?2, ?3, 'cdr'{values})"),
                (place as i64 + 1, &c.topic, &c.type_name),
            )
            .unwrap();
        if version > 3 {
            let text = c.definition.unwrap().text;
            writing
                .execute(
                    "INSERT INTO message_definitions VALUES (NULL, ?1, 'ros2msg', ?2, 'RIHS01_x')",
                    (&c.type_name, &*text),
                )
                .unwrap();
        }
    }
    for (connection, stamp, data) in messages {
        let row = (i64::from(connection) + 1, stamp.0, data);
        writing.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (?1, ?2, ?3)", row).unwrap();
    }
    writing.commit().unwrap();
}

/// An empty folder of its own for each test.
pub(crate) fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// The given bags (`../shared/data/ros_bags` beside the workspace, or below `MAPWRIGHT_DATA`), or a remark that the test
/// is skipped.
pub(crate) fn given(test: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = std::env::var_os("MAPWRIGHT_DATA").map_or_else(beside, PathBuf::from).join("ros_bags");
    if folder.exists() {
        return Some(folder);
    }
    let _ = writeln!(std::io::stderr(), "{test}: skipped: no data ({})", folder.display());
    None
}
