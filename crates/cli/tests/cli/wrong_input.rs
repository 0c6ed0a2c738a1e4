//! What recordings say wrongly: odometry, mountings, clocks and robots that are not what they seem, each in several formats.

use crate::support::{apart_m, assert_code, assert_refused, folder, json, map, poses, run, text};
use mapwright_bags::{
    Bag1Compression, Bag1Writer, Connection, DefinitionFormat, Encoding, McapCompression, McapWriter,
};
use mapwright_formats::CarmenWriter;
use mapwright_geom::{Pose2, Pose3, Stamp};
use mapwright_ros::messages::{Header, LaserScan, Odometry, TfMessage, Transform, TransformStamped};
use mapwright_ros::{Encoding as Layout, Field, builtin, encode};
use mapwright_sensor::{LaserModel, LaserScan as Scan, Odometry as Reading};
use mapwright_sim::{Drive, DriveSettings, Event, worlds};
use std::fs::File;
use std::path::Path;
use std::process::Output;
use std::sync::Arc;

const EPOCH_NS: i64 = 1_700_000_000_000_000_000;
const SECONDS: f64 = 40.0;
/// Where the laser sits.
const MOUNT_X_M: f64 = 0.2;

#[derive(Clone)]
enum What {
    Scan(Scan),
    Odometry(Pose2),
    Link(&'static str, &'static str, Pose3),
}

#[derive(Clone)]
struct Message {
    topic: String,
    recorded: Stamp,
    stamp: Stamp,
    what: What,
}

fn at_s(seconds: f64) -> Stamp {
    Stamp(EPOCH_NS + Stamp::from_secs_f64(seconds).0)
}

fn lifted(pose: Pose2) -> Pose3 {
    let (sin, cos) = (0.5 * pose.theta).sin_cos();
    Pose3::from_quaternion([pose.x, pose.y, 0.0], [0.0, 0.0, sin, cos]).unwrap()
}

fn mounting(x: f64) -> Pose3 {
    lifted(Pose2::new(x, 0.0, 0.0))
}

/// A drive through three rooms, as it was: each message recorded 10 ms after its stamp, the mounting first.
fn drive(seed: u64) -> Vec<Message> {
    let mut settings = DriveSettings { duration_s: SECONDS, seed, ..DriveSettings::default() };
    let robot_from_laser = Pose2::new(MOUNT_X_M, 0.0, 0.0);
    settings.laser.model = Arc::new(LaserModel { robot_from_laser, ..(*settings.laser.model).clone() });
    let message = |topic: &str, stamp: Stamp, what| {
        let stamp = Stamp(EPOCH_NS + stamp.0);
        Message { topic: topic.to_owned(), recorded: Stamp(stamp.0 + 10_000_000), stamp, what }
    };
    let mounted = message("/tf_static", Stamp(0), What::Link("base_link", "laser", mounting(MOUNT_X_M)));
    let driven = Drive::new(worlds::three_rooms(seed).into(), settings).map(|event| match event {
        Event::Odometry(Reading { stamp, odom_from_robot }) => message("/odom", stamp, What::Odometry(odom_from_robot)),
        Event::Scan(scan) => message("/scan", scan.scan.stamp, What::Scan(scan.scan)),
    });
    std::iter::once(mounted).chain(driven).collect()
}

/// The same with other odometry, that of the scans of a CARMEN log as well.
fn with_odometry(mut log: Vec<Message>, other: impl Fn(Stamp, Pose2) -> Pose2) -> Vec<Message> {
    for message in &mut log {
        match &mut message.what {
            What::Odometry(pose) => *pose = other(message.stamp, *pose),
            What::Scan(scan) => scan.odom_from_robot = scan.odom_from_robot.map(|pose| other(message.stamp, pose)),
            What::Link(..) => {}
        }
    }
    log
}

enum Container {
    Bag(Box<Bag1Writer<File>>),
    Mcap(Box<McapWriter<File>>),
}

struct Recorder {
    container: Container,
    topics: Vec<(String, u32)>,
}

impl Recorder {
    fn write<'a>(&mut self, topic: &str, kind: &str, at: (Stamp, Stamp), message: &impl Field<'a>) {
        let layout = if matches!(self.container, Container::Bag(_)) { Layout::Ros1 } else { Layout::Cdr };
        let known = self.topics.iter().find(|(name, _)| name == topic).map(|(_, id)| *id);
        let id = known.unwrap_or_else(|| {
            let id = self.add(topic, kind);
            self.topics.push((topic.to_owned(), id));
            id
        });
        let data = encode(message, layout).unwrap();
        match &mut self.container {
            Container::Bag(writer) => writer.write(id, at.0, &data).unwrap(),
            Container::Mcap(writer) => writer.write(id, at.0, at.1, &data).unwrap(),
        }
    }

    fn add(&mut self, topic: &str, kind: &str) -> u32 {
        match &mut self.container {
            Container::Bag(writer) => {
                let name = kind.replace("/msg/", "/");
                let text = builtin::text(kind, Layout::Ros1).unwrap();
                let md5sum = builtin::definition(kind, Layout::Ros1).unwrap().md5sum().unwrap();
                let connection = Connection::new(topic, name.as_str(), Encoding::Ros1)
                    .with_definition(DefinitionFormat::Ros1Msg, &text)
                    .with_metadata("md5sum", md5sum);
                writer.add_connection(&connection).unwrap()
            }
            Container::Mcap(writer) => writer.add_connection(&Connection::new(topic, kind, Encoding::Cdr)).unwrap(),
        }
    }

    fn message(&mut self, message: &Message) {
        let Message { topic, stamp, .. } = message;
        let at = (message.recorded, *stamp);
        match &message.what {
            What::Scan(scan) => {
                let laser = &scan.laser;
                let header = Header::new(*stamp, "laser");
                let said = LaserScan {
                    header,
                    angle_min: laser.angle_min_rad as f32,
                    angle_increment: laser.angle_step_rad as f32,
                    range_min: laser.range_min_m as f32,
                    range_max: laser.range_max_m as f32,
                    ranges: scan.ranges_m[..].into(),
                    ..Default::default()
                };
                self.write(topic, "sensor_msgs/msg/LaserScan", at, &said);
            }
            What::Odometry(pose) => {
                let header = Header::new(*stamp, "odom");
                let mut said = Odometry { header, child_frame_id: "base_link".into(), ..Default::default() };
                said.pose.pose = lifted(*pose).into();
                self.write(topic, "nav_msgs/msg/Odometry", at, &said);
            }
            What::Link(parent, child, pose) => {
                let (header, transform) = (Header::new(*stamp, parent), Transform::from(*pose));
                let transforms = vec![TransformStamped { header, child_frame_id: (*child).into(), transform }];
                self.write(topic, "tf2_msgs/msg/TFMessage", at, &TfMessage { transforms });
            }
        }
    }
}

/// Writes the messages in the order in which they were recorded, in the format that the name asks for.
fn write(log: &[Message], path: &Path) -> String {
    let mut container = match path.extension().and_then(|ending| ending.to_str()) {
        Some("bag") => {
            Container::Bag(Box::new(Bag1Writer::new(File::create(path).unwrap(), Bag1Compression::None).unwrap()))
        }
        Some("mcap") => {
            Container::Mcap(Box::new(McapWriter::new(File::create(path).unwrap(), McapCompression::None).unwrap()))
        }
        _ => return write_carmen(log, path),
    };
    let mut recorder = Recorder { container, topics: Vec::new() };
    log.iter().for_each(|message| recorder.message(message));
    container = recorder.container;
    match container {
        Container::Bag(writer) => drop(writer.finish().unwrap()),
        Container::Mcap(writer) => drop(writer.finish().unwrap()),
    }
    path.display().to_string()
}

fn write_carmen(log: &[Message], path: &Path) -> String {
    let mut writer = CarmenWriter::new(File::create(path).unwrap());
    for Message { stamp, what, .. } in log {
        match what {
            What::Scan(scan) => writer.scan(&Scan { stamp: *stamp, ..scan.clone() }).unwrap(),
            What::Odometry(pose) => writer.odometry(&Reading { stamp: *stamp, odom_from_robot: *pose }).unwrap(),
            What::Link(..) => {}
        }
    }
    drop(writer.finish().unwrap());
    path.display().to_string()
}

fn assert_says(output: &Output, says: &[&str]) {
    let said = text(&output.stdout);
    says.iter().for_each(|what| assert!(said.contains(what), "expected {what:?}, found {said}"));
    assert!(!said.contains(" -0.") && !said.contains("before any"), "{said}");
}

/// Maps the log and the one that it should be, in one format; the outputs, and how far the two trajectories are apart.
fn beside(clean: &[Message], log: &[Message], folder: &Path, ending: &str, code: i32, more: &[&str]) -> (Output, f64) {
    let [out, reference] = ["out", "reference"].map(|name| folder.join(format!("{name}_{ending}")));
    let clean = write(clean, &folder.join(format!("clean.{ending}")));
    assert_code(&map(&clean, &reference, &["--quiet"]), 0);
    let log = write(log, &folder.join(format!("log.{ending}")));
    let output = map(&log, &out, more);
    assert_code(&output, code);
    (output, apart_m(&out, &reference))
}

#[test]
fn odometry_that_begins_anew_goes_on_from_there() {
    let (folder, clean) = (folder("begins_anew"), drive(5));
    let poses = clean.iter().filter_map(|message| match message.what {
        What::Odometry(pose) if message.stamp > at_s(10.0) => Some((message.stamp, pose)),
        _ => None,
    });
    let far = |pose: &Pose2| pose.x.hypot(pose.y);
    let (since, origin) = poses.max_by(|a, b| far(&a.1).total_cmp(&far(&b.1))).unwrap();
    assert!(far(&origin) > 3.0, "{origin:?}");
    let log = with_odometry(clean.clone(), |at, pose| if at >= since { origin.between(pose) } else { pose });
    for ending in ["bag", "mcap", "clf"] {
        let (output, apart_m) = beside(&clean, &log, &folder, ending, 0, &[]);
        assert_says(&output, &[&format!("begins anew at {:.3}", since.as_secs_f64())]);
        assert_eq!(text(&output.stdout).matches("begins anew").count(), 1);
        assert!(apart_m < 0.05, "{ending}: {apart_m} m");
    }
}

#[test]
fn odometry_in_coordinates_of_utm_is_used_from_its_first_reading_on() {
    let (folder, clean) = (folder("utm"), drive(5));
    let log = with_odometry(clean.clone(), |_, pose| Pose2::new(pose.x + 448_264.5, pose.y + 5_411_932.25, pose.theta));
    for ending in ["bag", "mcap"] {
        let (output, apart_m) = beside(&clean, &log, &folder, ending, 0, &[]);
        assert_says(&output, &["(448264.50, 5411932.25) m is subtracted"]);
        assert!(apart_m < 1e-4, "{ending}: {apart_m} m");
        let info = run(&["info", &folder.join(format!("log.{ending}")).display().to_string()]);
        assert_says(&info, &["is subtracted"]);
    }
}

#[test]
fn odometry_that_never_moves_is_none() {
    let (folder, clean) = (folder("fake"), drive(5));
    let still = with_odometry(clean.clone(), |_, _| Pose2::IDENTITY);
    let mut link = still.clone();
    for message in &mut link {
        if let What::Odometry(_) = message.what {
            (message.topic, message.what) = ("/tf".to_owned(), What::Link("odom", "base_link", Pose3::identity()));
        }
    }
    for (log, ending, says) in [
        (&still, "bag", "none: /odom never moves"),
        (&link, "mcap", "none: 'odom' -> 'base_link' never moves"),
        (&still, "clf", "odometry never moves, though what is seen does"),
    ] {
        let out = |name: &str| folder.join(format!("{name}_{ending}"));
        let output = map(&write(log, &folder.join(format!("log.{ending}"))), &out("out"), &[]);
        assert_code(&output, 0);
        assert_says(&output, &[says]);
        let without = write(&clean, &folder.join(format!("clean.{ending}")));
        assert_code(&map(&without, &out("without"), &["--no-odometry", "--quiet"]), 0);
        assert!(apart_m(&out("out"), &out("without")) == 0.0, "{ending}");
    }
}

#[test]
fn a_robot_that_stands_has_odometry() {
    let (folder, clean) = (folder("stands"), drive(5));
    let first = clean.iter().find_map(|message| match &message.what {
        What::Scan(scan) => Some(scan.clone()),
        _ => None,
    });
    let first = first.unwrap();
    let mut standing = with_odometry(clean.clone(), |_, _| Pose2::IDENTITY);
    for message in &mut standing {
        if let What::Scan(scan) = &mut message.what {
            scan.ranges_m.clone_from(&first.ranges_m);
            scan.ranges_m.iter_mut().enumerate().for_each(|(k, range_m)| {
                *range_m += 0.01 * ((k as i64 + message.stamp.0 / 100_000_000) % 5 - 2) as f32;
            });
        }
    }
    let mut late = standing.clone();
    let shift = Stamp::from_secs_f64(SECONDS).0;
    late.extend(clean.iter().cloned().map(|message| Message {
        stamp: Stamp(message.stamp.0 + shift),
        recorded: Stamp(message.recorded.0 + shift),
        ..message
    }));
    for ending in ["bag", "mcap", "clf"] {
        for (name, log) in [("standing", &standing), ("late", &late)] {
            let out = folder.join(format!("{name}_{ending}"));
            let output = map(&write(log, &folder.join(format!("{name}.{ending}"))), &out, &[]);
            assert_code(&output, 0);
            assert!(!text(&output.stdout).contains("never moves"), "{name}.{ending}");
            let standing = poses(&out).len().min(300);
            let farthest_m = poses(&out)[..standing].iter().map(|pose| pose[1].hypot(pose[2])).fold(0.0, f64::max);
            assert!(farthest_m < 0.01, "{name}.{ending}: {farthest_m} m");
        }
    }
}

#[test]
fn a_laser_upside_down_that_is_said_to_be_upright_is_told_and_put_right_by_hand() {
    let (folder, clean) = (folder("mirrored"), drive(5));
    let mut log = clean.clone();
    for message in &mut log {
        if let What::Scan(scan) = &mut message.what {
            let last_rad = scan.laser.angle_min_rad + scan.laser.angle_step_rad * (scan.ranges_m.len() - 1) as f64;
            let seen = LaserModel { angle_min_rad: -last_rad, ..(*scan.laser).clone() };
            scan.laser = seen.into();
            scan.ranges_m.reverse();
        }
    }
    let by_hand = format!("{MOUNT_X_M},0,0,flipped");
    for ending in ["bag", "mcap", "clf"] {
        let path = folder.join(format!("log.{ending}"));
        let out = folder.join(format!("told_{ending}"));
        let output = map(&write(&log, &path), &out, &[]);
        assert_code(&output, 3);
        let said = "scans turn the other way than odometry";
        assert_says(&output, &[said, "upside down", "--mount", ",flipped"]);
        assert_refused(&run(&["calibrate", path.to_str().unwrap()]), 1, &[said, ",flipped"]);
        if ending != "clf" {
            let (output, apart_m) = beside(&clean, &log, &folder, ending, 0, &["--mount", &by_hand]);
            assert_says(&output, &["x 0.200 m, y 0.000 m, yaw 0.0 deg, upside down", "as asked for"]);
            assert!(apart_m < 1e-3, "{ending}: {apart_m} m");
        }
    }
    // a CARMEN log cannot say that the field of view is not that of its parameters: an even one is its own mirror image
    let mount = ["--mount", "0.2,0,0,flipped"];
    let (_, apart_m) = beside(&clean, &log, &folder, "clf", 0, &mount);
    assert!(apart_m < 0.1, "{apart_m} m");
}

#[test]
fn a_mounting_that_jitters_is_kept_and_one_that_moves_is_refused_with_the_remedy() {
    let (folder, clean) = (folder("jitter"), drive(5));
    let moving = |by_m: f64| {
        let mut log = Vec::new();
        for message in clean.iter().filter(|message| !matches!(message.what, What::Link(..))).cloned() {
            if let What::Odometry(_) = message.what {
                let step = (message.stamp.0 / 50_000_000 % 3 - 1) as f64;
                let what = What::Link("base_link", "laser", mounting(MOUNT_X_M + by_m * step));
                log.push(Message { topic: "/tf".to_owned(), what, ..message.clone() });
            }
            log.push(message);
        }
        log
    };
    for ending in ["bag", "mcap"] {
        let (output, apart_m) = beside(&clean, &moving(0.005), &folder, ending, 0, &[]);
        assert_says(&output, &["x 0.200 m", "'laser' moves in 'base_link' by up to 0.0", "its median"]);
        assert!(apart_m < 1e-3, "{ending}: {apart_m} m");
        let moves = write(&moving(0.1), &folder.join(format!("moves.{ending}")));
        let refused = map(&moves, &folder.join("refused"), &[]);
        assert_refused(&refused, 1, &["'laser' moves on the robot", "--frame laser", "--mount X,Y,YAW"]);
        let (_, apart_m) = beside(&clean, &moving(0.1), &folder, ending, 0, &["--mount", "0.2,0,0"]);
        assert!(apart_m < 1e-3, "{ending}: {apart_m} m");
    }
}

#[test]
fn two_robots_in_one_recording_are_told_apart() {
    let folder = folder("two_robots");
    let of = |name: &str, seed: u64, mount_x_m: f64| -> Vec<Message> {
        let mut log = drive(seed);
        for message in &mut log {
            message.topic = format!("/{name}{}", message.topic);
            if let What::Link(_, _, pose) = &mut message.what {
                *pose = mounting(mount_x_m);
            }
        }
        log
    };
    let (one, two) = (of("one", 5, MOUNT_X_M), of("two", 6, 0.3));
    let mut both = [one.clone(), two.clone()].concat();
    both.sort_by_key(|message| message.recorded);
    for ending in ["bag", "mcap"] {
        let log = write(&both, &folder.join(format!("both.{ending}")));
        let lists = ["2 robots in one recording", "one (/one/scan", "two (/two/scan", "--robot one", "mapwright merge"];
        assert_refused(&map(&log, &folder.join("none"), &[]), 1, &lists);
        assert_refused(&map(&log, &folder.join("none"), &["--robot", "three"]), 1, &["no robot three", "/two/scan"]);
        assert!(!folder.join("none").exists());
        assert_says(&run(&["info", &log]), &["no map", "--robot one"]);
        for (name, alone, x) in [("one", &one, "x 0.200 m"), ("two", &two, "x 0.300 m")] {
            let out = |what: &str| folder.join(format!("{what}_{name}_{ending}"));
            let alone = write(alone, &folder.join(format!("{name}.{ending}")));
            assert_code(&map(&alone, &out("alone"), &["--quiet"]), 0);
            for (how, asked) in [("robot", ["--robot", name]), ("topic", ["--topic", &format!("/{name}/scan")])] {
                let output = map(&log, &out(how), &asked);
                assert_code(&output, 0);
                assert_says(&output, &[&format!("/{name}/odom"), x]);
                assert!(apart_m(&out(how), &out("alone")) == 0.0, "{ending} {name} {how}");
            }
        }
        let out = folder.join(format!("merged_{ending}"));
        let merged = run(&["merge", &log, "-o", out.to_str().unwrap()]);
        assert!(matches!(merged.status.code(), Some(0 | 3)), "{}", text(&merged.stderr));
        let parts = json(&out.join("report.json"))["parts"].as_array().unwrap().len();
        assert_eq!((parts, poses(&out).len()), (2, poses(&folder.join(format!("alone_one_{ending}"))).len() * 2));
    }
}

#[test]
fn clocks_that_are_set_or_differ_and_scans_that_are_late_leave_the_trajectory_as_it_is() {
    let (folder, clean) = (folder("clocks"), drive(5));
    let later = |stamp: Stamp, s: f64| Stamp(stamp.0 + Stamp::from_secs_f64(s).0);
    let set = |who: &str, by_s: f64, after_s: f64, recorder: bool| -> Vec<Message> {
        let mut log = clean.clone();
        for message in log.iter_mut().filter(|message| message.stamp >= at_s(after_s)) {
            if who.is_empty() || message.topic == who {
                message.stamp = later(message.stamp, by_s);
            }
            if recorder {
                message.recorded = later(message.recorded, by_s);
            }
        }
        log
    };
    let late = || {
        let mut log = clean.clone();
        log.iter_mut().filter(|message| message.topic == "/scan").for_each(|message| {
            message.recorded = later(message.recorded, 5.0);
        });
        log.sort_by_key(|message| message.recorded);
        log
    };
    let at_random = || {
        let mut log = clean.clone();
        for (at, scan) in log.iter_mut().filter(|message| message.topic == "/scan").enumerate() {
            scan.recorded = later(scan.recorded, 1.9 * (at * at * 7919 % 101) as f64 / 101.0);
        }
        log.sort_by_key(|message| message.recorded);
        log
    };
    let set_says = |what: &str| vec!["the clock of".to_owned(), what.to_owned()];
    for ending in ["bag", "mcap"] {
        for (name, log, says) in [
            ("all_back", set("", -3600.0, 20.0, true), set_says("was set back by 36")),
            ("all_back_a_little", set("", -5.0, 20.0, true), set_says("was set back by 5")),
            ("scans_back", set("/scan", -7.0, 20.0, false), set_says("of /scan was set back by 7.0 s")),
            ("scans_back_a_little", set("/scan", -3.0, 20.0, false), set_says("of /scan was set back by 3.0 s")),
            ("odometry_back_a_little", set("/odom", -1.5, 20.0, false), set_says("of /odom was set back by 1.5 s")),
            ("odometry_back", set("/odom", -10_800.0, 20.0, false), set_says("of /odom was set back by 10800.0 s")),
            ("another_zone", set("/scan", 10_800.0, 0.0, false), set_says("10800.0 s ahead of the other")),
            ("late", late(), vec![]),
            ("late_at_random", at_random(), vec!["recorded in another order than they were taken in".to_owned()]),
        ] {
            let (output, apart_m) = beside(&clean, &log, &folder, ending, 0, &[]);
            assert_says(&output, &says.iter().map(String::as_str).collect::<Vec<_>>());
            assert!(apart_m < 0.03, "{name}.{ending}: {apart_m} m\n{}", text(&output.stdout));
            assert!(!text(&output.stdout).contains("without odometry"), "{name}: {}", text(&output.stdout));
        }
    }
    // a step ahead looks like a pause: where it is a break, what comes after is a piece of its own, honestly
    for (name, ending, log) in [
        ("all_ahead", "bag", set("", 60.0, 20.0, true)),
        ("scans_ahead", "mcap", set("/scan", 3600.0, 20.0, false)),
        ("all_ahead", "clf", set("", 60.0, 20.0, true)),
    ] {
        let log = write(&log, &folder.join(format!("{name}.{ending}")));
        let output = map(&log, &folder.join(format!("{name}_{ending}")), &[]);
        let said = text(&output.stdout);
        let is_apart = said.contains("nothing joins");
        assert_code(&output, if is_apart { 3 } else { 0 });
        let far_m = apart_m(&folder.join(format!("{name}_{ending}")), &folder.join(format!("reference_{}", "bag")));
        assert!(is_apart || far_m < 0.03, "{name}.{ending}: {far_m} m\n{said}");
        assert!(!said.contains("without odometry") && (name == "all_ahead" || said.contains("set ahead by 3600.0 s")));
    }
    for log in [set("", -3600.0, 20.0, true), at_random()] {
        let (_, apart_m) = beside(&clean, &log, &folder, "clf", 0, &[]);
        assert!(apart_m < 0.03, "{apart_m} m");
    }
}
