//! Closures and keyframes as markers.

use crate::error::ExportError;
use crate::frames::MAP;
use crate::recording::{Durability, Recording};
use mapwright_geom::{Pose3, Stamp};
use mapwright_record::{EdgeKind, Measurement, Session};
use mapwright_ros::Encoding;
use mapwright_ros::messages::{ColorRgba, Header, Marker, MarkerAction, MarkerArray, MarkerShape, Point, Vector3};
use std::io::{Seek, Write};

/// Closures as lines: namespace, colour and width in metres.
const CLOSURES: (&str, ColorRgba, f64) = ("closures", ColorRgba { r: 0.1, g: 0.75, b: 0.3, a: 0.9 }, 0.05);
/// Keyframes as dots.
const KEYFRAMES: (&str, ColorRgba, f64) = ("keyframes", ColorRgba { r: 0.2, g: 0.35, b: 0.85, a: 0.9 }, 0.08);

/// Writes `/closures`, the closures that stand and the keyframes; returns how many closures there are.
pub(crate) fn write_markers<W: Write + Seek, M: Measurement>(
    recording: &mut Recording<W>,
    session: &Session<M>,
    stamp: Stamp,
    point: impl Fn(&M::Pose) -> Point,
) -> Result<usize, ExportError> {
    let topic = recording.add("/closures", MarkerArray::TYPE, Durability::TransientLocal)?;
    let poses = session.map_from_keyframe();
    let closures = session.recorded_edges().iter().filter(|known| !known.withdrawn);
    let closures = closures.filter(|known| known.recorded.edge.kind == EdgeKind::Closure);
    let closures: Vec<[M::Pose; 2]> = closures.map(|known| known.ends.map(|end| poses[end as usize])).collect();
    let lines = closures.iter().flatten().map(&point).collect();
    let dots = poses.iter().map(&point).collect();
    // a marker without points is an error to RViz
    let markers = [(CLOSURES, MarkerShape::LineList, lines), (KEYFRAMES, MarkerShape::Points, dots)];
    let markers = markers.into_iter().filter(|(_, _, points): &(_, _, Vec<Point>)| !points.is_empty());
    let array =
        MarkerArray { markers: markers.map(|(look, shape, points)| marker(stamp, look, shape, points)).collect() };
    recording.write_bytes(topic, stamp, &array.encode(Encoding::Cdr)?)?;
    Ok(closures.len())
}

fn marker(
    stamp: Stamp,
    (ns, color, width_m): (&'static str, ColorRgba, f64),
    shape: MarkerShape,
    points: Vec<Point>,
) -> Marker<'static> {
    Marker {
        header: Header::new(stamp, MAP),
        ns: ns.into(),
        id: 0,
        shape,
        action: MarkerAction::Add,
        pose: Pose3::identity().into(),
        scale: Vector3 { x: width_m, y: width_m, z: 0.0 },
        color,
        frame_locked: false,
        points,
        colors: Vec::new(),
        text: "".into(),
    }
}
