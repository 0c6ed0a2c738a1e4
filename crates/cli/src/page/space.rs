//! Maps of space: a picture from above and from the side.

use super::drawn::{Drawn, drawn};
use super::figure::Figure;
use crate::failure::Failure;
use crate::maps::ways;
use crate::space::{MAP_SHARE, up};
use mapwright::{MapPoints, Pose3, SeparateMap, Session, Settings, SpaceMapper, SpaceSweep, points_of, points_of_map};
use mapwright_formats::{SpacePicture, write_bare_space_png};
use mapwright_geom::TangentMatrix;
use serde_json::Value;

/// Longest side of the picture, pixels: the first that takes no more bytes, or the last.
const SIDES_PX: [usize; 3] = [1100, 900, 700];
const PICTURE_BYTES: usize = 600_000;
/// The side of the smallest voxels where the report does not say, metres.
const RESOLUTION_M: f64 = 0.5;
/// What a page shows of a session.
pub(super) fn draw(session: &Session<SpaceSweep>, settings: Settings, report: &Value) -> Result<Drawn, Failure> {
    let resolution_m = report["resolution_m"].as_f64().filter(|side| *side > 0.0 && side.is_finite());
    let point_m = MAP_SHARE * resolution_m.unwrap_or(RESOLUTION_M);
    let way: Vec<Pose3> = session.trajectory().map(|pose| pose.map_from_robot).collect();
    let maps = session.maps();
    let map = points_of(session, point_m);
    let sensor = session.keyframes().first().map(|keyframe| &keyframe.sweep.sensor);
    let up = sensor.map_or([0.0, 0.0, 1.0], |sensor| up(sensor, &map, &way, point_m));
    let of_map =
        |(map, way): (&SeparateMap, &Vec<Pose3>)| figure(&points_of_map(session, map, point_m), way, up, point_m);
    let figures = maps.iter().zip(&ways(session, &maps).0).map(of_map).collect::<Result<Vec<_>, Failure>>()?;
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

fn figure(map: &MapPoints, way: &[Pose3], up: [f64; 3], point_m: f64) -> Result<Figure, Failure> {
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
    Ok(Figure {
        map: 0,
        words: "map.png: above the view from above, below it the one from the side; colours are heights, or what a camera saw"
            .to_owned(),
        png,
        size_px: placement.size_px,
        px_per_metre: placement.px_per_metre,
        views: placement.views.to_vec(),
        level_rad: None,
        is_coloured: true,
    })
}
