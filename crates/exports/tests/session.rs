//! What is written of a session reads back, here and with the official readers in Python. `scripts/check_exports.py` asks
//! them; Python with the wheels `mcap`, `mcap-ros2-support` and `rosbags` is `MAPWRIGHT_PYTHON`, or else `python3`.
#![allow(clippy::explicit_write, clippy::unwrap_used, clippy::print_stdout)] // tests unwrap what they expect and say what they skip

use mapwright_bags::McapReader;
use mapwright_exports::{SessionCounts, SpacePoints, SpaceSessionCounts, write_session_mcap, write_space_session_mcap};
use mapwright_formats::{GridImage, UNKNOWN};
use mapwright_geom::{Pose2, Pose3, Stamp};
use mapwright_record::{
    Edge, EdgeKind, Entry, Keyframe, OdometryOrigin, RecordedEdge, Run, RunId, ScanPose, Session, TrajectoryPose,
};
use mapwright_ros::messages::{LaserScan, OccupancyGrid, PointCloud2, TfMessage};
use mapwright_ros::{Channel, Decoder, Encoding, planar};
use mapwright_sensor::{BEAM_DROPPED, BEAM_NO_RETURN, LaserModel, SpaceSensor, SpaceSweep, Sweep};
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::io::Write as _;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;

const SCANS: u32 = 40;

/// A drive around, corrected against odometry; one stamp steps backwards, the laser hangs upside down.
fn session() -> Session {
    let laser = LaserModel {
        robot_from_laser: Pose2::new(0.2, 0.05, 0.3),
        inverted: true,
        range_max_m: 30.0,
        ..LaserModel::half_circle("front_laser", 5)
    };
    let laser = Arc::new(laser);
    let run = RunId::of_robot("a");
    let along = |k: u32| Pose2::new(0.1 * f64::from(k), (0.2 * f64::from(k)).sin(), 0.15 * f64::from(k));
    let codes = vec![1000, BEAM_DROPPED, BEAM_NO_RETURN, 2000, 3000];
    let sweep = Arc::new(Sweep { laser, codes, step_m: 0.001, twist_per_s: [0.0; 3], scatters: false });
    let mut session = Session::default();
    session.add(Entry::Run(Run { id: run, settings: String::new() })).unwrap();
    let odom_from_start = Pose2::new(0.3, -2.0, 1.0);
    session.add(Entry::OdometryOrigin(OdometryOrigin { from_scan: 0, odom_from_start })).unwrap();
    for k in 0..SCANS {
        let stamp = Stamp(1_600_000_000_000_000_000 + 100_000_000 * i64::from(if k == 7 { 4 } else { k }));
        if k.is_multiple_of(2) {
            let (id, sweep) = (run.keyframe(k / 2), Arc::clone(&sweep));
            let keyframe = Arc::new(Keyframe { id, stamp, scan: u64::from(k), sweep, hardly_fits: false });
            session.add(Entry::Keyframe { keyframe, map_from_keyframe: along(k) }).unwrap();
        }
        let keyframe_from_robot = along(k - k % 2).between(along(k));
        let odom_from_robot = along(k) * Pose2::new(0.001 * f64::from(k), 0.0, 0.002);
        let scan = ScanPose { stamp, keyframe: Some(run.keyframe(k / 2)), keyframe_from_robot, odom_from_robot };
        session.add(Entry::Scan(scan)).unwrap();
    }
    for (from, to, kind) in [(0, 1, EdgeKind::Odometry), (1, 19, EdgeKind::Closure), (2, 18, EdgeKind::Closure)] {
        let (from, to) = (run.keyframe(from), run.keyframe(to));
        let information = mapwright_geom::Cov3::identity();
        let edge = Edge { from, to, kind, from_from_to: Pose2::IDENTITY, information };
        session.add(Entry::Edge(RecordedEdge { edge, candidate: None })).unwrap();
    }
    session
}

fn map() -> GridImage {
    let cells = vec![0, 100, UNKNOWN, 40, 70, 5];
    GridImage { width: 3, height: 2, resolution_m: 0.05, world_from_map: Pose2::new(-1.0, 2.0, 0.0), cells }
}

fn written() -> Vec<u8> {
    let (out, counts) = write_session_mcap(&session(), &map(), |stamp| stamp, Cursor::new(Vec::new())).unwrap();
    assert_eq!(counts, SessionCounts { closures: 2, scans: 20, poses: 40 });
    out.into_inner()
}

#[test]
fn what_is_written_reads_back() {
    let mut reader = McapReader::open(Cursor::new(written())).unwrap();
    let channel = |name| Channel::new(name, Encoding::Cdr, None).unwrap();
    let mut scans = Decoder::<LaserScan<'_>>::new(&channel("sensor_msgs/LaserScan")).unwrap();
    let mut maps = Decoder::<OccupancyGrid<'_>>::new(&channel("nav_msgs/OccupancyGrid")).unwrap();
    let mut tfs = Decoder::<TfMessage<'_>>::new(&channel("tf2_msgs/TFMessage")).unwrap();
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    let (mut last, mut transforms) = (Stamp(0), 0);
    let session = session();
    while let Some(message) = reader.next_message().unwrap() {
        assert!(message.log_stamp >= last, "messages are in the order of their stamps");
        last = message.log_stamp;
        *counts.entry(message.connection.topic.clone()).or_default() += 1;
        match &*message.connection.topic {
            "/scan" => {
                let scan = scans.decode(message.data).unwrap();
                assert_eq!((scan.header.frame(), scan.ranges.len()), ("front_laser", 5));
                assert_eq!((scan.ranges.get(0), scan.ranges.get(2)), (Some(1.0), Some(f32::INFINITY)));
                assert!(scan.ranges.get(1).unwrap().is_nan());
            }
            "/map" => assert_eq!(maps.decode(message.data).unwrap().data.to_vec(), [0, 100, -1, 40, 70, 5]),
            "/tf" => {
                let message = tfs.decode(message.data).unwrap();
                let [map_from_odom, odom_from_robot] =
                    [0, 1].map(|k: usize| planar(&message.transforms[k].transform.to_pose3().unwrap()));
                let stamp = message.transforms[0].header.stamp;
                let at_stamp = session.trajectory().filter(|scan| scan.stamp == stamp);
                let off_m = |scan: TrajectoryPose| (map_from_odom * odom_from_robot).distance(scan.map_from_robot);
                assert!(at_stamp.map(off_m).fold(f64::INFINITY, f64::min) < 1e-9);
                transforms += 1;
            }
            _ => {}
        }
    }
    assert_eq!(transforms, 40);
    let all =
        [("/closures", 1), ("/map", 1), ("/path", 1), ("/pose", 40), ("/scan", 20), ("/tf", 40), ("/tf_static", 1)];
    assert!(counts.iter().map(|(topic, count)| (topic.as_str(), *count)).eq(all), "{counts:?}");
}

#[test]
fn an_empty_session_is_a_file_too() {
    let (out, counts) =
        write_session_mcap(&Session::default(), &map(), |stamp| stamp, Cursor::new(Vec::new())).unwrap();
    assert_eq!(counts, SessionCounts::default());
    assert!(McapReader::open(out).unwrap().next_message().unwrap().is_some());
}

/// What the official readers say of a file; nothing where there are none.
fn seen_by_python(test: &str, mcap: &[u8]) -> Option<Value> {
    let python = std::env::var("MAPWRIGHT_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let works = Command::new(&python).args(["-c", "import rosbags, mcap, mcap_ros2, zstandard"]).output();
    if !works.is_ok_and(|output| output.status.success()) {
        let _ = writeln!(
            std::io::stderr(),
            "{test}: skipped: no Python with rosbags, mcap and mcap-ros2-support ({python})"
        );
        return None;
    }
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{test}.mcap"));
    std::fs::write(&path, mcap).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scripts/check_exports.py");
    let output = Command::new(&python).arg(script).arg(&path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(serde_json::from_slice(&output.stdout).unwrap())
}

#[test]
fn the_official_readers_see_the_same() {
    let Some(seen) = seen_by_python("the_official_readers_see_the_same", &written()) else { return };
    assert_eq!(seen["profile"], "ros2");
    assert!(seen["worst"].as_f64().unwrap() < 1e-9, "map -> odom -> base_link is the pose: {seen}");
    assert_eq!(seen["links"], serde_json::json!(["base_link->front_laser", "map->odom", "odom->base_link"]));
    assert_eq!(seen["map"], serde_json::json!([3, 2, 0.05]));
    assert_eq!((&seen["path"], &seen["ranges"], &seen["occupied"]), (&40.into(), &5.into(), &2.into()));
    assert_eq!(seen["markers"], serde_json::json!([["closures", 5, 4], ["keyframes", 8, 20]]));
    for (topic, count, latched) in [("/map", 1, true), ("/path", 1, true), ("/tf_static", 1, true), ("/tf", 40, false)]
    {
        let seen = &seen["topics"][topic];
        assert_eq!(
            (&seen["count"], &seen["latched"], &seen["encoding"]),
            (&count.into(), &latched.into(), &"cdr".into())
        );
    }
}

/// A spiral upwards, corrected against odometry.
fn space_session() -> Session<SpaceSweep> {
    let robot_from_sensor = Pose3::exp(nalgebra::Vector6::new(0.2, 0.0, 0.5, 0.1, 0.0, 0.3));
    let sensor = Arc::new(SpaceSensor { robot_from_sensor, ..SpaceSensor::lidar("top") });
    let along = |k: u32| {
        let k = f64::from(k);
        Pose3::exp(nalgebra::Vector6::new(0.1 * k, 0.05 * k, 0.02 * k, 0.01 * k, -0.02 * k, 0.15 * k))
    };
    let run = RunId::of_robot("a");
    let mut session = Session::default();
    session.add(Entry::Run(Run { id: run, settings: String::new() })).unwrap();
    for k in 0..SCANS {
        let stamp = Stamp(1_600_000_000_000_000_000 + 100_000_000 * i64::from(if k == 7 { 4 } else { k }));
        if k.is_multiple_of(2) {
            let sweep = Arc::new(SpaceSweep::new(&sensor, &[[1.0, 2.0, 0.5]], Vec::new()));
            let id = run.keyframe(k / 2);
            let keyframe = Arc::new(Keyframe { id, stamp, scan: u64::from(k), sweep, hardly_fits: false });
            session.add(Entry::Keyframe { keyframe, map_from_keyframe: along(k) }).unwrap();
        }
        let keyframe_from_robot = along(k - k % 2).between(along(k));
        let odom_from_robot = along(k) * along(k / 3);
        let scan = ScanPose { stamp, keyframe: Some(run.keyframe(k / 2)), keyframe_from_robot, odom_from_robot };
        session.add(Entry::Scan(scan)).unwrap();
    }
    let (from, to, kind) = (run.keyframe(1), run.keyframe(19), EdgeKind::Closure);
    let information = mapwright_geom::Cov6::identity();
    let edge = Edge { from, to, kind, from_from_to: Pose3::identity(), information };
    session.add(Entry::Edge(RecordedEdge { edge, candidate: None })).unwrap();
    session
}

const POINTS_M: [[f32; 3]; 3] = [[1.0, -2.0, 0.5], [0.0, 0.25, 8.0], [3.0, 4.0, 5.0]];
const COLOURS: [[u8; 3]; 3] = [[200, 100, 50], [1, 2, 3], [0, 0, 0]];

fn written_of_space(colours: &[[u8; 3]]) -> Vec<u8> {
    let points = SpacePoints { points_m: &POINTS_M, colours, intensities: &[] };
    let (out, counts) =
        write_space_session_mcap(&space_session(), points, |stamp| stamp, Cursor::new(Vec::new())).unwrap();
    assert_eq!(counts, SpaceSessionCounts { closures: 1, points: 3, poses: 40 });
    out.into_inner()
}

#[test]
fn what_is_written_of_space_reads_back() {
    let mut reader = McapReader::open(Cursor::new(written_of_space(&COLOURS))).unwrap();
    let channel = |name| Channel::new(name, Encoding::Cdr, None).unwrap();
    let mut maps = Decoder::<PointCloud2<'_>>::new(&channel("sensor_msgs/PointCloud2")).unwrap();
    let mut tfs = Decoder::<TfMessage<'_>>::new(&channel("tf2_msgs/TFMessage")).unwrap();
    let (session, mut transforms, mut points) = (space_session(), 0, 0);
    while let Some(message) = reader.next_message().unwrap() {
        if message.connection.topic == "/map" {
            let message = maps.decode(message.data).unwrap();
            let cloud = mapwright_ros::Cloud::new(&message).unwrap();
            points += cloud.len();
            assert_eq!(message.data.len(), 3 * 16);
            assert_eq!(message.data[..12], [1.0_f32, -2.0, 0.5].map(f32::to_le_bytes).concat()[..]);
            assert_eq!(message.data[12..16], [50, 100, 200, 0]);
        } else if message.connection.topic == "/tf" {
            let message = tfs.decode(message.data).unwrap();
            let [map_from_odom, odom_from_robot] =
                [0, 1].map(|k: usize| message.transforms[k].transform.to_pose3().unwrap());
            let stamp = message.transforms[0].header.stamp;
            let off = session
                .trajectory()
                .filter(|cloud| cloud.stamp == stamp)
                .map(|cloud| (map_from_odom * odom_from_robot).between(cloud.map_from_robot).log().norm());
            assert!(off.fold(f64::INFINITY, f64::min) < 1e-9);
            transforms += 1;
        }
    }
    assert_eq!((transforms, points), (40, 3));
    let empty =
        write_space_session_mcap(&Session::default(), SpacePoints::default(), |stamp| stamp, Cursor::new(Vec::new()))
            .unwrap();
    assert_eq!(empty.1, SpaceSessionCounts::default());
    let points = SpacePoints { points_m: &POINTS_M, colours: &COLOURS[..2], intensities: &[] };
    let refused =
        write_space_session_mcap(&space_session(), points, |stamp| stamp, Cursor::new(Vec::new())).unwrap_err();
    assert!(refused.to_string().contains("expected 3 colours or none, found 2"), "{refused}");
}

#[test]
fn the_official_readers_see_the_same_in_space() {
    let test = "the_official_readers_see_the_same_in_space";
    for colours in [COLOURS.as_slice(), &[]] {
        let Some(seen) = seen_by_python(test, &written_of_space(colours)) else { return };
        assert!(seen["worst_in_space"].as_f64().unwrap() < 1e-9, "map -> odom -> base_link is the pose: {seen}");
        assert_eq!(seen["links"], serde_json::json!(["base_link->top", "map->odom", "odom->base_link"]));
        assert_eq!(seen["points"], serde_json::json!([3, 1, "map"]));
        let mut first = serde_json::json!({"x": 1.0, "y": -2.0, "z": 0.5});
        if !colours.is_empty() {
            first["rgb"] = serde_json::json!([200, 100, 50]);
        }
        assert_eq!(seen["first_point"], first);
        assert_eq!(seen["path"], 40);
        assert_eq!(seen["markers"], serde_json::json!([["closures", 5, 2], ["keyframes", 8, 20]]));
        for (topic, count, latched) in
            [("/map", 1, true), ("/path", 1, true), ("/tf_static", 1, true), ("/tf", 40, false), ("/pose", 40, false)]
        {
            let seen = &seen["topics"][topic];
            assert_eq!((&seen["count"], &seen["latched"]), (&count.into(), &latched.into()), "{topic}");
        }
    }
}
