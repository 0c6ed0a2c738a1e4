//! Maps of the plane: a grey picture of at most so many pixels, a whole number of cells each.

use super::drawn::{Drawn, MAPS_SHOWN, drawn};
use super::figure::Figure;
use crate::drawing::draw_map;
use crate::failure::Failure;
use crate::image::{map_image, without_outliers};
use crate::maps::{map_file, ways};
use mapwright::{Advice, Pose2, SeparateMap, Session, Settings, Sweep};
use mapwright_formats::{FormatError, GridImage, UNKNOWN, ViewPlacement, write_plain_png};
use mapwright_sensor::{BeamTable, SweepPoints};
use serde_json::Value;

/// Longest side of the picture of the first map and of the others, pixels.
const FIRST_SIDE_PX: usize = 1800;
const OTHER_SIDE_PX: usize = 700;
/// From this probability on a cell is occupied, percent, as maps are written.
const OCCUPIED_FROM: u8 = 65;

/// What a page shows of a session.
pub(super) fn draw(session: &Session, settings: &Settings, report: &Value) -> Result<Drawn, Failure> {
    let maps = session.maps();
    let (ways, _) = ways(session, &maps);
    let shown = maps.iter().zip(&ways).take(MAPS_SHOWN).enumerate();
    let figures: Result<Vec<Figure>, FormatError> =
        shown.map(|(number, (map, way))| figure(session, settings, (number, map), way)).collect();
    let figures = figures.map_err(|cause| Failure::write("report.html", cause))?;
    let (mut table, mut points) = (BeamTable::default(), SweepPoints::default());
    let hits = |sweep: &Sweep| {
        points.fill(sweep, &mut table, 0.0);
        points.hits.iter().map(|&[x, y]| [x, y, 0.0]).collect()
    };
    let mut drawn = drawn(session, report, &maps, figures, [0.0, 0.0, 1.0], hits);
    for map in &maps {
        let advice = Advice::of_map(session, map);
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
    (number, map): (usize, &SeparateMap),
    way: &[Pose2],
) -> Result<Figure, FormatError> {
    let whole = map_image(&draw_map(settings, session, map), settings.map.passes_per_hit).image;
    let shown = without_outliers(&whole, way);
    let side_px = if number == 0 { FIRST_SIDE_PX } else { OTHER_SIDE_PX };
    let image = reduced(&shown, shown.width.max(shown.height).div_ceil(side_px));
    let mut png = Vec::new();
    write_plain_png(&image, &mut png)?;
    let px_per_metre = 1.0 / image.resolution_m;
    let Pose2 { x, y, .. } = image.world_from_map;
    let above = ViewPlacement {
        px_from_map: [[px_per_metre, 0.0, 0.0], [0.0, -px_per_metre, 0.0]],
        offset_px: [-x * px_per_metre, image.height as f64 + y * px_per_metre],
    };
    let [width_m, height_m] = [shown.width, shown.height].map(|cells| cells as f64 * shown.resolution_m);
    Ok(Figure {
        map: number,
        words: format!("{}: {width_m:.0} by {height_m:.0} m, {} m a cell", map_file(number, "png"), shown.resolution_m),
        png,
        size_px: [image.width, image.height],
        px_per_metre,
        views: vec![above],
        is_coloured: false,
    })
}

/// The map with squares of so many cells a side as one, that of the lower left corner whole.
fn reduced(map: &GridImage, side: usize) -> GridImage {
    if side <= 1 {
        return map.clone();
    }
    let [width, height] = [map.width, map.height].map(|cells| cells.div_ceil(side));
    let mut cells = Vec::with_capacity(width * height);
    for v in 0..height {
        for u in 0..width {
            let rows = (v * side..map.height.min((v + 1) * side)).map(|v| &map.cells[v * map.width..][..map.width]);
            cells.push(together(rows.flat_map(|row| &row[u * side..map.width.min((u + 1) * side)])));
        }
    }
    GridImage { width, height, resolution_m: map.resolution_m * side as f64, cells, ..*map }
}

/// One cell of several: occupied where one of them is, so that thin walls survive; otherwise the mean of those that are known.
fn together<'a>(cells: impl Iterator<Item = &'a u8>) -> u8 {
    let (mut sum, mut known, mut most) = (0_u64, 0_u64, 0);
    for &cell in cells.filter(|cell| **cell <= 100) {
        (sum, known, most) = (sum + u64::from(cell), known + 1, most.max(cell));
    }
    match sum.checked_div(known) {
        None => UNKNOWN,
        Some(_) if most >= OCCUPIED_FROM => most,
        Some(mean) => mean as u8,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thin_walls_survive_and_what_is_unseen_stays_so() {
        let mut cells = vec![UNKNOWN; 35];
        cells[7] = 100;
        (cells[0], cells[1]) = (10, 30);
        cells[4] = 20;
        let map =
            GridImage { width: 7, height: 5, resolution_m: 0.1, world_from_map: Pose2::new(1.0, 2.0, 0.0), cells };
        let small = reduced(&map, 3);
        assert_eq!((small.width, small.height), (3, 2));
        assert_eq!(small.cells, [100, 20, UNKNOWN, UNKNOWN, UNKNOWN, UNKNOWN]);
        assert!((small.resolution_m - 0.3).abs() < 1e-12 && small.world_from_map == map.world_from_map);
        assert_eq!(reduced(&map, 1), map);
        assert_eq!(together([0, 3].iter()), 1);
    }
}
