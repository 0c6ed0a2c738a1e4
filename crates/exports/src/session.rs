//! A run's results as an MCAP file of ROS 2.

use crate::error::ExportError;
use crate::frames::{MAP, frame_of, in_space, scan_topic};
use crate::markers::write_markers;
use crate::messages::{course, laser_scan, mounts, pose_stamped};
use crate::recording::{Durability, Recording, Topic};
use mapwright_formats::{GridImage, UNKNOWN};
use mapwright_geom::{Pose2, Stamp};
use mapwright_record::{Session, TrajectoryPose};
use mapwright_ros::messages::{Header, MapMetaData, OccupancyGrid, Path, Point};
use mapwright_sensor::{BEAM_DROPPED, BEAM_NO_RETURN, LaserModel, Sweep};
use std::collections::BTreeMap;
use std::io::{Seek, Write};
use std::sync::Arc;

/// What was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SessionCounts {
    /// Lines between two keyframes.
    pub closures: usize,
    /// Sweeps of keyframes.
    pub scans: usize,
    /// Poses of the robot.
    pub poses: usize,
}

/// Writes a session and its map as an MCAP file of ROS 2 that Foxglove, RViz and `ros2 bag` open. `stamped` says what each
/// scan's stamp becomes, in the order of arrival; messages are in the order of these.
///
/// | topic | type | content |
/// |---|---|---|
/// | `/map` | `nav_msgs/OccupancyGrid` | the final map, at the first stamp; latched |
/// | `/path` | `nav_msgs/Path` | the final trajectory, every scan, at the first stamp; latched |
/// | `/closures` | `visualization_msgs/MarkerArray` | closures that stand as lines, keyframes as dots; latched |
/// | `/tf_static` | `tf2_msgs/TFMessage` | `base_link -> laser`, a frame for each laser by its name; latched |
/// | `/tf` | `tf2_msgs/TFMessage` | `map -> odom` (REP 105) and `odom -> base_link` at every scan |
/// | `/pose` | `geometry_msgs/PoseStamped` | the robot in the map at every scan |
/// | `/scan`, `/scan_NAME` | `sensor_msgs/LaserScan` | the keyframes' sweeps: dropped beams NaN, without return infinite |
///
/// # Errors
/// [`ExportError::Bag`] for stamps before 1970 or where the stream below fails; [`ExportError::Format`] for a map of
/// impossible shape.
pub fn write_session_mcap<W: Write + Seek>(
    session: &Session,
    map: &GridImage,
    mut stamped: impl FnMut(Stamp) -> Stamp,
    writer: W,
) -> Result<(W, SessionCounts), ExportError> {
    map.validate()?;
    let restamped = |pose: TrajectoryPose| TrajectoryPose { stamp: stamped(pose.stamp), ..pose };
    let mut scans: Vec<(usize, TrajectoryPose)> = session.trajectory().map(restamped).enumerate().collect();
    scans.sort_by_key(|(_, scan)| scan.stamp);
    let begin = scans.first().map_or(Stamp(0), |(_, scan)| scan.stamp);
    let mut recording = Recording::mcap(writer)?;
    write_map(&mut recording, map, begin)?;
    write_path(&mut recording, &scans, begin)?;
    let closures = write_markers(&mut recording, session, begin, |pose| Point { x: pose.x, y: pose.y, z: 0.0 })?;
    write_course(recording, session, &scans, begin, closures)
}

fn write_map<W: Write + Seek>(recording: &mut Recording<W>, map: &GridImage, stamp: Stamp) -> Result<(), ExportError> {
    let topic = recording.add("/map", "nav_msgs/OccupancyGrid", Durability::TransientLocal)?;
    let cells: Vec<i8> = map.cells.iter().map(|&cell| if cell == UNKNOWN { -1 } else { cell.min(100) as i8 }).collect();
    let info = MapMetaData {
        map_load_time: stamp,
        resolution: map.resolution_m as f32,
        width: map.width as u32,
        height: map.height as u32,
        origin: in_space(map.world_from_map).into(),
    };
    let message = OccupancyGrid { header: Header::new(stamp, MAP), info, data: cells[..].into() };
    recording.write(topic, stamp, &message)
}

fn write_path<W: Write + Seek>(
    recording: &mut Recording<W>,
    scans: &[(usize, TrajectoryPose)],
    begin: Stamp,
) -> Result<(), ExportError> {
    let topic = recording.add("/path", "nav_msgs/Path", Durability::TransientLocal)?;
    let poses = scans.iter().map(|(_, scan)| pose_stamped(scan.stamp, MAP, in_space(scan.map_from_robot))).collect();
    recording.write(topic, begin, &Path { header: Header::new(begin, MAP), poses })
}

/// Everything that happens on the way.
fn write_course<W: Write + Seek>(
    mut recording: Recording<W>,
    session: &Session,
    scans: &[(usize, TrajectoryPose)],
    begin: Stamp,
    closures: usize,
) -> Result<(W, SessionCounts), ExportError> {
    let lasers = lasers(session);
    let tf_static = recording.add("/tf_static", "tf2_msgs/TFMessage", Durability::TransientLocal)?;
    let mut shown = first_of_each_frame(&lasers);
    recording.write(tf_static, begin, &mounts(begin, shown.values().copied()))?;
    let tf = recording.add("/tf", "tf2_msgs/TFMessage", Durability::Volatile)?;
    let pose = recording.add("/pose", "geometry_msgs/PoseStamped", Durability::Volatile)?;
    let topics = scan_topics(&mut recording, &shown)?;
    let drawn = session.keyframes().iter().zip(session.drawn());
    let by_scan: BTreeMap<u64, &Arc<Sweep>> =
        drawn.filter_map(|(keyframe, sweep)| Some((keyframe.scan, sweep.as_ref()?))).collect();
    let mut counts = SessionCounts { closures, poses: scans.len(), scans: 0 };
    for (number, scan) in scans {
        recording.write(
            tf,
            scan.stamp,
            &course(scan.stamp, in_space(scan.map_from_robot), in_space(scan.odom_from_robot)),
        )?;
        recording.write(pose, scan.stamp, &pose_stamped(scan.stamp, MAP, in_space(scan.map_from_robot)))?;
        let Some(sweep) = by_scan.get(&(*number as u64)) else { continue };
        let frame = frame_of(&sweep.laser);
        let before = shown.insert(frame, &*sweep.laser);
        if before.is_some_and(|before| mount(before) != mount(&sweep.laser)) {
            recording.write(tf_static, scan.stamp, &mounts(scan.stamp, shown.values().copied()))?;
        }
        if let Some(topic) = topics.get(frame) {
            recording.write(*topic, scan.stamp, &laser_scan(scan.stamp, &sweep.laser, &ranges_m(sweep)))?;
            counts.scans += 1;
        }
    }
    Ok((recording.finish()?, counts))
}

/// The keyframes' lasers in the order in which they come.
fn lasers(session: &Session) -> Vec<&Arc<LaserModel>> {
    let mut lasers: Vec<&Arc<LaserModel>> = Vec::new();
    for keyframe in session.keyframes() {
        let laser = &keyframe.sweep.laser;
        if !lasers.iter().rev().any(|known| Arc::ptr_eq(known, laser)) {
            lasers.push(laser);
        }
    }
    lasers
}

/// By frame.
fn first_of_each_frame<'a>(lasers: &[&'a Arc<LaserModel>]) -> BTreeMap<&'a str, &'a LaserModel> {
    let mut shown = BTreeMap::new();
    for laser in lasers {
        shown.entry(frame_of(laser)).or_insert(&***laser);
    }
    shown
}

fn scan_topics<'a, W: Write + Seek>(
    recording: &mut Recording<W>,
    shown: &BTreeMap<&'a str, &'a LaserModel>,
) -> Result<BTreeMap<&'a str, Topic>, ExportError> {
    let mut topics = BTreeMap::new();
    for &frame in shown.keys() {
        let name = scan_topic(frame, topics.is_empty());
        topics.insert(frame, recording.add(&name, "sensor_msgs/LaserScan", Durability::Volatile)?);
    }
    Ok(topics)
}

fn mount(laser: &LaserModel) -> (Pose2, bool) {
    (laser.robot_from_laser, laser.inverted)
}

/// As REP 117 has them.
fn ranges_m(sweep: &Sweep) -> Vec<f32> {
    let range_m = |&code: &u16| match code {
        BEAM_DROPPED => f32::NAN,
        BEAM_NO_RETURN => f32::INFINITY,
        code => (f64::from(code) * sweep.step_m) as f32,
    };
    sweep.codes.iter().map(range_m).collect()
}
