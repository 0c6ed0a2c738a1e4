//! How much memory reading takes: as much for a long recording as for a short one, whole or damaged.
//!
//! One test and a program of its own, for the most memory that a process ever had is measured.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // tests unwrap what they expect and say what they skip

mod common;

use common::Random;
use mapwright_bags::{Bag1Compression, Bag1Writer, McapCompression, McapWriter, Recording};
use mapwright_geom::Stamp;
use std::fs::{self, File, OpenOptions};
use std::io::{BufWriter, Seek as _, SeekFrom, Write as _};
use std::path::Path;

/// Messages of the short recording and of the long one, so small that what is known of a message takes more than its data.
const COUNTS: [usize; 2] = [60_000, 240_000];
/// What reading may take, however long the recording is.
const MOST_BYTES: u64 = 12 << 20;
/// and what the long one may take more than the short one: the places of its chunks.
const MORE_BYTES: u64 = 4 << 20;

type Writing = fn(&Path, usize);

fn messages(count: usize) -> impl Iterator<Item = (u32, Stamp, [u8; 12])> {
    (0..count).map(|i| {
        let mut data = [7; 12];
        data[..4].copy_from_slice(&(i as u32).to_be_bytes());
        (i as u32 % 3, Stamp(1_600_000_000_000_000_000 + i as i64 * 1_000_001), data)
    })
}

fn bag1(path: &Path, count: usize) {
    let file = BufWriter::new(File::create(path).unwrap());
    let mut writer = Bag1Writer::new(file, Bag1Compression::Lz4).unwrap().with_chunk_bytes(1 << 18);
    (0..3).for_each(|place| assert!(writer.add_connection(&common::connection(place, true)).is_ok()));
    messages(count).for_each(|(connection, stamp, data)| writer.write(connection, stamp, &data).unwrap());
    writer.finish().unwrap().into_inner().unwrap();
}

fn mcap(path: &Path, count: usize) {
    let file = BufWriter::new(File::create(path).unwrap());
    let mut writer = McapWriter::with_chunk_bytes(file, McapCompression::Zstd, 1 << 18).unwrap();
    let ids = [0, 1, 2].map(|place| writer.add_connection(&common::connection(place, false)).unwrap());
    messages(count).for_each(|(place, stamp, data)| writer.write(ids[place as usize], stamp, stamp, &data).unwrap());
    writer.finish().unwrap();
}

/// Without chunks each message is a record of the file.
fn unchunked_mcap(path: &Path, count: usize) {
    let options = mcap::WriteOptions::new().compression(None).use_chunks(false);
    let mut writer = options.create(BufWriter::new(File::create(path).unwrap())).unwrap();
    let channel = writer.add_channel(0, "/scan", "cdr", &std::collections::BTreeMap::new()).unwrap();
    for (sequence, (_, stamp, data)) in (0..).zip(messages(count)) {
        let log_time = stamp.0 as u64;
        let header = mcap::records::MessageHeader { channel_id: channel, sequence, log_time, publish_time: log_time };
        writer.write_to_known_channel(&header, &data).unwrap();
    }
    writer.finish().unwrap();
}

#[cfg(feature = "sqlite")]
fn database(path: &Path, count: usize) {
    common::database_of(path, messages(count), 4);
}

/// An old one has no index on timestamps.
#[cfg(feature = "sqlite")]
fn old_database(path: &Path, count: usize) {
    common::database_of(path, messages(count), 1);
}

fn cut(path: &Path) {
    let file = OpenOptions::new().write(true).open(path).unwrap();
    file.set_len(file.metadata().unwrap().len() / 4 * 3).unwrap();
}

/// A byte in every million is another, but for those at the beginning.
fn flip(path: &Path) {
    let mut file = OpenOptions::new().write(true).open(path).unwrap();
    let mut random = Random(3);
    let end = file.metadata().unwrap().len() - 1_000_000;
    for begin in (1 << 17..end).step_by(1_000_000) {
        file.seek(SeekFrom::Start(begin + random.below(900_000) as u64)).unwrap();
        file.write_all(&[random.next() as u8]).unwrap();
    }
}

fn leave(_: &Path) {}

/// Bytes of memory, by a line of what the system says of this process.
fn memory(line: &str) -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|found| found.strip_prefix(line))?;
    Some(line.split_whitespace().next()?.parse::<u64>().ok()? << 10)
}

/// Messages that were read, and the most memory this process had meanwhile; none where the system does not say.
fn reading(path: &Path) -> (usize, Option<u64>) {
    let is_reset = fs::write("/proc/self/clear_refs", "5").is_ok();
    let mut recording = Recording::open(path).unwrap();
    let mut count = 0;
    while recording.next_message().unwrap().is_some() {
        count += 1;
    }
    (count, memory("VmHWM:").filter(|_| is_reset))
}

#[test]
fn reading_takes_no_more_memory_for_a_longer_recording() {
    let (folder, before) = (common::folder("memory"), memory("VmRSS:"));
    let mut containers: Vec<(&str, Writing)> =
        vec![("lz4.bag", bag1), ("zstd.mcap", mcap), ("unchunked.mcap", unchunked_mcap)];
    #[cfg(feature = "sqlite")]
    containers.extend([("indexed.db3", database as Writing), ("old.db3", old_database)]);
    for (name, write) in containers {
        for (harmed, harm) in [("whole", leave as fn(&Path)), ("cut", cut), ("flipped", flip)] {
            let [short, long] = COUNTS.map(|count| {
                let path = folder.join(name);
                write(&path, count);
                harm(&path);
                let (seen, bytes) = reading(&path);
                println!(
                    "{name} {harmed}: {seen} of {count} messages, {} bytes: {bytes:?}",
                    path.metadata().unwrap().len()
                );
                assert!(if harmed == "whole" { seen == count } else { seen > count / 2 }, "{name} {harmed}: {seen}");
                bytes
            });
            let Some(((short, long), before)) = short.zip(long).zip(before) else {
                println!("{name} {harmed}: the system does not say how much memory was taken");
                continue;
            };
            assert!(long < before + MOST_BYTES, "{name} {harmed}: {long} bytes, {before} at the beginning");
            assert!(long < short + MORE_BYTES, "{name} {harmed}: {short} bytes, {long} for the longer one");
        }
    }
}
