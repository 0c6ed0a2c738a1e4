//! Maps of space: a picture from above and from the side.

use super::drawn::{Drawn, MAPS_SHOWN, drawn};
use super::figure::{Figure, FigureView};
use super::turning::{Shown, Turning};
use crate::failure::Failure;
use crate::maps::ways;
use crate::pose_graph::standing;
use crate::space::{MAP_SHARE, up};
use mapwright::{
    EdgeKind, MapPoints, Pose3, SeparateMap, Session, Settings, SpaceMapper, SpaceSweep, points_of, points_of_map,
};
use mapwright_formats::{SpacePicture, SpacePlacement, SpaceView, write_bare_space_png};
use mapwright_geom::TangentMatrix;
use serde_json::Value;

/// Longest side of the picture, pixels: the first that takes no more bytes, or the last.
const SIDES_PX: [usize; 3] = [1100, 900, 700];
const PICTURE_BYTES: usize = 600_000;
/// The side of the smallest voxels where the report does not say, metres.
const RESOLUTION_M: f64 = 0.5;
/// What a page shows of a session. What can be turned of all maps together takes so many bytes of points at most.
pub(super) fn draw(
    session: &Session<SpaceSweep>,
    settings: Settings,
    report: &Value,
    turning_bytes: usize,
) -> Result<Drawn, Failure> {
    let resolution_m = report["resolution_m"].as_f64().filter(|side| *side > 0.0 && side.is_finite());
    let point_m = MAP_SHARE * resolution_m.unwrap_or(RESOLUTION_M);
    let way: Vec<Pose3> = session.trajectory().map(|pose| pose.map_from_robot).collect();
    let maps = session.maps();
    let map = points_of(session, point_m);
    let sensor = session.keyframes().first().map(|keyframe| &keyframe.sweep.sensor);
    let up = sensor.map_or([0.0, 0.0, 1.0], |sensor| up(sensor, &map, &way, point_m));
    let shown = maps.len().min(MAPS_SHOWN);
    let of_map = |(number, (map, way)): (usize, (&SeparateMap, &Vec<Pose3>))| {
        let points = points_of_map(session, map, point_m);
        let (figure, placement) = figure(&points, way, up, point_m)?;
        let closures = closures_of(session, map);
        let of = Shown { points: &points, way, closures: &closures, placement: &placement, point_m };
        let turning = Some(Turning::of(&of, turning_bytes / shown.max(1)));
        Ok(Figure { map: number, turning, ..figure })
    };
    let ways = ways(session, &maps).0;
    let figures = maps.iter().zip(&ways).take(shown).enumerate().map(of_map).collect::<Result<Vec<_>, Failure>>()?;
    let points = |sweep: &SpaceSweep| sweep.points_m().map(|point| point.map(f64::from)).collect();
    let mut drawn = drawn(session, report, &maps, figures, up, points);
    if !drawn.keyframes.is_empty() {
        for (id, covariance) in SpaceMapper::resume(settings, session.clone())?.certainty() {
            let known = session.place(id).and_then(|place| drawn.keyframes.get_mut(place));
            let sigma_m = covariance.position_variance_m2().sqrt();
            known
                .into_iter()
                .for_each(|keyframe| keyframe.sigma_m = Some(sigma_m).filter(|sigma_m| sigma_m.is_finite()));
        }
    }
    Ok(drawn)
}

fn figure(map: &MapPoints, way: &[Pose3], up: [f64; 3], point_m: f64) -> Result<(Figure, SpacePlacement), Failure> {
    let way_m: Vec<[f64; 3]> = way.iter().map(|pose| pose.translation.into()).collect();
    let picture = |side_px| SpacePicture {
        points_m: &map.points_m,
        colours: &map.colours,
        way_m: &way_m,
        up,
        point_m,
        side_px,
        ..SpacePicture::default()
    };
    let drawn = |side_px| {
        let mut png = Vec::new();
        let placement = write_bare_space_png(&picture(side_px), &mut png);
        placement.map(|placement| (placement, png)).map_err(|cause| Failure::write("report.html", cause))
    };
    let (mut placement, mut png) = drawn(SIDES_PX[0])?;
    for &side_px in &SIDES_PX[1..] {
        if png.len() > PICTURE_BYTES {
            (placement, png) = drawn(side_px)?;
        }
    }
    let is_of_storeys = placement.views.len() > 2;
    let view = |view: &SpaceView| FigureView {
        placement: view.placement,
        storey: is_of_storeys.then_some((placement.axes[2], view.heights_m)),
    };
    let figure = Figure {
        map: 0,
        words: words(&placement, map.colours.is_empty()),
        png,
        size_px: placement.size_px,
        px_per_metre: placement.px_per_metre,
        views: placement.views.iter().map(view).collect(),
        level_rad: None,
        is_coloured: true,
        turning: None,
    };
    Ok((figure, placement))
}

/// What the picture shows.
fn words(placement: &SpacePlacement, are_heights: bool) -> String {
    let above = match placement.views.len().saturating_sub(1) {
        1 => "Above the view from above".to_owned(),
        storeys => format!("Above the views from above of {storeys} storeys, the lowest first"),
    };
    let [low_m, high_m] = placement.heights_m;
    let colours = if are_heights {
        format!("colours are heights, from {low_m:.1} m (light) to {high_m:.1} m (dark)")
    } else {
        "colours are what a camera saw".to_owned()
    };
    let outside = 100.0 * placement.outside_share;
    let outside = if outside >= 0.05 { format!("; {outside:.1} % of the points lie outside") } else { String::new() };
    format!("{above}, below it the one from the side; {colours}{outside}.")
}

/// Both ends of each closure of a map that stands, metres.
fn closures_of(session: &Session<SpaceSweep>, map: &SeparateMap) -> Vec<[[f64; 3]; 2]> {
    let poses = session.map_from_keyframe();
    let closures = standing(session).filter(|(_, edge)| edge.kind == EdgeKind::Closure);
    let of_map = closures.filter(|(ends, _)| ends.iter().all(|&end| map.has(end)));
    of_map.map(|(ends, _)| ends.map(|end| poses[end].translation.into())).collect()
}
