//! Heads of scans that contradict themselves, ranges that are none: used where they can be, said, or refused in words.

use crate::support::{assert_code, assert_refused, folder, json, log_of, run, text};
use mapwright_bags::{Connection, Encoding, McapCompression, McapWriter};
use mapwright_geom::{Pose3, Stamp};
use mapwright_ros::messages::{Header, LaserEcho, LaserScan, MultiEchoLaserScan, Odometry};
use mapwright_ros::{Encoding as Layout, Field, encode};
use mapwright_sim::{Drive, DriveSettings, Event, worlds};
use std::fs::{self, File};
use std::path::Path;

/// What a driver makes of a scan.
type Driver<'a> = &'a dyn Fn(&mut LaserScan<'_>, &mut Vec<f32>);

const SECONDS: f64 = 15.0;

fn events() -> impl Iterator<Item = Event> {
    let settings = DriveSettings { duration_s: SECONDS, seed: 5, ..DriveSettings::default() };
    Drive::new(worlds::three_rooms(5).into(), settings)
}

fn later(stamp: Stamp) -> Stamp {
    Stamp(stamp.0 + 1_700_000_000_000_000_000)
}

fn write<'a>(writer: &mut McapWriter<File>, id: u32, stamp: Stamp, message: &impl Field<'a>) {
    writer.write(id, stamp, stamp, &encode(message, Layout::Cdr).unwrap()).unwrap();
}

/// The drive as an MCAP file, its scans as the driver has them; with echoes where it is asked for.
fn record(path: &Path, driver: Driver<'_>, echoes: bool) -> String {
    let mut writer = McapWriter::new(File::create(path).unwrap(), McapCompression::Zstd).unwrap();
    let kind = if echoes { "MultiEchoLaserScan" } else { "LaserScan" };
    let scans = Connection::new("/scan", format!("sensor_msgs/msg/{kind}"), Encoding::Cdr);
    let scans = writer.add_connection(&scans).unwrap();
    let odom = writer.add_connection(&Connection::new("/odom", "nav_msgs/msg/Odometry", Encoding::Cdr)).unwrap();
    for event in events() {
        match event {
            Event::Odometry(reading) => {
                let stamp = later(reading.stamp);
                let header = Header::new(stamp, "odom");
                let mut message = Odometry { header, child_frame_id: "base_link".into(), ..Default::default() };
                let pose = reading.odom_from_robot;
                message.pose.pose = Pose3 {
                    translation: [pose.x, pose.y, 0.0].into(),
                    rotation: nalgebra::UnitQuaternion::from_euler_angles(0.0, 0.0, pose.theta),
                }
                .into();
                write(&mut writer, odom, stamp, &message);
            }
            Event::Scan(scan) => {
                let (laser, mut ranges) = (&scan.scan.laser, scan.scan.ranges_m.clone());
                let stamp = later(scan.scan.stamp);
                let mut message = LaserScan {
                    header: Header::new(stamp, "laser"),
                    angle_min: laser.angle_min_rad as f32,
                    angle_max: (laser.angle_min_rad + laser.angle_step_rad * (ranges.len() - 1) as f64) as f32,
                    angle_increment: laser.angle_step_rad as f32,
                    range_min: laser.range_min_m as f32,
                    range_max: laser.range_max_m as f32,
                    ..Default::default()
                };
                driver(&mut message, &mut ranges);
                if echoes {
                    let both: Vec<[f32; 2]> = ranges.iter().map(|range| [*range, range + 3.0]).collect();
                    let ranges = both.iter().map(|both| LaserEcho { echoes: both[..].into() }).collect();
                    let LaserScan { header, angle_min, angle_max, angle_increment, range_min, range_max, .. } = message;
                    let message = MultiEchoLaserScan {
                        header,
                        angle_min,
                        angle_max,
                        angle_increment,
                        range_min,
                        range_max,
                        ranges,
                        ..Default::default()
                    };
                    write(&mut writer, scans, stamp, &message);
                } else {
                    message.ranges = ranges[..].into();
                    write(&mut writer, scans, stamp, &message);
                }
            }
        }
    }
    writer.finish().unwrap();
    path.display().to_string()
}

/// What is said of the log of a driver and what its trajectory is; it has to be mapped.
fn mapped(folder: &Path, name: &str, driver: Driver<'_>, more: &[&str]) -> (String, String) {
    let (log, out) = (record(&folder.join(name).with_extension("mcap"), driver, false), folder.join(name));
    let output = run(&[&["map", log.as_str(), "-o", out.to_str().unwrap()], more].concat());
    assert_code(&output, 0);
    (text(&output.stdout), fs::read_to_string(out.join("trajectory.tum")).unwrap())
}

#[test]
fn heads_that_contradict_themselves_are_mapped_like_sound_ones_and_said_once() {
    let folder = folder("odd_heads");
    let (said, sound) = mapped(&folder, "sound", &|_, _| {}, &[]);
    assert!(!said.contains("odd "), "{said}");
    let cases: [(&str, Driver<'_>, &str); 5] = [
        ("sign", &|scan, _| scan.angle_increment = -scan.angle_increment, "angle_max says +"),
        ("step", &|scan, _| scan.angle_increment *= 0.8, "angle_max says +"),
        ("unset", &|scan, _| scan.angle_max = 0.0, "angle_max says +0.0 deg"),
        ("times", &|scan, _| (scan.time_increment, scan.scan_time) = (1.4e5, 2e8), "nanoseconds?"),
        ("reach", &|scan, _| scan.range_max = 81_910.0, "the largest range is 81910 m"),
    ];
    for (name, driver, says) in cases {
        let (said, trajectory) = mapped(&folder, name, driver, &[]);
        assert_eq!(said.matches("odd ").count(), 1, "{name}: {said}");
        assert!(said.contains(says), "{name}: {said}");
        // steps of single precision and another step of ranges may differ in the last digits
        let (a, b) = (last_pose(&trajectory), last_pose(&sound));
        assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 0.02, "{name}: {a:?} {b:?}");
    }
    let (said, trajectory) = mapped(&folder, "no_limit", &|scan, _| scan.range_max = 0.0, &[]);
    assert!(said.contains("range_max is 0: not used, ranges count up to 80 m"), "{said}");
    let (a, b) = (last_pose(&trajectory), last_pose(&sound));
    assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 0.05, "{a:?} {b:?}");
}

fn last_pose(trajectory: &str) -> [f64; 2] {
    let words: Vec<f64> = trajectory.lines().last().unwrap().split(' ').map(|word| word.parse().unwrap()).collect();
    [words[1], words[2]]
}

#[test]
fn scans_that_say_nothing_are_refused_with_what_they_say() {
    let folder = folder("nothing_said");
    let cases: [(&str, Driver<'_>, &[&str]); 4] = [
        ("empty", &|_, ranges| ranges.clear(), &["a scan of `laser` with 0 beams"]),
        ("zero", &|_, ranges| ranges.fill(0.0), &["of which none can", "are 0, negative", "not one range can be used"]),
        ("nan", &|_, ranges| ranges.fill(f32::NAN), &["are no numbers", "not one range can be used"]),
        (
            "one_bearing",
            &|scan, _| (scan.angle_increment, scan.angle_max) = (0.0, scan.angle_min),
            &["the same bearing"],
        ),
    ];
    for (name, driver, says) in cases {
        let log = record(&folder.join(name).with_extension("mcap"), driver, false);
        let out = folder.join("out");
        assert_refused(&run(&["map", &log, "-o", out.to_str().unwrap()]), 1, says);
        assert!(!out.exists(), "{name}");
        let info = run(&["info", &log]);
        assert!(matches!(info.status.code(), Some(0 | 3)) && text(&info.stdout).contains("topic "), "{name}: {info:?}");
    }
}

#[test]
fn ranges_in_millimetres_are_named_and_mapped_when_the_unit_is_said() {
    let folder = folder("millimetres");
    let in_mm = |_: &mut LaserScan<'_>, ranges: &mut Vec<f32>| ranges.iter_mut().for_each(|range| *range *= 1e3);
    let all_in_mm = |scan: &mut LaserScan<'_>, ranges: &mut Vec<f32>| {
        in_mm(scan, ranges);
        (scan.range_min, scan.range_max) = (1e3 * scan.range_min, 1e3 * scan.range_max);
    };
    let (_, sound) = mapped(&folder, "metres", &|_, _| {}, &[]);
    for (name, driver) in [("ranges", &in_mm as Driver<'_>), ("all", &all_in_mm)] {
        let log = record(&folder.join(name).with_extension("mcap"), driver, false);
        let out = folder.join("out");
        let refused = run(&["map", &log, "-o", out.to_str().unwrap()]);
        assert_refused(&refused, 1, &["readings of up to ", "millimetres", "--range-unit 0.001"]);
        assert!(!out.exists());
        let (_, trajectory) = mapped(&folder, name, driver, &["--range-unit", "0.001"]);
        let (a, b) = (last_pose(&trajectory), last_pose(&sound));
        assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 0.02, "{name}: {a:?} {b:?}");
    }
}

#[test]
fn of_several_echoes_the_nearest_is_mapped_and_said() {
    let folder = folder("echoes");
    let (_, sound) = mapped(&folder, "one", &|_, _| {}, &[]);
    let (log, out) = (record(&folder.join("two.mcap"), &|_, _| {}, true), folder.join("two"));
    let output = run(&["map", &log, "-o", out.to_str().unwrap()]);
    assert_code(&output, 0);
    assert!(text(&output.stdout).contains("of up to 2 echoes, of which the nearest counts"), "{output:?}");
    let trajectory = fs::read_to_string(out.join("trajectory.tum")).unwrap();
    let (a, b) = (last_pose(&trajectory), last_pose(&sound));
    assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 0.02, "{a:?} {b:?}");
}

#[test]
fn a_carmen_log_is_judged_by_the_same_rules() {
    let folder = folder("odd_carmen");
    let text_of = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    let log = text_of(log_of(events()));
    let map = |name: &str, log: &str| {
        let (path, out) = (folder.join(name).with_extension("clf"), folder.join(name));
        fs::write(&path, log).unwrap();
        (run(&["map", path.to_str().unwrap(), "-o", out.to_str().unwrap()]), out)
    };
    // each range of a line times something
    let scaled = |factor: f64| -> String {
        let line = |line: &str| {
            let mut words: Vec<String> = line.split(' ').map(str::to_owned).collect();
            if words[0] == "ROBOTLASER1" {
                // type, angles, limits and modes stand before the number of beams
                let beams: usize = words[8].parse().unwrap();
                words[9..9 + beams]
                    .iter_mut()
                    .for_each(|word| *word = (factor * word.parse::<f64>().unwrap()).to_string());
            }
            words.join(" ")
        };
        log.lines().map(line).collect::<Vec<_>>().join("\n") + "\n"
    };
    assert!(log.contains("\nROBOTLASER1 "), "{}", &log[..200]);
    assert_refused(&map("mm", &scaled(1e3)).0, 1, &["millimetres", "--range-unit 0.001"]);
    assert_refused(&map("zero", &scaled(0.0)).0, 1, &["of which none can", "are 0, negative"]);
    let (sound, out) = map("sound", &log);
    assert_code(&sound, 0);
    assert_eq!(json(&out.join("report.json"))["read"]["ranges"]["blank"]["count"], 0);
}

#[test]
fn what_a_log_has_no_use_for_is_not_ignored() {
    let folder = folder("no_use");
    let carmen = folder.join("a.clf");
    fs::write(&carmen, log_of(events().take(30))).unwrap();
    let (carmen, out) = (carmen.display().to_string(), folder.join("out").display().to_string());
    for more in [["--topic", "/scan"], ["--frame", "base_link"], ["--slice", "0.1:1"]] {
        let output = run(&[&["map", carmen.as_str(), "-o", out.as_str()], &more[..]].concat());
        assert_refused(&output, 1, &[more[0], "found a CARMEN log"]);
    }
    let log = record(&folder.join("scans.mcap"), &|_, _| {}, false);
    let output = run(&["map", &log, "-o", &out, "--slice", "0.1:1"]);
    assert_refused(&output, 1, &["--slice makes scans of point clouds", "/scan"]);
    assert!(!Path::new(&out).exists());
}
