//! A ROS 1 bag or MCAP file out of any folder of clouds or images of depth that is read here, for tests of what is mapped in
//! space: `cargo run --release -p mapwright-logs --example clouds_bag FOLDER OUT.bag`
#![allow(clippy::print_stdout, clippy::unwrap_used)]

use mapwright_bags::{
    Bag1Compression, Bag1Writer, Connection, DefinitionFormat, Encoding, McapCompression, McapWriter,
};
use mapwright_clouds::{CameraOptions, Folder, recognise};
use mapwright_geom::Stamp;
use mapwright_ros::messages::{CameraInfo, Header, Image, PointCloud2, PointField};
use mapwright_ros::{Encoding as Layout, Field, Fixed, builtin, encode};
use mapwright_sensor::{Cloud, DepthImage};
use std::fs::{File, read, read_dir};
use std::path::{Path, PathBuf};

struct Disk(PathBuf);

impl Folder for Disk {
    fn names(&self) -> Vec<String> {
        let (mut names, mut folders) = (Vec::new(), vec![self.0.clone()]);
        while let Some(folder) = folders.pop() {
            for path in read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
                if path.is_dir() {
                    folders.push(path);
                } else {
                    names.push(path.strip_prefix(&self.0).unwrap().display().to_string());
                }
            }
        }
        names
    }

    fn read(&self, name: &str) -> std::io::Result<Vec<u8>> {
        read(self.0.join(name))
    }
}

/// A file being written; topics are added when they are first used.
enum Writer {
    Bag(Box<Bag1Writer<File>>),
    Mcap(Box<McapWriter<File>>),
}

struct Recorder {
    writer: Writer,
    topics: Vec<(&'static str, u32)>,
}

impl Recorder {
    fn write<'a>(&mut self, topic: &'static str, kind: &str, stamp: Stamp, message: &impl Field<'a>) {
        let known = self.topics.iter().find(|(name, _)| *name == topic).map(|(_, id)| *id);
        let id = known.unwrap_or_else(|| {
            let id = self.add(topic, kind);
            self.topics.push((topic, id));
            id
        });
        match &mut self.writer {
            Writer::Bag(writer) => writer.write(id, stamp, &encode(message, Layout::Ros1).unwrap()).unwrap(),
            Writer::Mcap(writer) => writer.write(id, stamp, stamp, &encode(message, Layout::Cdr).unwrap()).unwrap(),
        }
    }

    fn add(&mut self, topic: &str, kind: &str) -> u32 {
        match &mut self.writer {
            Writer::Bag(writer) => {
                let definition = builtin::text(kind, Layout::Ros1).unwrap();
                let md5sum = builtin::definition(kind, Layout::Ros1).unwrap().md5sum().unwrap();
                let connection = Connection::new(topic, kind, Encoding::Ros1).with_metadata("md5sum", md5sum);
                let connection = connection.with_definition(DefinitionFormat::Ros1Msg, &definition);
                writer.add_connection(&connection).unwrap()
            }
            Writer::Mcap(writer) => {
                let kind = kind.replace('/', "/msg/");
                writer.add_connection(&Connection::new(topic, kind, Encoding::Cdr)).unwrap()
            }
        }
    }

    fn cloud(&mut self, cloud: &Cloud) {
        let data: Vec<u8> = cloud.points_m.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        let field = |name: &'static str, offset| PointField { name: name.into(), offset, datatype: 7, count: 1 };
        let message = PointCloud2 {
            header: Header::new(cloud.stamp, "lidar"),
            height: 1,
            width: cloud.points_m.len() as u32,
            fields: vec![field("x", 0), field("y", 4), field("z", 8)],
            point_step: 12,
            row_step: data.len() as u32,
            data: &data,
            ..Default::default()
        };
        self.write("/points", "sensor_msgs/PointCloud2", cloud.stamp, &message);
    }

    fn image(&mut self, image: &DepthImage) {
        let (camera, mut k) = (&image.camera, [0.0; 9]);
        [k[0], k[2], k[4], k[5], k[8]] =
            [camera.focal_px[0], camera.centre_px[0], camera.focal_px[1], camera.centre_px[1], 1.0];
        let header = Header::new(image.stamp, "camera_depth_optical_frame");
        let (width, height) = (camera.width, camera.height);
        let info = CameraInfo {
            header: header.clone(),
            width,
            height,
            distortion_model: "plumb_bob".into(),
            d: camera.distortion[..].into(),
            k: Fixed(k),
            ..Default::default()
        };
        self.write("/camera/depth/camera_info", "sensor_msgs/CameraInfo", image.stamp, &info);
        let data: Vec<u8> = image.depth_m.iter().flat_map(|v| v.to_le_bytes()).collect();
        let encoding = "32FC1".into();
        let message = Image { header, width, height, encoding, step: 4 * width, data: &data, ..Default::default() };
        self.write("/camera/depth/image", "sensor_msgs/Image", image.stamp, &message);
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, out] = &arguments[..] else { return println!("FOLDER OUT.bag") };
    let folder = Disk(Path::new(folder).to_owned());
    let recording = recognise(&folder).unwrap().unwrap();
    let options = CameraOptions::default();
    let mut clouds = recording.clouds(&options).unwrap();
    let file = File::create(out).unwrap();
    let writer = if out.ends_with(".mcap") {
        Writer::Mcap(Box::new(McapWriter::new(file, McapCompression::Zstd).unwrap()))
    } else {
        Writer::Bag(Box::new(Bag1Writer::new(file, Bag1Compression::Lz4).unwrap()))
    };
    let mut recorder = Recorder { writer, topics: Vec::new() };
    let is_depth = recording.camera(&options).unwrap().is_some();
    let mut count = 0;
    while is_depth && let Some(image) = clouds.next_depth_image().unwrap() {
        recorder.image(&image);
        count += 1;
    }
    while !is_depth && let Some(cloud) = clouds.next_cloud().unwrap() {
        recorder.cloud(&cloud);
        count += 1;
    }
    match recorder.writer {
        Writer::Bag(writer) => writer.finish().map(|_| ()).unwrap(),
        Writer::Mcap(writer) => writer.finish().map(|_| ()).unwrap(),
    }
    println!("{out}: {count} clouds of {}", recording.kind());
}
