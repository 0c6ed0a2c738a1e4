//! What a user of the CARMEN reader and writer notices.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout)]

use mapwright_formats::{CarmenReader, CarmenWriter, DropReason, LogEvent, ReadReport, open_log};
use mapwright_geom::{Pose2, Stamp};
use mapwright_sensor::{LaserModel, LaserScan, Odometry};
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A log with every kind of line.
const SMALL_LOG: &str = include_str!("small.clf");

#[derive(Debug, Clone, PartialEq)]
enum Event {
    Scan(LaserScan),
    Odometry(Odometry),
}

fn read(log: &[u8]) -> (Vec<Event>, ReadReport) {
    let mut reader = CarmenReader::new(open_log(log).unwrap());
    let mut events = Vec::new();
    while let Some(event) = reader.next_event().unwrap() {
        events.push(match event {
            LogEvent::Scan(scan) => Event::Scan(scan.clone()),
            LogEvent::Odometry(odometry) => Event::Odometry(*odometry),
            _ => continue,
        });
    }
    (events, reader.into_report())
}

fn scans(log: &str) -> Vec<LaserScan> {
    let keep = |event| if let Event::Scan(scan) = event { Some(scan) } else { None };
    read(log.as_bytes()).0.into_iter().filter_map(keep).collect()
}

fn only_scan(log: &str) -> LaserScan {
    let mut scans = scans(log);
    assert_eq!(scans.len(), 1, "{log}");
    scans.remove(0)
}

/// The only dropped line of a log.
fn drop_of(log: &str) -> (DropReason, String) {
    let (_, report) = read(log.as_bytes());
    assert_eq!(report.dropped_lines(), 1, "{log}: {report:?}");
    let (reason, drops) = report.drops.first_key_value().unwrap();
    (*reason, drops.first[0].to_string())
}

#[test]
fn every_kind_of_line_is_read() {
    let (events, report) = read(SMALL_LOG.as_bytes());
    assert_eq!((events.len(), report.scans, report.odometry), (8, 5, 3));
    assert!(report.has_scans() && !report.has_losses());
    assert_eq!(report.lines, SMALL_LOG.lines().count() as u64);
    assert_eq!((report.other_tags["PARAM"], report.other_tags["SYNC"], report.other_tags["TRUEPOS"]), (6, 1, 1));
    assert_eq!(report.other_tags["NMEA-GGA"], 2);
    let names: Vec<_> = report.topics.iter().map(|t| t.name.as_str()).collect();
    assert_eq!(names, ["ODOM", "FLASER", "RLASER", "ROBOTLASER1"]);
}

#[test]
fn front_and_rear_lasers_sit_where_the_parameters_say() {
    let scans = scans(SMALL_LOG);
    let (front, rear) = (&scans[0].laser, &scans[2].laser);
    assert_eq!((front.robot_from_laser, front.range_max_m), (Pose2::new(-0.04, 0.0, 0.0), 80.99));
    assert_eq!((rear.robot_from_laser, rear.range_max_m), (Pose2::new(-0.3, 0.0, PI), 80.0));
    assert_eq!(front.angle_min_rad, -FRAC_PI_2);
    assert!(Arc::ptr_eq(front, &scans[1].laser));
    assert_eq!(scans[0].stamp, Stamp(1_211_520_329_000));
    assert_eq!(scans[0].odom_from_robot, Some(Pose2::new(-3.034287, 8.291214, -3.120965)));
}

#[test]
fn a_front_laser_sits_where_its_first_line_has_it_unless_a_parameter_says() {
    let line = |laser: &str| format!("FLASER 3 1 2 3 {laser} 5 6 0.5 1 host 1\n");
    let ahead = Pose2::new(5.0, 6.0, 0.5) * Pose2::new(0.25, 0.0, 0.0);
    let of = |pose: Pose2| format!("{:.6} {:.6} {:.6}", pose.x, pose.y, pose.theta);
    let (events, report) = read(line(&of(ahead)).as_bytes());
    assert_eq!(events.len(), 1);
    let words: Vec<_> = report.odd_heads.iter().map(|(words, _)| words.to_owned()).collect();
    assert!(words.iter().any(|words| words.contains("0.250 m ahead")), "{words:?}");
    assert_eq!(only_scan(&line(&of(ahead))).laser.robot_from_laser, Pose2::new(0.25, 0.0, 0.0));
    let said = format!("PARAM robot_frontlaser_offset 0.1 1 host 1\n{}", line(&of(ahead)));
    assert_eq!(only_scan(&said).laser.robot_from_laser.x, 0.1);
    // The pose of a mapper, turned, aside or far away, is no mounting.
    for pose in
        [Pose2::new(5.2, 6.0, 0.6), Pose2::new(5.0, 6.3, 0.5), Pose2::new(50.0, 6.0, 0.5), Pose2::new(5.0, 6.0, 0.5)]
    {
        assert_eq!(only_scan(&line(&of(pose))).laser.robot_from_laser, Pose2::IDENTITY);
    }
}

#[test]
fn a_rear_laser_without_parameters_sits_where_its_lines_say() {
    let mount = |x: f64, theta: f64| {
        scans(&format!("RLASER 2 1 2 {x} 2 {theta} 1 2 0 12.5 host 0.1\n"))[0].laser.robot_from_laser
    };
    let [behind, corrected] = [mount(0.7, PI), mount(0.7, 0.1)];
    assert!(behind.distance(Pose2::new(-0.3, 0.0, 0.0)) < 1e-9 && behind.theta.cos() < -0.999, "{behind:?}");
    assert!(corrected.distance(Pose2::IDENTITY) < 1e-9 && corrected.theta.cos() < -0.999, "another pose of the robot");
}

#[test]
fn a_robot_laser_says_itself_how_it_looks_at_the_world() {
    let scan = &scans(SMALL_LOG)[3];
    assert_eq!((scan.laser.angle_min_rad, scan.laser.angle_step_rad, scan.laser.range_max_m), (-1.57, 0.785, 50.0));
    assert_eq!(scan.ranges_m, [1.0, 2.0, 3.0, 4.0, 5.0]);
    assert!(scan.laser.robot_from_laser.distance(Pose2::new(0.2, 0.0, 0.0)) < 1e-9);
    assert_eq!((scan.stamp, scan.odom_from_robot), (Stamp(1_211_900_000_000), Some(Pose2::new(1.0, 2.0, FRAC_PI_2))));
}

#[test]
fn rounded_poses_do_not_make_a_new_laser_of_every_scan() {
    let line = |x: f64, y: f64, t: f64| {
        let (lx, ly) = (x + 0.2 * t.cos(), y + 0.2 * t.sin());
        format!(
            "ROBOTLASER1 0 -1.57 3.14 1.57 80 0 0 3 1 2 3 0 {lx:.4} {ly:.4} {t:.4} {x:.4} {y:.4} {t:.4} 0 0 0 0 0 7.5 h 0\n"
        )
    };
    let log: String = (0..50).map(|i| line(f64::from(i) * 0.31, f64::from(i) * 0.17, f64::from(i) * 0.1)).collect();
    let scans = scans(&log);
    assert!(scans.iter().all(|s| Arc::ptr_eq(&s.laser, &scans[0].laser)));
}

#[test]
fn old_logs_lack_trailing_fields() {
    let expected = Some(Pose2::new(4.0, 5.0, 0.6));
    let cases = [
        ("FLASER 2 1 2 1 2 0.3 4 5 0.6 12.5 host 0.1", expected, 12_500_000_000),
        ("FLASER 2 1 2 1 2 0.3 4 5 0.6 12.5 host", expected, 12_500_000_000),
        ("FLASER 2 1 2 1 2 0.3 4 5 0.6 12.5", expected, 12_500_000_000),
        ("FLASER 2 1 2 1 2 0.3 4 5 0.6", expected, 0),
        ("FLASER 2 1 2 4 5 0.6 12.5 host 0.1", expected, 12_500_000_000),
        ("FLASER 2 1 2 4 5 0.6 12.5", expected, 12_500_000_000),
        ("FLASER 2 1 2 4 5 0.6", expected, 0),
    ];
    for (line, pose, nanos) in cases {
        for log in [format!("{line}\n"), format!("  {}\r\n", line.replace(' ', " \t "))] {
            let scan = only_scan(&log);
            assert_eq!((scan.odom_from_robot, scan.stamp), (pose, Stamp(nanos)), "{log}");
        }
    }
    let odometry = |tail: &str| read(format!("ODOM 4 5 0.6{tail}\n").as_bytes()).0[0].clone();
    for tail in [" 1 2 3 12.5 host 0.1", " 1 2 3 12.5", " 1 2 12.5 host 0.1", " 12.5 host 0.1", " 12.5"] {
        let expected = Odometry { stamp: Stamp(12_500_000_000), odom_from_robot: Pose2::new(4.0, 5.0, 0.6) };
        assert_eq!(odometry(tail), Event::Odometry(expected), "{tail}");
    }
}

#[test]
fn a_scan_without_a_stamp_carries_the_one_before() {
    let (events, report) = read(b"ODOM 0 0 0 0 0 0 12.5 h 0\nFLASER 1 3.00 0 0 0 0 0 0\n");
    assert_eq!(report.unstamped.first_places, [2]);
    assert!(matches!(&events[1], Event::Scan(scan) if scan.stamp == Stamp(12_500_000_000)));
}

#[test]
fn bad_lines_are_dropped_with_line_number_expectation_and_finding() {
    use DropReason::{
        BadNumber, BeamCount, MissingField, NotText, PoseRefused, StampRefused, SurplusFields, TruncatedLastLine,
    };
    let cases = [
        (
            "\nFLASER 3 1.00 x 3.00 0 0 0 0 0 0 1 h 1\n",
            BadNumber,
            "line 2: expected the range of beam 2 of 3, found `x`",
        ),
        (
            "FLASER 3 1 2 3 0 0 0 0 0\n",
            MissingField,
            "line 1: expected a pose, odometry, a stamp, a host and a second stamp, found `0`",
        ),
        ("FLASER 900 1 2 3\n", MissingField, "line 1: expected 900 readings, as the line announces, found ` 1 2 3`"),
        ("FLASER 2 1 2 3 0 0 0 0 0 0 1 h 1\n", SurplusFields, "line 1: expected the end of the line, found `1`"),
        ("FLASER 0 0 0 0 0 0 0 1 h 1\n", BeamCount, "line 1: expected at least one beam, found `0`"),
        ("FLASER -5 0 0 0 0 0 0 1 h 1\n", BadNumber, "line 1: expected a number of beams from 1 to 65536, found `-5`"),
        (
            "FLASER 99999999999999999999 1 2\n",
            BadNumber,
            "line 1: expected a number of beams from 1 to 65536, found `99999999999999999999`",
        ),
        ("FLASER\n", MissingField, "line 1: expected a number of beams from 1 to 65536, found nothing"),
        ("ODOM 1e7 0 0 0 0 0 1 h 1\n", PoseRefused, "line 1: expected a finite pose within 10^6 m, found `1e7`"),
        ("ODOM 0 0 inf 0 0 0 1 h 1\n", PoseRefused, "line 1: expected a finite pose within 10^6 m, found `0`"),
        ("ODOM 0 0 0 0 0 0 nan h 1\n", StampRefused, "line 1: expected a stamp in seconds, found `nan`"),
        ("PARAM robot_frontlaser_offset far\n", BadNumber, "line 1: expected a parameter's value, found `far`"),
        ("PARAM robot_front_laser_max -1\n", BadNumber, "line 1: expected a value from 0.001 to 1000000, found `-1`"),
        ("\u{1}\u{2}binary\n", NotText, "line 1: expected a tag such as ODOM or FLASER, found `\\u{1}\\u{2}binary`"),
        ("ODOM 0 0 0 0 0 0 12.3", TruncatedLastLine, "line 1: expected a host name behind the stamp, found nothing"),
    ];
    for (log, reason, message) in cases {
        assert_eq!(drop_of(log), (reason, message.to_owned()));
    }
}

#[test]
fn a_wrong_count_of_readings_never_passes_for_a_scan() {
    let line = |n: usize| {
        format!(
            "FLASER {n} {}-2.994295 8.292039 -3.1 -3.03 8.29 -3.1 1211.520329 magnum 0.015885\n",
            "1.07 ".repeat(180)
        )
    };
    assert_eq!(scans(&line(180)).len(), 1);
    for wrong in (170..190).filter(|&n| n != 180) {
        let log = [line(180), line(wrong), line(180)].concat();
        assert_eq!(scans(&log).len(), 2, "{wrong}");
    }
}

#[test]
fn odd_ranges_are_delivered_raw_and_counted() {
    let log = b"FLASER 6 nan inf -1.5 1e300 0.00 81.83 0 0 0 0 0 0 1 h 1\n";
    let (events, report) = read(log);
    let Event::Scan(scan) = &events[0] else { panic!("{events:?}") };
    assert!(scan.ranges_m[0].is_nan());
    assert_eq!(scan.ranges_m[1..], [f32::INFINITY, -1.5, f32::INFINITY, 0.0, 81.83]);
    assert_eq!(report.non_finite_ranges, 3);
}

#[test]
fn odometry_far_out_is_used_relative_to_where_a_second_reading_confirms_it() {
    let log = b"ODOM 448264.5 5411932.25 0.1 0 0 0 1 h 1\nFLASER 1 1.00 0 0 0 448264.5 5411932.25 0.1 2 h 2\n\
        ODOM 448265.0 5411932.5 0.2 0 0 0 3 h 3\nODOM 1e7 0 0 0 0 0 4 h 4\n";
    let (events, report) = read(log);
    let [Event::Scan(scan), Event::Odometry(odometry)] = &events[..] else { panic!("{events:?}") };
    assert_eq!(scan.odom_from_robot, Some(Pose2::new(0.0, 0.0, 0.1)));
    assert_eq!(odometry.odom_from_robot, Pose2::new(0.5, 0.25, 0.2));
    assert_eq!((report.odometry_origin_m, report.dropped_lines()), (Some([448_264.5, 5_411_932.25]), 2));
    let robot_laser = "ROBOTLASER1 0 -1.57 3.14 3.14 80 0.01 0 2 1.0 1.0 0";
    let line = |s: i32| format!("{robot_laser} 448264.6 5411932.25 0 448264.5 5411932.25 0 0 0 0 0 0 {s} h {s}\n");
    let (events, _) = read((line(1) + &line(2)).as_bytes());
    let [Event::Scan(first), Event::Scan(second)] = &events[..] else { panic!("{events:?}") };
    assert!((second.laser.robot_from_laser.x - 0.1).abs() < 1e-6 && first.odom_from_robot.is_none());
    assert_eq!(second.odom_from_robot, Some(Pose2::IDENTITY));
}

#[test]
fn a_scan_survives_its_bad_pose_without_it() {
    let (events, report) = read(b"FLASER 1 1.00 0 0 0 1e9 0 0 1 h 1\nFLASER 1 1.00 0 0 0 nan nan nan 1 h 1\n");
    assert!(events.iter().all(|e| matches!(e, Event::Scan(s) if s.odom_from_robot.is_none())));
    assert_eq!((events.len(), report.refused_scan_poses.first_places.as_slice()), (2, [1].as_slice()));
}

#[test]
fn stamps_jumps_and_changing_beams_are_reported_and_nothing_is_reordered() {
    let log = "ODOM 0 0 0 0 0 0 2 h 1\nODOM 1 0 0 0 0 0 1 h 1\nODOM 50 0 0 0 0 0 1 h 1\n\
               FLASER 1 1.00 0 0 0 0 0 0 5 h 1\nFLASER 2 1.00 1.00 0 0 0 0 0 0 6 h 1\n";
    let (events, report) = read(log.as_bytes());
    let stamps = events.iter().map(|e| match e {
        Event::Scan(scan) => scan.stamp.0 / 1_000_000_000,
        Event::Odometry(odometry) => odometry.stamp.0 / 1_000_000_000,
    });
    let stamps: Vec<_> = stamps.collect();
    assert_eq!(stamps, [2, 1, 1, 5, 6]);
    let odometry = report.topic("ODOM").unwrap();
    assert_eq!(odometry.stamps.backward.first_places, [2]);
    assert_eq!(odometry.stamps.repeated.first_places, [3]);
    assert_eq!(odometry.odometry.jumps.first_places, [3]);
    assert_eq!(report.topic("FLASER").unwrap().beam_count_changes.first_places, [5]);
}

#[test]
fn a_robot_that_drove_on_while_the_log_paused_has_not_jumped() {
    let log = "ODOM 0 0 0 0 0 0 1 h 1\nODOM 50 0 0 0 0 0 61 h 1\nODOM 90 0 0 0 0 0 62 h 1\n";
    let (_, report) = read(log.as_bytes());
    assert_eq!(report.topic("ODOM").unwrap().odometry.jumps.first_places, [3]);
}

#[test]
fn foreign_files_are_told_by_their_report() {
    let binary: Vec<u8> = (0..100_000_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    for log in [&b""[..], b"\n\n\n", b"<html></html>\n", &binary, &[0; 100_000]] {
        let (events, report) = read(log);
        assert!(events.is_empty() && !report.has_scans());
    }
}

#[test]
fn monstrous_lines_need_no_monstrous_memory() {
    let beams = "1.00 ".repeat(1_000_000);
    let log = format!("FLASER 1000000 {beams}\nODOM 0 0 0 0 0 0 1 h 1\n");
    let (events, report) = read(log.as_bytes());
    assert_eq!((events.len(), report.drops[&DropReason::BeamCount].count), (1, 1));
    let endless = std::io::repeat(b'7').take(100_000_000).chain(&b"\nODOM 0 0 0 0 0 0 1 h 1\n"[..]);
    let mut reader = CarmenReader::new(endless);
    assert!(matches!(reader.next_event(), Ok(Some(LogEvent::Odometry(_)))));
    let found = reader.report().drops[&DropReason::LineTooLong].first[0].to_string();
    assert!(found.starts_with("line 1: expected a line of at most 16 MiB, found 100000000 bytes"), "{found}");
}

#[test]
fn a_torn_log_is_read_up_to_the_tear() {
    use std::io::Write;
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    (0..2000).for_each(|i| writeln!(encoder, "ODOM {i} 0 0 0 0 0 {i}.5 host 0").unwrap());
    let log = encoder.finish().unwrap();
    let (events, report) = read(&log[..log.len() / 2]);
    assert!(events.len() > 500 && report.has_losses());
    let tear = report.tear.unwrap().to_string();
    assert!(tear.contains(&format!("torn at byte {}", log.len() / 2)), "{tear}");
}

fn written(events: &[Event]) -> Vec<u8> {
    let mut writer = CarmenWriter::new(Vec::new());
    writer.comment("made up\nODOM 1 2 3").unwrap();
    for event in events {
        match event {
            Event::Scan(scan) => writer.scan(scan).unwrap(),
            Event::Odometry(odometry) => writer.odometry(odometry).unwrap(),
        }
    }
    writer.finish().unwrap()
}

#[test]
fn what_is_written_reads_back_the_same() {
    let (events, _) = read(SMALL_LOG.as_bytes());
    let (again, report) = read(&written(&events));
    assert_eq!(again, events);
    assert!(!report.has_losses());
}

fn pose() -> impl Strategy<Value = Pose2> {
    (-1e5..1e5_f64, -1e5..1e5_f64, -3.1..3.1_f64).prop_map(|(x, y, theta)| Pose2::new(x, y, theta))
}

fn laser() -> impl Strategy<Value = Arc<LaserModel>> {
    let numbers = (-4.0..4.0_f64, -0.1..0.1_f64, 0.0..1.0_f64, 1.0..200.0_f64);
    let mount = (-2.0..2.0_f64, -2.0..2.0_f64, -3.1..3.1_f64);
    let name = prop::sample::select(vec!["FLASER", "ROBOTLASER1", "RLASER", "ROBOTLASER2"]);
    (numbers, mount, name, any::<bool>(), any::<bool>()).prop_map(|(n, m, name, conventional, inverted)| {
        let robot_laser = name.starts_with("ROBOT");
        let (angle_min_rad, angle_step_rad) =
            if conventional && !robot_laser { (-FRAC_PI_2, PI / 180.0) } else { (n.0, n.1) };
        Arc::new(LaserModel {
            name: name.to_owned(),
            angle_min_rad,
            angle_step_rad,
            range_min_m: n.2,
            range_max_m: n.3,
            robot_from_laser: Pose2::new(m.0, m.1, m.2),
            inverted,
            beam_period_s: n.2 * 1e-3,
        })
    })
}

fn range() -> impl Strategy<Value = f32> {
    prop_oneof![
        (0..10_000_u32).prop_map(|h| h as f32 / 100.0),
        -1e3..1e3_f32,
        Just(f32::INFINITY),
        any::<f32>().prop_filter("compares", |v| !v.is_nan())
    ]
}

fn any_scan() -> impl Strategy<Value = Event> {
    (any::<i64>(), laser(), prop::collection::vec(range(), 180), prop::option::of(pose())).prop_map(
        |(stamp, laser, ranges_m, odom_from_robot)| {
            Event::Scan(LaserScan { stamp: Stamp(stamp), laser, ranges_m, odom_from_robot })
        },
    )
}

fn any_odometry() -> impl Strategy<Value = Event> {
    (any::<i64>(), pose())
        .prop_map(|(stamp, odom_from_robot)| Event::Odometry(Odometry { stamp: Stamp(stamp), odom_from_robot }))
}

/// Names become tags; everything else has to be equal to the bit.
fn without_name(event: &Event) -> Event {
    match event {
        Event::Scan(scan) => {
            let laser = LaserModel { name: String::new(), ..(*scan.laser).clone() };
            Event::Scan(LaserScan { laser: Arc::new(laser), ..scan.clone() })
        }
        Event::Odometry(_) => event.clone(),
    }
}

proptest! {
    #[test]
    fn any_log_reads_back(events in prop::collection::vec(prop_oneof![any_scan(), any_odometry()], 0..12)) {
        let (again, report) = read(&written(&events));
        prop_assert!(!report.has_losses(), "{:?}", report.drops);
        let strip = |events: &[Event]| events.iter().map(without_name).collect::<Vec<_>>();
        prop_assert_eq!(strip(&again), strip(&events));
    }
}

/// SplitMix64 (Steele et al. 2014).
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) % limit.max(1) as u64) as usize
    }
}

/// Damages a log in one of five ways.
fn corrupt(log: &mut Vec<u8>, random: &mut Random) {
    let at = random.below(log.len());
    match random.below(5) {
        0 => log.truncate(at),
        1 => drop(log.drain(at..(at + random.below(200)).min(log.len()))),
        2 if !log.is_empty() => log[at] ^= 1 << random.below(8),
        3 => log.insert(at, random.below(256) as u8),
        _ => swap_lines(log, random),
    }
}

fn swap_lines(log: &mut Vec<u8>, random: &mut Random) {
    let mut lines: Vec<Vec<u8>> = log.split(|&b| b == b'\n').map(<[u8]>::to_vec).collect();
    let (a, b) = (random.below(lines.len()), random.below(lines.len()));
    lines.swap(a, b);
    *log = lines.join(&b'\n');
}

/// Reads a thousand damaged copies; whatever comes out must be usable.
fn survives_damage(log: &[u8], seed: u64) {
    let mut random = Random(seed);
    for _ in 0..1000 {
        let mut damaged = log.to_vec();
        for _ in 0..=random.below(8) {
            corrupt(&mut damaged, &mut random);
        }
        let mut reader = CarmenReader::new(open_log(damaged.as_slice()).unwrap());
        while let Some(event) = reader.next_event().unwrap() {
            let pose = match event {
                LogEvent::Scan(scan) => scan.odom_from_robot,
                LogEvent::Odometry(odometry) => Some(odometry.odom_from_robot),
                _ => None,
            };
            assert!(pose.is_none_or(|p| p.is_finite() && p.x.abs() <= 1e6 && p.y.abs() <= 1e6));
        }
    }
}

#[test]
fn a_thousand_damaged_copies_of_a_small_log_are_survived() {
    survives_damage(SMALL_LOG.as_bytes(), 1);
}

/// A file of the real data, or a remark that the test is skipped.
fn real(path: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data").join(path);
    if path.exists() {
        return Some(path);
    }
    println!("skipped: {} is not there", path.display());
    None
}

#[test]
fn a_thousand_damaged_copies_of_a_real_log_are_survived() {
    let Some(path) = real("2d_benchmark/intel.clf.bz2") else { return };
    let mut log = Vec::new();
    open_log(File::open(path).unwrap()).unwrap().take(2_000_000).read_to_end(&mut log).unwrap();
    survives_damage(&log, 2);
}

#[test]
fn the_intel_log_is_read_whole() {
    let Some(path) = real("2d_benchmark/intel.clf.bz2") else { return };
    let mut reader = CarmenReader::new(open_log(File::open(path).unwrap()).unwrap());
    let (mut path_m, mut last) = (0.0, None);
    while let Some(event) = reader.next_event().unwrap() {
        if let LogEvent::Scan(scan) = event {
            assert_eq!((scan.ranges_m.len(), scan.laser.range_max_m), (180, 80.0));
            path_m += last.zip(scan.odom_from_robot).map_or(0.0, |(a, b): (Pose2, _)| a.distance(b));
            last = scan.odom_from_robot;
        }
    }
    let report = reader.report();
    assert_eq!((report.scans, report.odometry, report.has_losses()), (13_631, 26_915, false));
    assert_eq!(report.topic("FLASER").unwrap().stamps.backward.count, 631);
    assert!((path_m - 508.4).abs() < 0.1, "{path_m}");
}

#[test]
fn the_freiburg_log_has_its_laser_behind_the_robots_origin() {
    let Some(path) = real("2d_benchmark/fr079.clf.bz2") else { return };
    let mut reader = CarmenReader::new(open_log(File::open(path).unwrap()).unwrap());
    while let Some(event) = reader.next_event().unwrap() {
        if let LogEvent::Scan(scan) = event {
            assert_eq!(scan.laser.robot_from_laser, Pose2::new(-0.04, 0.0, 0.0));
            assert_eq!(
                (scan.ranges_m.len(), scan.laser.angle_step_rad, scan.laser.range_max_m),
                (360, PI / 360.0, 80.99)
            );
        }
    }
    assert_eq!((reader.report().scans, reader.report().has_losses()), (4934, false));
}

/// A log of `RAWLASER1` lines between odometry, and with `ROBOTLASER1` lines of the same scans or without.
fn raw_log(scans: usize, with_poses: bool) -> String {
    let mut log = "PARAM robot_frontlaser_offset 0.1\n".to_owned();
    for k in 0..scans {
        let head = "0 -1.570796 3.141593 0.785398 30.0 0.01 0 5 1.0 2.0 3.0 2.0 1.0 0";
        log += &format!("ODOM {k} 0 0 0 0 0 {k}.1 host 0\nRAWLASER1 {head} {k}.2 host 0\n");
        if with_poses {
            log += &format!("ROBOTLASER1 {head} {k}.1 0 0 {k} 0 0 0 0 0 0 0 {k}.2 host 0\n");
        }
    }
    log
}

#[test]
fn raw_scans_are_read_unless_the_same_come_with_poses() {
    for scans in [1, 3, 200] {
        let (events, report) = read(raw_log(scans, false).as_bytes());
        assert_eq!((events.len(), report.scans, report.odometry), (2 * scans, scans as u64, scans as u64));
        assert!(!report.has_losses(), "{:?}", report.drops);
        for (k, pair) in events.chunks(2).enumerate() {
            let (Event::Odometry(odometry), Event::Scan(scan)) = (&pair[0], &pair[1]) else { panic!("{pair:?}") };
            assert_eq!((odometry.odom_from_robot.x, scan.odom_from_robot), (k as f64, None));
            assert_eq!(scan.laser.robot_from_laser.x, 0.1);
            assert_eq!((scan.ranges_m.len(), scan.laser.name.as_str()), (5, "RAWLASER1"));
        }
        let (events, report) = read(raw_log(scans, true).as_bytes());
        assert_eq!((events.len(), report.other_tags["RAWLASER1"]), (2 * scans, scans as u64));
        assert!(events.iter().all(|e| !matches!(e, Event::Scan(scan) if scan.odom_from_robot.is_none())));
    }
}

#[test]
fn the_field_of_view_counts_before_a_resolution_that_contradicts_it() {
    let scan = |fov: f64, step: f64| {
        let ranges = "1.00 ".repeat(181);
        let line =
            format!("ROBOTLASER1 0 -1.570796 {fov} {step} 81 0.01 0 181 {ranges}0 0 0 0 0 0 0 0 0 0 0 0 5.0 host 0\n");
        let (events, report) = read(line.repeat(3).as_bytes());
        let Event::Scan(scan) = &events[0] else { panic!("{events:?}") };
        let odd: Vec<_> = report.odd_heads.iter().map(|(words, noted)| (words.to_owned(), noted.count)).collect();
        (scan.laser.angle_step_rad.to_degrees(), odd)
    };
    let (step_deg, odd) = scan(PI, PI / 180.0);
    assert!((step_deg - 1.0).abs() < 1e-9 && odd.is_empty(), "{step_deg} {odd:?}");
    for step in [PI / 360.0, -PI / 180.0] {
        let (step_deg, odd) = scan(PI, step);
        assert!((step_deg - 1.0).abs() < 1e-6 && odd.len() == 1 && odd[0].1 == 3, "{step_deg} {odd:?}");
        assert!(odd[0].0.contains("the field of view says +90.0 deg"), "{odd:?}");
    }
    let (step_deg, odd) = scan(180.0, 1.0);
    assert!((step_deg - 1.0).abs() < 1e-9 && odd[0].0.contains("taken as degrees"), "{step_deg} {odd:?}");
}

#[test]
fn a_byte_order_mark_before_a_log_is_passed_over() {
    let (events, report) = read(b"\xEF\xBB\xBFFLASER 1 3.00 0 0 0 0 0 0 5.0 h 0\n");
    assert!(events.len() == 1 && !report.has_losses());
}
