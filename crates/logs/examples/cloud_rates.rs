//! How fast MCAP files of point clouds are read and decoded, beside the official crate's bare iteration over messages, on
//! one thread and in memory: `cargo run --release -p mapwright-logs --example cloud_rates [clouds]`
#![allow(clippy::print_stdout, clippy::unwrap_used)]

use mapwright_bags::{Connection, Encoding, McapCompression, McapReader, McapWriter};
use mapwright_geom::Stamp;
use mapwright_ros::messages::{Header, PointCloud2, PointField};
use mapwright_ros::{Channel, Cloud, Decoder, Encoding as Layout, encode};
use std::io::Cursor;
use std::time::Instant;

const POINTS: u32 = 65_536;
const RUNS: usize = 5;
const TYPE: &str = "sensor_msgs/msg/PointCloud2";

/// Clouds of 1 MiB: x, y, z and intensity as floats, with the noise that a lidar has.
fn clouds(count: usize, compression: McapCompression) -> Vec<u8> {
    let mut content = Cursor::new(Vec::new());
    let mut writer = McapWriter::new(&mut content, compression).unwrap();
    let id = writer.add_connection(&Connection::new("/points", TYPE, Encoding::Cdr)).unwrap();
    let mut state = 1_u32;
    let field = |name: &'static str, offset| PointField { name: name.into(), offset, datatype: 7, count: 1 };
    for cloud in 0..count {
        let mut data = Vec::new();
        for point in 0..POINTS {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let range = 5.0 + (point % 1024) as f32 / 100.0 + (state >> 20) as f32 / 1e5;
            let angle = point as f32 * 1e-3;
            let point = [range * angle.cos(), range * angle.sin(), (point / 1024) as f32 / 10.0, (state >> 26) as f32];
            point.iter().for_each(|value| data.extend_from_slice(&value.to_le_bytes()));
        }
        let stamp = Stamp(1 + cloud as i64 * 100_000_000);
        let message = PointCloud2 {
            header: Header::new(stamp, "lidar"),
            height: 64,
            width: POINTS / 64,
            fields: vec![field("x", 0), field("y", 4), field("z", 8), field("intensity", 12)],
            point_step: 16,
            row_step: POINTS / 4,
            data: &data,
            ..Default::default()
        };
        writer.write(id, stamp, stamp, &encode(&message, Layout::Cdr).unwrap()).unwrap();
    }
    writer.finish().unwrap();
    content.into_inner()
}

/// The best of several runs, bytes of messages per second.
fn rate(mut read: impl FnMut() -> usize) -> f64 {
    let run = |_| {
        let start = Instant::now();
        read() as f64 / start.elapsed().as_secs_f64()
    };
    (0..RUNS).map(run).fold(0.0, f64::max)
}

/// Read and decoded, every point's place looked at.
fn ours(content: &[u8]) -> usize {
    let mut reader = McapReader::open(Cursor::new(content)).unwrap();
    let mut decoder = Decoder::<PointCloud2<'_>>::new(&Channel::new(TYPE, Layout::Cdr, None).unwrap()).unwrap();
    let (mut bytes, mut sum) = (0, [0.0; 3]);
    while let Some(message) = reader.next_message().unwrap() {
        let cloud = decoder.decode(message.data).unwrap();
        Cloud::new(&cloud).unwrap().for_each_position(|place| (0..3).for_each(|axis| sum[axis] += place[axis]));
        bytes += message.data.len();
    }
    std::hint::black_box(sum);
    bytes
}

fn official(content: &[u8]) -> usize {
    mcap::io::MessageReader::new(Cursor::new(content)).map(|message| message.unwrap().data.len()).sum()
}

fn official_slice(content: &[u8]) -> usize {
    mcap::MessageStream::new(content).unwrap().map(|message| message.unwrap().data.len()).sum()
}

fn main() {
    let count = std::env::args().nth(1).and_then(|count| count.parse().ok()).unwrap_or(200);
    for (name, compression) in [("none", McapCompression::None), ("zstd", McapCompression::Zstd)] {
        let content = clouds(count, compression);
        let rates = [rate(|| ours(&content)), rate(|| official(&content)), rate(|| official_slice(&content))];
        let [ours, stream, slice] = rates.map(|rate| rate / 1e6);
        println!(
            "{name}: {count} clouds, {} MB: {ours:.0} MB/s decoded; official crate, not decoded: {stream:.0} MB/s from a \
             stream ({:.2} times), {slice:.0} MB/s from a slice ({:.2} times)",
            content.len() / 1_000_000,
            ours / stream,
            ours / slice
        );
    }
}
