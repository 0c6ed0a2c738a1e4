//! Recordings of what lidars' drivers publish beside clouds: their own points, packets, Foxglove's schema.
#![allow(clippy::unwrap_used, clippy::panic, clippy::explicit_write, reason = "tests may")]

mod common;

use common::{Recorder, ms};
use mapwright_bags::{Connection, DefinitionFormat, Encoding};
use mapwright_clouds::{CameraOptions, Folder, Notes, recognise};
use mapwright_geom::Stamp;
use mapwright_logs::{Choice, SpaceEvent, SpacePlan, SpaceStream, Survey};
use mapwright_ros::messages::{Header, LivoxPoint, LivoxScan, OusterPacket, Text};
use mapwright_ros::{Encoding as Layout, encode};
use mapwright_sensor::{Cloud, ImuReading};
use std::io::Write;
use std::path::{Path, PathBuf};

fn planned(survey: &Survey) -> Result<SpacePlan, String> {
    SpacePlan::of(survey, &Choice::default(), &CameraOptions::default())
}

fn read_by(path: &Path, survey: Survey) -> (Vec<Cloud>, Vec<ImuReading>, Notes) {
    let plan = planned(&survey).unwrap();
    let mut stream = SpaceStream::open("log", path, survey, plan).unwrap();
    let (mut clouds, mut readings) = (Vec::new(), Vec::new());
    while let Some(event) = stream.next_event().unwrap() {
        match event {
            SpaceEvent::Cloud(cloud) => clouds.push(cloud),
            SpaceEvent::Imu(reading) => readings.push(reading),
            SpaceEvent::Odometry(_) => {}
        }
    }
    (clouds, readings, stream.notes().clone())
}

fn read(path: &Path) -> (Vec<Cloud>, Vec<ImuReading>, Notes) {
    read_by(path, Survey::of(path).unwrap())
}

fn refused(path: &Path) -> String {
    planned(&Survey::of(path).unwrap()).unwrap_err()
}

/// A file of the real data, or a remark that the test is skipped.
fn given(name: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let path = std::env::var_os("MAPWRIGHT_DATA").map_or_else(beside, PathBuf::from).join(name);
    if path.exists() {
        return Some(path);
    }
    let _ = writeln!(std::io::stderr(), "{name}: skipped: no data ({})", path.display());
    None
}

#[test]
fn livox_points_are_clouds_with_times() {
    let mut log = Recorder::new("livox.mcap");
    for k in 0..3_i64 {
        let point =
            |number: u32| LivoxPoint { offset_time: 1_000_000 * number, x: 1.0, tag: 0x10, ..LivoxPoint::default() };
        let scan = LivoxScan {
            header: Header::new(ms(100 * k), "livox_frame"),
            points: (0..100).map(point).collect(),
            ..LivoxScan::default()
        };
        log.write("/livox/lidar", "livox_ros_driver2/msg/CustomMsg", ms(100 * k), &scan);
    }
    let (clouds, _, notes) = read(&log.finish());
    assert_eq!((clouds.len(), notes), (3, Notes::default()));
    assert_eq!((clouds[2].stamp, clouds[2].points_m.len(), clouds[2].points_m[0]), (ms(200), 100, [1.0, 0.0, 0.0]));
    assert!((clouds[2].times_s[99] - 0.099).abs() < 1e-6);
}

/// A VLP-16's packet, whose 12 blocks turn by 0.4 degrees each.
fn velodyne(number: u32, product: u8) -> Vec<u8> {
    let mut payload = Vec::new();
    for block in 0..12 {
        payload.extend([0xff, 0xee]);
        payload.extend((((480 * number + 40 * block) % 36_000) as u16).to_le_bytes());
        (0..32).for_each(|_| payload.extend([0xf4, 1, 9]));
    }
    payload.extend((1327 * number).to_le_bytes());
    payload.extend([0x37, product]);
    payload
}

/// CDR of a header and packets of a fixed size.
fn packets(frame: &str, stamp: Stamp, packets: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = encode(&Header::new(stamp, frame), Layout::Cdr).unwrap();
    let align = |bytes: &mut Vec<u8>| bytes.resize(4 + (bytes.len() - 4).next_multiple_of(4), 0);
    align(&mut bytes);
    bytes.extend((packets.len() as u32).to_le_bytes());
    for (number, packet) in packets.iter().enumerate() {
        align(&mut bytes);
        let ns = stamp.0 + 1_327_000 * number as i64;
        bytes.extend(((ns / 1_000_000_000) as i32).to_le_bytes());
        bytes.extend(((ns % 1_000_000_000) as u32).to_le_bytes());
        bytes.extend(packet);
    }
    bytes
}

fn velodyne_log(name: &str, product: u8) -> PathBuf {
    let mut log = Recorder::new(name);
    for scan in 0..3_u32 {
        let all: Vec<_> = (0..75).map(|k| velodyne(75 * scan + k, product)).collect();
        let at_ms = 100 * i64::from(scan);
        log.raw(
            "/velodyne_packets",
            "velodyne_msgs/msg/VelodyneScan",
            ms(at_ms),
            &packets("velodyne", ms(at_ms), &all),
        );
    }
    log.finish()
}

#[test]
fn velodyne_scans_are_revolutions() {
    let (clouds, _, notes) = read(&velodyne_log("velodyne.mcap", 0x22));
    assert_eq!(clouds.iter().map(|cloud| cloud.points_m.len()).collect::<Vec<_>>(), [28_800; 3]);
    assert_eq!(clouds[0].stamp, ms(0));
    assert!((clouds[1].stamp.secs_since(ms(0)) - 75.0 * 1327e-6).abs() < 1e-9 && !notes.has_losses(), "{notes:?}");
    assert!(
        refused(&velodyne_log("velodyne_128.mcap", 0xa1)).contains("product 0xa1: play it through velodyne_driver")
    );
}

/// A capture in memory.
struct OneFile(Vec<u8>);

impl Folder for OneFile {
    fn names(&self) -> Vec<String> {
        vec!["a.pcap".to_owned()]
    }

    fn read(&self, _: &str) -> std::io::Result<Vec<u8>> {
        Ok(self.0.clone())
    }
}

/// The packets of points in a capture of Ethernet, with their stamps in microseconds.
fn captured(file: &[u8]) -> Vec<(i64, Vec<u8>)> {
    let number = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap()) as usize;
    let (mut at, mut all) = (24, Vec::new());
    while at + 16 <= file.len() {
        let (length, us) = (number(at + 8), 1_000_000 * number(at) as i64 + number(at + 4) as i64);
        let packet = &file[at + 16..at + 16 + length];
        if length == 42 + 1206 {
            all.push((us, packet[42..].to_vec()));
        }
        at += 16 + length;
    }
    all
}

#[test]
fn packets_in_messages_are_the_clouds_of_the_same_packets_in_a_capture() {
    for name in ["sample_velodyne_vlp16_gps.pcap", "sample_velodyne_hdl32.pcap"] {
        let Some(path) = given(&format!("lidar_mrpt/{name}")) else { continue };
        let file = OneFile(std::fs::read(path).unwrap());
        let packets = captured(&file.0);
        let mut log = Recorder::new(&format!("{name}.mcap"));
        for some in packets.chunks(76) {
            let mut bytes = encode(&Header::new(Stamp(1000 * some[0].0), "velodyne"), Layout::Cdr).unwrap();
            let align = |bytes: &mut Vec<u8>| bytes.resize(4 + (bytes.len() - 4).next_multiple_of(4), 0);
            align(&mut bytes);
            bytes.extend((some.len() as u32).to_le_bytes());
            for (us, packet) in some {
                align(&mut bytes);
                bytes.extend(
                    [us / 1_000_000, us % 1_000_000 * 1000].map(|part| part as u32).map(u32::to_le_bytes).concat(),
                );
                bytes.extend(packet);
            }
            log.raw("/velodyne_packets", "velodyne_msgs/msg/VelodyneScan", ms((some[0].0 / 1000) % 1_000_000), &bytes);
        }
        let (of_messages, ..) = read(&log.finish());
        let recording = recognise(&file).unwrap().unwrap();
        let mut clouds = recording.clouds(&CameraOptions::default()).unwrap();
        let of_capture: Vec<_> = std::iter::from_fn(|| clouds.next_cloud().unwrap()).collect();
        assert_eq!(of_messages.len(), of_capture.len());
        for (a, b) in of_messages.iter().zip(&of_capture) {
            assert!((a.stamp, &a.points_m, &a.times_s) == (b.stamp, &b.points_m, &b.times_s), "{name}");
        }
    }
}

#[test]
fn any_bytes_as_packets_end_in_notes() {
    let mut seed = 1_u64;
    let mut random = move || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as u8
    };
    let mut log = Recorder::new("random_packets.mcap");
    let whole: Vec<_> = (0..75).map(|k| velodyne(k, 0x22)).collect();
    for k in 0..40 {
        let mut message = packets("velodyne", ms(100 * k), &whole);
        for _ in 0..if k > 0 { 30 } else { 0 } {
            let at = (usize::from(random()) << 16 | usize::from(random()) << 8 | usize::from(random())) % message.len();
            message[at] = random();
        }
        log.raw("/velodyne_packets", "velodyne_msgs/msg/VelodyneScan", ms(100 * k), &message);
    }
    let (clouds, ..) = read(&log.finish());
    assert!(!clouds.is_empty());
}

fn foxglove_log(name: &str, encoding: &str, format: &str, message: &[u8]) -> PathBuf {
    let mut log = Recorder::new(name);
    let connection = Connection::new("/points", "foxglove.PointCloud", Encoding::Other(encoding.to_owned()));
    let connection = connection.with_definition(DefinitionFormat::Other(format.to_owned()), "{}");
    (0..2).for_each(|k| log.add(&connection, ms(100 * k), message));
    log.finish()
}

#[test]
fn foxglove_clouds_are_read_and_other_encodings_named() {
    let json = br#"{"timestamp":{"sec":1000,"nsec":0},"frame_id":"lidar","point_stride":12,
        "pose":{"position":{"x":0,"y":0,"z":2},"orientation":{"x":0,"y":0,"z":0,"w":1}},
        "fields":[{"name":"x","offset":0,"type":7},{"name":"y","offset":4,"type":7},{"name":"z","offset":8,"type":7}],
        "data":"AACAPwAAAEAAAEBA"}"#;
    let (clouds, ..) = read(&foxglove_log("foxglove.mcap", "json", "jsonschema", json));
    assert_eq!((clouds.len(), clouds[0].points_m[0], clouds[0].stamp), (2, [1.0, 2.0, 5.0], ms(0)));
    let flat = refused(&foxglove_log("flat.mcap", "flatbuffer", "flatbuffer", json));
    assert!(flat.contains("as json or protobuf, found flatbuffer"), "{flat}");
}

#[test]
fn what_is_not_read_is_named_with_what_to_do() {
    for (kind, says) in [
        (
            "robosense_msgs/msg/RslidarScan",
            "/lidar (robosense_msgs/msg/RslidarScan, 1) has a RoboSense's packets, which are not read: play it through rslidar_sdk",
        ),
        (
            "foxglove.LaserScan",
            "has scans in Foxglove's schema, which are not read: record foxglove.PointCloud (which is read)",
        ),
        ("sensor_msgs/PointCloud", "point_cloud_converter"),
        (
            "acme_msgs/msg/Sonar",
            "messages of the types acme_msgs/msg/Sonar are not read; to have something to map, record the lidar's LaserScan or PointCloud2",
        ),
    ] {
        let mut log = Recorder::new("unread.mcap");
        log.raw("/lidar", kind, ms(0), &[0, 1, 0, 0]);
        let reason = refused(&log.finish());
        assert!(reason.contains(says), "{says}: {reason}");
    }
}

/// An Ouster of 16 level beams and 16 columns, whose one packet is a revolution.
const METADATA: &str = r#"{"prod_line":"OS-1-16","beam_altitude_angles":[0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0],
    "beam_azimuth_angles":[0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0],
    "data_format":{"columns_per_frame":16,"columns_per_packet":16,"pixels_per_column":16,"udp_profile_lidar":"LEGACY"}}"#;

fn ouster(number: u16) -> Vec<u8> {
    let mut packet = Vec::new();
    for column in 0..16_u16 {
        packet.extend((100_000_000 * u64::from(number) + 6_000_000 * u64::from(column)).to_le_bytes());
        packet.extend([column.to_le_bytes(), number.to_le_bytes(), [0; 2], [0; 2]].concat());
        (0..16).for_each(|_| packet.extend([0xb8, 0x0b, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]));
        packet.extend([0xff; 4]);
    }
    packet
}

fn ouster_log(name: &str, has_metadata: bool) -> PathBuf {
    let mut log = Recorder::new(name);
    if has_metadata {
        log.write("/ouster/metadata", "std_msgs/msg/String", ms(0), &Text { data: METADATA.into() });
    }
    for number in 0..3 {
        let at_ms = 100 * i64::from(number);
        log.write(
            "/ouster/lidar_packets",
            "ouster_sensor_msgs/msg/PacketMsg",
            ms(at_ms),
            &OusterPacket { buf: &ouster(number) },
        );
        let times = [0, 0, 100_000_000 * u64::from(number) + 50_000_000].map(u64::to_le_bytes).concat();
        let numbers = [0.0, 0.0, 1.0, 0.0, 0.0, 180.0_f32].map(f32::to_le_bytes).concat();
        let imu = [times, numbers].concat();
        log.write(
            "/ouster/imu_packets",
            "ouster_sensor_msgs/msg/PacketMsg",
            ms(at_ms + 50),
            &OusterPacket { buf: &imu },
        );
    }
    log.finish()
}

#[test]
fn ouster_packets_are_clouds_and_readings_by_one_clock() {
    let path = ouster_log("ouster.mcap", true);
    let (clouds, readings, notes) = read(&path);
    assert_eq!(
        clouds.iter().map(|cloud| (cloud.stamp, cloud.points_m.len())).collect::<Vec<_>>(),
        [(ms(0), 256), (ms(100), 256), (ms(200), 256)]
    );
    assert!(!notes.has_losses(), "{notes:?}");
    assert_eq!(readings.iter().map(|reading| reading.stamp).collect::<Vec<_>>(), [ms(50), ms(150), ms(250)]);
    assert!((readings[0].turn_rate_rad_per_s.z - std::f64::consts::PI).abs() < 1e-6);
    assert_eq!(planned(&Survey::of(&path).unwrap()).unwrap().messages, 3);
}

#[test]
fn an_ousters_metadata_may_lie_beside_its_packets() {
    let path = ouster_log("ouster_alone.mcap", false);
    let reason = refused(&path);
    assert!(
        reason.contains("put the sensor's metadata beside the recording, with its name and the ending .json"),
        "{reason}"
    );
    let mut survey = Survey::of(&path).unwrap();
    survey.hear_metadata(METADATA);
    assert_eq!(read_by(&path, survey).0.len(), 3);
    let mut survey = Survey::of(&path).unwrap();
    survey.hear_metadata(&METADATA.replace("columns_per_packet\":16", "columns_per_packet\":8"));
    assert!(planned(&survey).unwrap_err().contains("found 3392: these metadata are another sensor's"));
}

/// The share of points within 2 cm of the straightest upright wall of a cloud, of those between two heights.
fn in_a_wall(cloud: &Cloud, heights_m: std::ops::Range<f32>) -> f64 {
    let points: Vec<_> = cloud.points_m.iter().filter(|point| heights_m.contains(&point[2])).collect();
    let in_slab = |half_degrees: u32| {
        let (sin, cos) = (f64::from(half_degrees) * 0.5).to_radians().sin_cos();
        let mut slabs = std::collections::BTreeMap::<i64, usize>::new();
        for point in &points {
            let along = cos * f64::from(point[0]) + sin * f64::from(point[1]);
            *slabs.entry((along / 0.04).floor() as i64).or_default() += 1;
        }
        slabs.into_values().max().unwrap_or(0)
    };
    (0..360).map(in_slab).max().unwrap_or(0) as f64 / points.len() as f64
}

#[test]
fn real_recordings_of_packets_show_rooms() {
    for (name, sizes, turn_s, wall) in [
        ("vendor/512x10_raw.bag", &[(20_000, 66_000)][..], 0.0, 0.08),
        ("vendor/1673400677802009732_0.db3", &[(30_000, 130_000); 4], 0.1, 0.08),
        ("cases/vendor_packets/livox_custom.bag", &[(1500, 1920); 20], 0.1, 0.1),
    ] {
        let Some(path) = given(name) else { continue };
        let (clouds, readings, notes) = read(&path);
        assert!(!notes.has_losses(), "{name}: {notes:?}");
        let counts: Vec<_> = clouds.iter().map(|cloud| cloud.points_m.len()).collect();
        assert!(counts.len() == sizes.len(), "{name}: {counts:?}");
        assert!(counts.iter().zip(sizes).all(|(count, (least, most))| (least..=most).contains(&count)), "{counts:?}");
        let turns = clouds.windows(2).map(|pair| pair[1].stamp.secs_since(pair[0].stamp));
        assert!(turns.clone().all(|turn| (turn - turn_s).abs() < 0.002), "{name}: {:?}", turns.collect::<Vec<_>>());
        let last_s = clouds[0].times_s.iter().copied().fold(0.0, f32::max);
        assert!((0.09..0.101).contains(&last_s), "{name}: {last_s}");
        let found = in_a_wall(&clouds[0], 0.0..1.5);
        assert!(found > wall, "{name}: {found}");
        assert_eq!(readings.len(), if name.contains("512x10") { 10 } else { 0 });
    }
}
