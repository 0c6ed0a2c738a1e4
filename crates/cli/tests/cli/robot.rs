//! Simulated drives as recordings of messages.

use mapwright_bags::{Connection, Encoding, McapCompression, McapWriter};
use mapwright_formats::TumWriter;
use mapwright_geom::{Pose2, Pose3, Stamp};
use mapwright_ros::messages::{
    Header, LaserScan, Odometry, PointCloud2, PointField, TfMessage, Transform, TransformStamped,
};
use mapwright_ros::{Encoding as Layout, Field, encode};
use mapwright_sensor::{LaserModel, LaserScan as Scan};
use mapwright_sim::{Drive, DriveSettings, Event, worlds};
use std::fs::File;
use std::path::Path;
use std::sync::Arc;

/// What the robot records.
#[derive(Clone, Copy)]
pub(crate) struct Robot {
    /// Seconds of the drive.
    pub(crate) from_s: f64,
    pub(crate) to_s: f64,
    /// Roll and pitch of the laser on the robot.
    pub(crate) laser_roll_pitch: [f64; 2],
    /// Whether odometry comes as messages, or as transforms alone.
    pub(crate) odometry_messages: bool,
    /// Whether the laser's place is said, and only at the end.
    pub(crate) says_mounting: bool,
    pub(crate) clouds: bool,
    /// How long a sweep takes, and whether `time_increment` says so.
    pub(crate) sweep_s: f64,
    pub(crate) says_times: bool,
    pub(crate) turn_rate_rad_per_s: f64,
}

impl Default for Robot {
    fn default() -> Self {
        Self {
            from_s: 0.0,
            to_s: 30.0,
            laser_roll_pitch: [0.0; 2],
            odometry_messages: true,
            says_mounting: true,
            clouds: false,
            sweep_s: 0.0,
            says_times: true,
            turn_rate_rad_per_s: 0.8,
        }
    }
}

const EPOCH_NS: i64 = 1_700_000_000_000_000_000;

fn later(stamp: Stamp) -> Stamp {
    Stamp(stamp.0 + EPOCH_NS)
}

fn turned([roll, pitch]: [f64; 2], yaw: f64) -> Pose3 {
    let [(sr, cr), (sp, cp), (sy, cy)] = [roll, pitch, yaw].map(|angle| (0.5 * angle).sin_cos());
    let q = [
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    ];
    Pose3::from_quaternion([0.0; 3], q).unwrap()
}

fn lifted(pose: Pose2) -> Pose3 {
    let mut lifted = turned([0.0; 2], pose.theta);
    (lifted.translation.x, lifted.translation.y) = (pose.x, pose.y);
    lifted
}

fn link<'a>(stamp: Stamp, parent: &'a str, child: &'a str, pose: Pose3) -> TfMessage<'a> {
    let header = Header::new(stamp, parent);
    TfMessage {
        transforms: vec![TransformStamped { header, child_frame_id: child.into(), transform: Transform::from(pose) }],
    }
}

/// An MCAP file being written; topics are added when they are first used.
struct Recorder {
    writer: McapWriter<File>,
    topics: Vec<(String, u32)>,
}

impl Recorder {
    fn write<'a>(&mut self, topic: &str, kind: &str, stamp: Stamp, message: &impl Field<'a>) {
        let known = self.topics.iter().find(|(name, _)| name == topic).map(|(_, id)| *id);
        let id = known.unwrap_or_else(|| {
            let id = self.writer.add_connection(&Connection::new(topic, kind, Encoding::Cdr)).unwrap();
            self.topics.push((topic.to_owned(), id));
            id
        });
        let data = encode(message, Layout::Cdr).unwrap();
        self.writer.write(id, stamp, stamp, &data).unwrap();
    }
}

impl Robot {
    fn drive(self) -> DriveSettings {
        let mut settings = DriveSettings { duration_s: self.to_s, seed: 5, ..DriveSettings::default() };
        settings.robot.turn_rate_rad_per_s = self.turn_rate_rad_per_s;
        settings.robot.turn_acceleration_rad_per_s2 = 4.0 * self.turn_rate_rad_per_s;
        let beam_period_s = self.sweep_s / settings.laser.beams as f64;
        settings.laser.model = Arc::new(LaserModel { beam_period_s, ..(*settings.laser.model).clone() });
        settings
    }

    /// Records the drive as an MCAP file, and the truth beside it as `.tum`.
    pub(crate) fn record(self, path: &Path) -> String {
        let writer = McapWriter::new(File::create(path).unwrap(), McapCompression::Zstd).unwrap();
        let mut recorder = Recorder { writer, topics: Vec::new() };
        let mut truth = TumWriter::new(File::create(path.with_extension("tum")).unwrap());
        let mut last = Stamp(0);
        for event in Drive::new(worlds::three_rooms(5).into(), self.drive()) {
            let (Event::Odometry(mapwright_sensor::Odometry { stamp, .. })
            | Event::Scan(mapwright_sim::TrueScan { scan: Scan { stamp, .. }, .. })) = &event;
            if stamp.as_secs_f64() < self.from_s {
                continue;
            }
            last = later(*stamp);
            if let Event::Scan(scan) = &event {
                truth.write_planar(last, scan.world_from_robot).unwrap();
            }
            match event {
                Event::Odometry(odometry) => self.odometry(&mut recorder, last, odometry.odom_from_robot),
                Event::Scan(scan) if self.clouds => self.cloud(&mut recorder, last, &scan.scan),
                Event::Scan(scan) => self.scan(&mut recorder, last, &scan.scan),
            }
        }
        if self.says_mounting {
            let robot_from_laser = turned(self.laser_roll_pitch, 0.0);
            recorder.write(
                "/tf_static",
                "tf2_msgs/msg/TFMessage",
                last,
                &link(last, "base_link", "laser", robot_from_laser),
            );
        }
        recorder.writer.finish().unwrap();
        truth.finish().unwrap();
        path.display().to_string()
    }

    fn odometry(self, recorder: &mut Recorder, stamp: Stamp, odom_from_robot: Pose2) {
        let pose = lifted(odom_from_robot);
        recorder.write("/tf", "tf2_msgs/msg/TFMessage", stamp, &link(stamp, "odom", "base_link", pose));
        if self.odometry_messages {
            let mut odometry = Odometry {
                header: Header::new(stamp, "odom"),
                child_frame_id: "base_link".into(),
                ..Default::default()
            };
            odometry.pose.pose = pose.into();
            recorder.write("/odom", "nav_msgs/msg/Odometry", stamp, &odometry);
        }
    }

    /// A laser that hangs upside down sees the same from the other side.
    fn scan(self, recorder: &mut Recorder, stamp: Stamp, scan: &Scan) {
        let laser = &scan.laser;
        let mut ranges = scan.ranges_m.clone();
        let last_rad = laser.angle_min_rad + laser.angle_step_rad * (ranges.len() - 1) as f64;
        let (mut first, mut last) = (laser.angle_min_rad, last_rad);
        if self.laser_roll_pitch[0] > 1.0 {
            ranges.reverse();
            (first, last) = (-last, -first);
        }
        let message = LaserScan {
            header: Header::new(stamp, "laser"),
            angle_min: first as f32,
            angle_max: last as f32,
            angle_increment: laser.angle_step_rad as f32,
            time_increment: if self.says_times { laser.beam_period_s as f32 } else { 0.0 },
            range_min: laser.range_min_m as f32,
            range_max: laser.range_max_m as f32,
            ranges: ranges[..].into(),
            ..Default::default()
        };
        recorder.write("/scan", "sensor_msgs/msg/LaserScan", stamp, &message);
    }

    /// The returns of a scan as points half a metre up, and as many on the floor; with times where a sweep takes any.
    fn cloud(self, recorder: &mut Recorder, stamp: Stamp, scan: &Scan) {
        let (mut data, mut points) = (Vec::new(), 0);
        for (beam, range_m) in scan.ranges_m.iter().enumerate() {
            let range_m = f64::from(*range_m);
            let time_s = if self.says_times { beam as f64 * scan.laser.beam_period_s } else { 0.0 };
            if range_m < scan.laser.range_max_m {
                let (sin, cos) = scan.laser.bearing_in_robot(beam).sin_cos();
                for (share, z) in [(1.0, 0.5), (0.5, 0.0)] {
                    let point = [share * range_m * cos, share * range_m * sin, z, time_s];
                    point.iter().for_each(|value| data.extend_from_slice(&(*value as f32).to_le_bytes()));
                    points += 1;
                }
            }
        }
        let field = |name: &'static str, offset| PointField { name: name.into(), offset, datatype: 7, count: 1 };
        let last = if self.says_times { "time" } else { "intensity" };
        let message = PointCloud2 {
            header: Header::new(stamp, "laser"),
            height: 1,
            width: points,
            fields: vec![field("x", 0), field("y", 4), field("z", 8), field(last, 12)],
            point_step: 16,
            row_step: 16 * points,
            data: &data,
            ..Default::default()
        };
        recorder.write("/points", "sensor_msgs/msg/PointCloud2", stamp, &message);
    }
}
