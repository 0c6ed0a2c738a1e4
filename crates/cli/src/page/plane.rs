//! Maps of the plane: a grey picture of at most so many pixels, turned as `map.png` is.

use super::drawn::{Drawn, MAPS_SHOWN, NextPlace, drawn};
use super::figure::{Figure, FigureView};
use crate::advice::words_of;
use crate::drawing::draw_map;
use crate::failure::Failure;
use crate::image::map_image;
use crate::maps::{map_file, ways};
use crate::picture::{MapOfRuns, RunNames};
use mapwright::{Advice, Pose2, SeparateMap, Session, Settings, Sweep};
use mapwright_formats::{FormatError, Frame, Picture, Runs, write_bare_png};
use mapwright_sensor::{BeamTable, SweepPoints};
use serde_json::Value;

/// Longest side of the picture of the first map and of the others, at least where a whole number of pixels a cell gives it, and at most; pixels.
const FIRST_SIDE_PX: [usize; 2] = [800, 1800];
const OTHER_SIDE_PX: [usize; 2] = [400, 700];

/// What a page shows of a session. Maps are turned until the direction that is given is level, or as the run has turned them.
pub(super) fn draw(
    session: &Session,
    settings: &Settings,
    report: &Value,
    level_rad: Option<f64>,
) -> Result<Drawn, Failure> {
    let maps = session.maps();
    let (ways, _) = ways(session, &maps);
    let shown = maps.iter().zip(&ways).take(MAPS_SHOWN).enumerate();
    let figures: Result<Vec<Figure>, FormatError> = shown
        .map(|(number, (map, way))| {
            let turned_rad = match number {
                0 => report["map"]["wall_angle_rad"].as_f64(),
                number => report["further_maps"][number - 1]["wall_angle_rad"].as_f64(),
            };
            let runs = MapOfRuns::of(session, map, &RunNames::default());
            let way = if runs.is_some() { &[][..] } else { &way[..] };
            figure(session, settings, (number, map, way, runs.as_ref()), level_rad.or(turned_rad).unwrap_or(0.0))
        })
        .collect();
    let figures = figures.map_err(|cause| Failure::write("report.html", cause))?;
    let (mut table, mut points) = (BeamTable::default(), SweepPoints::default());
    let hits = |sweep: &Sweep| {
        points.fill(sweep, &mut table, 0.0);
        points.hits.iter().map(|&[x, y]| [x, y, 0.0]).collect()
    };
    let mut drawn = drawn(session, report, &maps, figures, [0.0, 0.0, 1.0], hits);
    for (number, map) in maps.iter().enumerate() {
        let advice = Advice::of_map(session, map);
        drawn.next.extend(advice.places.iter().map(|place| NextPlace {
            map: number,
            place: [place.at[0], place.at[1], 0.0],
            words: words_of(&advice, place),
        }));
        for (place, sigma_m) in map.places().zip(advice.keyframe_sigmas_m) {
            if let Some(keyframe) = drawn.keyframes.get_mut(place) {
                keyframe.sigma_m = Some(sigma_m).filter(|sigma_m| sigma_m.is_finite());
            }
        }
    }
    Ok(drawn)
}

fn figure(
    session: &Session,
    settings: &Settings,
    (number, map, way, runs): (usize, &SeparateMap, &[Pose2], Option<&MapOfRuns>),
    level_rad: f64,
) -> Result<Figure, FormatError> {
    let drawn = map_image(&draw_map(settings, session, map), settings.map.passes_per_hit);
    let [min_side_px, max_side_px] = if number == 0 { FIRST_SIDE_PX } else { OTHER_SIDE_PX };
    let picture = Picture {
        world_from_robot: way,
        runs: runs.map(|runs| Runs { ways: &runs.ways, meetings: &runs.meetings }),
        level_rad,
        seen: Some(&drawn.seen),
        scale_bar: false,
        min_side_px,
        max_side_px,
        ..Picture::default()
    };
    let frame = Frame::of(&drawn.image, &picture);
    let picture = Picture { frame: Some(frame), ..picture };
    let mut png = Vec::new();
    let placement = write_bare_png(&drawn.image, &picture, &mut png)?;
    let [width_m, height_m] = frame.sides_m();
    let cell_m = drawn.image.resolution_m;
    let turned = match level_rad.to_degrees() {
        0.0 => String::new(),
        degrees => {
            format!(", turned {:.1}° {}", degrees.abs(), if degrees < 0.0 { "anticlockwise" } else { "clockwise" })
        }
    };
    Ok(Figure {
        map: number,
        words: format!("{}: {width_m:.0} by {height_m:.0} m, {cell_m} m a cell{turned}", map_file(number, "png")),
        png,
        size_px: placement.size_px,
        px_per_metre: placement.px_per_metre,
        views: vec![FigureView::whole(placement.view)],
        level_rad: Some(level_rad),
        is_coloured: false,
        turning: None,
    })
}
