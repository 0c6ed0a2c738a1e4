//! Recordings by path: split, compressed as a whole or message by message, with `metadata.yaml` or without.
#![cfg(feature = "sqlite")]
#![allow(clippy::unwrap_used, clippy::print_stdout)] // tests unwrap what they expect and say what they skip

mod common;

use common::{Made, database, expected, folder, messages, read_path};
use mapwright_bags::{BagError, Container, DamageKind, Encoding, McapCompression, Recording};
use std::path::Path;

fn metadata(folder: &Path, files: &[&str]) {
    let text = format!(
        "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n  unheard_of: {{a: [1, 2]}}\n  \
         relative_file_paths:\n{}",
        files.iter().map(|file| format!("    - {file}\n")).collect::<String>()
    );
    std::fs::write(folder.join("metadata.yaml"), text).unwrap();
}

#[test]
fn databases_of_all_versions_come_back_in_the_order_of_their_stamps() {
    let folder = folder("versions");
    let mut made = messages(700);
    for version in [1, 2, 3, 4] {
        let path = folder.join(format!("version_{version}.db3"));
        database(&path, &made, version);
        let (seen, report, connections) = read_path(&path).unwrap();
        assert_eq!(seen, expected(&made, false), "{version}");
        assert!(report.damages.is_empty() && report.container == Some(Container::Sqlite), "{:?}", report.damages);
        assert!(connections.iter().all(|c| c.encoding == Encoding::Cdr));
        assert!(connections.iter().all(|c| c.definition.is_some() == (version == 4)));
        assert!(connections.iter().all(|c| c.metadata.contains_key("offered_qos_profiles") == (version > 2)));
    }
    // as it is played, whatever came first into the file; among equal stamps by row
    made.reverse();
    made.iter_mut().for_each(|(_, stamp, _)| stamp.0 /= 200_000_000);
    for version in [1, 4] {
        let path = folder.join(format!("reversed_{version}.db3"));
        database(&path, &made, version);
        let mut sorted = expected(&made, false);
        sorted.sort_by_key(|seen| seen.stamp);
        assert_eq!(read_path(&path).unwrap().0, sorted, "{version}");
    }
}

#[test]
fn parts_follow_each_other_by_metadata_or_by_name() {
    let (folder, made) = (folder("split"), messages(300));
    for (place, part) in made.chunks(30).enumerate() {
        database(&folder.join(format!("drive_{place}.db3")), part, 4);
    }
    let extra = [messages(301)[300].clone()];
    database(&folder.join("drive_10.db3"), &extra, 4);
    let all: Vec<Made> = made.iter().chain(&extra).cloned().collect();
    let (seen, report, connections) = read_path(&folder).unwrap();
    assert_eq!((seen, report.parts.len(), connections.len()), (expected(&all, false), 11, 3));
    // rosbag2's order, and one that is missing
    metadata(&folder, &["split/drive_3.db3", "drive_1.db3", "gone.db3"]);
    let (seen, report, _) = read_path(&folder).unwrap();
    let parts: Vec<Made> = made[90..120].iter().chain(&made[30..60]).cloned().collect();
    assert_eq!(seen, expected(&parts, false));
    assert_eq!(report.damages[&DamageKind::BadPart].count, 1);
    // a broken one is told, and names count
    std::fs::write(folder.join("metadata.yaml"), "rosbag2_bagfile_information: [").unwrap();
    let (seen, report, _) = read_path(&folder).unwrap();
    assert_eq!((seen.len(), report.damages[&DamageKind::BadMetadata].count, report.has_losses()), (301, 1, false));
    // a part that is none costs itself
    std::fs::write(folder.join("drive_4.db3"), "no database").unwrap();
    let (seen, report, _) = read_path(&folder).unwrap();
    assert_eq!((seen.len(), report.damages[&DamageKind::BadPart].first[0].part), (271, 4));
}

#[test]
fn files_and_messages_compressed_by_zstd_come_back() {
    let (folder, made) = (folder("zstd"), messages(200));
    let database_path = folder.join("plain.db3");
    database(&database_path, &made, 3);
    let packed = zstd::bulk::compress(&std::fs::read(&database_path).unwrap(), 1).unwrap();
    std::fs::remove_file(&database_path).unwrap();
    std::fs::write(folder.join("a_0.db3.zstd"), &packed).unwrap();
    metadata(&folder, &["a_0.db3"]);
    assert_eq!(read_path(&folder).unwrap().0, expected(&made, false));
    assert_eq!(read_path(&folder.join("a_0.db3.zstd")).unwrap().0, expected(&made, false));
    // cut: what is there is used
    std::fs::write(folder.join("a_0.db3.zstd"), &packed[..packed.len() / 2]).unwrap();
    if let Ok((seen, report, _)) = read_path(&folder) {
        assert!(report.has_losses() && seen.len() < 200);
    }
    let pack = |(topic, stamp, data): &Made| (*topic, *stamp, zstd::bulk::compress(data, 1).unwrap());
    let mut messages: Vec<Made> = made.iter().map(pack).collect();
    database(&folder.join("by_message.db3"), &messages, 4);
    assert_eq!(read_path(&folder.join("by_message.db3")).unwrap().0, expected(&made, false));
    std::fs::write(folder.join("by_message.mcap"), common::mcap(&messages, McapCompression::None)).unwrap();
    assert_eq!(read_path(&folder.join("by_message.mcap")).unwrap().0, expected(&made, false));
    // one that does not unpack is left out
    messages[7].2.truncate(12);
    database(&folder.join("by_message.db3"), &messages, 4);
    let (seen, report, _) = read_path(&folder.join("by_message.db3")).unwrap();
    assert_eq!((seen.len(), report.damages[&DamageKind::BadMessage].count), (199, 1));
}

#[test]
fn bombs_are_refused() {
    let folder = folder("bombs");
    let path = folder.join("bomb.db3");
    std::fs::write(&path, zstd::bulk::compress(&vec![0; 300 << 20], 1).unwrap()).unwrap();
    assert!(matches!(Recording::open(&path), Err(BagError::Bomb { .. })));
    let mut made = messages(3);
    made[1].2 = zstd::bulk::compress(&vec![0; 300 << 20], 1).unwrap();
    database(&path, &made, 4);
    let (seen, report, _) = read_path(&path).unwrap();
    assert_eq!((seen.len(), report.damages[&DamageKind::TooLarge].count), (2, 1));
}

#[test]
fn what_is_no_recording_is_refused_with_what_is_there() {
    let folder = folder("foreign");
    assert!(matches!(Recording::open(&folder), Err(BagError::EmptyFolder { .. })));
    std::fs::write(folder.join("notes.txt"), "hello").unwrap();
    assert!(Recording::open(&folder).unwrap_err().to_string().contains("found notes.txt"));
    assert!(matches!(Recording::open(&folder.join("gone.bag")), Err(BagError::Path { .. })));
    assert!(matches!(Recording::open(&folder.join("notes.txt")), Err(BagError::UnknownContainer { .. })));
    let path = folder.join("other.db3");
    rusqlite::Connection::open(&path).unwrap().execute_batch("CREATE TABLE a(b); CREATE TABLE topics(id)").unwrap();
    assert!(Recording::open(&path).unwrap_err().to_string().contains("no table `messages`"));
}

#[test]
fn a_database_whose_index_is_damaged_goes_on_by_rows() {
    let (folder, made) = (folder("index"), messages(600));
    let path = folder.join("a.db3");
    database(&path, &made, 2);
    let root: i64 = rusqlite::Connection::open(&path)
        .unwrap()
        .query_row("SELECT rootpage FROM sqlite_master WHERE name = 'timestamp_idx'", [], |row| row.get(0))
        .unwrap();
    let mut content = std::fs::read(&path).unwrap();
    let at = (root as usize - 1) * 4096;
    content[at..at + 2000].fill(0xA5);
    std::fs::write(&path, &content).unwrap();
    let (seen, report, _) = read_path(&path).unwrap();
    assert_eq!(seen, expected(&made, false));
    assert!(report.damages.contains_key(&DamageKind::Database));
}
