//! A log as a bag or MCAP and back.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // tests unwrap what they expect and say what they skip

use mapwright_bags::{Bag1Reader, McapReader, RawMessage};
use mapwright_exports::EventWriter;
use mapwright_formats::{CarmenReader, LogEvent};
use mapwright_geom::{Pose2, Stamp};
use mapwright_ros::messages::{Imu, LaserScan, Odometry, TfMessage};
use mapwright_ros::{Channel, Decoder, Encoding, Mounting};
use mapwright_sensor::TurnRate;
use std::io::Cursor;

const LOG: &str = "PARAM robot_frontlaser_offset -0.04 nohost 0\n\
    ODOM 1 2 0.25 0 0 0 12.25 host 0.1\n\
    FLASER 3 1.07 2.5 81.83 0.96 2 0.25 1 2 0.25 12.5 host 0.2\n\
    ODOM 1 2.5 -3 0 0 0 12.75 host 0.3\n\
    FLASER 3 1.08 2.5 81.83 1 2 0.5 1 2 0.5 12.125 host 0.4\n";

#[derive(Debug, PartialEq)]
enum Seen {
    Scan(Stamp, Vec<f32>),
    Odometry(Stamp, [f64; 3]),
    Robot(Stamp, [f64; 2]),
    Mount(String, f64),
}

fn seen(message: &RawMessage<'_>, encoding: Encoding) -> Seen {
    let channel = Channel::new(&message.connection.type_name, encoding, None).unwrap();
    match &*message.connection.topic {
        "/scan" => {
            let scan = Decoder::<LaserScan<'_>>::new(&channel).unwrap().decode(message.data).unwrap();
            assert_eq!(scan.laser(&Mounting::IDENTITY).unwrap().0.angle_min_rad, -std::f64::consts::FRAC_PI_2);
            Seen::Scan(scan.header.stamp, scan.ranges.to_vec())
        }
        "/odom" => {
            let odometry = Decoder::<Odometry<'_>>::new(&channel).unwrap().decode(message.data).unwrap();
            let Pose2 { x, y, theta } = odometry.to_sensor().unwrap().odom_from_robot;
            Seen::Odometry(odometry.header.stamp, [x, y, (theta * 1e12).round() / 1e12])
        }
        topic => {
            let mut message = Decoder::<TfMessage<'_>>::new(&channel).unwrap().decode(message.data).unwrap();
            let link = message.transforms.remove(0);
            let place = link.transform.translation;
            match topic {
                "/tf_static" => Seen::Mount(link.child_frame_id.into_owned(), place.x),
                _ => Seen::Robot(link.header.stamp, [place.x, place.y]),
            }
        }
    }
}

fn pour<W: std::io::Write + std::io::Seek>(log: &[u8], mut writer: EventWriter<W>) -> W {
    let mut reader = CarmenReader::new(log);
    while let Some(event) = reader.next_event().unwrap() {
        writer.write(event).unwrap();
    }
    let (out, counts) = writer.finish().unwrap();
    assert_eq!((counts.scans, counts.odometry, counts.left_out), (2, 2, 0));
    out
}

fn expected() -> Vec<Seen> {
    let at = |ms: i64| Stamp(ms * 1_000_000);
    let read = |ms, pose: [f64; 3]| [Seen::Odometry(at(ms), pose), Seen::Robot(at(ms), [pose[0], pose[1]])];
    let mut all = Vec::new();
    all.extend(read(12_250, [1.0, 2.0, 0.25]));
    all.push(Seen::Mount("FLASER".to_owned(), -0.04));
    all.extend(read(12_500, [1.0, 2.0, 0.25]));
    all.push(Seen::Scan(at(12_500), vec![1.07, 2.5, 81.83]));
    all.extend(read(12_750, [1.0, 2.5, -3.0]));
    all.extend(read(12_125, [1.0, 2.0, 0.5]));
    all.push(Seen::Scan(at(12_125), vec![1.08, 2.5, 81.83]));
    all
}

#[test]
fn mcap_and_bags_carry_the_log_in_its_order() {
    let mcap = pour(LOG.as_bytes(), EventWriter::mcap(Cursor::new(Vec::new())).unwrap());
    let mut reader = McapReader::open(mcap).unwrap();
    let mut found = Vec::new();
    while let Some(message) = reader.next_message().unwrap() {
        assert!(message.connection.definition.is_some());
        found.push(seen(&message, Encoding::Cdr));
    }
    assert_eq!(found, expected());
    let bag = pour(LOG.as_bytes(), EventWriter::bag1(Cursor::new(Vec::new())).unwrap());
    let (mut reader, mut found, mut last) = (Bag1Reader::open(bag).unwrap(), Vec::new(), Stamp(0));
    while let Some(message) = reader.next_message().unwrap() {
        assert!(message.log_stamp >= last, "received in the order in which they are written");
        last = message.log_stamp;
        assert_eq!(message.connection.latching(), message.connection.topic == "/tf_static");
        found.push(seen(&message, Encoding::Ros1));
    }
    assert_eq!(found, expected());
}

#[test]
fn turn_rates_go_into_recordings_as_they_were_and_carmen_leaves_them_out() {
    let rates =
        [(1_000, 0.125), (1_010, -3.5)].map(|(ms, rad_per_s)| TurnRate { stamp: Stamp(ms * 1_000_000), rad_per_s });
    let mut writer = EventWriter::mcap(Cursor::new(Vec::new())).unwrap();
    rates.iter().for_each(|rate| writer.write(LogEvent::TurnRate(rate)).unwrap());
    let (mcap, counts) = writer.finish().unwrap();
    assert_eq!((counts.turn_rates, counts.left_out), (2, 0));
    let mut reader = McapReader::open(mcap).unwrap();
    let mut found = Vec::new();
    while let Some(message) = reader.next_message().unwrap() {
        let channel = Channel::new(&message.connection.type_name, Encoding::Cdr, None).unwrap();
        let imu = Decoder::<Imu<'_>>::new(&channel).unwrap().decode(message.data).unwrap();
        assert_eq!((&*message.connection.topic, imu.header.frame()), ("/imu", "base_link"));
        assert_eq!((imu.orientation_covariance.0[0], imu.angular_velocity_covariance.0[0]), (-1.0, 0.0));
        found.push(TurnRate { stamp: imu.header.stamp, rad_per_s: imu.angular_velocity.z });
    }
    assert_eq!(found, rates);
    let mut writer = EventWriter::carmen(Cursor::new(Vec::new()));
    rates.iter().for_each(|rate| writer.write(LogEvent::TurnRate(rate)).unwrap());
    assert_eq!(writer.finish().unwrap().1.left_out, 2);
}

#[test]
fn carmen_stays_as_it_is_and_a_scans_own_reading_gets_no_line() {
    let again = pour(LOG.as_bytes(), EventWriter::carmen(Cursor::new(Vec::new()))).into_inner();
    let text = String::from_utf8(again.clone()).unwrap();
    let tags: Vec<_> = text.lines().filter_map(|line| line.split(' ').next()).filter(|tag| *tag != "PARAM").collect();
    assert_eq!(tags, ["ODOM", "FLASER", "ODOM", "FLASER"]);
    let mut writer = EventWriter::carmen(Cursor::new(Vec::new()));
    let mut reader = CarmenReader::new(again.as_slice());
    while let Some(event) = reader.next_event().unwrap() {
        if let LogEvent::Scan(scan) = event {
            let odom_from_robot = scan.odom_from_robot.unwrap();
            let own = mapwright_sensor::Odometry { stamp: scan.stamp, odom_from_robot };
            writer.write(LogEvent::Odometry(&own)).unwrap();
        }
        writer.write(event).unwrap();
    }
    assert_eq!(writer.finish().unwrap().0.into_inner(), again);
}
