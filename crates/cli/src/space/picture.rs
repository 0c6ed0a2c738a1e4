//! Pictures of maps of space.

use crate::failure::Failure;
use crate::output::OutputFolder;
use crate::pose_graph::standing;
use mapwright::{EdgeKind, MapPoints, Pose3, SeparateMap, Session, SpaceSensor, SpaceSweep};
use mapwright_formats::{SpacePicture, upward, write_space_png};
use nalgebra::Vector3;

/// What a picture shows of a session: one of its maps, and the way of the robot within it.
pub(super) struct Shown<'a> {
    pub(super) map: &'a SeparateMap,
    pub(super) way: &'a [Pose3],
    pub(super) points: &'a MapPoints,
    pub(super) point_m: f64,
}

/// Writes a map with the way and the closures.
pub(super) fn write(
    output: &mut OutputFolder,
    name: &str,
    (sensor, session): (&SpaceSensor, &Session<SpaceSweep>),
    shown: &Shown<'_>,
    side_px: Option<u16>,
) -> Result<(), Failure> {
    let Shown { map, way, points: MapPoints { points_m, colours, .. }, point_m } = *shown;
    let way_m: Vec<[f64; 3]> = way.iter().map(|pose| pose.translation.into()).collect();
    let poses = session.map_from_keyframe();
    let closures =
        standing(session).filter(|(ends, edge)| edge.kind == EdgeKind::Closure && ends.iter().all(|&end| map.has(end)));
    let closures_m: Vec<_> = closures.map(|(ends, _)| ends.map(|end| poses[end].translation.into())).collect();
    let picture = SpacePicture {
        points_m,
        colours,
        way_m: &way_m,
        closures_m: &closures_m,
        up: up(sensor, shown.points, way, point_m),
        point_m,
        side_px: side_px.map_or(SpacePicture::default().side_px, usize::from),
    };
    output.write(name.to_owned(), |writer| write_space_png(&picture, writer))
}

/// Up as the floor says, near to where it should be: for a depth camera, whose frame has z ahead, x to the right and y down, near to
/// where it was up on average; for a lidar, which may have been held askew, near to z.
pub(crate) fn up(sensor: &SpaceSensor, map: &MapPoints, way: &[Pose3], point_m: f64) -> [f64; 3] {
    // Only depth from disparity grows worse with the square of the distance.
    let is_camera = sensor.range_sigma_per_m > 0.0 && sensor.robot_from_sensor.rotation.angle() < 1e-6;
    let up_of_robot = if is_camera { -Vector3::y() } else { Vector3::z() };
    let guess: Vector3<f64> = way.iter().map(|pose| pose.rotation * up_of_robot).sum();
    upward(&map.points_m, guess.into(), if is_camera { 45.0 } else { 15.0 }, point_m.max(0.01))
}
