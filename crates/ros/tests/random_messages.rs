//! Messages of all built-in types with random content: whole, as another reader sees them, and damaged.
#![allow(clippy::explicit_write, clippy::unwrap_used, clippy::panic, clippy::print_stderr, reason = "tests may")]

mod common;

use common::digest;
use common::random::{Random, Style, message};
use mapwright_geom::{Pose3, Stamp};
use mapwright_ros::messages::{
    self, ColorRgba, Header, Kind, Marker, MarkerAction, MarkerArray, MarkerShape, Point, PointCloud2, PointField,
    Pose, Vector3,
};
use mapwright_ros::{Channel, Cloud, Decoder, Encoding, builtin, encode, long_name};
use std::fmt::Debug;
use std::io::Write;
use std::path::Path;

/// Calls a generic function for each kind of typed message.
macro_rules! for_each_kind {
    ($function:ident, $style:expr) => {
        for_each_kind!($function, $style; LaserScan, MultiEchoLaserScan, PointCloud2, Odometry, TfMessage, Imu, Image,
            CameraInfo, CompressedImage, Range, PoseStamped, PoseWithCovarianceStamped, Path, OccupancyGrid,
            LivoxScan, OusterPacket, Text)
    };
    ($function:ident, $style:expr; $($kind:ident),*) => { $( $function::<messages::$kind<'_>>($style); )* };
}

fn come_back<K: Kind>(style: Style)
where
    for<'m> K::Message<'m>: PartialEq + Debug,
{
    let channel = Channel::new(K::TYPES[0], style.encoding(), None).unwrap();
    let mut decoder = Decoder::<K>::new(&channel).unwrap();
    assert!(decoder.fit().exact && decoder.fit().extra.is_empty() && decoder.fit().missing.is_empty());
    let mut random = Random(1);
    for _ in 0..200 {
        let bytes = message(channel.schema(), style, &mut random);
        let typed = decoder.decode(&bytes).unwrap();
        assert_eq!(typed, decoder.decode_by_name(&bytes).unwrap(), "{}", K::TYPES[0]);
        let again = encode(&typed, style.encoding()).unwrap();
        let same = match style {
            Style::CdrBig => digest(&channel.value(&again).unwrap()) == digest(&channel.value(&bytes).unwrap()),
            _ => again == bytes,
        };
        assert!(same, "{} {style:?}\n{bytes:?}\n{again:?}", K::TYPES[0]);
    }
    assert_eq!(decoder.lossy_texts(), 0);
}

#[test]
fn messages_of_all_types_are_written_as_they_were_read() {
    for style in Style::ALL {
        for_each_kind!(come_back, style);
    }
}

fn survive<K: Kind>(style: Style) {
    let channel = Channel::new(K::TYPES[0], style.encoding(), None).unwrap();
    let mut decoder = Decoder::<K>::new(&channel).unwrap();
    let mut random = Random(2);
    let mut refused = 0;
    for _ in 0..2000 {
        let bytes = damaged(message(channel.schema(), style, &mut random), &mut random);
        let typed = decoder.decode(&bytes).is_ok();
        assert_eq!(typed, decoder.decode_by_name(&bytes).is_ok(), "{} {bytes:?}", K::TYPES[0]);
        assert_eq!(typed, channel.value(&bytes).is_ok());
        refused += u32::from(!typed);
    }
    assert!(refused > 300, "{}: {refused} of 2000 refused", K::TYPES[0]);
}

/// Cut somewhere, or up to eight bytes changed.
fn damaged(mut bytes: Vec<u8>, random: &mut Random) -> Vec<u8> {
    if random.below(3) == 0 {
        bytes.truncate(random.below(bytes.len()));
        return bytes;
    }
    for _ in 0..=random.below(8) {
        let place = random.below(bytes.len());
        bytes[place] = random.next() as u8;
    }
    bytes
}

#[test]
fn two_thousand_damaged_messages_of_each_type_are_survived() {
    for style in Style::ALL {
        for_each_kind!(survive, style);
    }
}

#[test]
fn damaged_clouds_are_survived() {
    let channel = Channel::new("sensor_msgs/PointCloud2", Encoding::Ros1, None).unwrap();
    let mut decoder = Decoder::<PointCloud2<'_>>::new(&channel).unwrap();
    let data: Vec<u8> = (0..20 * 16).map(|i| i as u8).collect();
    let field = |name: &'static str, offset| PointField { name: name.into(), offset, datatype: 7, count: 1 };
    let fields = vec![field("x", 0), field("y", 4), field("z", 8), field("time", 12)];
    let (data, point_step, row_step) = (&data[..], 16, 160);
    let whole = PointCloud2 { height: 2, width: 10, fields, point_step, row_step, data, ..PointCloud2::default() };
    let whole = encode(&whole, Encoding::Ros1).unwrap();
    let mut random = Random(3);
    let (mut points, mut refused) = (0, 0);
    for _ in 0..2000 {
        let bytes = damaged(whole.clone(), &mut random);
        let Ok(message) = decoder.decode(&bytes) else { continue };
        match Cloud::new(&message) {
            Ok(cloud) => points += cloud.points().count(),
            Err(_) => refused += 1,
        }
    }
    assert!(points > 1000 && refused > 50, "{points} points, {refused} clouds refused");
}

fn markers() -> MarkerArray<'static> {
    let line = Marker {
        header: Header::new(Stamp(1_500_000_000), "map"),
        ns: "closures".into(),
        id: 7,
        shape: MarkerShape::LineList,
        action: MarkerAction::Add,
        pose: Pose::from(Pose3::identity()),
        scale: Vector3 { x: 0.05, y: 0.0, z: 0.0 },
        color: ColorRgba { r: 1.0, g: 0.5, b: 0.25, a: 1.0 },
        frame_locked: true,
        points: vec![Point::default(), Point { x: 1.0, y: 2.0, z: 3.0 }],
        colors: vec![ColorRgba::default(); 2],
        text: "closure".into(),
    };
    MarkerArray { markers: vec![line.clone(), Marker { action: MarkerAction::DeleteAll, points: Vec::new(), ..line }] }
}

#[test]
fn markers_are_what_their_definition_says() {
    for encoding in [Encoding::Ros1, Encoding::Cdr] {
        let channel = Channel::new(MarkerArray::TYPE, encoding, None).unwrap();
        let bytes = markers().encode(encoding).unwrap();
        let text = common::canonical(&channel.value(&bytes).unwrap());
        for line in ["markers[0].points[1].z=4008000000000000", "markers[1].text=closure", "markers[1].action=00000003"]
        {
            assert!(text.lines().any(|l| l == line), "{line} in\n{text}");
        }
    }
}

#[test]
fn another_reader_sees_the_same_in_all_messages() {
    let mut script = match common::script() {
        Ok(script) => script,
        Err(reason) => {
            let _ = writeln!(std::io::stderr(), "another reader: skipped: {reason}");
            return;
        }
    };
    let mut out = Vec::new();
    let mut random = Random(4);
    for (style, format) in
        [(Style::Ros1, "ros1 ros1msg"), (Style::CdrLittle, "cdr ros2msg"), (Style::CdrBig, "cdr ros2msg")]
    {
        let names = include_str!("../src/standard_ros2.msgs").lines().filter_map(|line| line.strip_prefix("MSG: "));
        // What only ROS 2 has: where it says nothing it has a byte that ROS 1 has not.
        let is_of_ros2 = |name: &str| {
            let is_of_service = name.ends_with("_Request") || name.ends_with("_Response");
            is_of_service || name.starts_with("rcl_interfaces/") || name.starts_with("lifecycle_msgs/")
        };
        let is_left_out =
            |name: &str| name.starts_with("builtin_interfaces") || style == Style::Ros1 && is_of_ros2(name);
        for name in names.filter(|name| !is_left_out(name)) {
            let channel = Channel::new(name, style.encoding(), None).unwrap();
            let text = builtin::text(name, style.encoding()).unwrap();
            write!(out, "C {} {format} {} topic\n{text}\n", long_name(name), text.len()).unwrap();
            for _ in 0..20 {
                put(&mut out, &channel, &message(channel.schema(), style, &mut random));
            }
            if name == MarkerArray::TYPE {
                put(&mut out, &channel, &markers().encode(style.encoding()).unwrap());
            }
        }
    }
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("random_messages.bin");
    std::fs::write(&path, out).unwrap();
    let run = script.arg("--check").arg(&path).output().unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
}

fn put(out: &mut Vec<u8>, channel: &Channel, message: &[u8]) {
    let digest = digest(&channel.value(message).unwrap());
    writeln!(out, "M {} {digest}", message.len()).unwrap();
    out.extend_from_slice(message);
    out.push(b'\n');
}
