//! Recordings of clouds and images of depth with everything that goes wrong, made here.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests may")]

use common::{Recorder, ms};
use mapwright_bags::{Bag1Compression, Bag1Writer, Connection, DefinitionFormat, Encoding};
use mapwright_clouds::{CameraOptions, NoteKind, Notes};
use mapwright_geom::{Pose3, Stamp};
use mapwright_logs::{Choice, OdometrySource, SpaceEvent, SpacePlan, SpaceStream, Survey};
use mapwright_ros::messages::{
    CameraInfo, CompressedImage, Header, Image, Imu, LaserScan, Odometry, PointCloud2, PointField, TfMessage,
    Transform, TransformStamped,
};
use mapwright_ros::{Encoding as Layout, Fixed, builtin, encode};
use mapwright_sensor::{Cloud, ImuReading};
use std::fs::File;
use std::path::{Path, PathBuf};

#[path = "../common/mod.rs"]
mod common;
mod depth;
mod inertial;
mod lidars;
mod stereo;
mod tilting;

const CLOUD: &str = "sensor_msgs/msg/PointCloud2";
const IMU: &str = "sensor_msgs/msg/Imu";
const IMAGE: &str = "sensor_msgs/msg/Image";

impl Recorder {
    fn cloud(&mut self, at_ms: i64, data: &[u8]) {
        self.write("/points", CLOUD, ms(at_ms), &cloud(ms(at_ms), data));
    }

    fn odometry(&mut self, at_ms: i64, pose: Pose3) {
        let header = Header::new(ms(at_ms), "odom");
        let mut odometry = Odometry { header, child_frame_id: "base_link".into(), ..Default::default() };
        odometry.pose.pose.position.x = pose.translation.x;
        odometry.pose.pose.position.z = pose.translation.z;
        odometry.pose.pose.orientation.w = 1.0;
        self.write("/odom", "nav_msgs/msg/Odometry", ms(at_ms), &odometry);
    }

    fn imu(&mut self, topic: &str, frame: &str, at_ms: i64, rate: [f64; 3], force: [f64; 3]) {
        self.write(topic, IMU, ms(at_ms), &imu(ms(at_ms), frame, rate, force));
    }

    fn link(&mut self, topic: &str, at_ms: i64, parent: &str, child: &str, pose: Pose3) {
        let header = Header::new(ms(at_ms), parent);
        let transforms =
            vec![TransformStamped { header, child_frame_id: child.into(), transform: Transform::from(pose) }];
        self.write(topic, "tf2_msgs/msg/TFMessage", ms(at_ms), &TfMessage { transforms });
    }

    fn camera(&mut self, topic: &str, size: [u32; 2]) {
        let mut k = [0.0; 9];
        [k[0], k[2], k[4], k[5], k[8]] = [4.0, 1.5, 4.0, 1.0, 1.0];
        let header = Header::new(ms(0), "optical");
        let info = CameraInfo {
            header,
            width: size[0],
            height: size[1],
            distortion_model: "plumb_bob".into(),
            k: Fixed(k),
            ..Default::default()
        };
        self.write(topic, "sensor_msgs/msg/CameraInfo", ms(0), &info);
    }

    fn depth(&mut self, topic: &str, at_ms: i64, size: [u32; 2], data: &[u8]) {
        let image = Image {
            header: Header::new(ms(at_ms), "optical"),
            width: size[0],
            height: size[1],
            encoding: "16UC1".into(),
            step: size[0].saturating_mul(2),
            data,
            ..Default::default()
        };
        self.write(topic, IMAGE, ms(at_ms), &image);
    }

    fn scan(&mut self, at_ms: i64) {
        let header = Header::new(ms(at_ms), "laser");
        let ranges = [1.0_f32; 4];
        let scan = LaserScan {
            header,
            angle_increment: 0.01,
            range_max: 9.0,
            ranges: ranges[..].into(),
            ..Default::default()
        };
        self.write("/scan", "sensor_msgs/msg/LaserScan", ms(at_ms), &scan);
    }
}

fn imu(stamp: Stamp, frame: &str, rate: [f64; 3], force: [f64; 3]) -> Imu<'_> {
    let mut imu = Imu { header: Header::new(stamp, frame), ..Default::default() };
    (imu.angular_velocity.x, imu.angular_velocity.y, imu.angular_velocity.z) = rate.into();
    (imu.linear_acceleration.x, imu.linear_acceleration.y, imu.linear_acceleration.z) = force.into();
    imu
}

fn field(name: &'static str, offset: u32, datatype: u8) -> PointField<'static> {
    PointField { name: name.into(), offset, datatype, count: 1 }
}

fn cloud(stamp: Stamp, data: &[u8]) -> PointCloud2<'_> {
    PointCloud2 {
        header: Header::new(stamp, "lidar"),
        height: 1,
        width: (data.len() / 12) as u32,
        fields: vec![field("x", 0, 7), field("y", 4, 7), field("z", 8, 7)],
        point_step: 12,
        row_step: data.len() as u32,
        data,
        ..Default::default()
    }
}

fn floats(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
}

fn shifted(x: f64, z: f64) -> Pose3 {
    Pose3::from_quaternion([x, 0.0, z], [0.0, 0.0, 0.0, 1.0]).unwrap()
}

fn plan(path: &Path, options: &CameraOptions) -> Result<SpacePlan, String> {
    SpacePlan::of(&Survey::of(path).unwrap(), &Choice::default(), options)
}

fn read_with(path: &Path, choice: &Choice, options: &CameraOptions) -> (Vec<Cloud>, Notes, SpacePlan) {
    let survey = Survey::of(path).unwrap();
    let plan = SpacePlan::of(&survey, choice, options).unwrap();
    let mut stream = SpaceStream::open("log", path, survey, plan.clone()).unwrap();
    let clouds = std::iter::from_fn(|| stream.next_cloud().unwrap()).collect();
    (clouds, stream.notes().clone(), plan)
}

fn read(path: &Path) -> (Vec<Cloud>, Notes, SpacePlan) {
    read_with(path, &Choice::default(), &CameraOptions::default())
}

#[test]
fn clouds_come_with_the_sensors_place_and_the_wheels_pose_at_their_stamps() {
    let mut recorder = Recorder::new("space.mcap");
    let tilted = Pose3::from_quaternion([0.2, 0.0, 1.1], [0.0, 0.3_f64.sin(), 0.0, 0.3_f64.cos()]).unwrap();
    recorder.link("/tf_static", 0, "base_link", "lidar", tilted);
    recorder.odometry(0, shifted(0.0, 0.0));
    recorder.cloud(50, &floats(&[1.0, 2.0, 3.0, f32::NAN, 0.0, 0.0]));
    recorder.odometry(100, shifted(1.0, 0.5));
    recorder.cloud(60, &floats(&[4.0, 5.0, 6.0])); // steps forward, recorded later
    recorder.cloud(9000, &floats(&[7.0, 8.0, 9.0]));
    let (clouds, notes, plan) = read(&recorder.finish());
    let poses: Vec<_> = clouds.iter().map(|cloud| cloud.odom_from_robot.map(|pose| pose.translation)).collect();
    assert!((poses[0].unwrap().x - 0.5).abs() < 1e-9 && (poses[0].unwrap().z - 0.25).abs() < 1e-9, "{poses:?}");
    assert!((poses[1].unwrap().x - 0.6).abs() < 1e-9 && poses[2].is_none());
    assert_eq!(clouds[0].points_m[0], [1.0, 2.0, 3.0]);
    let mount = clouds[0].sensor.robot_from_sensor;
    assert!(mount.distance(tilted) < 1e-9 && mount.rotation.angle_to(&tilted.rotation) < 1e-9);
    assert!(matches!(&plan.odometry, OdometrySource::Topic { name, .. } if name == "/odom"));
    assert!(plan.assumed.is_empty(), "{plan:?}");
    assert_eq!((notes.count(NoteKind::NotFinite), notes.count(NoteKind::WithoutOdometry)), (1, 1));
    assert!(!notes.has_losses());
}

#[test]
fn transforms_of_a_robot_that_swings_in_space_are_odometry() {
    let mut recorder = Recorder::new("flying.mcap");
    recorder.link("/tf_static", 0, "drone", "lidar", shifted(0.1, 0.0));
    for k in 0..10_i64 {
        let angle: f64 = 0.05 * k as f64;
        let pose = Pose3::from_quaternion([k as f64, 0.0, 0.0], [angle.sin(), 0.0, 0.0, angle.cos()]).unwrap();
        recorder.link("/tf", 100 * k, "vicon", "drone", pose);
        recorder.cloud(100 * k + 50, &floats(&[1.0, 2.0, 3.0]));
    }
    let (clouds, _, plan) = read(&recorder.finish());
    assert_eq!((plan.robot_frame.as_str(), clouds.len()), ("drone", 10));
    let odometry = clouds[4].odom_from_robot.unwrap();
    assert!((odometry.translation.x - 4.5).abs() < 0.05 && (odometry.rotation.angle() - 0.45).abs() < 1e-6);
}

#[test]
fn clouds_that_contradict_themselves_are_counted_and_the_others_mapped() {
    let mut recorder = Recorder::new("bad_clouds.mcap");
    let good = floats(&[1.0, 2.0, 3.0]);
    recorder.cloud(0, &good);
    let whole = cloud(ms(100), &good);
    let bad = [
        PointCloud2 { height: 4, row_step: 12, ..whole.clone() },
        PointCloud2 { width: u32::MAX, height: u32::MAX, row_step: u32::MAX, ..whole.clone() },
        PointCloud2 { fields: vec![field("x", 0, 7), field("y", 4, 7)], ..whole.clone() },
        PointCloud2 { fields: vec![field("x", 0, 7), field("y", 4, 7), field("z", 9, 7)], ..whole.clone() },
        PointCloud2 { header: Header::new(ms(100), "elsewhere"), ..whole.clone() },
    ];
    for message in &bad {
        recorder.write("/points", CLOUD, ms(100), message);
    }
    recorder.raw("/points", CLOUD, ms(100), &[0, 1, 0, 0, 1, 2]);
    recorder.cloud(200, &[]);
    recorder.write("/points", CLOUD, ms(300), &cloud(Stamp(0), &good));
    recorder.cloud(250, &good);
    let (clouds, notes, _) = read(&recorder.finish());
    assert_eq!(clouds.len(), 4);
    assert_eq!((clouds[2].stamp, clouds[3].stamp), (ms(300), ms(250)));
    let kinds = [NoteKind::UnreadableFrame, NoteKind::EmptyCloud, NoteKind::RecordedStamp, NoteKind::BackwardStamp];
    assert_eq!(kinds.map(|kind| notes.count(kind)), [6, 1, 1, 1]);
    let first: Vec<String> = notes.kinds[&NoteKind::UnreadableFrame].first.iter().map(ToString::to_string).collect();
    assert!(first[0].contains("4 x 1 points of 12 bytes (48 bytes), found 12 bytes"), "{first:?}");
    assert!(first[2].contains("expected one named `z`") && first[4].contains("'elsewhere'"), "{first:?}");
}

#[test]
fn a_recording_of_which_no_cloud_can_be_read_says_why() {
    let mut recorder = Recorder::new("none.mcap");
    let good = floats(&[1.0, 2.0, 3.0]);
    recorder.cloud(0, &good);
    recorder.raw("/points", CLOUD, ms(0), &[0, 1, 0, 0]);
    let path = recorder.finish();
    let survey = Survey::of(&path).unwrap();
    let plan = SpacePlan::of(&survey, &Choice::default(), &CameraOptions::default()).unwrap();
    let mut recorder = Recorder::new("none.mcap");
    recorder.write("/points", CLOUD, ms(0), &PointCloud2 { height: 9, ..cloud(ms(0), &good) });
    let path = recorder.finish();
    let error = SpaceStream::open("log", &path, survey, plan).unwrap().next_cloud().unwrap_err().to_string();
    assert!(error.starts_with("log: none of the messages of /points can be mapped; the first: "), "{error}");
}

/// 4 x 3 pixels of 2 m.
fn two_metres() -> Vec<u8> {
    2000_u16.to_le_bytes().repeat(12)
}

#[test]
fn images_of_depth_become_clouds_by_the_camera_beside_them() {
    let mut recorder = Recorder::new("depth.mcap");
    recorder.camera("/cam/color/camera_info", [640, 480]);
    recorder.camera("/cam/depth/camera_info", [4, 3]);
    recorder.depth("/cam/depth/image_raw", 0, [4, 3], &two_metres());
    recorder.depth("/cam/depth/image_raw", 100, [4, 3], &two_metres()[..10]);
    recorder.depth("/cam/depth/image_raw", 200, [2, 2], &two_metres()[..8]);
    let (clouds, notes, plan) = read(&recorder.finish());
    assert_eq!((clouds.len(), notes.count(NoteKind::UnreadableFrame)), (1, 2));
    assert_eq!(clouds[0].points_m[0], [-0.75, -0.5, 2.0]);
    assert_eq!(clouds[0].sensor.range_max_m, 6.0);
    let camera = plan.reasons.iter().find(|(what, _)| *what == "camera").unwrap();
    assert!(camera.1.contains("/cam/depth/camera_info: 4 x 3, fx 4.0"), "{camera:?}");
}

#[test]
fn without_camera_info_the_options_are_named() {
    let mut recorder = Recorder::new("no_info.mcap");
    recorder.depth("/depth", 0, [4, 3], &two_metres());
    recorder.depth("/depth", 100, [u32::MAX, u32::MAX], &two_metres());
    let path = recorder.finish();
    let error = plan(&path, &CameraOptions::default()).unwrap_err();
    assert!(error.contains("--intrinsics FX,FY,CX,CY --depth-scale S"), "{error}");
    let options = CameraOptions {
        intrinsics: Some([4.0, 4.0, 1.5, 1.0]),
        depth_scale: Some(2000.0),
        range_unit_m: None,
        baseline_m: None,
    };
    let (clouds, notes, _) = read_with(&path, &Choice::default(), &options);
    assert_eq!(clouds[0].points_m[0], [-0.375, -0.25, 1.0]);
    assert_eq!((clouds.len(), notes.count(NoteKind::UnreadableFrame)), (1, 1));
    let wrong = CameraOptions { depth_scale: Some(0.0), ..options };
    assert!(plan(&path, &wrong).unwrap_err().contains("--depth-scale"));
}

/// A recording of clouds, each of these points, `x y z` and a time of any type behind them.
fn timed(name: &str, every_ms: i64, kind: u8, points: impl Fn(i64) -> Vec<([f32; 3], Vec<u8>)>) -> PathBuf {
    let mut recorder = Recorder::new(name);
    for k in 0..10 {
        let points = points(every_ms * k);
        let step = 12 + points[0].1.len() as u32;
        let data: Vec<u8> = points.iter().flat_map(|(place, time)| [floats(place), time.clone()].concat()).collect();
        let fields = vec![field("x", 0, 7), field("y", 4, 7), field("z", 8, 7), field("time", 12, kind)];
        let (width, row_step) = (points.len() as u32, data.len() as u32);
        let message = PointCloud2 { fields, point_step: step, width, row_step, ..cloud(ms(every_ms * k), &data) };
        recorder.write("/points", CLOUD, ms(every_ms * k), &message);
    }
    recorder.finish()
}

/// Points around, with times from 0 to the end as floats.
fn sweep(end: f32) -> Vec<([f32; 3], Vec<u8>)> {
    let place = |k: usize| [3.0 + 0.01 * k as f32, 1.0, 0.5];
    (0..200).map(|k| (place(k), (end * k as f32 / 199.0).to_le_bytes().to_vec())).collect()
}

#[test]
fn times_from_0_to_1_are_shares_of_a_sweep_that_lasts_as_long_as_clouds_are_apart() {
    let ends_s = |end: f32, every_ms: i64| {
        let path = timed("shares.mcap", every_ms, 7, |_| sweep(end));
        let (clouds, notes, plan) = read(&path);
        let last_s = clouds[3].times_s.last().copied();
        (
            last_s,
            notes.count(NoteKind::BadPointTimes),
            plan.assumed.iter().any(|words| words.contains("shares of a sweep")),
        )
    };
    assert_eq!(ends_s(1.0, 100), (Some(0.1), 0, true));
    for (end, every_ms) in [(0.1, 100), (0.12, 100), (0.1, 300), (1.0, 1000)] {
        assert_eq!(ends_s(end, every_ms), (Some(end), 0, false), "{end} s every {every_ms} ms");
    }
    for (end, every_ms) in [(0.5, 100), (1.0, 300)] {
        assert_eq!(ends_s(end, every_ms), (None, 10, false), "{end} s every {every_ms} ms");
    }
    let path = timed("shares.mcap", 100, 7, |_| sweep(0.5));
    let (_, notes, plan) = read(&path);
    let first = notes.kinds[&NoteKind::BadPointTimes].first[0].to_string();
    assert!(first.contains("clouds come every 0.10 s, found times that span 0.50 s"), "{first}");
    assert!(plan.reasons.iter().any(|(what, why)| *what == "motion" && why.starts_with("not undone")), "{plan:?}");
}

#[test]
fn times_of_points_that_brought_nothing_back_do_not_count() {
    for nothing in [[f32::NAN; 3], [0.0; 3]] {
        let path = timed("nothing_back.mcap", 100, 8, |at_ms| {
            let began_s = ms(at_ms).as_secs_f64();
            let point = |k: usize| match k % 3 {
                1 => (nothing, 0.0_f64.to_le_bytes().to_vec()),
                _ => ([4.0, 0.01 * k as f32, 0.0], (began_s + 0.0001 * k as f64).to_le_bytes().to_vec()),
            };
            (0..901).map(point).collect()
        });
        let (clouds, notes, plan) = read(&path);
        assert_eq!((notes.count(NoteKind::BadPointTimes), clouds[2].stamp), (0, ms(200)), "{nothing:?}");
        assert!((clouds[2].times_s[900] - 0.09).abs() < 1e-5 && clouds[2].times_s[1] == 0.0);
        assert!(plan.reasons.iter().any(|(what, why)| *what == "motion" && why.starts_with("undone")), "{plan:?}");
    }
}

/// Points on a circle, of so many metres.
fn circle(radius: f32) -> Vec<u8> {
    let point = |k: usize| [radius * (0.1 * k as f32).sin(), radius * (0.1 * k as f32).cos(), 0.1 * radius];
    floats(&(0..200).flat_map(point).collect::<Vec<_>>())
}

#[test]
fn clouds_in_another_unit_are_taken_for_what_they_can_only_be_or_named() {
    let of = |radius: f32, choice: &Choice| {
        let mut recorder = Recorder::new("units.mcap");
        (0..3).for_each(|k| recorder.cloud(100 * k, &circle(radius)));
        let (clouds, _, plan) = read_with(&recorder.finish(), choice, &CameraOptions::default());
        ((clouds[0].points_m[0][1] - 4.0).abs() < 1e-3, clouds[0].sensor.range_min_m, plan)
    };
    let asked = |unit_m: f64| Choice { range_unit_m: Some(unit_m), ..Choice::default() };
    let (is_metres, _, plan) = of(4000.0, &Choice::default());
    assert!(is_metres && plan.assumed.iter().any(|words| words.contains("taken for millimetres")), "{plan:?}");
    let (is_metres, _, plan) = of(4000.0, &asked(1.0));
    assert!(!is_metres && plan.odd[0].contains("--range-unit 0.001"), "{plan:?}");
    let (is_metres, _, plan) = of(40.0, &asked(0.1));
    assert!(is_metres && plan.odd.is_empty(), "{plan:?}");
    let (is_metres, range_min_m, plan) = of(4.0, &Choice::default());
    assert!(
        is_metres && range_min_m == 0.5 && !plan.assumed.iter().any(|words| words.contains("points at")),
        "{plan:?}"
    );
    let (_, range_min_m, plan) = of(0.2, &Choice::default());
    assert!(
        range_min_m == 0.02 && plan.assumed.iter().any(|words| words.contains("nearer than the 0.5 m")),
        "{plan:?}"
    );
}

#[test]
fn of_mixed_sensors_the_lidars_clouds_are_mapped_and_a_name_asks_for_others() {
    let mut recorder = Recorder::new("mixed.mcap");
    recorder.camera("/cam/camera_info", [4, 3]);
    let points = floats(&[1.0; 30]);
    for k in 0..5 {
        recorder.scan(100 * k);
        recorder.cloud(100 * k, &points);
        recorder.depth("/cam/depth", 100 * k, [4, 3], &two_metres());
        let header = Header::new(ms(100 * k), "map");
        let map = PointCloud2 { header, ..cloud(ms(100 * k), &points) };
        recorder.write("/cloud_map", CLOUD, ms(100 * k), &map);
        let rgb =
            Image { encoding: "rgb8".into(), width: 1, height: 1, step: 3, data: &[1, 2, 3], ..Default::default() };
        recorder.write("/cam/rgb", IMAGE, ms(100 * k), &rgb);
    }
    let path = recorder.finish();
    let survey = Survey::of(&path).unwrap();
    assert!(!SpacePlan::is_default(&survey, &Choice::default()));
    let planar = mapwright_logs::Plan::of(&survey, &Choice::default()).unwrap();
    let said = |of: &[(&str, String)], words: &str| of.iter().any(|(_, why)| why.contains(words));
    assert!(said(&planar.reasons, "`--space` maps the clouds instead"), "{planar:?}");
    let (clouds, _, found) = read(&path);
    assert_eq!((found.topic.as_str(), clouds.len()), ("/points", 5));
    assert!(said(&found.reasons, "/cloud_map: in 'map'") && said(&found.reasons, "not used: /cam/depth"), "{found:?}");
    let asked = |name: &str| Choice { topics: vec![name.to_owned()], ..Choice::default() };
    assert!(SpacePlan::is_default(&survey, &asked("/cam/depth")));
    assert_eq!(read_with(&path, &asked("cam/depth"), &CameraOptions::default()).2.topic, "/cam/depth");
    let error = |name: &str| SpacePlan::of(&survey, &asked(name), &CameraOptions::default()).unwrap_err();
    assert!(error("/scan").contains("expected clouds, images of depth or odometry"), "{}", error("/scan"));
    assert!(error("/cam/rgb").contains("`rgb8`") && error("/nothing").contains("there is no topic"));
}

#[test]
fn a_camera_of_which_nothing_says_where_it_sits_looks_ahead_of_its_robot() {
    let mut recorder = Recorder::new("ahead.mcap");
    recorder.camera("/cam/camera_info", [4, 3]);
    recorder.depth("/cam/depth", 50, [4, 3], &two_metres());
    recorder.odometry(0, shifted(0.0, 0.0));
    recorder.odometry(100, shifted(1.0, 0.0));
    let (clouds, _, plan) = read(&recorder.finish());
    let ahead = clouds[0].sensor.robot_from_sensor.transform(nalgebra::Vector3::z());
    assert!((ahead - nalgebra::Vector3::x()).norm() < 1e-9 && plan.assumed.len() == 1, "{ahead} {plan:?}");
}

#[test]
fn bags_of_ros_1_are_read_alike() {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("clouds.bag");
    let mut writer = Bag1Writer::new(File::create(&path).unwrap(), Bag1Compression::None).unwrap();
    let definition = builtin::text("sensor_msgs/PointCloud2", Layout::Ros1).unwrap();
    let md5sum = builtin::definition("sensor_msgs/PointCloud2", Layout::Ros1).unwrap().md5sum().unwrap();
    let connection =
        Connection::new("/points", "sensor_msgs/PointCloud2", Encoding::Ros1).with_metadata("md5sum", md5sum);
    let id = writer.add_connection(&connection.with_definition(DefinitionFormat::Ros1Msg, &definition)).unwrap();
    let data = floats(&[1.0, 2.0, 3.0]);
    writer.write(id, ms(0), &encode(&cloud(ms(0), &data), Layout::Ros1).unwrap()).unwrap();
    writer.finish().unwrap();
    let survey = Survey::of(&path).unwrap();
    assert!(SpacePlan::is_default(&survey, &Choice::default()));
    let (clouds, notes, _) = read(&path);
    assert_eq!((clouds.len(), clouds[0].points_m[0], notes), (1, [1.0, 2.0, 3.0], Notes::default()));
}

#[test]
fn more_points_than_any_sensor_has_are_refused_before_there_is_room_for_them() {
    let mut recorder = Recorder::new("many.mcap");
    let bytes = vec![0; (1 << 24) + 1];
    let fields = vec![field("x", 0, 2), field("y", 0, 2), field("z", 0, 2)];
    let many = PointCloud2 { width: bytes.len() as u32, point_step: 1, fields, ..cloud(ms(0), &bytes) };
    recorder.write("/points", CLOUD, ms(0), &many);
    recorder.cloud(100, &floats(&[1.0, 2.0, 3.0]));
    let (clouds, notes, _) = read(&recorder.finish());
    assert_eq!((clouds.len(), notes.count(NoteKind::UnreadableFrame)), (1, 1));
}

#[test]
fn flipped_bits_cost_messages_and_nothing_else() {
    let points = floats(&[1.0; 60]);
    let (mut flips, mut delivered) = (7_u64, 0);
    for round in 0..150 {
        let mut recorder = Recorder::new("flipped.mcap");
        recorder.link("/tf_static", 0, "base_link", "lidar", shifted(0.1, 0.2));
        recorder.camera("/cam/camera_info", [4, 3]);
        recorder.flips = flips;
        for k in 0..8 {
            recorder.odometry(100 * k, shifted(0.1 * k as f64, 0.0));
            recorder.cloud(100 * k, &points);
            recorder.imu("/imu", "lidar", 100 * k, [0.1; 3], [0.0, 0.0, 9.8]);
            recorder.depth("/cam/depth", 100 * k, [4, 3], &two_metres());
            let data = [floats(&[0.0; 3]), png(1000)].concat();
            let header = Header::new(ms(100 * k), "optical");
            let image = CompressedImage { header, format: "16UC1; compressedDepth".into(), data: &data };
            recorder.write("/cam/depth/compressedDepth", "sensor_msgs/msg/CompressedImage", ms(100 * k), &image);
        }
        flips = recorder.flips;
        let path = recorder.finish();
        let survey = Survey::of(&path).unwrap();
        let topics = ["/points", "/cam/depth", "/cam/depth/compressedDepth"];
        let choice = Choice { topics: vec![topics[round % 3].to_owned()], ..Choice::default() };
        let Ok(plan) = SpacePlan::of(&survey, &choice, &CameraOptions::default()) else { continue };
        let mut stream = SpaceStream::open("flipped", &path, survey, plan).unwrap();
        while let Ok(Some(_)) = stream.next_cloud() {
            delivered += 1;
        }
    }
    assert!(delivered > 100, "{delivered}");
}

/// A greyscale PNG of 4 x 3 pixels of 16 bits.
fn png(number: u16) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, 4, 3);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    encoder.write_header().unwrap().write_image_data(&number.to_be_bytes().repeat(12)).unwrap();
    file
}

fn said(reasons: &[(&'static str, String)], words: &str) -> bool {
    reasons.iter().any(|(_, reason)| reason.contains(words))
}
