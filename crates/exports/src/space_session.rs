//! A run's results in space as an MCAP file of ROS 2.

use crate::error::ExportError;
use crate::frames::{MAP, ROBOT, frame_of_space};
use crate::markers::write_markers;
use crate::messages::{course, pose_stamped, transform};
use crate::recording::{Durability, Recording};
use mapwright_geom::{Pose3, Stamp};
use mapwright_record::{Session, TrajectoryPose};
use mapwright_ros::messages::{Header, Path, Point, PointCloud2, PointField, TfMessage};
use mapwright_sensor::SpaceSweep;
use std::collections::BTreeMap;
use std::io::{Seek, Write};

/// `datatype` of a 32-bit float in `sensor_msgs/PointField`.
const FLOAT32: u8 = 7;
/// Bytes of `x y z`.
const POINT_BYTES: usize = 12;
/// Bytes of an intensity, and of a colour: the bits of a float, blue first, as RViz and PCL have them.
const COLUMN_BYTES: usize = 4;

/// Points of a map in its frame, metres, and what is known of each; what is not known of all is empty.
#[derive(Debug, Clone, Copy, Default)]
pub struct SpacePoints<'a> {
    /// Places.
    pub points_m: &'a [[f32; 3]],
    /// Red, green and blue.
    pub colours: &'a [[u8; 3]],
    /// How bright each is.
    pub intensities: &'a [f32],
}

/// What was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SpaceSessionCounts {
    /// Lines between two keyframes.
    pub closures: usize,
    /// Points of the map.
    pub points: usize,
    /// Poses of the robot.
    pub poses: usize,
}

/// Writes a session of space and its map as an MCAP file of ROS 2, as [`crate::write_session_mcap`] does in the plane. The map is
/// points in its frame, metres, with an intensity and a colour each where there are any.
///
/// | topic | type | content |
/// |---|---|---|
/// | `/map` | `sensor_msgs/PointCloud2` | the final map, `x y z`, `intensity` and `rgb`, at the first stamp; latched |
/// | `/path` | `nav_msgs/Path` | the final trajectory, every cloud, at the first stamp; latched |
/// | `/closures` | `visualization_msgs/MarkerArray` | closures that stand as lines, keyframes as dots; latched |
/// | `/tf_static` | `tf2_msgs/TFMessage` | `base_link -> sensor`, a frame for each sensor by its name; latched |
/// | `/tf` | `tf2_msgs/TFMessage` | `map -> odom` (REP 105) and `odom -> base_link` at every cloud |
/// | `/pose` | `geometry_msgs/PoseStamped` | the robot in the map at every cloud |
///
/// # Errors
/// [`ExportError::Bag`] for stamps before 1970 or where the stream below fails; [`ExportError::Points`] for a number of colours that is
/// neither that of the points nor none, and for more points than a message can hold.
pub fn write_space_session_mcap<W: Write + Seek>(
    session: &Session<SpaceSweep>,
    map: SpacePoints<'_>,
    mut stamped: impl FnMut(Stamp) -> Stamp,
    writer: W,
) -> Result<(W, SpaceSessionCounts), ExportError> {
    let restamped = |pose: TrajectoryPose<Pose3>| TrajectoryPose { stamp: stamped(pose.stamp), ..pose };
    let mut clouds: Vec<TrajectoryPose<Pose3>> = session.trajectory().map(restamped).collect();
    clouds.sort_by_key(|cloud| cloud.stamp);
    let begin = clouds.first().map_or(Stamp(0), |cloud| cloud.stamp);
    let points = map.points_m.len();
    let data = bytes_of(map)?;
    let map = message(&data, [!map.intensities.is_empty(), !map.colours.is_empty()], points, begin)?;
    let mut recording = Recording::mcap(writer)?;
    let topic = recording.add("/map", "sensor_msgs/PointCloud2", Durability::TransientLocal)?;
    recording.write(topic, begin, &map)?;
    let topic = recording.add("/path", "nav_msgs/Path", Durability::TransientLocal)?;
    let poses = clouds.iter().map(|cloud| pose_stamped(cloud.stamp, MAP, cloud.map_from_robot)).collect();
    recording.write(topic, begin, &Path { header: Header::new(begin, MAP), poses })?;
    let point = |pose: &Pose3| Point { x: pose.translation.x, y: pose.translation.y, z: pose.translation.z };
    let closures = write_markers(&mut recording, session, begin, point)?;
    let topic = recording.add("/tf_static", "tf2_msgs/TFMessage", Durability::TransientLocal)?;
    recording.write(topic, begin, &mounts(session, begin))?;
    write_course(&mut recording, &clouds)?;
    let counts = SpaceSessionCounts { closures, points, poses: clouds.len() };
    Ok((recording.finish()?, counts))
}

/// Points side by side, little endian.
fn bytes_of(map: SpacePoints<'_>) -> Result<Vec<u8>, ExportError> {
    let SpacePoints { points_m, colours, intensities } = map;
    for (found, what) in [(colours.len(), "colours"), (intensities.len(), "intensities")] {
        if found != 0 && found != points_m.len() {
            return Err(ExportError::Points(format!("expected {} {what} or none, found {found}", points_m.len())));
        }
    }
    let mut data = Vec::with_capacity(points_m.len() * (POINT_BYTES + 2 * COLUMN_BYTES));
    for (number, point) in points_m.iter().enumerate() {
        point.iter().for_each(|value| data.extend(value.to_le_bytes()));
        data.extend(intensities.get(number).into_iter().flat_map(|intensity| intensity.to_le_bytes()));
        if let Some([red, green, blue]) = colours.get(number) {
            data.extend([*blue, *green, *red, 0]);
        }
    }
    Ok(data)
}

fn message(
    data: &[u8],
    [has_intensities, is_coloured]: [bool; 2],
    points: usize,
    stamp: Stamp,
) -> Result<PointCloud2<'_>, ExportError> {
    let too_many =
        || ExportError::Points(format!("expected {} bytes of points at most, found {}", u32::MAX, data.len()));
    let row_step = u32::try_from(data.len()).map_err(|_| too_many())?;
    let more = [(has_intensities, "intensity"), (is_coloured, "rgb")];
    let more: Vec<&str> = more.into_iter().filter(|(is_there, _)| *is_there).map(|(_, name)| name).collect();
    let point_step = (POINT_BYTES + COLUMN_BYTES * more.len()) as u32;
    let names = ["x", "y", "z"].into_iter().chain(more);
    let field =
        |(offset, name): (u32, &'static str)| PointField { name: name.into(), offset, datatype: FLOAT32, count: 1 };
    Ok(PointCloud2 {
        header: Header::new(stamp, MAP),
        height: 1,
        width: points as u32,
        fields: (0..).step_by(4).zip(names).map(field).collect(),
        is_bigendian: false,
        point_step,
        row_step,
        data,
        is_dense: true,
    })
}

/// Where each sensor sits, the first of each name.
fn mounts(session: &Session<SpaceSweep>, stamp: Stamp) -> TfMessage<'_> {
    let mut sensors = BTreeMap::new();
    for keyframe in session.keyframes() {
        sensors.entry(frame_of_space(&keyframe.sweep.sensor)).or_insert(&keyframe.sweep.sensor);
    }
    let mount = |(frame, sensor): (_, &std::sync::Arc<mapwright_sensor::SpaceSensor>)| {
        transform(stamp, ROBOT, frame, sensor.robot_from_sensor)
    };
    TfMessage { transforms: sensors.into_iter().map(mount).collect() }
}

fn write_course<W: Write + Seek>(
    recording: &mut Recording<W>,
    clouds: &[TrajectoryPose<Pose3>],
) -> Result<(), ExportError> {
    let tf = recording.add("/tf", "tf2_msgs/TFMessage", Durability::Volatile)?;
    let pose = recording.add("/pose", "geometry_msgs/PoseStamped", Durability::Volatile)?;
    for &TrajectoryPose { stamp, map_from_robot, odom_from_robot } in clouds {
        recording.write(tf, stamp, &course(stamp, map_from_robot, odom_from_robot))?;
        recording.write(pose, stamp, &pose_stamped(stamp, MAP, map_from_robot))?;
    }
    Ok(())
}
