//! Closures and keyframes as markers.

use crate::error::ExportError;
use crate::frames::MAP;
use crate::recording::{Durability, Recording};
use mapwright_formats::run_colour;
use mapwright_geom::{Pose3, Stamp};
use mapwright_record::{EdgeKind, Measurement, RunId, Session};
use mapwright_ros::Encoding;
use mapwright_ros::messages::{ColorRgba, Header, Marker, MarkerAction, MarkerArray, MarkerShape, Point, Vector3};
use std::io::{Seek, Write};

/// Closures as lines: namespace, colour and width in metres.
const CLOSURES: (&str, ColorRgba, f64) = ("closures", ColorRgba { r: 0.1, g: 0.75, b: 0.3, a: 0.9 }, 0.05);
/// Keyframes as dots; of several runs those of each in its colour.
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
    // a marker without points is an error to RViz
    let mut markers = Vec::new();
    if !closures.is_empty() {
        markers.push(marker(stamp, CLOSURES, MarkerShape::LineList, lines));
    }
    let by_run = places_by_run(session);
    for (number, places) in by_run.iter().enumerate() {
        let look = if by_run.len() > 1 { (KEYFRAMES.0, run_rgba(number), KEYFRAMES.2) } else { KEYFRAMES };
        let dots = places.iter().map(|place| point(&poses[*place])).collect();
        markers.push(Marker { id: number as i32, ..marker(stamp, look, MarkerShape::Points, dots) });
    }
    let array = MarkerArray { markers };
    recording.write_bytes(topic, stamp, &array.encode(Encoding::Cdr)?)?;
    Ok(closures.len())
}

/// Places of each run's keyframes, of the runs that have any, in the order in which they come.
fn places_by_run<M: Measurement>(session: &Session<M>) -> Vec<Vec<usize>> {
    let (mut runs, mut places): (Vec<RunId>, Vec<Vec<usize>>) = (Vec::new(), Vec::new());
    for (place, keyframe) in session.keyframes().iter().enumerate() {
        let run = keyframe.id.run();
        let number = runs.iter().position(|known| *known == run).unwrap_or_else(|| {
            runs.push(run);
            places.push(Vec::new());
            runs.len() - 1
        });
        places[number].push(place);
    }
    places
}

fn run_rgba(number: usize) -> ColorRgba {
    let [r, g, b] = run_colour(number).map(|channel| f32::from(channel) / 255.0);
    ColorRgba { r, g, b, a: KEYFRAMES.1.a }
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
