//! A ROS 1 bag or MCAP file of clouds out of a folder of them, float32 `x y z intensity` as KITTI has them, not compressed:
//! `cargo run --release -p mapwright-logs --example clouds_bag FOLDER TIMES OUT.bag`
#![allow(clippy::print_stdout, clippy::unwrap_used)]

use mapwright_bags::{
    Bag1Compression, Bag1Writer, Connection, DefinitionFormat, Encoding, McapCompression, McapWriter,
};
use mapwright_geom::Stamp;
use mapwright_ros::messages::{Header, PointCloud2, PointField};
use mapwright_ros::{Encoding as Layout, builtin, encode};
use std::fs::{File, read, read_to_string};
use std::path::Path;

/// `1630577758.569490`, exact.
fn stamp(text: &str) -> Stamp {
    let (whole, fraction) = text.trim().split_once('.').unwrap_or((text.trim(), "0"));
    Stamp(whole.parse::<i64>().unwrap() * 1_000_000_000 + format!("{fraction:0<9}")[..9].parse::<i64>().unwrap())
}

fn cloud(stamp: Stamp, data: &[u8]) -> PointCloud2<'_> {
    let field = |name: &'static str, offset| PointField { name: name.into(), offset, datatype: 7, count: 1 };
    PointCloud2 {
        header: Header::new(stamp, "os_sensor"),
        height: 1,
        width: (data.len() / 16) as u32,
        fields: vec![field("x", 0), field("y", 4), field("z", 8), field("intensity", 12)],
        point_step: 16,
        row_step: data.len() as u32,
        data,
        ..Default::default()
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, times, out] = &arguments[..] else { return println!("FOLDER TIMES OUT.bag") };
    let times = read_to_string(times).unwrap();
    let clouds = times.lines().enumerate().map(|(number, line)| {
        let file = Path::new(folder).join(format!("{number:06}.bin"));
        (stamp(line), read(file).unwrap())
    });
    let file = File::create(out).unwrap();
    let mut count = 0;
    if out.ends_with(".mcap") {
        let mut writer = McapWriter::new(file, McapCompression::Zstd).unwrap();
        let connection = Connection::new("/points", "sensor_msgs/msg/PointCloud2", Encoding::Cdr);
        let id = writer.add_connection(&connection).unwrap();
        for (stamp, data) in clouds {
            writer.write(id, stamp, stamp, &encode(&cloud(stamp, &data), Layout::Cdr).unwrap()).unwrap();
            count += 1;
        }
        writer.finish().unwrap();
    } else {
        let mut writer = Bag1Writer::new(file, Bag1Compression::Lz4).unwrap();
        let definition = builtin::text("sensor_msgs/PointCloud2", Layout::Ros1).unwrap();
        let connection = Connection::new("/points", "sensor_msgs/PointCloud2", Encoding::Ros1);
        let md5sum = builtin::definition("sensor_msgs/PointCloud2", Layout::Ros1).unwrap().md5sum().unwrap();
        let connection =
            connection.with_metadata("md5sum", md5sum).with_definition(DefinitionFormat::Ros1Msg, &definition);
        let id = writer.add_connection(&connection).unwrap();
        for (stamp, data) in clouds {
            writer.write(id, stamp, &encode(&cloud(stamp, &data), Layout::Ros1).unwrap()).unwrap();
            count += 1;
        }
        writer.finish().unwrap();
    }
    println!("{out}: {count} clouds");
}
