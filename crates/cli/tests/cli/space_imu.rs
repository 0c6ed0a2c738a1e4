//! Recordings of a lidar and an inertial sensor, mapped in space.

use crate::support::{assert_code, folder, json, run, text};
use mapwright_bags::{
    Bag1Compression, Bag1Writer, Connection, DefinitionFormat, Encoding, McapCompression, McapWriter,
};
use mapwright_geom::{Pose3, Stamp};
use mapwright_ros::messages::{Header, Imu, PointCloud2, PointField, TfMessage, Transform, TransformStamped};
use mapwright_ros::{Encoding as Layout, Field, builtin, encode};
use mapwright_sensor::{Cloud, ImuReading};
use mapwright_sim::RobotSettings;
use mapwright_sim::space::{LidarSettings, SpaceDrive, SpaceDriveSettings, worlds};
use std::fmt::Write;
use std::fs::{self, File};
use std::path::Path;

/// A file being written; topics are added when they are first used.
enum Writer {
    Bag(Box<Bag1Writer<File>>),
    Mcap(Box<McapWriter<File>>),
}

pub(super) struct Recorder {
    writer: Writer,
    topics: Vec<(&'static str, u32)>,
}

impl Recorder {
    pub(super) fn new(path: &Path) -> Self {
        let file = File::create(path).unwrap();
        let writer = if path.extension().is_some_and(|ending| ending == "bag") {
            Writer::Bag(Box::new(Bag1Writer::new(file, Bag1Compression::None).unwrap()))
        } else {
            Writer::Mcap(Box::new(McapWriter::new(file, McapCompression::None).unwrap()))
        };
        Self { writer, topics: Vec::new() }
    }

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
                writer.add_connection(&connection.with_definition(DefinitionFormat::Ros1Msg, &definition)).unwrap()
            }
            Writer::Mcap(writer) => {
                let kind = kind.replace('/', "/msg/");
                writer.add_connection(&Connection::new(topic, kind, Encoding::Cdr)).unwrap()
            }
        }
    }

    pub(super) fn mount(&mut self, child: &str, robot_from_child: Pose3) {
        let header = Header::new(Stamp(BEGAN_NS), "base_link");
        let transform = Transform::from(robot_from_child);
        let transforms = vec![TransformStamped { header, child_frame_id: child.into(), transform }];
        self.write("/tf_static", "tf2_msgs/TFMessage", Stamp(BEGAN_NS), &TfMessage { transforms });
    }

    pub(super) fn cloud(&mut self, cloud: &Cloud) {
        let points = cloud.points_m.iter().zip(&cloud.times_s);
        let data = points.flat_map(|([x, y, z], time_s)| [*x, *y, *z, *time_s]).flat_map(f32::to_le_bytes);
        let data: Vec<u8> = data.collect();
        let field = |name: &'static str, offset| PointField { name: name.into(), offset, datatype: 7, count: 1 };
        let message = PointCloud2 {
            header: Header::new(later(cloud.stamp), "lidar"),
            height: 1,
            width: cloud.points_m.len() as u32,
            fields: vec![field("x", 0), field("y", 4), field("z", 8), field("time", 12)],
            point_step: 16,
            row_step: data.len() as u32,
            data: &data,
            ..Default::default()
        };
        // recorded when it was complete
        self.write("/points", "sensor_msgs/PointCloud2", later(Stamp(cloud.stamp.0 + 100_000_000)), &message);
    }

    fn imu(&mut self, reading: &ImuReading, robot_from_imu: Pose3) {
        self.late_imu(reading, robot_from_imu, 0.0);
    }

    /// Recorded when it was read; its stamp is so much later, seconds.
    pub(super) fn late_imu(&mut self, reading: &ImuReading, robot_from_imu: Pose3, late_s: f64) {
        let stamp = Stamp(later(reading.stamp).0 + Stamp::from_secs_f64(late_s).0);
        let mut imu = Imu { header: Header::new(stamp, "imu"), ..Default::default() };
        let back = robot_from_imu.rotation.inverse();
        let (rate, force) = (back * reading.turn_rate_rad_per_s, back * reading.specific_force_m_per_s2.unwrap());
        (imu.angular_velocity.x, imu.angular_velocity.y, imu.angular_velocity.z) = (rate.x, rate.y, rate.z);
        (imu.linear_acceleration.x, imu.linear_acceleration.y, imu.linear_acceleration.z) = (force.x, force.y, force.z);
        self.write("/imu", "sensor_msgs/Imu", later(reading.stamp), &imu);
    }

    /// Where the robot is by its wheels.
    pub(super) fn wheels(&mut self, stamp: Stamp, odom_from_robot: Pose3) {
        let header = Header::new(later(stamp), "odom");
        let transform = Transform::from(odom_from_robot);
        let transforms = vec![TransformStamped { header, child_frame_id: "base_link".into(), transform }];
        self.write("/tf", "tf2_msgs/TFMessage", later(stamp), &TfMessage { transforms });
    }

    pub(super) fn finish(self) {
        match self.writer {
            Writer::Bag(writer) => drop(writer.finish().unwrap()),
            Writer::Mcap(writer) => drop(writer.finish().unwrap()),
        }
    }
}

const BEGAN_NS: i64 = 1_000_000_000_000;

fn later(stamp: Stamp) -> Stamp {
    Stamp(BEGAN_NS + stamp.0)
}

/// Every fourth cloud of a drive that turns fast; what was read is recorded when it was, a cloud when it was complete. The truth is
/// returned as lines of a trajectory.
fn record(path: &Path, with_imu: bool) -> String {
    record_part(path, with_imu, 0..usize::MAX)
}

/// Of those clouds these, with what was read since the one before.
pub(super) fn record_part(path: &Path, with_imu: bool, clouds: std::ops::Range<usize>) -> String {
    let usual = SpaceDriveSettings::default();
    let settings = SpaceDriveSettings {
        lidar: LidarSettings { columns: 240, ..LidarSettings::spinning(16) },
        robot: RobotSettings { turn_rate_rad_per_s: 2.4, ..usual.robot.clone() },
        seed: 1,
        duration_s: 24.0,
        ..usual
    };
    let drive = SpaceDrive::new(worlds::two_storey(1).into(), settings.clone());
    let mut recorder = Recorder::new(path);
    let lying = Pose3::from_quaternion([0.1, 0.0, 0.3], [0.5, 0.5, -0.5, 0.5]).unwrap();
    recorder.mount("lidar", settings.lidar.sensor.robot_from_sensor);
    recorder.mount("imu", lying);
    let mut readings = drive.imu_readings().peekable();
    let mut truth = String::new();
    for (number, taken) in drive.clouds().step_by(4).enumerate().take_while(|(number, _)| *number < clouds.end) {
        let end = Stamp(taken.cloud.stamp.0 + 100_000_000);
        let is_recorded = number >= clouds.start;
        while let Some(reading) = readings.next_if(|reading| with_imu && reading.stamp <= end) {
            if is_recorded {
                recorder.imu(&reading, lying);
            }
        }
        if !is_recorded {
            continue;
        }
        recorder.cloud(&taken.cloud);
        let (at, [x, y, z, w]) = (taken.world_from_robot.translation, taken.world_from_robot.rotation.coords.into());
        let seconds = later(taken.cloud.stamp).as_secs_f64();
        writeln!(truth, "{seconds:.6} {} {} {} {x} {y} {z} {w}", at.x, at.y, at.z).unwrap();
    }
    recorder.finish();
    truth
}

#[test]
fn a_bag_with_an_inertial_sensor_is_mapped_no_worse_than_one_without() {
    let folder = folder("space_imu");
    let mapped = |name: &str, with_imu: bool| {
        let (log, out) = (folder.join(name), folder.join(format!("{name}.out")));
        let truth = record(&log, with_imu);
        fs::write(folder.join("truth.tum"), truth).unwrap();
        let output = run(&["map", log.to_str().unwrap(), "-o", out.to_str().unwrap()]);
        assert_code(&output, 0);
        let truth = folder.join("truth.tum");
        let way = out.join("trajectory.tum");
        let eval = run(&["eval", way.to_str().unwrap(), "--reference", truth.to_str().unwrap(), "--json"]);
        assert_code(&eval, 0);
        let value: serde_json::Value = serde_json::from_slice(&eval.stdout).unwrap();
        (text(&output.stdout), json(&out.join("report.json")), value, out)
    };
    let (said, report, with, out) = mapped("with.mcap", true);
    let (_, bag_report, _, bag_out) = mapped("with.bag", true);
    let (_, without_report, without, _) = mapped("without.mcap", false);
    println!("{said}{with}\n{without}");
    assert!(said.contains("imu      /imu: "), "{said}");
    let imu = &report["imu"];
    assert!(imu["clouds_predicted"].as_u64().unwrap() > 30, "{imu}");
    assert_eq!(imu["late"], 0, "{imu}");
    assert!(imu["gravity_edges"].as_u64().unwrap() > 3 && without_report["imu"].is_null(), "{imu}");
    let bytes = |out: &Path| fs::read(out.join("trajectory.tum")).unwrap();
    assert!(bytes(&out) == bytes(&bag_out), "a bag and an MCAP file of the same messages are mapped alike");
    assert_eq!(imu, &bag_report["imu"]);
    let ate = |value: &serde_json::Value| value[0]["ate"]["translation_m"]["rmse"].as_f64().unwrap();
    assert!(ate(&with) <= 1.05 * ate(&without) && ate(&with) < 0.05, "{} {}", ate(&with), ate(&without));
    // Gravity is written for others, and read again.
    let graph = fs::read_to_string(out.join("graph.g2o")).unwrap();
    let tags = ["VERTEX_SE3:QUAT ", "EDGE_SE3:QUAT ", "PARAMS_SE3OFFSET ", "EDGE_SE3_PRIOR "];
    assert!(
        graph.lines().all(|line| tags.iter().any(|tag| line.starts_with(tag))),
        "the first keyframe may be levelled"
    );
    let priors = graph.lines().filter(|line| line.starts_with("EDGE_SE3_PRIOR ")).count();
    assert_eq!(imu["gravity_edges"], priors);
    let (solved, graph) = (folder.join("solved.g2o"), out.join("graph.g2o"));
    let optimize = ["optimize", graph.to_str().unwrap(), "-o", solved.to_str().unwrap(), "--json"];
    for more in [&[][..], &["--robust"]] {
        let output = run(&[&optimize, more].concat());
        assert_code(&output, 0);
        let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(value["gravity"], priors, "{value}");
    }
    let info = run(&["info", folder.join("with.mcap").to_str().unwrap()]);
    assert_code(&info, 0);
    let info = text(&info.stdout);
    assert!(info.contains("/imu (") && info.contains("a second"), "{info}");
}

#[test]
fn a_recording_with_an_inertial_sensor_in_two_parts_is_mapped_like_the_whole() {
    let folder = folder("space_imu_resume");
    let stop = 30;
    for (name, clouds) in [("whole", 0..usize::MAX), ("first", 0..stop), ("second", stop..usize::MAX)] {
        record_part(&folder.join(format!("{name}.mcap")), true, clouds);
    }
    let map = |name: &str, earlier: Option<&str>| {
        let path = |name: String| folder.join(name).display().to_string();
        let (log, out) = (path(format!("{name}.mcap")), path(format!("{name}.out")));
        let earlier = earlier.map(|earlier| path(format!("{earlier}.out")));
        let mut arguments = vec!["map", &log, "-o", &out, "--quiet"];
        arguments.extend(earlier.iter().flat_map(|earlier| ["--resume", earlier]));
        assert_code(&run(&arguments), 0);
        json(&folder.join(format!("{name}.out/report.json")))["imu"].clone()
    };
    let (whole, _, second) = (map("whole", None), map("first", None), map("second", Some("first")));
    assert_eq!(second["gyroscope_bias_rad_per_s"], whole["gyroscope_bias_rad_per_s"], "{second}");
    assert!(second["clouds_predicted"].as_u64().unwrap() > 20, "{second}");
    for file in ["trajectory.tum", "graph.g2o", "map.ply"] {
        let read = |out: &str| fs::read(folder.join(out).join(file)).unwrap();
        assert!(read("whole.out") == read("second.out"), "{file} differs");
    }
}

#[test]
fn the_demo_in_space_has_an_inertial_sensor_where_it_is_asked_for() {
    let folder = folder("demo_imu");
    let demo = |name: &str, more: &[&str]| {
        let out = folder.join(name);
        assert_code(
            &run(&[&["demo", "--3d", "--seconds", "8", "--quiet", "-o", out.to_str().unwrap()], more].concat()),
            0,
        );
        json(&out.join("report.json"))["imu"].clone()
    };
    assert!(demo("without", &[]).is_null());
    let imu = demo("with", &["--imu"]);
    assert!(imu["readings"].as_u64().unwrap() > 1500 && imu["late"] == 0 && imu["clouds_without"] == 0, "{imu}");
    assert_code(&run(&["demo", "--imu"]), 2);
}
