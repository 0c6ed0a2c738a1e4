//! What is written as MCAP, as the official crate reads it.
#![allow(clippy::unwrap_used)] // tests unwrap what they expect

mod common;

use common::messages;
use mapwright_bags::{McapCompression, McapWriter};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

/// The official reader's kinds of records, with all checksums compared.
fn kinds(content: &[u8]) -> Vec<u8> {
    let options = LinearReaderOptions::default()
        .with_emit_chunks(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true);
    let (mut reader, mut rest, mut kinds) = (LinearReader::new_with_options(options), content, Vec::new());
    while let Some(event) = reader.next_event() {
        match event.unwrap() {
            LinearReadEvent::ReadRequest(wanted) => {
                let (now, later) = rest.split_at(wanted.min(rest.len()));
                reader.insert(now.len()).copy_from_slice(now);
                reader.notify_read(now.len());
                rest = later;
            }
            LinearReadEvent::Record { opcode, .. } => kinds.push(opcode),
        }
    }
    kinds
}

#[test]
fn the_official_crate_finds_every_message_by_the_way_and_by_the_index() {
    let made = messages(200);
    for compression in [McapCompression::None, McapCompression::Zstd] {
        let content = common::mcap(&made, compression);
        let found: Vec<_> = mcap::MessageStream::new(&content).unwrap().map(Result::unwrap).collect();
        let as_made = found.iter().map(|found| {
            let place = common::TOPICS.iter().position(|(topic, _)| *topic == found.channel.topic).unwrap();
            (place as u32, mapwright_geom::Stamp(found.log_time as i64), found.data.to_vec())
        });
        assert!(as_made.eq(made.iter().cloned()));
        assert!(found.iter().all(|found| found.publish_time + 5 == found.log_time));
        let scan = &found.iter().find(|found| found.channel.topic == "/scan").unwrap().channel;
        let schema = scan.schema.as_ref().unwrap();
        assert_eq!((&*schema.name, &*schema.encoding), ("some_msgs/msg/LaserScan", "ros2msg"));
        assert!(scan.metadata.contains_key("offered_qos_profiles"));

        let summary = mcap::Summary::read(&content).unwrap().unwrap();
        let mut by_index = Vec::new();
        for chunk in &summary.chunk_indexes {
            for entries in summary.read_message_indexes(&content, chunk).unwrap().values() {
                by_index.extend(entries.iter().map(|entry| summary.seek_message(&content, chunk, entry).unwrap()));
            }
        }
        by_index.sort_by_key(|message| message.log_time);
        assert!(by_index.iter().map(|message| &message.data).eq(found.iter().map(|message| &message.data)));
    }
}

#[test]
fn the_summary_is_that_of_the_official_writer() {
    let made = messages(200);
    let options = mcap::WriteOptions::new().compression(None).chunk_size(Some(common::CHUNK_BYTES as u64));
    let (ours, theirs) = (common::mcap(&made, McapCompression::None), common::foreign_mcap(&made, options));
    let summary = |content| mcap::Summary::read(content).unwrap().unwrap();
    assert_eq!(summary(&ours).stats, summary(&theirs).stats);
    let mut kinds = [kinds(&ours), kinds(&theirs)];
    kinds.iter_mut().for_each(|kinds| kinds.sort_unstable());
    assert_eq!(kinds[0], kinds[1]);
}

#[test]
fn a_file_without_messages_is_whole() {
    let mut writer = McapWriter::new(Vec::new(), McapCompression::Zstd).unwrap();
    let id = writer.add_connection(&common::connection(0, false)).unwrap();
    assert_eq!(writer.add_connection(&common::connection(0, false)).unwrap(), id);
    for (id, stamp) in [(id, -1), (id + 1, 0), (0, 0)] {
        assert!(writer.write(id, mapwright_geom::Stamp(stamp), mapwright_geom::Stamp(0), b"").is_err());
    }
    let content = writer.finish().unwrap();
    let summary = mcap::Summary::read(&content).unwrap().unwrap();
    assert_eq!((summary.channels.len(), summary.schemas.len()), (1, 1));
    assert_eq!(mcap::MessageStream::new(&content).unwrap().count(), 0);
    assert!(!kinds(&content).is_empty());
}
