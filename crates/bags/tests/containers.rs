//! What recordings look like in the field: without index, in parts, compressed in every way, irregular.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // tests unwrap what they expect and say what they skip

mod common;

use common::{CHUNK_BYTES, expected, messages, read};
use mapwright_bags::{
    Bag1Compression, Bag1Reader, BagError, BagReader, DamageKind, Definition, DefinitionFormat, Encoding,
    McapCompression, McapReader, Place,
};
use std::io::Cursor;

fn seen_of(content: &[u8]) -> Vec<common::Seen> {
    read(content).unwrap().0.into_iter().map(|(seen, _)| seen).collect()
}

fn lz4(content: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
    encoder.write_all(content).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn ros_1_bags_come_back_with_every_compression_and_without_an_index() {
    let made = messages(200);
    for compression in [Bag1Compression::None, Bag1Compression::Lz4, Bag1Compression::Bz2] {
        let mut bag = common::bag1(&made, compression);
        let reader = Bag1Reader::open(Cursor::new(&bag)).unwrap();
        assert_eq!(reader.connections().len(), 3, "the index names them before the first message");
        let connection = &reader.connections()[0];
        assert_eq!((connection.id, &*connection.topic, &connection.encoding), (0, "/scan", &Encoding::Ros1));
        assert!(!connection.latching() && connection.metadata["md5sum"].len() == 32);
        let Definition { format, text } = connection.definition.clone().unwrap();
        assert_eq!((format, &*text), (DefinitionFormat::Ros1Msg, "Header header\nfloat32[] ranges\n"));
        assert_eq!(seen_of(&bag), expected(&made, true));
        // as `rosbag record` leaves it when it is killed
        let index_pos = bag.windows(10).position(|bytes| bytes == b"index_pos=").unwrap() + 10;
        let index_at = u64::from_le_bytes(bag[index_pos..index_pos + 8].try_into().unwrap()) as usize;
        bag[index_pos..index_pos + 8].fill(0);
        bag.truncate(index_at);
        let (seen, report, _) = read(&bag).unwrap();
        assert!(seen.iter().map(|(seen, _)| seen).eq(&expected(&made, true)));
        assert_eq!((report.indexed, report.damages.len()), (Some(false), 0));
        assert_eq!(report.connections.iter().map(|c| c.messages).sum::<u64>(), 200);
        assert!(report.connections.iter().all(|c| c.earliest < c.latest));
    }
}

#[test]
fn index_records_of_a_wrong_length_are_passed_by_their_count() {
    let made = messages(200);
    let mut bag = common::bag1(&made, Bag1Compression::None);
    let mut at = 0;
    let mut changed = 0;
    while let Some(found) = bag[at..].windows(6).position(|bytes| bytes == b"count=") {
        at += found + 6;
        let count = u32::from_le_bytes(bag[at..at + 4].try_into().unwrap());
        let length = u32::from_le_bytes(bag[at + 4..at + 8].try_into().unwrap());
        if length == count * 12 {
            bag[at + 4..at + 8].copy_from_slice(&(count * 20).to_le_bytes());
            changed += 1;
        }
    }
    let (seen, report, _) = read(&bag).unwrap();
    assert!(seen.iter().map(|(seen, _)| seen).eq(&expected(&made, true)));
    assert_eq!(report.damages[&DamageKind::Irregular].count, changed);
    assert!(!report.has_losses() && report.damages[&DamageKind::Irregular].first.len() <= 20);
}

#[test]
fn a_connection_that_only_the_index_describes_is_found() {
    let made = messages(200);
    let mut bag = common::bag1(&made, Bag1Compression::None);
    let at = bag.windows(10).position(|bytes| bytes == b"type=some_").unwrap();
    bag[at..at + 4].copy_from_slice(b"tope"); // within the first chunk
    let (seen, report, _) = read(&bag).unwrap();
    assert!(seen.iter().map(|(seen, _)| seen).eq(&expected(&made, true)));
    assert_eq!(report.damages[&DamageKind::BadRecord].count, 1);
}

#[test]
fn mcap_files_come_back_chunked_or_not_and_without_a_summary() {
    let made = messages(200);
    let options = || mcap::WriteOptions::new().compression(None);
    let files = [
        common::mcap(&made, McapCompression::None),
        common::mcap(&made, McapCompression::Zstd),
        common::foreign_mcap(&made, options().use_chunks(false)),
        common::foreign_mcap(&made, options().emit_summary_records(false)),
        common::foreign_mcap(&made, options().calculate_chunk_crcs(false).chunk_size(Some(CHUNK_BYTES as u64))),
    ];
    for (place, file) in files.iter().enumerate() {
        let (seen, report, _) = read(file).unwrap();
        assert!(seen.iter().map(|(seen, _)| seen).eq(&expected(&made, false)), "{place}");
        assert!(report.damages.is_empty(), "{place}: {:?}", report.damages);
        assert_eq!(report.indexed, Some(place != 3), "{place}");
    }
    let mut reader = McapReader::open(Cursor::new(&files[0])).unwrap();
    let first = reader.next_message().unwrap().unwrap();
    assert_eq!(first.publish_stamp.unwrap().0, first.log_stamp.0 - 5);
    assert_eq!(first.data, made[0].2);
}

/// A record of MCAP.
fn record(op: u8, body: &[u8]) -> Vec<u8> {
    [&[op][..], &(body.len() as u64).to_le_bytes(), body].concat()
}

/// The chunks of a file whose chunks are not compressed, compressed anew, and no summary.
fn with_chunks(file: &[u8], name: &str, compress: impl Fn(&[u8]) -> (u64, Vec<u8>)) -> Vec<u8> {
    let (mut at, mut out) = (8, file[..8].to_vec());
    while at + 9 <= file.len() - 8 {
        let length = u64::from_le_bytes(file[at + 1..at + 9].try_into().unwrap()) as usize;
        let body = &file[at + 9..at + 9 + length];
        if file[at] == 6 {
            let (size, stored) = compress(&body[40..]);
            let mut chunk = [&body[..16], &size.to_le_bytes(), &body[24..28]].concat();
            chunk.extend_from_slice(&(name.len() as u32).to_le_bytes());
            chunk.extend_from_slice(name.as_bytes());
            chunk.extend_from_slice(&(stored.len() as u64).to_le_bytes());
            chunk.extend_from_slice(&stored);
            out.extend(record(6, &chunk));
        } else if file[at] == 15 {
            break;
        } else {
            out.extend(record(file[at], body));
        }
        at += 9 + length;
    }
    out.extend(record(15, &[0; 4]));
    out.extend(record(2, &[0; 20]));
    [&out, &file[..8]].concat()
}

#[test]
fn mcap_chunks_of_lz4_are_read_unknown_ones_and_bombs_passed_over() {
    let made = messages(200);
    let plain = common::mcap(&made, McapCompression::None);
    let file = with_chunks(&plain, "lz4", |records| (records.len() as u64, lz4(records)));
    assert_eq!(seen_of(&file), expected(&made, false));
    let file = with_chunks(&plain, "rar", |records| (records.len() as u64, records.to_vec()));
    let (seen, report, _) = read(&file).unwrap();
    assert!(seen.is_empty() && report.damages[&DamageKind::UnknownCompression].count > 3);
    let bomb = zstd::bulk::compress(&vec![0; 200 << 20], 1).unwrap();
    let file = with_chunks(&plain, "zstd", |_| (200 << 20, bomb.clone()));
    let (seen, report, held) = read(&file).unwrap();
    assert!(seen.is_empty() && report.damages[&DamageKind::TooLarge].count > 3);
    assert!(held <= file.len() + (1 << 17), "{held}");
    let file = with_chunks(&plain, "zstd", |_| (u64::MAX, bomb.clone()));
    assert!(read(&file).unwrap().1.has_losses());
}

#[test]
fn foreign_bytes_are_refused_with_what_was_found() {
    let open = |bytes: &[u8]| BagReader::open(Cursor::new(bytes.to_vec())).unwrap_err();
    for bytes in [&b""[..], b"hello", b"ODOM 1 2 3 4", &[0; 100]] {
        assert!(matches!(open(bytes), BagError::UnknownContainer { .. }));
    }
    assert!(matches!(open(b"#ROSBAG V1.2\n"), BagError::Version { .. }));
    assert!(matches!(open(b"\x89MCAP1\r\n"), BagError::Version { .. }));
    assert!(matches!(open(b"SQLite format 3\0..."), BagError::NeedsPath));
    assert!(open(b"hello").to_string().contains("found \"hello\""));
}

#[test]
fn a_bag_that_lacks_what_it_needs_is_not_written() {
    use mapwright_bags::{Bag1Writer, Connection};
    let mut writer = Bag1Writer::new(Cursor::new(Vec::new()), Bag1Compression::None).unwrap();
    let no_md5sum = Connection::new("/a", "b/C", Encoding::Ros1);
    assert!(matches!(writer.add_connection(&no_md5sum), Err(BagError::NotRepresentable { .. })));
    let id = writer.add_connection(&common::connection(0, true)).unwrap();
    for (id, stamp) in [(id, -1), (id, i64::MAX), (id + 1, 0)] {
        assert!(writer.write(id, mapwright_geom::Stamp(stamp), b"").is_err());
    }
    let empty = writer.finish().unwrap().into_inner();
    let (seen, report, _) = read(&empty).unwrap();
    assert!(seen.is_empty() && report.damages.is_empty());
}

#[test]
fn a_harmed_length_in_an_mcap_file_without_chunks_costs_its_message() {
    let made = common::messages(60);
    let whole = common::foreign_mcap(&made, mcap::WriteOptions::new().compression(None).use_chunks(false));
    let (messages, ..) = common::read(&whole).unwrap();
    for (harmed, offset) in [(7, 1), (20, 3), (58, 4)] {
        let at = messages[harmed].1 as usize;
        // A length within the file that leads into a message, one beyond its end, one beyond all sense.
        let mut content = whole.clone();
        content[at + offset] ^= 0x55;
        let (seen, report, _) = common::read(&content).unwrap();
        let all_but_one = (0..60).filter(|&k| k != harmed).map(|k| messages[k].0.clone());
        assert!(seen.iter().map(|(seen, _)| seen.clone()).eq(all_but_one), "{harmed}: {} of 60", seen.len());
        let damages = &report.damages[&DamageKind::BadRecord];
        assert_eq!((damages.count, damages.first[0].place), (1, Place::Byte(at as u64)));
    }
}
