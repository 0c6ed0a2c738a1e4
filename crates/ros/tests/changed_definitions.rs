//! Messages whose definition in the file is not the standard one: read properly or refused by name, never misread.
#![allow(clippy::unwrap_used, clippy::panic, reason = "tests may")]

mod common;

use common::random::{Random, Style, message};
use mapwright_ros::messages::{CameraInfo, Imu, Kind, LaserScan, Range};
use mapwright_ros::{Channel, Decoder, DefinitionFormat, Encoding, RosError, Value, builtin};

const SCAN: &str = "sensor_msgs/LaserScan";

fn channel(type_name: &str, text: &str) -> Channel {
    Channel::new(type_name, Encoding::Cdr, Some((DefinitionFormat::Ros2Msg, text))).unwrap()
}

fn scan_text() -> String {
    builtin::text(SCAN, Encoding::Cdr).unwrap()
}

#[test]
fn fields_are_found_by_name_where_they_were_moved_or_added() {
    let text = scan_text()
        .replace("float32[] intensities\n", "")
        .replace(
            "std_msgs/Header header\n",
            "uint8 quality\nfloat32[] intensities\nstd_msgs/Header header\nstring note\n",
        )
        .replace("string frame_id\n", "string frame_id\nuint64 clock\n");
    let channel = channel(SCAN, &text);
    let mut decoder = Decoder::<LaserScan<'_>>::new(&channel).unwrap();
    assert!(!decoder.fit().exact);
    assert_eq!(decoder.fit().extra, ["header.clock", "quality", "note"]);
    let mut random = Random(5);
    for style in [Style::CdrLittle, Style::CdrBig] {
        for _ in 0..100 {
            let bytes = message(channel.schema(), style, &mut random);
            let value = channel.value(&bytes).unwrap();
            let scan = decoder.decode(&bytes).unwrap();
            assert_eq!(value.get("angle_min"), Some(&Value::F32(scan.angle_min)));
            assert_eq!(value.get("header.frame_id"), Some(&Value::Text(scan.header.frame_id.clone())));
            let Some(Value::Numbers(ranges)) = value.get("ranges") else { panic!("no ranges") };
            assert_eq!(ranges.as_slice::<f32>().unwrap(), scan.ranges);
        }
    }
}

#[test]
fn an_optional_field_may_be_missing() {
    let channel = channel(SCAN, &scan_text().replace("float32[] intensities\n", ""));
    let mut decoder = Decoder::<LaserScan<'_>>::new(&channel).unwrap();
    assert_eq!(decoder.fit().missing, ["intensities"]);
    let bytes = message(channel.schema(), Style::CdrLittle, &mut Random(6));
    assert!(decoder.decode(&bytes).unwrap().intensities.is_empty());
}

fn refusal<K: Kind>(type_name: &str, from: &str, to: &str) -> String {
    let text = builtin::text(type_name, Encoding::Cdr).unwrap();
    assert!(text.contains(from));
    Decoder::<K>::new(&channel(type_name, &text.replace(from, to))).err().map(|e| e.to_string()).unwrap()
}

#[test]
fn a_field_that_is_needed_is_missed_by_name() {
    assert_eq!(
        refusal::<LaserScan<'_>>(SCAN, "float32[] ranges\n", ""),
        "sensor_msgs/LaserScan in this file has no field `ranges` (float32[]); it has header, angle_min, angle_max, \
         angle_increment, time_increment, scan_time, range_min, range_max, intensities"
    );
    assert_eq!(
        refusal::<LaserScan<'_>>(SCAN, "float32[] ranges", "float64[] ranges"),
        "sensor_msgs/LaserScan in this file has field `ranges` as float64[], expected float32[]"
    );
    assert_eq!(
        refusal::<Imu<'_>>("sensor_msgs/Imu", "float64 w\n", ""),
        "sensor_msgs/Imu in this file has no field `orientation.w` (float64); it has x, y, z"
    );
    assert_eq!(
        refusal::<Imu<'_>>("sensor_msgs/Imu", "builtin_interfaces/Time stamp", "float64 stamp"),
        "sensor_msgs/Imu in this file has field `header.stamp` as float64, expected builtin_interfaces/Time"
    );
    assert_eq!(
        refusal::<Imu<'_>>("sensor_msgs/Imu", "int32 sec\n", "int64 sec\n"),
        "sensor_msgs/Imu in this file has field `header.stamp` as builtin_interfaces/Time, expected builtin_interfaces/Time \
         of int32 sec and uint32 nanosec"
    );
    assert_eq!(
        refusal::<LaserScan<'_>>(SCAN, "std_msgs/Header header", "std_msgs/Header[] header"),
        "sensor_msgs/LaserScan in this file has field `header` as std_msgs/Header[], expected std_msgs/Header"
    );
}

#[test]
fn ranges_of_newer_distributions_have_a_variance_behind() {
    let text = builtin::text("sensor_msgs/Range", Encoding::Cdr)
        .unwrap()
        .replace("float32 range\n", "float32 range\nfloat32 variance\n");
    let channel = channel("sensor_msgs/Range", &text);
    let bytes = message(channel.schema(), Style::CdrLittle, &mut Random(7));
    assert!(Decoder::<Range<'_>>::new(&channel).unwrap().decode(&bytes).is_ok());
    let without_definition = Channel::new("sensor_msgs/Range", Encoding::Cdr, None).unwrap();
    let error = without_definition.value(&bytes).unwrap_err();
    assert!(matches!(error, RosError::Trailing { left_bytes: 4, .. }), "{error}");
}

#[test]
fn camera_matrices_have_capital_letters_in_ros1() {
    let text = builtin::text("sensor_msgs/CameraInfo", Encoding::Ros1).unwrap();
    assert!(text.contains("float64[9] K\n"));
    let definition = Some((DefinitionFormat::Ros1Msg, text.as_str()));
    let channel = Channel::new("sensor_msgs/CameraInfo", Encoding::Ros1, definition).unwrap();
    let decoder = Decoder::<CameraInfo<'_>>::new(&channel).unwrap();
    assert!(decoder.fit().exact);
}

#[test]
fn messages_made_of_nothing_do_not_fill_the_memory() {
    let text = "Nothing[4000000000] many\n===\nMSG: a/Nothing\n";
    let channel = Channel::new("a/Much", Encoding::Ros1, Some((DefinitionFormat::Ros1Msg, text))).unwrap();
    assert!(matches!(channel.value(&[0; 16]), Err(RosError::Unsupported { .. })));
    let doubled: String = (0..30).map(|i| format!("T{i} a\nT{i} b\n===\nMSG: a/T{i}\n")).collect();
    let channel = Channel::new("a/Much", Encoding::Ros1, Some((DefinitionFormat::Ros1Msg, &doubled))).unwrap();
    assert!(matches!(channel.value(&[]), Err(RosError::Unsupported { .. })));
}

#[test]
fn a_type_without_any_definition_is_refused_by_name() {
    let error = Channel::new("my_msgs/msg/Thing", Encoding::Cdr, Some((DefinitionFormat::Ros2Msg, " "))).unwrap_err();
    assert_eq!(
        error.to_string(),
        "no definition of my_msgs/Thing comes with the file, and it is not one of the built-in types"
    );
}
